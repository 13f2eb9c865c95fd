"""Rotations and chains whose results are known by hand or from other libraries."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp

from latentmotion.arrays import prefix_mask, unit
from latentmotion.kinematics.inverse_kinematics import hinge, nearest_rotation
from latentmotion.kinematics.rotations import (
    axis_angle_from_matrix,
    matrix_between,
    matrix_from_axis_angle,
    quaternion_between,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    quaternion_rotate,
    slerp,
)
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Skeleton

X, Y, Z = np.eye(3)
# Two bones of 2 and 1 meters along x.
ARM = Skeleton(
    "arm",
    ("shoulder", "elbow", "wrist"),
    (-1, 0, 1),
    np.array([[0.0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]]),
)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.mark.parametrize(
    ("shoulder", "elbow", "expected"),
    [
        (0, 0, [3, 0, 0]),
        (90, 0, [0, 3, 0]),
        (0, 90, [2, 1, 0]),
        (90, -90, [1, 2, 0]),
        (180, 180, [-1, 0, 0]),
        (30, 60, [2 * np.cos(np.pi / 6), 2, 0]),
    ],
)
def test_an_arm_of_two_bones(shoulder: float, elbow: float, expected: list[float]) -> None:
    vectors = np.radians([[0, 0, shoulder], [0, 0, elbow], [0, 0, 77.0]])
    rotations = matrix_from_axis_angle(vectors)
    root = np.array([5.0, -1.0, 2.0])
    joints = ARM.forward_kinematics(rotations, root)
    np.testing.assert_allclose(joints[2] - root, expected, atol=1e-12)
    world = axis_angle_from_matrix(ARM.world_rotations(rotations)[1])
    turned = (np.radians(shoulder + elbow) + np.pi - 1e-9) % (2 * np.pi) - np.pi + 1e-9
    np.testing.assert_allclose(abs(world[2]), abs(turned), atol=1e-7)


@pytest.mark.parametrize("skeleton", [ARM, HUMANML3D, KIT, BODY], ids=lambda s: s.name)
def test_local_and_world_rotations_undo_each_other(
    skeleton: Skeleton, random: np.random.Generator
) -> None:
    local = matrix_from_axis_angle(random.normal(size=(4, len(skeleton), 3)))
    world = skeleton.world_rotations(local)
    np.testing.assert_allclose(skeleton.local_rotations(world), local, atol=1e-12)
    turn = matrix_from_axis_angle(random.normal(size=3))
    turned = skeleton.local_rotations(turn @ world)
    np.testing.assert_allclose(turned[:, 1:], local[:, 1:], atol=1e-12)
    np.testing.assert_allclose(turned[:, 0], turn @ local[:, 0], atol=1e-12)


def test_a_pose_turns_and_moves_with_its_root(random: np.random.Generator) -> None:
    rotations = matrix_from_axis_angle(random.normal(0, 0.5, (3, len(HUMANML3D), 3)))
    root = random.normal(size=(3, 3))
    turn = matrix_from_axis_angle(random.normal(size=3))
    expected = HUMANML3D.forward_kinematics(rotations, root) @ turn.T
    rotations[:, 0] = turn @ rotations[:, 0]
    found = HUMANML3D.forward_kinematics(rotations, root @ turn.T)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_great_arcs_are_scipys(share: float, random: np.random.Generator) -> None:
    for vectors in random.normal(size=(10, 2, 3)):
        ends = Rotation.from_rotvec(vectors)
        expected = Slerp([0, 1], ends)(share).as_matrix()
        one, other = quaternion_from_matrix(ends.as_matrix())
        for sign in (1, -1):
            found = Rotation.from_quat(np.roll(slerp(one, sign * other, share), -1))
            np.testing.assert_allclose(found.as_matrix(), expected, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-4, 0.1, 3.0, np.pi - 1e-6])
def test_angles_of_any_size_come_back(angle: float) -> None:
    axis = unit(np.array([1.0, -2.0, 0.5]))
    matrix = matrix_from_axis_angle(angle * axis)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(axis_angle_from_matrix(matrix), angle * axis, atol=1e-8)
    quaternion = quaternion_from_axis_angle(angle * axis)
    assert quaternion[0] == pytest.approx(np.cos(angle / 2))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (X, Y, np.pi / 2 * Z),
        (3 * Y, 0.1 * Z, np.pi / 2 * X),
        (X, X, 0 * X),
        (X + Y, X, -np.pi / 4 * Z),
        (0 * X, Y, 0 * X),
    ],
)
def test_the_shortest_rotation_by_hand(one, other, expected: np.ndarray) -> None:
    matrix = matrix_between(one, other)
    np.testing.assert_allclose(axis_angle_from_matrix(matrix), expected, atol=1e-7)
    turned = quaternion_rotate(quaternion_between(one, other), unit(one))
    np.testing.assert_allclose(turned, unit(other) if one.any() else one, atol=1e-7)


def bent(frames: int, bend: float, normal: np.ndarray) -> tuple[np.ndarray, ...]:
    """Upper bone along x, and the normal of the limb's plane, as long as the sine of the bend."""
    return np.tile(X, (frames, 1)), np.tile(np.sin(bend) * normal, (frames, 1))


