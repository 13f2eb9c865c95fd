"""Fit: derivatives against finite differences, motions found again, parts of the body."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.control.edit import PARTS, generate_edited, parts_named, with_parts
from latentmotion.control.fit_keypoints import (
    Capture,
    Observation,
    body_scale,
    fit_motion,
    unlikeliness,
    white_noise,
)
from latentmotion.errors import InputError
from latentmotion.kinematics.keypoints import LAYOUTS, Keypoints, joint_weights
from latentmotion.kinematics.skeleton import HUMANML3D, KIT
from latentmotion.representation.canonical import turn
from tests.support.walker import walker

NAMES = HUMANML3D.names


@pytest.fixture(scope="module")
def generate() -> MotionPipeline:
    return MotionPipeline.from_pretrained("fast", "onnxruntime", 1)


@pytest.fixture(scope="module")
def walk(generate: MotionPipeline) -> np.ndarray:
    joints = generate("a person walks forward", 2.0, 0, takes=1, clean_up=None).joints.astype(float)
    return turn(joints, np.array(0.8)) + np.array([2.0, 0.0, -1.0])


@pytest.mark.parametrize("flat", [False, True])
def test_derivatives_of_an_observation_are_those_of_its_loss(flat: bool) -> None:
    draw = np.random.default_rng(0)
    seen = Observation(
        draw.normal(size=(7, 5, 2 if flat else 3)),
        draw.random((7, 5)),
        np.linspace(0, 5, 7),
        draw.normal(size=(5, 22)) * (draw.random((5, 22)) < 0.2),
        6,
        np.full(7, 3.0) if flat else None,
    )
    joints, place = draw.normal(size=(6, 22, 3)), np.array([0.4, 0.1, 0.2, 12, 0.3 * flat])
    _, of_joints, of_place = seen.loss(joints, place, 0.5)
    for number in range(5 if flat else 4):
        step = 1e-6 * np.eye(5)[number]
        ends = [seen.loss(joints, place + sign * step, 0.5)[0] for sign in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(of_place[number], rel=1e-5)
    step = 1e-6 * draw.normal(size=joints.shape)
    ends = [seen.loss(joints + sign * step, place, 0.5)[0] for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 2 == pytest.approx((of_joints * step).sum(), rel=1e-5)


def test_derivatives_of_what_is_unlikely() -> None:
    draw = np.random.default_rng(1)
    z, step = draw.normal(size=(2, 6, 4))
    ends = [unlikeliness(z + sign * 1e-6 * step)[0] for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 2e-6 == pytest.approx((unlikeliness(z)[1] * step).sum())


def test_noise_and_gaps_are_taken_away_where_the_recording_is(
    generate: MotionPipeline, walk: np.ndarray
) -> None:
    noisy = walk + np.random.default_rng(2).normal(0, 0.05, walk.shape)
    seen = np.ones(walk.shape[:2], bool)
    seen[15:25, [4, 5, 7, 8, 10, 11]] = False
    noisy[0, 20] += 3.0  # a mistake of the tracker
    fitted = fit_motion(generate, noisy, seen)
    assert len(fitted) == len(walk) and fitted.fps == 20
    off = np.linalg.norm(fitted.joints - walk, axis=-1)
    assert off[seen].mean() < 0.04 and off[~seen].mean() < 0.2
    assert off[0, 20] < 0.3
    assert fitted.metadata["fit"]["noise"] == pytest.approx(0.05, abs=0.015)


LEGS = [f"{side}_{part}" for side in ("left", "right") for part in ("knee", "ankle", "foot")]
FOUR = ["pelvis", "head", "left_wrist", "right_wrist"]


@pytest.mark.parametrize(
    ("unseen", "height"),
    [
        (LEGS, 0.0),
        ([*LEGS, "pelvis", "left_hip", "right_hip"], -1.5),
        ([name for name in NAMES if name not in FOUR], 0.0),
        ([name for name in NAMES if name not in FOUR[:2]], -1.5),
    ],
    ids=["legs", "lower body", "all but head, hands and pelvis", "all but head and pelvis"],
)
def test_joints_that_are_never_seen_are_those_of_somebody_upright(
    generate: MotionPipeline, walk: np.ndarray, unseen: list[str], height: float
) -> None:
    real = walk + np.array([0, height, 0])
    seen = np.array([name not in unseen for name in NAMES])[None].repeat(len(real), axis=0)
    fitted = fit_motion(generate, real, seen).joints
    assert np.linalg.norm(fitted - real, axis=-1)[~seen].mean() < 0.25
    feet = fitted[:, [10, 11], 1].min(axis=1) - height
    assert abs(feet).max() < 0.1


def test_somebody_who_sits_with_legs_unseen_has_feet_on_the_floor(generate: MotionPipeline) -> None:
    sits = generate("a person sits down on a chair", 2.0, 2, takes=1).joints.astype(float)
    assert np.median(sits[:, 0, 1]) < 0.7
    seen = np.array([name not in LEGS for name in NAMES])[None].repeat(len(sits), axis=0)
    fitted = fit_motion(generate, sits, seen).joints
    assert abs(np.median(fitted[:, [10, 11], 1].min(axis=1))) < 0.1


def test_other_rates_and_layouts_are_fitted(generate: MotionPipeline, walk: np.ndarray) -> None:
    fast = Motion(walk).resampled(50)
    points = np.einsum("kj,tjc->tkc", joint_weights(LAYOUTS["coco_17"]), fast.joints)
    fitted = fit_motion(generate, points, fps=50, names=LAYOUTS["coco_17"])
    count = min(len(fitted), len(walk))
    assert abs(len(fitted) - len(walk)) <= 1
    assert np.linalg.norm(fitted.joints[:count] - walk[:count], axis=-1).mean() < 0.05


def test_a_camera_sees_which_way_somebody_walks(generate: MotionPipeline) -> None:
    joints = generate("a person walks forward", 2.0, 0, takes=1, clean_up=None).joints.astype(float)
    seen = turn(joints - joints[0, 0] * (1, 0, 1), np.array(np.pi / 2))
    seen += np.array([-1.0, -1.0, 5.0])
    points = np.einsum("kj,tjc->tkc", joint_weights(LAYOUTS["body_25"]), seen)
    pixels = (640, 360) - 1000 * points[..., :2] / np.maximum(points[..., 2:], 1)
    keypoints = Keypoints(
        pixels, np.ones(pixels.shape[:2]), 20, LAYOUTS["body_25"], (1280, 720), 1000
    )
    fitted = fit_motion(generate, keypoints)
    walked = fitted.joints[-1, 0] - fitted.joints[0, 0]
    assert walked[0] == pytest.approx(seen[-1, 0, 0] - seen[0, 0, 0], rel=0.25)
    own, real = (x - x[:, :1] for x in (fitted.joints, seen))
    assert np.linalg.norm(own - real, axis=-1).mean() < 0.12
    assert abs(fitted.joints[..., 1].min()) < 0.1


def test_long_recordings_are_fitted_in_windows(
    generate: MotionPipeline, monkeypatch: pytest.MonkeyPatch, walk: np.ndarray
) -> None:
    monkeypatch.setattr("latentmotion.control.fit_keypoints._WINDOW", 24)
    monkeypatch.setattr("latentmotion.control.fit_keypoints._OVERLAP", 8)
    fitted = fit_motion(generate, walk, noise=0.01)
    assert len(fitted) == len(walk)
    assert np.linalg.norm(fitted.joints - walk, axis=-1).mean() < 0.03
    # Without legs all windows have the floor of the first.
    seen = np.ones(walk.shape[:2], bool)
    seen[:, [NAMES.index(name) for name in LEGS]] = False
    lowest = fit_motion(generate, walk, seen).joints[..., 1].min(axis=1)
    assert np.ptp(lowest) < 0.1


def test_noise_and_size_are_measured(walk: np.ndarray) -> None:
    draw = np.random.default_rng(3)
    noisy = np.tile(walk, (3, 1, 1)) + draw.normal(0, 0.05, (3 * len(walk), 22, 3))
    assert white_noise(noisy) == pytest.approx(0.05, rel=0.15)
    # A child of two thirds.
    assert body_scale(walk * 0.66, NAMES, 0.0) == pytest.approx(1.5, rel=0.05)
    with pytest.raises(InputError, match="expected points in meters"):
        body_scale(walk * 1000, NAMES, 0.0)


def test_nothing_seen_for_a_whole_window_is_told(
    generate: MotionPipeline, monkeypatch: pytest.MonkeyPatch, walk: np.ndarray
) -> None:
    monkeypatch.setattr("latentmotion.control.fit_keypoints._WINDOW", 24)
    monkeypatch.setattr("latentmotion.control.fit_keypoints._OVERLAP", 8)
    seen = np.ones(walk.shape[:2], bool)
    seen[14:] = False
    with pytest.raises(InputError, match=r"nothing was seen for .* s: cut the recording there"):
        fit_motion(generate, walk, seen)


def test_frames_of_a_window_are_counted_from_its_start(walk: np.ndarray) -> None:
    keypoints = Keypoints(walk, np.ones(walk.shape[:2]), 40.0, NAMES)
    capture = Capture.of(keypoints, 20.0, 0.01)
    assert capture.frames == 20
    window = capture.window(5, 8)
    np.testing.assert_allclose(window.positions, np.arange(15) / 2)
    np.testing.assert_array_equal(window.points, capture.points[10:25])


# Parts of the body


def test_other_joints_of_an_edited_part_are_the_same_numbers(generate: MotionPipeline) -> None:
    walk = generate("a person walks forward", 3.0, 3, takes=1)
    edited = generate_edited(
        generate, walk, "a person waves", (1.0, 2.0), parts=["left_arm", "head"]
    )
    changed = (edited.joints != walk.joints).any(axis=-1)
    moved = {NAMES[joint] for joint in np.flatnonzero(changed.any(axis=0))}
    assert moved == {"left_elbow", "left_wrist", "head"}
    assert not changed[:20].any() and not changed[40:].any()
    bones = [np.linalg.norm(m.joints[:, 18] - m.joints[:, 16], axis=-1) for m in (edited, walk)]
    np.testing.assert_allclose(*bones, atol=1e-5)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_of_the_same_motion_elsewhere_is_that_of_the_motion(name: str) -> None:
    own = walker(30).joints()
    other = turn(own, np.array(1.1)) + np.array([3, 0, 1])
    (part,) = parts_named([name], HUMANML3D)
    np.testing.assert_allclose(with_parts(own, other, [part], HUMANML3D), own, atol=1e-6)


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["left_hand"], "unknown part 'left_hand'; did you mean 'left_arm'"),
        (["left_arm", "upper_body"], "left_elbow belongs to both left_arm and upper_body"),
        ("left_arm", r"expected a list of names"),
    ],
)
def test_wrong_parts_are_named(names: list[str], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        parts_named(names, HUMANML3D)
    with pytest.raises(InputError, match="lacks"):
        parts_named(["left_arm"], KIT)


def test_keypoints_bring_their_own_names(generate: MotionPipeline, walk: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"shape \(40, 2, 3\): expected \(frames, 22 keypoints"):
        fit_motion(generate, walk[:, :2], names=NAMES)
    with pytest.raises(InputError, match="leave the others"):
        fit_motion(generate, Keypoints(walk, np.ones(walk.shape[:2]), 20.0, NAMES), names=NAMES)
