"""Skeletons: trees in order, sides in agreement, forward kinematics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, KIT

SKELETONS = pytest.mark.parametrize("skeleton", [HUMANML3D, KIT], ids=lambda s: s.name)


def turns(skeleton, *batch):
    return np.broadcast_to(np.eye(3), (*batch, len(skeleton), 3, 3)).copy()


@SKELETONS
def test_parents_come_first_and_counts_agree(skeleton):
    assert all(parent < joint for joint, parent in enumerate(skeleton.parents))
    assert skeleton.parents.count(-1) == 1
    assert len(skeleton.names) == len(set(skeleton.names)) == len(skeleton.offsets)


@SKELETONS
def test_sides(skeleton):
    mirror = skeleton.mirror
    assert [mirror[j] for j in mirror] == list(range(len(skeleton)))
    assert [mirror[j] for j in skeleton.left_foot] == list(skeleton.right_foot)
    assert [mirror[max(p, 0)] for p in skeleton.parents] == [
        max(skeleton.parents[j], 0) for j in mirror
    ]
    rest = skeleton.rest_joints()
    for joint, name in enumerate(skeleton.names):
        side = name.startswith("left") - int(name.startswith("right"))
        assert np.sign(rest[joint, 0]) == side
    # The two sides of HumanML3D's sample body differ by up to two centimeters.
    np.testing.assert_allclose(rest * [-1, 1, 1], rest[list(mirror)], atol=0.025)


@SKELETONS
def test_no_rotation_is_the_rest_pose(skeleton):
    root = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    joints = skeleton.forward_kinematics(turns(skeleton, 2), root)
    np.testing.assert_allclose(joints, skeleton.rest_joints() + root[:, None], atol=1e-12)


def test_a_bent_elbow_moves_the_wrist_alone():
    rotations = turns(HUMANML3D)
    elbow, wrist = (HUMANML3D.names.index(f"left_{part}") for part in ("elbow", "wrist"))
    rotations[elbow] = matrix_from_axis_angle(np.array([-np.pi / 2, 0, 0]))
    joints = HUMANML3D.forward_kinematics(rotations, np.zeros(3))
    rest = HUMANML3D.rest_joints()
    moved = np.linalg.norm(joints - rest, axis=-1) > 1e-9
    assert np.flatnonzero(moved).tolist() == [wrist]
    ahead = joints[wrist] - joints[elbow]
    np.testing.assert_allclose(ahead, [0, 0, np.linalg.norm(HUMANML3D.offsets[wrist])], atol=1e-12)


@SKELETONS
def test_bones_keep_their_lengths_in_both_libraries(skeleton):
    torch = pytest.importorskip("torch")
    random = np.random.default_rng(0)
    rotations = matrix_from_axis_angle(random.standard_normal((3, len(skeleton), 3)))
    root = random.standard_normal((3, 3))
    joints = skeleton.forward_kinematics(rotations, root)
    parents = [max(p, 0) for p in skeleton.parents]
    lengths = np.linalg.norm(joints - joints[:, parents], axis=-1)
    expected = np.linalg.norm(skeleton.offsets, axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(expected, lengths.shape), atol=1e-12)
    theirs = skeleton.forward_kinematics(torch.from_numpy(rotations), torch.from_numpy(root))
    np.testing.assert_allclose(theirs.numpy(), joints, atol=1e-12)


def test_animated_offsets_replace_those_at_rest():
    offsets = np.broadcast_to(HUMANML3D.offsets, (2, 22, 3)) * np.array([1.0, 2.0])[:, None, None]
    joints = HUMANML3D.forward_kinematics(turns(HUMANML3D, 2), np.zeros((2, 3)), offsets)
    np.testing.assert_allclose(joints[1], 2 * joints[0], atol=1e-12)


def test_children():
    assert HUMANML3D.children(9) == (12, 13, 14)
    assert KIT.children(20) == ()