@pytest.mark.parametrize("bend", [0.2, 1.0, 1.5])
def test_a_bent_limb_has_the_hinge_of_its_plane(bend: float) -> None:
    axis, normal = bent(12, bend, unit(Y + Z))
    found = hinge(axis, normal, np.tile(0.01 * unit(Y + Z), (12, 1)), 0.1, np.full(11, 0.2))
    np.testing.assert_allclose(found, np.tile(unit(Y + Z), (12, 1)), atol=1e-9)


def test_a_straight_limb_has_the_expected_hinge() -> None:
    axis, normal = bent(12, 0.0, Y)
    found = hinge(axis, normal, np.tile(0.05 * Z, (12, 1)), 0.1, np.full(11, 0.2))
    np.testing.assert_allclose(found, np.tile(Z, (12, 1)), atol=1e-9)


def test_a_limb_beyond_straight_keeps_its_hinge() -> None:
    axis, normal = bent(20, 1.0, Y)
    normal[9:11] = -0.3 * Y
    found = hinge(axis, normal, np.tile(0.01 * Y, (20, 1)), 0.1, np.full(19, 0.2))
    np.testing.assert_allclose(found, np.tile(Y, (20, 1)), atol=1e-9)


@pytest.mark.parametrize("pace", [0.1, 0.2])
def test_a_hinge_turns_no_faster_than_its_pace(pace: float) -> None:
    axis, normal = bent(80, 0.05, Y)
    normal[40:] = np.sin(0.05) * Z
    found = hinge(axis, normal, np.tile(1e-6 * Y, (80, 1)), 1e-4, np.full(79, pace))
    turns = np.arccos(np.clip((found[1:] * found[:-1]).sum(-1), -1, 1))
    assert turns.max() < 1.2 * pace
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1)
    np.testing.assert_allclose(found[0], Y, atol=0.1)
    np.testing.assert_allclose(found[-1], Z, atol=0.1)


@pytest.mark.parametrize("lengths", [[3, 0, 2], np.array([3, 0, 2]), torch.tensor([3, 0, 2])])
@pytest.mark.parametrize("longest", [None, 5])
def test_prefixes_are_true_up_to_their_length(lengths, longest: int | None) -> None:
    mask = prefix_mask(lengths, longest)
    assert mask.shape == (3, longest or 3)
    assert np.asarray(mask.sum(-1)).tolist() == [3, 0, 2]
    assert np.asarray(mask[2]).tolist()[:3] == [True, True, False]


def test_unit_vectors_of_nothing_are_nothing() -> None:
    np.testing.assert_allclose(unit(np.array([[0.0, 3, 4], [0, 0, 0]])), [[0, 0.6, 0.8], [0, 0, 0]])


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_thenearest_rotation_is_that_of_the_singular_values(rank: int) -> None:
    left, right = np.random.default_rng(rank).normal(size=(2, 200, rank, 3))
    given = np.concatenate([np.swapaxes(left, 1, 2) @ right, np.eye(3)[None], -np.eye(3)[None]])
    u, values, vt = np.linalg.svd(given)
    best = values[:, 0] + values[:, 1] + np.linalg.det(u @ vt) * values[:, 2]
    found = nearest_rotation(given)
    np.testing.assert_allclose(np.einsum("nij,nij->n", found, given), best, atol=1e-9)
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), [np.eye(3)] * 202, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found), 1)
