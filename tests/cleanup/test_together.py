"""Clean-up of many at once: bones, feet and motions are what they are one after another."""

from __future__ import annotations

import re

import numpy as np
import pytest

from latentmotion.arrays import cross, quantile
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.cleanup.bones import constant_bones
from latentmotion.cleanup.contacts import Contacts, foot_contacts, foot_stances, velocity
from latentmotion.cleanup.foot_lock import drift_correction
from latentmotion.cleanup.leg_ik import find_legs, reach
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.kinematics.rotations import quaternion_between, quaternion_rotate
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.motion import Motion
from tests.support.walker import walker

FPS = 20.0


def shaken(frames: int, seed: int) -> np.ndarray:
    """Someone who walks and slides, every joint off by some 8 mm."""
    joints = walker(frames).joints()
    noise = np.random.default_rng(seed).normal(0, 0.008, joints.shape)
    slide = 0.05 * np.sin(np.arange(frames) / 7 + seed)[:, None, None] * (1, 0, 0.5)
    return joints + noise + slide


def test_motions_of_a_batch_are_what_they_are_alone() -> None:
    lengths = [50, 31, 50, 1, 50, 2, 31, 21, 44, 20, 97]
    motions = [Motion(shaken(n, seed), FPS, caption=str(seed)) for seed, n in enumerate(lengths)]
    lying = shaken(50, 9)[..., [0, 2, 1]] * (1, 0.3, 1)
    motions += [Motion(lying, FPS), Motion(shaken(50, 3), 30.0)]
    motions.append(Motion(np.repeat(KIT.rest_joints()[None], 50, axis=0), 12.5, KIT))
    for steps in (CleanUp(), CleanUp(in_place=True)):
        for alone, together in zip(motions, clean_batch(motions, steps), strict=True):
            assert together.caption == alone.caption
            np.testing.assert_allclose(together.joints, alone.cleaned(steps).joints, atol=1e-6)
    assert clean_batch([]) == []


