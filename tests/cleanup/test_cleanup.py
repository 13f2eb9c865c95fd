"""Clean-up: feet stand still, legs bend softly and forward, all else stays where it was."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cleanup import CleanUp, CleanUpWarning, clean
from latentmotion.cleanup.bones import constant_bones
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.floor import Floor, align_floor, land_walkers, lift_feet, lift_hands
from latentmotion.cleanup.foot_lock import FootLock, lock_feet
from latentmotion.cleanup.leg_ik import find_legs, keep_knee_direction, reach
from latentmotion.cleanup.pipeline import ground_path, in_place
from latentmotion.cleanup.smoothing import smooth, upper_envelope
from latentmotion.cli.main import main
from latentmotion.errors import InputError
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration, skating_ratio
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.measure.signals import spans
from latentmotion.motion import Motion

NAMES = HUMANML3D.names
FPS = 20.0
FEET = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]
LEGS = [NAMES.index(f"{s}_{n}") for s in ("left", "right") for n in ("knee", "ankle", "foot")]
NO_STEPS = CleanUp(smooth=False, bones=False, floor=False, feet=False)


def standing(frames: int = 80) -> np.ndarray:
    """A person who stands with the knees a little bent, toes on the floor."""
    joints = HUMANML3D.rest_joints()
    joints[:, 1] -= joints[FEET, 1].min()
    for leg in find_legs(HUMANML3D):
        hip, knee, ankle = (joints[j].copy() for j in (leg.hip, leg.knee, leg.ankle))
        goal = ankle + np.array([0, 0.03, 0])
        ahead = np.array([[0.0, 0, 1]])
        found = reach(*(x[None] for x in (hip, knee, ankle, goal)), ahead)
        joints[leg.knee], joints[leg.ankle] = found[0][0], found[1][0]
        joints[list(leg.below)] += goal - ankle
    joints[:, 1] -= 0.03
    return np.repeat(joints[None], frames, axis=0)


def slider(speed: float = 0.2, frames: int = 80) -> np.ndarray:
    """The same person, carried forward by a conveyor belt that sways."""
    joints = standing(frames)
    time = np.arange(frames) / FPS
    joints[:, FEET, 2] += 0.05 * np.sin(2 * np.pi * 0.5 * time)[:, None] * speed / 0.16
    legs = find_legs(HUMANML3D)
    for leg in legs:
        parts = [joints[:, j] for j in (leg.hip, leg.knee, leg.ankle)]
        knee = standing(frames)[:, leg.knee]
        ankle = standing(frames)[:, leg.ankle]
        ahead = np.tile((0.0, 0, 1), (frames, 1))
        joints[:, leg.knee], joints[:, leg.ankle] = reach(parts[0], knee, ankle, parts[2], ahead)
    return joints


def bone_lengths(joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(joints[:, 1:] - joints[:, list(HUMANML3D.parents[1:])], axis=-1)


def knees_ahead(joints: np.ndarray) -> np.ndarray:
    """How far each knee is ahead of the line from hip to ankle, seen across the hips."""
    across = joints[:, 1] - joints[:, 2]
    found = []
    for leg in find_legs(HUMANML3D):
        hip, knee, ankle = (joints[:, j] for j in (leg.hip, leg.knee, leg.ankle))
        ahead = np.cross(across, hip - ankle)
        ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
        found.append(((knee - hip) * ahead).sum(axis=-1))
    return np.stack(found, axis=1)


def swaying(way: float = 0.06, frames: int = 80) -> np.ndarray:
    """A person who stands on ice: all of them sways, feet and body alike."""
    joints = standing(frames)
    joints[..., 0] += way * np.sin(2 * np.pi * 0.5 * np.arange(frames) / FPS)[:, None]
    return joints


def test_smoothing_keeps_ends_and_cubics_and_takes_out_shaking():
    time = np.linspace(-1, 1, 60)[:, None]
    cubic = np.concatenate([time**3 - time, time**2, 0 * time + 2], axis=1)
    smoothed = smooth(cubic, FPS, 5.0)
    np.testing.assert_allclose(smoothed[[0, -1]], cubic[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(smoothed[12:-12], cubic[12:-12], atol=1e-3)
    shaking = (-1.0) ** np.arange(60)[:, None]
    assert np.abs(smooth(shaking, FPS, 5.0)[5:-5]).max() < 0.25


def test_smoothing_has_the_cutoff_that_it_says():
    wave = np.sin(2 * np.pi * 5.0 * np.arange(4001) / 200)[:, None]
    assert np.abs(smooth(wave, 200.0, 5.0)[1000:3000]).max() == pytest.approx(0.75, abs=0.01)


def test_upper_envelope_is_nowhere_below():
    values = np.random.default_rng(0).normal(size=50)
    assert (upper_envelope(values, 3) >= values - 1e-12).all()
    np.testing.assert_allclose(upper_envelope(np.full(9, 2.0), 2), 2.0)


def test_bones_get_one_length_and_joints_stay_near():
    generator = np.random.default_rng(0)
    joints = standing() + generator.normal(scale=0.01, size=(80, len(NAMES), 3))
    fixed = constant_bones(joints, FPS, HUMANML3D)
    assert np.ptp(bone_lengths(fixed), axis=0).max() < 1e-9
    assert np.linalg.norm(fixed - joints, axis=-1).mean() < 0.015
    np.testing.assert_allclose(constant_bones(fixed, FPS, HUMANML3D), fixed, atol=1e-9)


def test_a_collapsed_bone_points_where_it_did_before_and_after():
    joints = standing()
    elbow, wrist = NAMES.index("left_elbow"), NAMES.index("left_wrist")
    joints[40, wrist] = joints[40, elbow] + (0, 1e-5, 0)
    fixed = constant_bones(joints, FPS, HUMANML3D)
    bones = fixed[:, wrist] - fixed[:, elbow]
    assert np.linalg.norm(bones[40] - bones[30]) < 0.03


def test_contacts_of_one_who_stands_then_jumps():
    joints = standing()
    joints[30:50, :, 1] += 0.4 * np.sin(np.linspace(0, np.pi, 20))[:, None]
    found = foot_contacts(joints, FPS, HUMANML3D)
    assert found[:28].all() and found[52:].all()
    assert not found[34:46].any()


def test_contacts_have_hysteresis_and_forget_blinks():
    joints = standing()
    joints[40, FEET, 1] += 0.2
    assert foot_contacts(joints, FPS, HUMANML3D)[30].all()
    high = standing()
    high[..., 1] += 0.3
    high[40, FEET, 1] -= 0.3
    assert not foot_contacts(high, FPS, HUMANML3D)[:, 1::2].any()


def test_spans():
    assert list(spans(np.array([True, False, True, True]))) == [(0, 1), (2, 4)]
    assert list(spans(np.zeros(3, dtype=bool))) == []


def test_two_bones_reach_their_goal_and_keep_their_lengths():
    generator = np.random.default_rng(1)
    hip, knee, ankle = generator.normal(size=(3, 50, 3))
    goal = ankle + 0.05 * generator.normal(size=(50, 3))
    ahead = generator.normal(size=(50, 3))
    new_knee, new_ankle = reach(hip, knee, ankle, goal, ahead)
    thigh, shank = (np.linalg.norm(x, axis=-1) for x in (knee - hip, ankle - knee))
    np.testing.assert_allclose(np.linalg.norm(new_knee - hip, axis=-1), thigh, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(new_ankle - new_knee, axis=-1), shank, atol=1e-9)
    possible = np.linalg.norm(goal - hip, axis=-1)
    possible = (possible < thigh + shank) & (possible > np.abs(thigh - shank))
    np.testing.assert_allclose(new_ankle[possible], goal[possible], atol=1e-9)
    same = reach(hip, knee, ankle, ankle, ahead)
    np.testing.assert_allclose(same[0], knee, atol=1e-5)


@pytest.mark.parametrize("same", [(1, 2, 4, 5, 7, 8), (4, 5, 7, 8), range(22)])
@pytest.mark.filterwarnings("error:.*:RuntimeWarning")
def test_bones_without_a_length_divide_by_nothing(same):
    joints = np.random.default_rng(0).normal(size=(30, 22, 3)).astype("f4")
    joints[:, list(same)] = joints[:, [1]]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CleanUpWarning)
        assert np.isfinite(clean(Motion(joints)).joints).all()


def test_a_straight_leg_bends_forward_even_if_it_was_bent_back_a_little():
    hip, ankle = np.array([[0.0, 0.9, 0]]), np.array([[0.0, 0, 0]])
    for back in (0.0, -0.005):
        knee = np.array([[0.0, 0.45, back]])
        goal = np.array([[0.0, 0.05, 0]])
        bent, _ = reach(hip, knee, ankle, goal, np.array([[0.0, 0, 1]]))
        assert bent[0, 2] > 0.1


def test_feet_that_slide_stand_still_and_the_rest_hardly_moves():
    joints = slider()
    before = foot_sliding(joints, FPS)
    motion = clean(Motion(joints), replace(NO_STEPS, feet=True))
    assert before > 0.05
    assert foot_sliding(motion.joints, FPS) < 0.02 * before
    rest = [j for j in range(len(NAMES)) if j not in LEGS]
    assert np.linalg.norm(motion.joints - joints, axis=-1)[:, rest].mean() < 0.02
    np.testing.assert_allclose(bone_lengths(motion.joints), bone_lengths(joints), atol=1e-5)


def steps_forward() -> np.ndarray:
    """The left foot stands sliding, swings forward for half a second, stands sliding."""
    joints = standing(90)
    swing = np.clip((np.arange(90) - 40) / 10, 0, 1)
    ahead = 0.25 * swing**2 * (3 - 2 * swing) + 0.1 * np.arange(90) / FPS * (swing == 0)
    ahead = np.where(swing > 0, ahead + 0.1 * 40 / FPS, ahead) - 0.2
    up = 0.1 * np.sin(np.pi * swing)
    leg = find_legs(HUMANML3D)[0]
    goal = joints[:, leg.ankle] + np.stack([0 * up, up, ahead], axis=-1)
    knee = reach(
        joints[:, leg.hip],
        joints[:, leg.knee],
        joints[:, leg.ankle],
        goal,
        np.tile((0.0, 0, 1), (90, 1)),
    )
    foot = joints[:, list(leg.below)] - joints[:, [leg.ankle]]
    joints[:, leg.knee], joints[:, leg.ankle] = knee
    joints[:, list(leg.below)] = joints[:, [leg.ankle]] + foot
    return joints


def test_blends_are_soft_and_knees_stay_in_front():
    joints = steps_forward()
    contacts = foot_contacts(joints, FPS, HUMANML3D)
    locked = lock_feet(joints, contacts, FPS, HUMANML3D, FootLock())
    assert foot_sliding(locked, FPS) < 0.2 * foot_sliding(joints, FPS)

    def most(values: np.ndarray) -> float:
        acceleration = np.diff(values[:, LEGS], n=2, axis=0) * FPS**2
        return float(np.linalg.norm(acceleration, axis=-1).max())

    assert most(locked) < 1.5 * most(joints)
    assert knees_ahead(locked).min() > -1e-6


def test_a_foot_that_slides_far_takes_steps():
    joints = standing(120)
    joints[:, :, 2] += 0.3 * np.arange(120)[:, None] / FPS
    locked = clean(Motion(joints), replace(NO_STEPS, feet=True)).joints
    assert foot_sliding(locked, FPS) < 0.1 * foot_sliding(joints, FPS)
    assert locked[:, FEET, 1].max() > 0.029
    shift = np.linalg.norm(locked - joints, axis=-1)[:, FEET]
    assert shift.max() < 0.3


def test_a_body_that_drifts_with_its_feet_stops_and_does_not_lean():
    joints = swaying()
    locked = clean(Motion(joints), replace(NO_STEPS, feet=True)).joints
    assert foot_sliding(locked, FPS) < 0.02 * foot_sliding(joints, FPS)
    assert np.ptp(locked[:, 0, 0]) < 0.6 * np.ptp(joints[:, 0, 0])
    stiff = replace(NO_STEPS, feet=True, lock=FootLock(stay=1e6))
    leaning = [
        np.ptp(j[:, 0, 0] - j[:, 7, 0]) for j in (locked, clean(Motion(joints), stiff).joints)
    ]
    assert leaning[0] < 0.6 * leaning[1]


def test_feet_that_slide_apart_leave_the_body_where_it_is():
    joints = standing()
    apart = 0.04 * np.sin(np.pi * np.arange(80) / FPS)
    for leg, side in zip(find_legs(HUMANML3D), (1, -1), strict=True):
        way = side * apart[:, None, None] * np.array([1.0, 0, 0])
        joints[:, [leg.knee, leg.ankle, *leg.below]] += way * np.array([0.5, 1, 1])[:, None]
    locked = lock_feet(joints, np.ones((80, 4), dtype=bool), FPS, HUMANML3D, FootLock())
    np.testing.assert_allclose(locked[:, 0, ::2], joints[:, 0, ::2], atol=1e-6)
    assert np.ptp(locked[:, FEET, 0], axis=0).max() < 0.015


def test_a_foot_that_comes_to_rest_is_left_as_it_lands_and_takes_off():
    joints = standing()
    time = np.arange(80) / FPS
    joints[..., 2] += (0.03 * np.where(time < 1, (1 - time) ** 2, 0))[:, None]
    locked = lock_feet(joints, np.ones((80, 4), dtype=bool), FPS, HUMANML3D, FootLock())
    np.testing.assert_allclose(locked, joints, atol=1e-3)


def test_a_leg_nears_straight_without_a_snap():
    joints = standing()
    contacts = np.ones((80, 4), dtype=bool)
    joints[..., 2] += 0.5 * np.linspace(-1, 1, 80)[:, None] ** 3
    locked = lock_feet(joints, contacts, FPS, HUMANML3D, FootLock(slip=9.0, stay=1e6))
    for leg in find_legs(HUMANML3D):
        whole = bone_lengths(locked)[0, [leg.knee - 1, leg.ankle - 1]].sum()
        length = np.linalg.norm(locked[:, leg.ankle] - locked[:, leg.hip], axis=-1)
        assert length.max() < 0.997 * whole
        assert np.abs(np.diff(length, n=2)).max() < 0.005


def test_knees_are_turned_ahead_about_the_line_from_hip_to_ankle():
    joints = standing(3)
    moved = joints.copy()
    for leg in find_legs(HUMANML3D):
        moved[:, leg.knee, 2] = 2 * moved[:, leg.hip, 2] - moved[:, leg.knee, 2] - 0.01
        moved[:, leg.knee, 0] += 0.02
    kept = keep_knee_direction(moved, joints, HUMANML3D)
    assert knees_ahead(moved).max() < -0.01
    np.testing.assert_allclose(knees_ahead(kept), 0, atol=1e-9)
    np.testing.assert_allclose(bone_lengths(kept), bone_lengths(moved), atol=1e-9)
    np.testing.assert_allclose(keep_knee_direction(joints, joints, HUMANML3D), joints, atol=1e-9)


def test_bones_of_one_who_lies_down_with_thighs_too_long_turn_no_knee_backward():
    """As the starter draws it: pelvis near the floor, knees up, a thigh a third too long."""
    joints = standing()
    left, right = find_legs(HUMANML3D)
    joints[30:50, :, 1] -= joints[30, 0, 1] - 0.2
    for leg, long in ((left, 1.35), (right, 0.8)):
        hip = joints[30:50, leg.hip]
        joints[30:50, leg.knee] = hip + 0.42 * long * np.array([0.15, 0.55, 0.82])
        joints[30:50, leg.ankle] = hip + np.array([0.1, -0.1, 0.45])
        joints[30:50, list(leg.below)] = joints[30:50, [leg.ankle]] + (0, -0.03, 0.13)
    fixed = constant_bones(joints, FPS, HUMANML3D)
    before, after = knees_ahead(joints), knees_ahead(fixed)
    assert (after >= np.minimum(before, 0) - 1e-6).all()
    hips = [j[:, left.hip] - j[:, right.hip] for j in (joints, fixed)]
    cosine = (hips[0] * hips[1]).sum(-1) / np.prod(np.linalg.norm(hips, axis=-1), axis=0)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 30


def test_an_arm_of_twice_its_length_is_shortened_with_a_warning():
    joints = standing()
    shoulder, elbow, wrist = (NAMES.index(f"left_{n}") for n in ("shoulder", "elbow", "wrist"))
    reach_up = np.array([0.3, 0.95, 0])
    joints[30:50, elbow] = joints[30:50, shoulder] + 0.5 * reach_up
    joints[30:50, wrist] = joints[30:50, shoulder] + 1.05 * reach_up
    with pytest.warns(CleanUpWarning, match=r"left_wrist was moved by \d+ cm at [12]\.\d s"):
        fixed = clean(Motion(joints), replace(NO_STEPS, bones=True)).joints
    assert np.ptp(bone_lengths(fixed), axis=0).max() < 1e-5
    assert np.linalg.norm(fixed - joints, axis=-1)[:, LEGS].max() < 0.03


def test_a_pelvis_comes_down_where_a_leg_is_too_short():
    joints = standing()
    contacts = np.ones((80, 4), dtype=bool)
    away = 0.25 * np.sin(2 * np.pi * np.arange(80) / 80)[:, None] * (0, 0, 1)
    rest = [j for j in range(len(NAMES)) if j not in LEGS]
    joints[:, rest] += away[:, None]
    for leg in find_legs(HUMANML3D):
        joints[:, [leg.knee, leg.ankle, *leg.below]] += away[:, None]
    locked = lock_feet(joints, contacts, FPS, HUMANML3D, FootLock(slip=1.0, stay=1e6))
    drop = joints[:, 0, 1] - locked[:, 0, 1]
    assert 0 < drop.max() <= FootLock().lower + 1e-9
    np.testing.assert_allclose(bone_lengths(locked), bone_lengths(joints), atol=1e-9)


def test_floor_under_feet_far_above_or_below_is_moved_and_jumps_are_kept():
    joints = standing()
    joints[30:50, :, 1] += 0.4 * np.sin(np.linspace(0, np.pi, 20))[:, None]
    np.testing.assert_allclose(align_floor(joints, FPS, HUMANML3D), joints, atol=1e-9)
    for off in (-0.1, 0.1):
        aligned = align_floor(joints + np.array([0, off, 0]), FPS, HUMANML3D)
        height = aligned[:20, FEET, 1].min()
        assert abs(height) <= Floor().tolerance + 1e-9
        leap = aligned[40, 0, 1] - aligned[10, 0, 1]
        assert leap == pytest.approx(joints[40, 0, 1] - joints[10, 0, 1], abs=1e-6)


@pytest.mark.parametrize(("height", "lowest"), [(0.5, 0.1), (-0.3, 0.0)])
def test_a_lying_body_neither_hovers_nor_sinks(height: float, lowest: float):
    lying = standing(100)[..., [0, 2, 1]] * (1, 1, -1)
    lying = lying - (0, lying[..., 1].min(), 0) + (0, min(height, 0.2), 0)
    aligned = align_floor(lying, FPS, HUMANML3D)
    assert aligned[..., 1].min() == pytest.approx(lowest, abs=0.02)


def test_hands_below_the_floor_are_put_onto_it():
    joints = standing()
    wrist, elbow = NAMES.index("left_wrist"), NAMES.index("left_elbow")
    joints[..., 1] -= joints[0, elbow, 1] - 0.1
    joints[30:40, wrist] = joints[30:40, elbow] + (0, -0.2699, 0)
    lifted = lift_hands(joints, FPS, HUMANML3D)
    assert lifted[:, wrist, 1].min() > -1e-9
    np.testing.assert_allclose(bone_lengths(lifted), bone_lengths(joints), atol=1e-9)


def test_a_body_comes_down_that_is_raised_and_a_jump_stays():
    joints, time = standing(), np.arange(80) / FPS
    raised, jumps = joints.copy(), joints.copy()
    raised[..., 1] += 0.1 * np.sin(np.pi * np.clip((time - 1) / 1.2, 0, 1))[:, None]
    jumps[..., 1] += np.maximum(0, 2.5 * (time - 1) - 9.81 / 2 * (time - 1) ** 2)[:, None]
    landed = land_walkers(raised, FPS, HUMANML3D)
    assert landed[..., 1].min(axis=1).max() < 0.045 < raised[..., 1].min(axis=1).max()
    np.testing.assert_allclose(bone_lengths(landed), bone_lengths(joints), atol=1e-9)
    np.testing.assert_array_equal(land_walkers(jumps, FPS, HUMANML3D), jumps)


def test_feet_below_the_floor_are_lifted_by_their_legs():
    joints = standing()
    joints[30:40, ..., 1] -= 0.05
    lifted = lift_feet(joints, FPS, HUMANML3D, 0.0, np.ones(80))
    assert lifted[:, FEET, 1].min() > -1e-9
    np.testing.assert_allclose(bone_lengths(lifted), bone_lengths(joints), atol=1e-9)
    others = [joint for joint in range(22) if joint not in LEGS]
    np.testing.assert_array_equal(lifted[:, others], joints[:, others])
    np.testing.assert_array_equal(lifted[:20], joints[:20])


def test_in_place_takes_the_path_away():
    joints = standing()
    joints[..., 2] += np.arange(80)[:, None] / FPS
    np.testing.assert_allclose(in_place(joints, FPS), standing(), atol=1e-9)
    np.testing.assert_allclose(ground_path(joints, FPS)[:, 2], joints[:, 0, 2], atol=1e-9)
    assert np.abs(clean(Motion(joints), CleanUp(in_place=True)).joints[:, 0, [0, 2]]).max() < 1e-3


def test_everything_together_on_one_who_shakes_and_slides():
    generator = np.random.default_rng(0)
    joints = slider() + generator.normal(scale=0.004, size=(80, len(NAMES), 3))
    motion = Motion(joints, FPS, caption="x", metadata={"seed": 1})
    cleaned = motion.cleaned()
    assert (cleaned.caption, cleaned.metadata, len(cleaned)) == ("x", {"seed": 1}, 80)
    assert foot_sliding(cleaned.joints, FPS) < 0.2 * foot_sliding(joints, FPS)
    assert skating_ratio(cleaned.joints, FPS) <= skating_ratio(joints, FPS)
    assert jitter(cleaned.joints, FPS) < jitter(joints, FPS)
    assert penetration(cleaned.joints) < 1e-4
    assert np.ptp(bone_lengths(cleaned.joints), axis=0).max() < 1e-5


def test_one_who_stands_still_is_left_alone():
    joints = standing()
    np.testing.assert_allclose(clean(Motion(joints)).joints, joints, atol=1e-4)


def test_a_turned_figure_is_cleaned_alike():
    turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0.0]])
    straight = clean(Motion(slider())).joints
    turned = clean(Motion(slider() @ turn.T)).joints
    np.testing.assert_allclose(turned, straight @ turn.T, atol=1e-4)


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
def test_very_short_motions(frames: int):
    cleaned = clean(Motion(slider(frames=frames)))
    assert cleaned.joints.shape == (frames, len(NAMES), 3)
    assert np.isfinite(cleaned.joints).all()


def test_another_skeleton_and_frame_rate():
    joints = np.repeat(KIT.rest_joints()[None], 30, axis=0)
    joints[..., 1] -= joints[..., 1].min()
    joints[..., 0] += 0.008 * np.arange(30)[:, None]
    cleaned = clean(Motion(joints, 12.5, KIT))
    feet = [*KIT.left_foot, *KIT.right_foot]
    assert np.abs(np.diff(cleaned.joints[5:15, feet, 0], axis=0)).max() < 0.0005


def test_a_skeleton_without_feet_is_cleaned_otherwise_and_warned_of():
    worm = Skeleton("worm", ("root", "tip"), (-1, 0), np.array([[0, 0, 0], [0, 0.3, 0.0]]))
    joints = np.repeat(worm.rest_joints()[None], 10, axis=0)
    joints += np.random.default_rng(0).normal(scale=0.01, size=joints.shape)
    with pytest.warns(CleanUpWarning, match="'worm' names no feet"):
        cleaned = clean(Motion(joints, 20.0, worm))
    assert jitter(cleaned.joints, 20.0) < jitter(joints, 20.0)
    clean(Motion(joints, 20.0, worm), CleanUp(feet=False))


def test_bad_input_is_refused():
    joints = standing()
    joints[7, 3, 1] = np.nan
    with pytest.raises(InputError, match="first in frame 7"):
        Motion(joints)
    with pytest.raises(InputError, match="frames"):
        Motion(joints[:0])
    with pytest.raises(InputError, match="cutoff"):
        CleanUp(cutoff=float("nan"))


def test_the_command_cleans_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    Motion(slider(frames=30)).save(tmp_path / "in.npz")
    outputs = [str(tmp_path / name) for name in ("out.npz", "out.bvh")]
    main(["clean", str(tmp_path / "in.npz"), "-o", *outputs, "--no-smooth"])
    assert capsys.readouterr().out.count("wrote") == 2
    cleaned = Motion.load(tmp_path / "out.npz")
    assert foot_sliding(cleaned.joints, FPS) < 0.2 * foot_sliding(slider(frames=30), FPS)
    again = Motion.load(tmp_path / "out.bvh")
    np.testing.assert_allclose(again.joints, cleaned.joints, atol=1e-3)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["in.npz", "-o", "out.foo"], "ending '.foo'"),
        (["none.npz", "-o", "out.npz"], "there is no file"),
        (["in.npz", "-o", "out.npz", "--cutoff", "0"], "cutoff 0.0"),
        (["broken.npz", "-o", "out.npz"], "broken.npz"),
        (["nan.npy", "-o", "out.npz"], "NaN"),
    ],
)
def test_the_command_refuses_and_writes_nothing(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Motion(slider(frames=10)).save("in.npz")
    Path("broken.npz").write_bytes(b"no motion")
    np.save("nan.npy", np.full((4, 22, 3), np.nan, dtype=np.float32))
    before = sorted(tmp_path.iterdir())
    with pytest.raises(SystemExit, match="2"):
        main(["clean", *words])
    assert said in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def locked(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets nobody write the file of that name, as a program does that has it open on Windows."""
    replace_file = Path.replace

    def refuse(self: Path, target: Path) -> Path:
        if Path(target).name == name:
            raise PermissionError(13, "Permission denied")
        return replace_file(self, target)

    monkeypatch.setattr(Path, "replace", refuse)


