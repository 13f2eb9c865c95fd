"""Clean-up by its definitions: what a step must keep, whatever the motion."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.cleanup.bones import constant_bones
from latentmotion.cleanup.floor import align_floor, find_arms, lift_hands
from latentmotion.cleanup.leg_ik import find_legs, keep_knee_direction, reach
from latentmotion.cleanup.smoothing import gaussian, smooth, upper_envelope
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.representation.canonical import turn
from tests.support.simple_motions import figure
from tests.support.walker import walker

FPS = 20.0
SIDES = [
    HUMANML3D.names.index(name.replace("left", "x").replace("right", "left").replace("x", "right"))
    for name in HUMANML3D.names
]


def mirror(joints: np.ndarray) -> np.ndarray:
    return joints[:, SIDES] * (-1, 1, 1)


@pytest.fixture(scope="module")
def shaken() -> np.ndarray:
    """Someone who walks, every joint off by some 5 mm."""
    joints = walker(50).joints()
    return joints + np.random.default_rng(0).normal(0, 0.005, joints.shape)


def bones(joints: np.ndarray) -> np.ndarray:
    return joints[:, 1:] - joints[:, list(HUMANML3D.parents[1:])]


STEPS = {
    "bones": lambda joints: constant_bones(joints, FPS, HUMANML3D),
    "floor": lambda joints: align_floor(joints, FPS, HUMANML3D),
    "hands": lambda joints: lift_hands(joints, FPS, HUMANML3D),
    "smooth": lambda joints: smooth(joints.reshape(len(joints), -1), FPS, 5).reshape(joints.shape),
}


@pytest.mark.parametrize("step", STEPS)
def test_a_step_does_not_care_where_one_is_nor_which_way_one_faces(
    step: str, shaken: np.ndarray
) -> None:
    low = shaken - (0, 0.3, 0)
    angle, shift = np.array(2.1), np.array([5.0, 0.0, -3.0])
    found = STEPS[step](turn(low, angle) + shift)
    np.testing.assert_allclose(found, turn(STEPS[step](low), angle) + shift, atol=1e-7)


@pytest.mark.parametrize("step", ["floor", "hands", "smooth"])
def test_a_step_does_to_the_mirror_image_what_the_mirror_shows(
    step: str, shaken: np.ndarray
) -> None:
    low = shaken - (0, 0.3, 0)
    np.testing.assert_allclose(mirror(mirror(low)), low)
    np.testing.assert_allclose(STEPS[step](mirror(low)), mirror(STEPS[step](low)), atol=1e-7)


def test_bones_have_their_median_lengths_and_the_second_time_changes_nothing(
    shaken: np.ndarray,
) -> None:
    once = constant_bones(shaken, FPS, HUMANML3D)
    lengths = np.linalg.norm(bones(once), axis=-1)
    medians = np.median(np.linalg.norm(bones(shaken), axis=-1), axis=0)
    np.testing.assert_allclose(lengths, np.broadcast_to(medians, lengths.shape), rtol=1e-9)
    np.testing.assert_allclose(constant_bones(once, FPS, HUMANML3D), once, atol=1e-9)


def test_bones_of_a_larger_body_are_as_much_longer(shaken: np.ndarray) -> None:
    found = constant_bones(2 * shaken, FPS, HUMANML3D)
    np.testing.assert_allclose(found, 2 * constant_bones(shaken, FPS, HUMANML3D), atol=1e-6)


# Floor


@pytest.mark.parametrize("height", [-0.8, -0.2, 0.0, 0.2, 1.5])
def test_one_who_stands_comes_to_the_same_height_from_anywhere(height: float) -> None:
    standing = figure(2)
    feet = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]
    standing[..., 1] += height - standing[:, feet, 1].min()
    found = align_floor(standing, FPS, HUMANML3D)
    left = np.sign(height) * 0.03  # what is tolerated in motion capture
    np.testing.assert_allclose(found[:, feet, 1].min(axis=1), left, atol=1e-9)
    np.testing.assert_allclose(found - found[:, :1], standing - standing[:, :1], atol=1e-9)


def test_no_body_is_below_the_floor_after_it(shaken: np.ndarray) -> None:
    lying = shaken[..., [0, 2, 1]] * (1, 0.2, 1) - (0, 0.3, 0)
    found = align_floor(lying, FPS, HUMANML3D)
    feet = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]
    others = [joint for joint in range(22) if joint not in feet]
    assert lying[:, others, 1].min() < -0.2
    assert found[:, others, 1].min() > -1e-9 and found[:, feet, 1].min() > -0.04 - 1e-9


def test_arms_are_found_by_their_names() -> None:
    names = [tuple(HUMANML3D.names[joint] for joint in arm) for arm in find_arms(HUMANML3D)]
    assert names == [
        (f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist") for side in ("left", "right")
    ]
    one = Skeleton("one", ("left_shoulder", "left_elbow", "left_wrist"), (-1, 0, 1),
                   np.array([[0, 1.0, 0], [0, -0.3, 0], [0, -0.3, 0]]))  # fmt: skip
    assert find_arms(one) == ((0, 1, 2),)
    blob = Skeleton("blob", ("pelvis",), (-1,), np.zeros((1, 3)))
    assert find_arms(blob) == ()
    below = np.array([[[0.0, -1, 0]]])
    np.testing.assert_array_equal(lift_hands(below, FPS, blob), below)


def test_hands_that_are_lifted_keep_their_arms_lengths_and_others_stay(shaken: np.ndarray) -> None:
    low = shaken - (0, 0.95, 0)
    arms = find_arms(HUMANML3D)
    wrists = [arm[2] for arm in arms]
    assert low[:, wrists, 1].min() < 0
    found = lift_hands(low, FPS, HUMANML3D)
    assert found[:, wrists, 1].min() > -1e-5
    rest = [joint for joint in range(22) if joint not in {j for arm in arms for j in arm[1:]}]
    np.testing.assert_array_equal(found[:, rest], low[:, rest])
    for shoulder, elbow, wrist in arms:
        for upper, lower in ((shoulder, elbow), (elbow, wrist)):
            before, after = (np.linalg.norm(x[:, lower] - x[:, upper], axis=-1)
                             for x in (low, found))  # fmt: skip
            np.testing.assert_allclose(after, before, rtol=1e-6)


# Smoothing


@pytest.mark.parametrize("deviation", [0.0, 0.3, 2.0, 50.0])
def test_means_keep_ends_and_straight_lines(deviation: float) -> None:
    time = np.arange(15.0)
    line = np.stack([3 - 2 * time, 0 * time + 7], axis=1)
    np.testing.assert_allclose(gaussian(line, deviation), line, atol=1e-9)
    noise = np.random.default_rng(0).normal(size=(15, 2))
    found = gaussian(noise, deviation)
    np.testing.assert_allclose(found[[0, -1]], noise[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(gaussian(noise[::-1], deviation), found[::-1], atol=1e-9)


def test_means_are_weighted_by_the_gaussian() -> None:
    impulse = np.zeros((41, 1))
    impulse[20] = 1
    found = gaussian(impulse, 2.0)[:, 0]
    np.testing.assert_allclose(found[21:26] / found[20], np.exp(-(np.arange(1, 6) ** 2) / 8))
    assert found.sum() == pytest.approx(1) and not found[:14].any()


def test_a_sum_is_smoothed_as_its_parts_are() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 30, 3))
    found = smooth(2 * a - b, FPS, 4.0)
    np.testing.assert_allclose(found, 2 * smooth(a, FPS, 4.0) - smooth(b, FPS, 4.0), atol=1e-12)


@pytest.mark.parametrize("reach_", [1, 3, 10])
def test_an_envelope_of_a_constant_is_the_constant_and_of_a_peak_reaches_it(reach_: int) -> None:
    np.testing.assert_allclose(upper_envelope(np.full(9, 0.3), reach_), 0.3)
    peak = np.zeros(61)
    peak[30] = 1.0
    found = upper_envelope(peak, reach_)
    assert found[30] == pytest.approx(1) and found.max() <= 1 + 1e-12
    assert not found[: 30 - 2 * reach_].any() and not found[31 + 2 * reach_ :].any()
    np.testing.assert_allclose(found, found[::-1], atol=1e-12)


# Legs


@pytest.mark.parametrize("skeleton", [HUMANML3D, KIT])
def test_legs_go_from_hip_to_toes(skeleton: Skeleton) -> None:
    legs = find_legs(skeleton)
    assert len(legs) == 2
    for leg, side in zip(legs, ("left", "right"), strict=True):
        chain = [skeleton.names[joint] for joint in (leg.hip, leg.knee, leg.ankle)]
        assert chain == [f"{side}_{name}" for name in ("hip", "knee", "ankle")]
        assert skeleton.parents[leg.ankle] == leg.knee and skeleton.parents[leg.knee] == leg.hip
        assert set(leg.pivots) <= {leg.ankle, *leg.below}


def test_a_leg_at_its_goal_stays_and_one_too_far_is_stretched() -> None:
    hip, knee, ankle = (np.array([point]) for point in ([0.0, 1, 0], [0, 0.6, 0.2], [0, 0.2, 0]))
    ahead = np.array([[0.0, 0, 1]])
    for found, old in zip(reach(hip, knee, ankle, ankle, ahead), (knee, ankle), strict=True):
        np.testing.assert_allclose(found, old, atol=1e-5)
    thigh, shank = np.linalg.norm(knee - hip), np.linalg.norm(ankle - knee)
    for direction in np.array([[[0, -1.0, 0]], [[0.6, -0.8, 0]], [[0, -0.6, 0.8]]]):
        bent, foot = reach(hip, knee, ankle, hip + 5 * direction, ahead)
        np.testing.assert_allclose(foot, hip + (thigh + shank) * direction, atol=1e-9)
        np.testing.assert_allclose(bent, hip + thigh * direction, atol=1e-5)


def test_goals_within_reach_are_met_by_bones_of_their_lengths() -> None:
    generator = np.random.default_rng(1)
    hip, ahead = np.zeros((200, 3)), np.tile([0.0, 0, 1], (200, 1))
    knee, ankle = (hip + np.array(down) for down in ([0, -0.4, 0.05], [0, -0.8, 0]))
    directions = generator.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    goal = directions * generator.uniform(0.1, 0.8, (200, 1))
    bent, foot = reach(hip, knee, ankle, goal, ahead)
    np.testing.assert_allclose(foot, goal, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(bent, axis=1), np.linalg.norm(knee, axis=1))
    shank = np.linalg.norm(ankle - knee, axis=1)
    np.testing.assert_allclose(np.linalg.norm(foot - bent, axis=1), shank)


def test_knees_that_were_not_turned_backward_are_left_alone(shaken: np.ndarray) -> None:
    np.testing.assert_array_equal(keep_knee_direction(shaken, shaken, HUMANML3D), shaken)
    turned = shaken.copy()
    for leg in find_legs(HUMANML3D):
        middle = (shaken[:, leg.hip] + shaken[:, leg.ankle]) / 2
        turned[:, leg.knee] = 2 * middle - shaken[:, leg.knee]
    kept = keep_knee_direction(turned, shaken, HUMANML3D)
    assert not np.allclose(kept, turned)
    for leg in find_legs(HUMANML3D):
        for end in (leg.hip, leg.ankle):
            lengths = (np.linalg.norm(x[:, leg.knee] - x[:, end], axis=-1) for x in (kept, turned))
            np.testing.assert_allclose(next(lengths), next(lengths), rtol=1e-9)
