"""Bones with rest rotations in files, and the rates of their keys."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from latentmotion.errors import FileFormatError
from latentmotion.formats.bones import (
    MOST_FRAMES,
    WorldPose,
    bone_axes,
    even_rate,
    plain_animation,
    plain_skeleton,
)
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Skeleton
from tests.support.mocap_folders import swaying

SKELETONS = pytest.mark.parametrize("skeleton", [HUMANML3D, KIT, BODY], ids=lambda s: s.name)
PATH = Path("file.glb")


@pytest.mark.parametrize(
    ("seconds", "fps", "frames"),
    [
        ([], 30.0, 1),
        ([2.0], 30.0, 1),
        (np.arange(7) / 60, 60.0, 7),
        (np.arange(7) / 29.97 + 5, 29.97, 7),
        (np.round(np.arange(121) / 120, 4), 120.0, 121),
        ([0.0, 0.1, 0.25, 0.5], 30.0, 16),
        ([0.0, 1.0, 2.0], 30.0, 61),
        ([0.0, 0.05, 0.1, 0.3], 20.0, 7),
        (np.repeat(np.arange(5) / 24, 2), 24.0, 5),
    ],
)
def test_keys_tell_the_rate_if_they_lie_on_one(seconds, fps: float, frames: int) -> None:
    found, times = even_rate(PATH, np.asarray(seconds, float))
    assert found == pytest.approx(fps) and len(times) == frames
    if len(seconds):
        assert times[0] == seconds[0] and abs(times[-1] - seconds[-1]) < 0.51 / fps


def test_the_rate_of_keys_set_by_hand_can_be_chosen() -> None:
    fps, times = even_rate(PATH, np.array([0.0, 1.0, 2.5]), otherwise=12.0)
    assert fps == 12 and len(times) == 31
    with pytest.raises(FileFormatError, match=r"file\.glb: has keys from 0 s to 1e\+06 s"):
        even_rate(PATH, np.array([0.0, 1e6]))
    assert MOST_FRAMES / 30 > 3600, "an hour at 30 frames per second"


def test_repeated_names_get_a_number() -> None:
    rest = WorldPose(np.arange(12.0).reshape(4, 3), np.tile(np.eye(3), (4, 1, 1)))
    skeleton = plain_skeleton("s", ["a", "b", "a", "a"], [-1, 0, 1, 0], rest)
    assert skeleton.names == ("a", "b", "a_2", "a_3")
    np.testing.assert_array_equal(skeleton.offsets, [[0] * 3, [3] * 3, [3] * 3, [9] * 3])


@pytest.mark.parametrize("seed", [0, 1])
def test_rest_rotations_are_folded_in(seed: int) -> None:
    """A file's joints may rest in any axes; the animation moves them to the same places."""
    animation = swaying(6, seed=seed)
    skeleton, count = animation.skeleton, len(HUMANML3D)
    rest = Rotation.random(count, random_state=seed).as_matrix()
    world = skeleton.world_rotations(animation.rotations)
    moved = WorldPose(animation.joints(), world @ rest)
    found_skeleton = plain_skeleton(
        "s", skeleton.names, skeleton.parents, WorldPose(skeleton.rest_joints(), rest)
    )
    found = plain_animation(
        found_skeleton, WorldPose(skeleton.rest_joints(), rest), moved, animation.fps
    )
    assert found.translations is None
    np.testing.assert_allclose(found.rotations, animation.rotations, atol=1e-9)
    np.testing.assert_allclose(found.joints(), animation.joints(), atol=1e-9)
    stretched = WorldPose(1.2 * moved.positions, moved.rotations)
    apart = plain_animation(
        found_skeleton, WorldPose(skeleton.rest_joints(), rest), stretched, animation.fps
    )
    assert apart.translations is not None
    np.testing.assert_allclose(apart.joints(), stretched.positions, atol=1e-9)


@SKELETONS
def test_axes_are_rotations_whose_y_lies_along_a_bone(skeleton: Skeleton) -> None:
    axes = bone_axes(skeleton).world
    np.testing.assert_allclose(
        axes @ axes.swapaxes(1, 2), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1)
    for joint in range(len(skeleton)):
        bones = [skeleton.offsets[child] for child in skeleton.children(joint)]
        along = [bone @ axes[joint, :, 1] / np.linalg.norm(bone) for bone in bones]
        assert not bones or max(along) == pytest.approx(1), skeleton.names[joint]


@SKELETONS
def test_axes_of_both_sides_are_mirror_images(skeleton: Skeleton) -> None:
    axes = bone_axes(skeleton).world
    other = axes[list(skeleton.mirror)]
    np.testing.assert_allclose(axes[:, :, 1] * [-1, 1, 1], other[:, :, 1], atol=1e-6)


@SKELETONS
def test_a_file_draws_the_joints_where_they_are(skeleton: Skeleton) -> None:
    axes = bone_axes(skeleton)
    random = np.random.default_rng(0)
    rotations = matrix_from_axis_angle(random.normal(0, 0.5, (4, len(skeleton), 3)))
    root = random.normal(size=(4, 3))
    expected = skeleton.forward_kinematics(rotations, root)
    local, offsets = axes.rotations(rotations), axes.offsets(skeleton.offsets)
    in_file = Skeleton("file", skeleton.names, skeleton.parents, offsets)
    np.testing.assert_allclose(in_file.forward_kinematics(local, root), expected, atol=1e-9)
    over_time = axes.offsets(np.tile(skeleton.offsets, (4, 1, 1)))
    np.testing.assert_allclose(over_time, np.tile(offsets, (4, 1, 1)), atol=1e-12)


def test_bones_may_pass_their_joint() -> None:
    exact, passing = (bone_axes(HUMANML3D, miss).world for miss in (0.0, 0.001))
    knee = HUMANML3D.names.index("left_knee")
    angle = np.arccos(np.clip(exact[knee, :, 1] @ passing[knee, :, 1], -1, 1))
    length = np.linalg.norm(HUMANML3D.offsets[HUMANML3D.names.index("left_ankle")])
    assert angle == pytest.approx(np.arctan(0.001 / length), rel=1e-3)
