"""Inverse kinematics: reaches the joints, bends hinges, does not flip."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.kinematics.inverse_kinematics import solve, solve_batch
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from tests.support.walker import t_pose, walker

NAMES = HUMANML3D.names


def largest_turn(rotations: np.ndarray) -> float:
    """The largest turn of any joint from one frame to the next, degrees."""
    steps = np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:]
    return float(np.degrees(np.linalg.norm(axis_angle_from_matrix(steps), axis=-1).max()))


def test_the_rest_pose_is_a_t():
    rest = dict(zip(NAMES, t_pose().skeleton.rest_joints(), strict=True))
    for side, sign in (("left", 1), ("right", -1)):
        arm = rest[f"{side}_wrist"] - rest[f"{side}_shoulder"]
        leg = rest[f"{side}_ankle"] - rest[f"{side}_hip"]
        foot = rest[f"{side}_foot"] - rest[f"{side}_ankle"]
        np.testing.assert_allclose(arm / np.linalg.norm(arm), (sign, 0, 0), atol=1e-6)
        assert leg[1] < -0.99 * np.linalg.norm(leg)
        assert foot[2] > 0.8 * np.linalg.norm(foot)
        assert abs(foot[0]) < 1e-6


def test_reaches_the_joints_and_gives_back_the_rotations():
    person = walker()
    found = solve(person.joints(), person.fps)
    assert found.translations is None
    np.testing.assert_allclose(found.joints(), person.joints(), atol=0.001)
    for name in ("left_elbow", "right_elbow", "left_knee", "right_knee"):
        wanted = axis_angle_from_matrix(person.rotations[:, NAMES.index(name)])
        given = axis_angle_from_matrix(found.rotations[:, NAMES.index(name)])
        np.testing.assert_allclose(given, wanted, atol=0.15)


def test_hinges_turn_about_their_axis_only():
    found = solve(walker().joints(), 20.0)
    elbow = axis_angle_from_matrix(found.rotations[:, NAMES.index("left_elbow")])
    knee = axis_angle_from_matrix(found.rotations[:, NAMES.index("left_knee")])
    assert (np.abs(elbow[:, 1]) > 0.95 * np.linalg.norm(elbow, axis=-1)).all()
    assert (elbow[:, 1] < 0).all()
    assert (np.abs(knee[:, 0]) > 0.95 * np.linalg.norm(knee, axis=-1)).all()
    assert (knee[:, 0] > 0).all()


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_chest_whose_neck_and_collars_lie_at_one_point_turns_with_the_shoulders(share):
    turn = matrix_from_axis_angle(np.linspace(0, 2, 24)[:, None] * np.array([0.0, 1.0, 0.0]))
    joints = walker(24).joints() @ np.swapaxes(turn, -1, -2)
    chest, neck = (joints[:, NAMES.index(name)] for name in ("spine3", "neck"))
    for name in ("neck", "left_collar", "right_collar"):  # on the chest, or all at the neck
        joints[:, NAMES.index(name)] = chest + share * (neck - chest)
    found = solve(joints, 20.0)
    np.testing.assert_allclose(found.joints(), joints, atol=0.01)
    assert largest_turn(found.rotations) < 30
    steps = found.resampled(40.0).joints()
    assert np.abs(np.diff(steps, 2, axis=0)).max() < 2 * np.abs(np.diff(joints, 2, axis=0)).max()
    world = found.skeleton.world_rotations(found.rotations)[:, NAMES.index("spine3")]
    across = joints[:, NAMES.index("left_shoulder")] - joints[:, NAMES.index("right_shoulder")]
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    assert (world[:, :, 0] * across).sum(-1).min() > 0.95


def test_no_flip_when_the_figure_turns_its_back():
    person = walker()
    heading = matrix_from_axis_angle(np.array([0, 2.0, 0]))
    straight = solve(person.joints(), 20.0)
    turned = solve(person.joints() @ heading.T, 20.0)
    np.testing.assert_allclose(turned.rotations[:, 1:], straight.rotations[:, 1:], atol=1e-5)
    np.testing.assert_allclose(
        turned.rotations[:, 0], heading @ straight.rotations[:, 0], atol=1e-5
    )
    assert largest_turn(straight.rotations) < 1.5 * largest_turn(person.rotations)


def test_straight_limbs_do_not_spin():
    noise = np.random.default_rng(0).normal(size=(40, len(NAMES), 3))
    down = np.zeros((40, len(NAMES), 3))
    for side, sign in (("left", -1), ("right", 1)):
        down[:, NAMES.index(f"{side}_shoulder"), 2] = sign * 1.3
    pose = t_pose()
    joints = pose.skeleton.forward_kinematics(matrix_from_axis_angle(down), np.zeros((40, 3)))
    found = solve(joints + 0.0005 * noise, 20.0)
    assert largest_turn(found.rotations) < 6


def test_an_elbow_that_passes_straight_keeps_its_hinge():
    bend = np.zeros((40, len(NAMES), 3))
    bend[:, NAMES.index("left_elbow"), 1] = np.linspace(-1.2, 0.3, 40)
    pose = t_pose()
    joints = pose.skeleton.forward_kinematics(matrix_from_axis_angle(bend), np.zeros((40, 3)))
    found = solve(joints, 20.0)
    np.testing.assert_allclose(found.joints(), joints, atol=1e-6)
    shoulder = axis_angle_from_matrix(found.rotations[:, NAMES.index("left_shoulder")])
    assert np.abs(shoulder).max() < 0.05


def test_a_straight_arm_whose_plane_jumps_turns_at_its_pace():
    """The elbow bends to one side, is straight for a moment, and bends to the other."""
    turn = np.zeros((60, len(NAMES), 3))
    turn[:, NAMES.index("left_shoulder"), 0] = np.where(np.arange(60) < 30, 0.0, 2.6)
    bend = np.abs(np.arange(60) - 29.5) / 30
    turn[:, NAMES.index("left_elbow"), 1] = -0.8 * bend
    pose = t_pose()
    joints = pose.skeleton.forward_kinematics(matrix_from_axis_angle(turn), np.zeros((60, 3)))
    found = solve(joints, 20.0)
    np.testing.assert_allclose(found.joints(), joints, atol=1e-6)
    assert largest_turn(found.rotations[:, [NAMES.index("left_shoulder")]]) < 20


def singular(name: str, frames: int = 60) -> np.ndarray:
    """Returns joints of a figure that passes through a pose in which a rotation is not told."""
    turns, time = np.zeros((frames, len(NAMES), 3)), np.linspace(0, 1, frames)
    shoulders = [(NAMES.index(f"{s}_shoulder"), sign) for s, sign in (("left", 1), ("right", -1))]
    hips = [NAMES.index(f"{side}_hip") for side in ("left", "right")]
    if name == "arms straight up and down":
        for joint, sign in shoulders:
            turns[:, joint, 2] = sign * np.linspace(-1.5, 1.5, frames)
    elif name == "straight legs swing":
        turns[:, hips[0], 0] = np.sin(2 * np.pi * time)
        turns[:, hips[1], 0] = -np.sin(2 * np.pi * time)
    elif name == "turns its back":
        turns[:, 0, 1] = 4 * np.pi * time
    elif name == "lies down":
        turns[:, 0, 0] = -np.pi / 2 * time
    elif name == "handstand":
        turns[:, 0, 0] = np.pi * time
    elif name == "cartwheel":
        turns[:, 0, 2] = 2 * np.pi * time
    rotations = matrix_from_axis_angle(turns)
    return t_pose().skeleton.forward_kinematics(rotations, np.zeros((frames, 3)))


@pytest.mark.parametrize(
    "name",
    [
        *("arms straight up and down", "straight legs swing", "turns its back"),
        *("lies down", "handstand", "cartwheel"),
    ],
)
def test_singular_poses_have_no_spin(name: str):
    joints = singular(name)
    found = solve(joints, 20.0)
    np.testing.assert_allclose(found.joints(), joints, atol=1e-6)
    allowed = {"turns its back": 12.5, "cartwheel": 6.5, "straight legs swing": 6.5}
    assert largest_turn(found.rotations) < allowed.get(name, 3.5)
    if name in ("turns its back", "lies down", "handstand", "cartwheel"):
        local = axis_angle_from_matrix(found.rotations[:, 1:])
        assert np.ptp(local, axis=0).max() < 0.02


@pytest.mark.parametrize("lean", [0.0, 0.5])
def test_any_turn_of_the_whole_figure_turns_the_root_alone(lean: float):
    joints = walker().joints()
    turn = matrix_from_axis_angle(np.array([lean, 2.8, -lean]))
    straight, turned = solve(joints, 20.0), solve(joints @ turn.T, 20.0)
    feet = [NAMES.index(f"{s}_{n}") for s in ("left", "right") for n in ("ankle", "foot")]
    same = [j for j in range(1, len(NAMES)) if j not in feet]
    np.testing.assert_allclose(turned.rotations[:, same], straight.rotations[:, same], atol=1e-5)


def test_a_spine_that_bends_in_the_pelvis_moves_a_joint_and_still_fits():
    joints = walker().joints()
    above = [NAMES.index(n) for n in NAMES if not n.endswith(("hip", "knee", "ankle", "foot"))][1:]
    joints[:, above] += 0.03 * np.sin(np.arange(len(joints)))[:, None, None] * (1.0, 0, 0)
    spine = joints[:, 3] - joints[:, 0]
    length = np.linalg.norm(spine, axis=-1, keepdims=True)
    joints[:, above] += (spine * (0.13 / length - 1))[:, None]
    found = solve(joints, 20.0)
    assert found.translations is not None
    np.testing.assert_allclose(found.joints(), joints, atol=0.005)


def test_kit_and_single_frames():
    joints = np.tile(KIT.rest_joints(), (1, 1, 1))
    found = solve(joints, 12.5, KIT)
    np.testing.assert_allclose(found.joints(), joints, atol=1e-6)
    assert found.skeleton.names == KIT.names


def test_published_joints(shared):
    joints = np.load(shared / "reference/humanml3d_sample/012314_joints.npy")
    found = solve(joints, 20.0)
    assert found.translations is None
    np.testing.assert_allclose(found.joints(), joints, atol=0.001)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_very_short_motions(frames: int):
    joints = walker(frames).joints()
    np.testing.assert_allclose(solve(joints, 20.0).joints(), joints, atol=0.001)


def test_a_chain_without_branches_may_carry_a_head():
    heights = np.arange(3.0)[:, None] * (0.0, 1.0, 0.0)
    chain = Skeleton("chain", ("base", "neck", "head"), (-1, 0, 1), np.eye(3)[[1, 1, 1]])
    joints = np.broadcast_to(heights, (4, 3, 3)).astype(np.float32)
    np.testing.assert_allclose(solve(joints, 20.0, chain).joints(), joints, atol=1e-6)


def test_motions_are_solved_together_as_alone():
    noise = np.random.default_rng(0).normal(0, 0.01, (4, 30, len(NAMES), 3))
    motions = np.stack([walker(30).joints() + one for one in noise], axis=1)
    for number, together in enumerate(solve_batch(motions, 20.0, HUMANML3D)):
        alone = solve(motions[:, number], 20.0)
        np.testing.assert_allclose(together.rotations, alone.rotations, atol=1e-12)
        np.testing.assert_allclose(together.skeleton.offsets, alone.skeleton.offsets, atol=1e-12)
        np.testing.assert_allclose(together.joints(), alone.joints(), atol=1e-12)
