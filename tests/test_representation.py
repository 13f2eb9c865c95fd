"""Representations: one list of contract checks for all, then HumanML3D's golden numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.representation.canonical import canonicalize, gaussian_smooth, heading, turn
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SMPL_FEATURES

ALL = [HUMANML3D_FEATURES, KIT_FEATURES, SMPL_FEATURES]
REPRESENTATIONS = pytest.mark.parametrize("representation", ALL, ids=lambda r: r.name)
WITH_CONTACTS = pytest.mark.parametrize(
    "representation", [r for r in ALL if "contacts" in r.blocks], ids=lambda r: r.name
)


def waves(random, frames, count):
    """Smooth curves of about unit size."""
    time = np.arange(frames)[:, None] / frames
    phase, speed = random.uniform(0, 6, (2, count))
    return np.sin(phase + 2 * speed * time)


def moving_body(representation, frames=60, seed=0, turning=0.05):
    """Someone waving all limbs while walking in a curve; bones keep their lengths."""
    random, skeleton = np.random.default_rng(seed), representation.skeleton
    vectors = 0.4 * waves(random, frames, 3 * len(skeleton)).reshape(frames, -1, 3)
    vectors[:, 0] = [0, 1, 0] * (1 + turning * np.arange(frames)[:, None])
    root = waves(random, frames, 3) * [2, 0.05, 2] + [0, 1, 0]
    return skeleton.forward_kinematics(matrix_from_axis_angle(vectors), root)


def still_body(representation, frames=5):
    return np.repeat(representation.skeleton.rest_joints()[None], frames, axis=0)


def mirrored(joints, skeleton):
    return joints[:, list(skeleton.mirror)] * [-1, 1, 1]


# Contract: what every implementation is checked for.


@REPRESENTATIONS
def test_is_a_representation_whose_blocks_cover_the_width_once(representation):
    assert isinstance(representation, Representation)
    stops = [block.stop for block in representation.blocks.values()]
    assert [block.start for block in representation.blocks.values()] == [0, *stops[:-1]]
    assert stops[-1] == representation.width
    assert representation.encode(still_body(representation)).shape == (4, representation.width)


@REPRESENTATIONS
@pytest.mark.parametrize("turning", [0.0, 0.05, -0.3])
def test_decoding_undoes_encoding_up_to_the_start(representation, turning):
    joints = moving_body(representation, frames=120, turning=turning)
    decoded = representation.decode(representation.encode(joints))
    expected = canonicalize(joints[:-1], representation.skeleton)
    found = canonicalize(decoded, representation.skeleton)
    np.testing.assert_allclose(found, expected, atol=1e-4)


@REPRESENTATIONS
@settings(max_examples=10)
@given(st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5))
def test_place_and_direction_on_the_floor_change_nothing(representation, angle, x, z):
    joints = moving_body(representation)
    moved = turn(joints, np.array(angle)) + np.array([x, 0, z])
    expected = representation.encode(joints)
    np.testing.assert_allclose(representation.encode(moved), expected, atol=1e-5)


@REPRESENTATIONS
def test_a_part_that_is_restarted_is_a_clip_of_its_own(representation):
    features = representation.encode(moving_body(representation))
    part = representation.restart(features[20:])
    found = canonicalize(representation.decode(part), representation.skeleton)
    expected = canonicalize(representation.decode(features)[20:], representation.skeleton)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(representation.decode(part)[0, 0, [0, 2]], 0, atol=1e-7)
    np.testing.assert_array_equal(representation.restart(part), part)


@WITH_CONTACTS
def test_still_feet_have_contact_and_moving_ones_have_not(representation):
    contacts = representation.blocks["contacts"]
    still = still_body(representation)
    assert (representation.encode(still)[:, contacts] == 1).all()
    still[:, list(representation.skeleton.left_foot)] += np.arange(5.0)[:, None, None]
    assert (representation.encode(still)[:, contacts] == [0, 0, 1, 1]).all()


@REPRESENTATIONS
def test_mirroring_is_that_of_the_joints_and_its_own_inverse(representation):
    joints = moving_body(representation)
    features = representation.encode(joints)
    mirror = representation.mirror(features)
    np.testing.assert_array_equal(representation.mirror(mirror), features)
    expected = representation.encode(mirrored(joints, representation.skeleton))
    np.testing.assert_allclose(mirror, expected, atol=1e-5)
    path = representation.decode(features)
    path_of_mirror = representation.decode(mirror)
    np.testing.assert_allclose(path_of_mirror, mirrored(path, representation.skeleton), atol=1e-5)


@REPRESENTATIONS
def test_both_libraries_and_batches_agree(representation):
    torch = pytest.importorskip("torch")
    clips = np.stack([moving_body(representation, seed=seed) for seed in range(2)])
    features = np.stack([representation.encode(clip) for clip in clips])
    theirs = torch.from_numpy(features)
    encoded = representation.encode(torch.from_numpy(clips[0]))
    np.testing.assert_allclose(encoded.numpy(), features[0], atol=1e-6)
    for function in (representation.decode, representation.mirror, representation.restart):
        ours = function(features)
        assert ours.dtype == np.float32
        np.testing.assert_allclose(function(theirs).numpy(), ours, atol=1e-5)
        np.testing.assert_allclose(function(features[1]), ours[1], atol=1e-6)


def test_decoding_has_the_right_slope():
    torch = pytest.importorskip("torch")
    features = torch.from_numpy(HUMANML3D_FEATURES.encode(moving_body(HUMANML3D_FEATURES, 4)))
    used = features[:, :67].double().requires_grad_()
    rest = features[:, 67:].double()

    def decode(used):
        return HUMANML3D_FEATURES.decode(torch.cat([used, rest], dim=-1))

    assert torch.autograd.gradcheck(decode, used)


# HumanML3D in particular.


def test_closed_forms():
    speed, turning = 0.03, 0.02
    time = np.arange(301)
    joints = still_body(HUMANML3D_FEATURES, 301)
    walking = HUMANML3D_FEATURES.encode(joints + time[:, None, None] * [0, 0, speed])
    np.testing.assert_allclose(walking[:, :3], np.tile([0, 0, speed], (300, 1)), atol=1e-6)
    np.testing.assert_allclose(walking[:, 193:259].reshape(300, 22, 3)[..., 2], speed, atol=1e-6)
    np.testing.assert_allclose(walking[:, 3], -joints[0, :, 1].min(), atol=1e-6)
    spinning = HUMANML3D_FEATURES.encode(turn(joints, turning * time[:, None]))
    np.testing.assert_allclose(spinning[100:200, 0], -turning / 2, atol=1e-6)
    np.testing.assert_allclose(heading(joints[0], HUMANML3D_FEATURES.skeleton), 0, atol=1e-12)


def test_smoothing_is_scipys():
    ndimage = pytest.importorskip("scipy.ndimage")
    signal = np.random.default_rng(0).standard_normal((50, 2))
    for sigma in (2.0, 20.0):
        expected = ndimage.gaussian_filter1d(signal, sigma, axis=0, mode="nearest")
        np.testing.assert_allclose(gaussian_smooth(signal, sigma), expected, atol=1e-12)


@pytest.mark.parametrize("noise", [0.0, 1e-15])
def test_a_bone_that_the_source_lacks_goes_straight_on(noise: float) -> None:
    """Two joints in one place, but for rounding, as spine3 is in some BVH of CMU."""
    generator = np.random.default_rng(0)
    joints = HUMANML3D_FEATURES.skeleton.rest_joints()[None].repeat(30, 0)
    joints[:, [9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21]] -= [0, 0.0574, 0]
    joints[:, 9] += noise * generator.normal(size=(30, 3))
    found = HUMANML3D_FEATURES.retarget(joints)
    np.testing.assert_allclose(found[:, 9] - found[:, 6], [[0, 0.0574, 0]] * 30, atol=1e-9)


@REPRESENTATIONS
def test_retargeting_changes_lengths_and_keeps_directions(representation):
    skeleton = representation.skeleton
    joints = 1.3 * moving_body(representation)
    found = representation.retarget(joints)
    np.testing.assert_allclose(found, joints / 1.3, atol=1e-9)
    joints[:, 4] = joints[:, skeleton.parents[4]]
    assert np.isfinite(representation.retarget(joints)).all()


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (np.zeros((5, 21, 3)), "21 joints; humanml3d describes 22"),
        (np.zeros((1, 22, 3)), "1 frames"),
        (np.full((5, 22, 3), np.nan), "not finite"),
    ],
)
def test_joints_that_do_not_fit_are_refused(joints, message):
    with pytest.raises(InputError, match=message):
        HUMANML3D_FEATURES.encode(joints)


# Golden numbers of the authors' code.


@pytest.fixture(scope="module")
def golden(shared):
    return np.load(shared / "reference/features.npz")


GOLDEN = pytest.mark.parametrize(
    ("representation", "name"), [(HUMANML3D_FEATURES, "t2m"), (KIT_FEATURES, "kit")]
)


@GOLDEN
def test_golden_recovery(golden, representation, name):
    torch = pytest.importorskip("torch")
    features, joints = golden[f"recover_{name}_features"], golden[f"recover_{name}_joints"]
    np.testing.assert_allclose(representation.decode(features), joints, atol=1e-5)
    theirs = representation.decode(torch.from_numpy(features)).numpy()
    np.testing.assert_allclose(theirs, joints, atol=1e-5)
    recovered = representation.decode(golden[f"process_{name}_features"])
    np.testing.assert_allclose(recovered, golden[f"process_{name}_recovered"], atol=1e-5)


@GOLDEN
def test_golden_encoding(golden, representation, name):
    skeleton = replace(representation.skeleton, offsets=golden[f"process_{name}_tgt_offsets"])
    representation = replace(representation, skeleton=skeleton)
    assert representation.still == golden[f"process_{name}_foot_threshold"].astype("f8").round(6)
    uniform = representation.retarget(golden[f"process_{name}_joints"])
    np.testing.assert_allclose(uniform, golden[f"process_{name}_uniform"], atol=1e-5)
    error = abs(representation.encode(uniform) - golden[f"process_{name}_features"])
    assert error.mean() < 1e-5
    # The golden yaw velocity has the wrong sign in one frame, where the heading crosses -z.
    assert error.max() < 0.02
    assert np.delete(error, 0, axis=1).max() < 1e-3


def test_published_sample(shared):
    folder = shared / "reference/humanml3d_sample"
    joints = np.load(folder / "012314_joints.npy")
    features = np.load(folder / "012314_features.npy")
    np.testing.assert_allclose(HUMANML3D_FEATURES.decode(features), joints, atol=1e-5)
    # Canonical lengths are given to a tenth of a millimeter.
    np.testing.assert_allclose(HUMANML3D_FEATURES.retarget(joints), joints, atol=2e-4)
    error = abs(HUMANML3D_FEATURES.encode(joints) - features[:-1])
    assert error.mean() < 1e-3
    assert error.max() < 0.02
