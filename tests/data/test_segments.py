"""Where takes are cut: glitches, labels, stillness, and T-poses."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.quality import (
    begins_with_t_pose,
    clean_spans,
    held_t_pose,
    is_blended,
    without_blend,
)
from latentmotion.data.segments import LONGEST, SHORTEST, pieces
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from tests.support.mocap_folders import swaying, with_t_pose


def walking(frames: int) -> np.ndarray:
    return swaying(frames, fps=20).joints()


@pytest.mark.parametrize("frames", [20, 150, 196, 197, 215, 216, 400, 1111])
def test_pieces_are_long_enough_short_enough_and_touch(frames: int) -> None:
    found = list(pieces(walking(frames), 20))
    assert all(SHORTEST <= last - first <= LONGEST for first, last in found)
    assert [first for first, _ in found] == [0, *(last for _, last in found[:-1])]
    assert found[-1][1] == frames


def test_less_than_a_second_is_no_piece() -> None:
    assert list(pieces(walking(19), 20)) == []


def test_cuts_are_kept_where_no_piece_gets_too_short() -> None:
    assert list(pieces(walking(150), 20, cuts=[5, 60, 70, 145])) == [(0, 60), (60, 150)]


def test_a_long_take_is_cut_where_it_is_still() -> None:
    joints = walking(300)
    joints[130:150] = joints[130]
    ((_, cut), _) = list(pieces(joints, 20))
    assert 130 <= cut <= 150


def test_glitches_are_cut_out_and_the_rest_is_kept() -> None:
    joints = walking(150)
    joints[70, 20] += 3.0
    assert clean_spans(joints, 20) == [(0, 67), (74, 150)]
    assert list(pieces(joints, 20)) == [(0, 67), (74, 150)]


def test_frames_that_are_not_finite_are_glitches() -> None:
    joints = walking(60)
    joints[30] = np.nan
    assert clean_spans(joints, 20) == [(0, 27), (34, 60)]


def test_a_body_of_the_wrong_size_has_no_clean_stretch() -> None:
    assert clean_spans(walking(60) * 10, 20) == []


def from_angles(angles: np.ndarray) -> Animation:
    root = np.zeros((len(angles), 3))
    return Animation(HUMANML3D, matrix_from_axis_angle(angles), root, 120.0)


def test_a_t_pose_that_was_put_before_the_motion_is_found() -> None:
    assert begins_with_t_pose(with_t_pose(swaying(60)))
    assert not begins_with_t_pose(swaying(60))


def test_who_stands_in_a_t_pose_has_none_put_before() -> None:
    angles = np.full((60, 22, 3), 0.01)
    assert not begins_with_t_pose(from_angles(angles))


def test_only_frames_drawn_to_the_t_pose_are_blended() -> None:
    angles = np.full((60, 22, 3), 0.3)
    angles[0] = 0
    assert not is_blended(from_angles(angles))
    angles[1:6] *= np.array([0.3, 0.5, 0.7, 0.9, 0.95])[:, None, None]
    assert begins_with_t_pose(from_angles(angles))
    assert is_blended(from_angles(angles))


def test_bones_without_length_stay_without() -> None:
    joints = walking(40)
    joints[:, 6] = joints[:, 3]
    out = without_blend(joints, 120, 20)
    assert np.isfinite(out).all()
    np.testing.assert_allclose(out[0, 6], out[0, 3])


def test_arms_stretched_out_to_the_sides_are_a_t_pose() -> None:
    pose = np.zeros((3, 22, 3))
    names = HUMANML3D.names
    for side, sign in (("left", 1), ("right", -1)):
        for name, x, y in (
            ("hip", 0.1, 0.9),
            ("ankle", 0.1, 0.1),
            ("shoulder", 0.2, 1.4),
            ("elbow", 0.45, 1.4),
            ("wrist", 0.7, 1.4),
        ):
            pose[:, names.index(f"{side}_{name}")] = (sign * x, y, 0)
    pose[1, names.index("left_wrist")] = (0.45, 1.1, 0)
    pose[2, names.index("left_ankle")] = (0.9, 0.9, 0)
    assert held_t_pose(pose).tolist() == [True, False, False]