@pytest.mark.parametrize("words", [["clean", "in.npz"], ["generate", "a person walks"]])
def test_a_locked_file_survives_and_nothing_is_half_written(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Motion(slider(frames=10)).save("in.npz")
    Path("out.bvh").write_text("dear work")
    locked("out.bvh", monkeypatch)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(SystemExit, match="2"):
        main([*words, "-o", "out.bvh"])
    assert "cannot write out.bvh: Permission denied" in capsys.readouterr().err
    assert Path("out.bvh").read_text() == "dear work"
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
def test_a_read_only_file_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    Motion(slider(frames=10)).save(tmp_path / "in.npz")
    (tmp_path / "out.bvh").write_text("dear work")
    (tmp_path / "out.bvh").chmod(0o444)
    with pytest.raises(SystemExit, match="2"):
        main(["clean", str(tmp_path / "in.npz"), "-o", str(tmp_path / "out.bvh")])
    assert "read-only" in capsys.readouterr().err
    assert (tmp_path / "out.bvh").read_text() == "dear work"


def test_a_folder_in_place_of_the_file_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    Motion(slider(frames=10)).save(tmp_path / "in.npz")
    (tmp_path / "out.bvh").mkdir()
    with pytest.raises(SystemExit, match="2"):
        main(["clean", str(tmp_path / "in.npz"), "-o", str(tmp_path / "out.bvh")])
    assert "cannot write" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.npz", "out.bvh"]


def test_a_body_that_hovers_comes_down_and_one_on_stairs_stays():
    rising = standing(120)
    rising[40:, :, 1] += 0.1  # as a generated kick: its foot leaves the floor and never returns
    aligned = align_floor(rising, FPS, HUMANML3D)
    assert aligned[80:, FEET, 1].min(axis=1).max() <= Floor().tolerance + 1e-6
    stairs = standing(120)
    stairs[40:, :, 1] += 0.4
    np.testing.assert_allclose(align_floor(stairs, FPS, HUMANML3D)[90:], stairs[90:], atol=1e-3)
    without_stairs = align_floor(stairs, FPS, HUMANML3D, on_floor=np.array(True))
    assert without_stairs[60:, FEET, 1].min(axis=1).max() <= Floor().tolerance + 1e-6
    down = standing(120)
    down[:80, :, 1] += 0.6
    np.testing.assert_allclose(align_floor(down, FPS, HUMANML3D)[:30], down[:30], atol=1e-3)
    begun_above = standing(120)
    begun_above[:60, :, 1] += 0.4
    aligned = align_floor(begun_above, FPS, HUMANML3D)
    assert aligned[:30, FEET, 1].min(axis=1).max() <= Floor().tolerance + 1e-3
