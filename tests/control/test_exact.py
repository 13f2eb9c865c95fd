"""Exact: goals met in the joints, bones kept, feet held; pieces pasted; motion bent onto curves."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.control.direct import looking, missed_looks
from latentmotion.control.exact import (
    distances,
    held_in_contacts,
    hold_targets,
    inertialized,
    quintic,
    spread,
)
from latentmotion.control.goals import (
    Heading,
    LookAt,
    Pose,
    Reach,
    RootPath,
    targets_of,
    with_hands,
)
from latentmotion.control.path import Curve, bent, path_seconds, straight_points, straightened
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn
from tests.support.walker import walker


def bones(joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(joints[:, 1:] - joints[:, list(HUMANML3D.parents[1:])], axis=-1)


def near(joints: np.ndarray, name: str, frame: int, offset: tuple[float, float, float]) -> Reach:
    place = joints[frame, HUMANML3D.names.index(name)] + offset
    return Reach(name, frame / 20, tuple(place.tolist()))


@pytest.mark.parametrize("name", ["pelvis", "head", "right_wrist", "left_ankle", "left_foot"])
def test_a_goal_is_met_and_bones_keep_their_lengths(name: str) -> None:
    joints = walker(60).joints()
    targets = targets_of([near(joints, name, 30, (0.02, 0.01, -0.03))], 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert distances(held, targets, HUMANML3D).max() < 1e-6
    assert np.abs(bones(held) - bones(joints)).max() < 2e-3
    assert np.allclose(held[:10], joints[:10])
    assert np.allclose(held[50:], joints[50:])


def test_several_goals_at_once() -> None:
    joints = walker(60).joints()
    goals = [
        near(joints, "right_wrist", 20, (0.03, 0, 0)),
        near(joints, "left_wrist", 22, (0, -0.02, 0)),
        near(joints, "pelvis", 30, (0.02, 0, 0.02)),
        near(joints, "right_foot", 45, (0, 0.03, 0)),
        near(joints, "head", 20, (0.02, 0, 0)),
    ]
    targets = targets_of(goals, 60, 20.0, HUMANML3D)
    assert (
        distances(hold_targets(joints, targets, 20.0, HUMANML3D), targets, HUMANML3D).max() < 1e-5
    )


def test_a_goal_beyond_the_arm_takes_the_body_along() -> None:
    joints = walker(60).joints()
    targets = targets_of([near(joints, "right_wrist", 30, (0.3, 0.2, 0.3))], 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert distances(held, targets, HUMANML3D).max() < 1e-3
    assert np.abs(bones(held) - bones(joints)).max() < 2e-2


def test_a_pose_is_met_by_every_joint() -> None:
    joints = walker(60).joints()
    pose = Motion(joints[31:32] + np.random.default_rng(0).normal(0, 0.01, (1, 22, 3)))
    targets = targets_of([Pose(1.5, pose)], 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert distances(held, targets, HUMANML3D).max() < 1e-6


@pytest.mark.parametrize("name", ["right_hand", "left_fingertips", "right_wrist", "pelvis"])
def test_a_goal_that_holds_is_held_without_a_jerk(name: str) -> None:
    joints = walker(80).joints()
    index = targets_of([Reach(name, 1.5, (0, 1, 0))], 80, 20.0, HUMANML3D, None).joints[0]
    place = with_hands(joints, HUMANML3D)[34, index] + (0.02, 0.01, -0.02)
    goal = Reach(name, 1.5, tuple(place.tolist()), 2.0)
    targets = targets_of([goal], 80, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert len(targets.frames) == 11
    assert distances(held, targets, HUMANML3D).max() < 1e-5
    assert np.abs(bones(held) - bones(joints)).max() < 1e-2
    path = with_hands(held, HUMANML3D)[:, index]
    free = with_hands(joints, HUMANML3D)[:, index]
    # It comes to rest: no more than twice the acceleration that is there without the goal.
    bends = [np.linalg.norm(np.diff(one, n=2, axis=0), axis=1)[18:52].max() for one in (path, free)]
    assert bends[0] < 2 * bends[1] + 0.06
    assert np.allclose(held[:18], joints[:18])


def test_two_hands_on_one_thing() -> None:
    joints = walker(60).joints()
    goals = [
        Reach("left_hand", 0.5, (0.2, 0.0, 0.35), 2.5, "spine3"),
        Reach("right_hand", 0.5, (-0.4, 0.0, 0.0), 2.5, "left_hand"),
    ]
    targets = targets_of(goals, 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert distances(held, targets, HUMANML3D).max() < 1e-3
    hands = with_hands(held, HUMANML3D)[10:51, [22, 24]]
    assert np.allclose(np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1), 0.4, atol=1e-3)


def test_a_heading_turns_the_body_and_leaves_the_feet() -> None:
    joints = np.repeat(walker(1).joints(), 60, axis=0)
    joints[..., 1] -= joints[..., 1].min()
    facing = float(heading(joints[0], HUMANML3D))
    targets = targets_of([Heading(1, np.degrees(facing) + 8, 2)], 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert np.allclose(heading(held, HUMANML3D)[20:41], facing + np.radians(8), atol=1e-6)
    assert np.ptp(held[:, [7, 8, 10, 11]], axis=0).max() < 1e-6
    assert np.abs(bones(held) - bones(joints)).max() < 2e-3


def test_the_head_turns_to_a_point_and_joints_stay() -> None:
    motion = Motion(walker(60).joints())
    facing = heading(motion.joints[30].astype(float), motion.skeleton)
    beside = motion.joints[30, 15] + turn(np.array([1.5, 0.3, 6.0]), np.asarray(facing))
    look = LookAt(1.5, tuple(beside.tolist()))  # the walker shakes its head
    turned = looking(motion, [look])
    assert (turned.joints == motion.joints).all()
    assert missed_looks(motion, look) > 10
    assert missed_looks(turned, look) < 0.1
    assert missed_looks(turned.resampled(30), look) < 2
    head = motion.skeleton.names.index("head")
    world = [m.skeleton.world_rotations(m.animation().rotations)[:, head] for m in (motion, turned)]
    assert np.allclose(world[0][:9], world[1][:9], atol=1e-6)
    with pytest.raises(InputError, match="two looks"):
        looking(motion, [look, LookAt(1.5, (0.0, 1.0, 2.0))])


def test_a_path_at_a_pace_takes_its_time() -> None:
    path = RootPath([(0, 0), (0, 2), (0, 3)], pace=[1.0, 1.0, 0.5])
    assert path_seconds(path) == pytest.approx(2 + 1 / 0.75, abs=0.01)
    times, meters = straight_points(path, Curve.through(path), 80, 20.0)
    assert np.allclose(np.interp([1.0, 2.0], times, meters), [1, 2], atol=0.02)
    assert times[-1] == pytest.approx(2 + 1 / 0.75, abs=0.01)
    with pytest.raises(InputError, match="ask for more seconds or a faster pace"):
        straight_points(path, Curve.through(path), 40, 20.0)


def test_offsets_come_and_go_smoothly() -> None:
    curve = spread({20: np.array([1.0, 0, 0]), 25: np.array([0, 2.0, 0])}, 60, 10)
    assert np.allclose(curve[[20, 25]], [[1, 0, 0], [0, 2, 0]])
    assert np.allclose(curve[[9, 36]], 0)
    assert (quintic(np.array([0.0, 0.5, 1.0])) == [0, 0.5, 1]).all()


def test_a_foot_that_stands_is_moved_as_a_whole() -> None:
    standing = np.zeros(100, bool)
    standing[10:55] = standing[60:64] = standing[90:] = True
    goal, other = np.array([0.05, 0.02, -0.1]), np.array([0.06, 0.0, -0.1])
    curve = held_in_contacts({30: goal}, standing, 10)
    np.testing.assert_allclose(curve[10:55], np.broadcast_to(goal, (45, 3)))
    assert np.ptp(curve[60:64, [0, 2]], axis=0).max() == 0 and 0.01 < abs(curve[60, 2]) < 0.1
    assert curve[60, 1] > curve[63, 1] > 0  # the floor is where it was
    np.testing.assert_array_equal(curve[75:], 0)
    both = held_in_contacts({20: goal, 50: other}, standing, 10)
    np.testing.assert_allclose(both[[20, 50]], [goal, other])
    assert np.linalg.norm(np.diff(both[10:55], axis=0), axis=1).max() < 0.003


def test_a_goal_of_a_standing_foot_makes_it_slide_nowhere() -> None:
    joints = np.repeat(walker(1).joints(), 60, axis=0)
    joints[..., 1] -= joints[..., 1].min()
    targets = targets_of([near(joints, "left_foot", 30, (0.05, 0, 0.04))], 60, 20.0, HUMANML3D)
    held = hold_targets(joints, targets, 20.0, HUMANML3D)
    assert distances(held, targets, HUMANML3D).max() < 1e-6
    assert np.ptp(held[:, [8, 10, 11]], axis=0).max() < 1e-6


def test_a_pasted_piece_leaves_and_meets_what_is_around_it() -> None:
    whole = walker(80).joints()
    other = walker(80, 26).joints()[24:44] + np.array([0.3, -0.2, 0.1])
    piece = inertialized(other, whole[:30], whole[50:], HUMANML3D, 8)
    pasted, cut = (np.concatenate([whole[:30], x, whole[50:]]) for x in (piece, other))
    jerk = [np.abs(np.diff(x, n=2, axis=0)).max() for x in (pasted, cut, whole)]
    assert jerk[0] < 0.2 * jerk[1]
    assert np.abs(bones(pasted) - bones(whole)).max() < 1e-9
    same = inertialized(whole[30:50], whole[:30], whole[50:], HUMANML3D, 8)
    assert np.abs(same - whole[30:50]).max() < 0.05


def test_a_straight_walk_is_bent_onto_a_circle() -> None:
    radius, angles = 2.0, np.linspace(0, np.pi, 7)
    points = [(radius * (1 - np.cos(a)), radius * np.sin(a)) for a in angles]
    curve = Curve.through(RootPath(points))
    assert abs(curve.length - np.pi * radius) < 0.05
    joints = np.repeat(walker(1).joints(), 60, axis=0)
    joints[..., ::2] -= joints[:1, :1, ::2]
    joints[..., 2] += np.linspace(0, curve.length, 60)[:, None]
    moved = bent(joints, curve, 20.0, HUMANML3D)
    around = moved[:, 0, ::2] - (radius, 0)
    assert np.abs(np.linalg.norm(around, axis=1) - radius).max() < 0.045
    turned = np.unwrap(heading(moved, HUMANML3D))
    assert np.abs(turned[8:-8] - np.linspace(0, np.pi, 60)[8:-8]).max() < 0.12
    assert np.abs(bones(moved) - bones(joints)).max() < 1e-6


def test_planted_feet_stay_planted_on_a_curve() -> None:
    curve = Curve.through(RootPath([(0, 0), (0, 1), (0.5, 2), (1.5, 2.5)]))
    joints = np.repeat(walker(1).joints(), 20, axis=0)
    joints[..., ::2] -= joints[:1, :1, ::2]
    sway = 0.05 * np.linspace(0, 1, 20)[:, None]
    upper = [j for j in range(22) if j not in (7, 8, 10, 11)]
    joints[:, upper, 2] += sway
    joints[:, upper, 1] -= 0.02
    moved = bent(joints, curve, 20.0, HUMANML3D)
    assert np.ptp(moved[:, [7, 8, 10, 11]], axis=0).max() < 1e-6


def test_points_of_the_world_go_back_onto_the_straight_line() -> None:
    curve = Curve.through(RootPath([(1, 2), (1, 3), (2, 4)]))
    place = curve.place(np.array(1.2), np.array(0.0))
    there = straightened((place[0], 0.9, place[1]), (0.1, 1.1), 1.1, curve)
    joints = np.repeat(walker(1).joints(), 3, axis=0)
    joints[..., ::2] += np.array([0.1, 1.1]) - joints[:, :1, ::2]
    joints[:, 15] = there
    assert np.allclose(bent(joints, curve, 20.0, HUMANML3D)[1, 15, ::2], place)


def test_nothing_but_the_head_turns_for_a_look() -> None:
    motion = Motion(walker(60).joints())
    turned = looking(motion, [LookAt(1, (2.0, 1.8, 3.0), 2)])
    local = [one.animation().rotations for one in (motion, turned)]
    others = [j for j, name in enumerate(motion.skeleton.names) if name != "head"]
    np.testing.assert_allclose(local[1][:, others], local[0][:, others], atol=1e-6)