def one_after_another(joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Bones of one length as they are defined: every bone pulls, one after the other."""
    parents, moved = skeleton.parents, joints.copy()
    trunk = {0} | {p for p in parents if parents.count(p) > 1}
    for joint in sorted(trunk):
        while joint > 0:
            trunk, joint = trunk | {joint}, parents[joint]
    ease = [0.1 if j in trunk or p in trunk else 1.0 for j, p in enumerate(parents)]
    bones = joints - joints[:, np.maximum(parents, 0)]
    length = np.median(np.linalg.norm(bones, axis=-1), axis=0)
    for _ in range(10):
        for joint, parent in list(enumerate(parents))[1:]:
            bone = moved[:, joint] - moved[:, parent]
            pull = bone * (1 - length[joint] / np.linalg.norm(bone, axis=-1))[:, None]
            share = ease[joint] / (ease[joint] + ease[parent])
            moved[:, joint] -= share * pull
            moved[:, parent] += (1 - share) * pull
    even = moved.copy()
    for joint, parent in list(enumerate(parents))[1:]:
        bone = moved[:, joint] - moved[:, parent]
        unit = bone / np.linalg.norm(bone, axis=-1, keepdims=True)
        even[:, joint] = even[:, parent] + length[joint] * unit
    return even


@pytest.mark.parametrize("skeleton", [HUMANML3D, KIT])
def test_bones_that_pull_together_pull_as_one_after_another(skeleton: Skeleton) -> None:
    joints = np.repeat(skeleton.rest_joints()[None], 12, axis=0)
    joints[:, [leg.knee for leg in find_legs(skeleton)], 2] += 0.1  # knees well ahead
    joints += np.random.default_rng(0).normal(0, 0.004, joints.shape)
    found = constant_bones(joints, FPS, skeleton)
    np.testing.assert_allclose(found, one_after_another(joints, skeleton), atol=1e-9)


def test_contacts_begin_strictly_last_loosely_and_are_not_short() -> None:
    joints = np.zeros((400, len(HUMANML3D), 3))
    wander = gaussian(np.random.default_rng(0).normal(size=(400, 4, 3)), 1.0)
    joints[:, [*HUMANML3D.left_foot, *HUMANML3D.right_foot]] = 0.06 * wander
    settings = Contacts(shortest=0.2)
    found = foot_contacts(joints, FPS, HUMANML3D, settings)
    feet = joints[:, [*HUMANML3D.left_foot, *HUMANML3D.right_foot]]
    low = np.percentile(feet[..., 1], 5, axis=0).reshape(2, 2).min(axis=0)
    height, move = feet[..., 1] - np.clip([*low, *low], 0, 0.12), np.gradient(feet, axis=0) * FPS
    across, climb = np.hypot(move[..., 0], move[..., 2]), np.abs(move[..., 1])
    for foot in range(4):
        stands, expected = False, np.zeros(400, bool)
        for frames in (range(400), reversed(range(400))):  # a contact lasts to either side
            stands = False
            for t in frames:
                values, n = (height[t, foot], across[t, foot], climb[t, foot]), int(stands)
                limits = settings.height[n], settings.speed[n], settings.climb[n]
                stands = all(value < limit for value, limit in zip(values, limits, strict=True))
                expected[t] |= stands
        text = "".join("x" if stands else "." for stands in expected)
        text = re.sub(r"(?<=x)\.{1,3}(?=x)", lambda gap: "x" * len(gap[0]), text)
        text = re.sub(r"(?<!x)x{1,3}(?!x)", lambda short: "." * len(short[0]), text)
        assert "".join("x" if stands else "." for stands in found[:, foot]) == text
    assert found.any() and not found.all()


def test_the_body_takes_the_drift_that_feet_have_in_common() -> None:
    drift = 0.06 * np.sin(np.arange(60) / 8)[:, None, None, None] * (1.0, 0, 0)
    pivots = np.zeros((60, 4, 2, 3)) + drift
    pivots[:, 2:] *= -1  # another motion, which drifts the other way
    path, stances = foot_stances(pivots, np.ones((60, 4, 2), bool), FPS, landing=0.7)
    root = drift_correction(path, stances, 2, deviation=4.0, stay=0.01)
    np.testing.assert_allclose(root[:, 0], -root[:, 1], atol=1e-9)
    assert np.ptp(path[:, 0, 0] + root[:, 0, 0]) < 0.2 * np.ptp(path[:, 0, 0])
    still = foot_stances(pivots, np.zeros((60, 4, 2), bool), FPS, landing=0.7)
    assert not drift_correction(*still, 2, 4.0, 1.0).any()


def test_a_knee_turns_as_the_line_from_hip_to_ankle_does() -> None:
    generator = np.random.default_rng(2)
    knee, goal = generator.normal(size=(2, 50, 3)) * 0.2 - (0, 0.5, 0)
    hip, ankle = np.zeros((50, 3)), 2 * knee + generator.normal(size=(50, 3)) * 0.1
    goal *= np.linalg.norm(ankle, axis=1, keepdims=True) / np.linalg.norm(goal, axis=1)[:, None]
    turned = quaternion_rotate(quaternion_between(ankle, goal), knee)
    found, _ = reach(hip, knee, ankle, goal, np.tile([0.0, 0, 1], (50, 1)))
    np.testing.assert_allclose(found, turned, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 5, 80])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
def test_quantiles_are_those_of_numpy(count: int, share: float) -> None:
    values = np.random.default_rng(count).normal(size=(count, 3, 2))
    np.testing.assert_allclose(quantile(values, share), np.quantile(values, share, axis=0))


def test_cross_products_and_velocities_are_those_of_numpy() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 7, 4, 3))
    np.testing.assert_allclose(cross(a[:, :1], b), np.cross(a[:, :1], b))
    np.testing.assert_allclose(velocity(a, FPS), FPS * np.gradient(a, axis=0))
    assert not velocity(a[:1], FPS).any()
