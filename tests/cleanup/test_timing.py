"""Timing: who idles comes to rest, ends settle, and all that moves is still shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.cleanup import CleanUp, clean
from latentmotion.cleanup.smoothing import settled, sharpened
from latentmotion.language.claims import Corrections
from latentmotion.motion import Motion
from tests.support.walker import walker

FPS = 20.0


def waving(frames: int = 80, drift: float = 0.2, start: int = 30) -> np.ndarray:
    """Someone who stands, drifts at some speed in m/s, and lifts a hand in the middle."""
    joints = np.repeat(walker(2).joints()[:1].astype(np.float64), frames, axis=0)
    joints[..., 0] += drift * np.arange(frames)[:, None] / FPS
    lift = np.clip(np.arange(frames) - start, 0, 10) / 10
    joints[:, 20, 1] += 0.6 * lift
    return joints


def speeds(joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(axis=1) * FPS


def test_who_idles_slows_down_and_the_act_stays() -> None:
    before = waving()
    after = settled(before, FPS)
    assert after.shape == before.shape
    assert speeds(after)[:25].mean() < 0.6 * speeds(before)[:25].mean()
    assert after[:, 20, 1].max() == pytest.approx(before[:, 20, 1].max(), abs=0.02)
    assert speeds(after).max() < 1.3 * speeds(before).max()
    assert speeds(after)[0] < 0.6 * speeds(before)[0]


def test_rest_takes_time_but_nobody_freezes() -> None:
    before = waving(start=12)
    before = np.concatenate([before[:32], before[31::-1], before[:32], before[31::-1]])
    longer = settled(before, FPS, longest=196)
    assert len(before) < len(longer) <= 1.36 * len(before)
    assert len(settled(before, FPS, longest=130)) <= 130
    assert speeds(longer)[:20].mean() < 0.4 * speeds(before)[:20].mean()
    assert max(speeds(longer)[-1], speeds(longer)[0]) < 0.6 * speeds(before)[-1]
    assert longer[:, 20, 1].max() == pytest.approx(before[:, 20, 1].max(), abs=0.02)
    # Two seconds of rest may get two seconds longer, or hardly where a walk follows.
    for step, least, most in ((0.0, 3.0, 4.2), (0.05, 2.0, 2.5)):
        late = waving(120, drift=0.1, start=40)
        late[40:, :, 2] += step * np.arange(80)[:, None]
        lifts = settled(late, FPS, longest=196)[:, 20, 1]
        assert least < np.flatnonzero(lifts > lifts[0] + 0.1)[0] / FPS < most


def test_who_walks_or_flies_keeps_the_end() -> None:
    walk = walker(60).joints().astype(np.float64)
    np.testing.assert_allclose(settled(walk, FPS)[-1], walk[-1], atol=0.05)
    flying = waving(drift=0.75)
    flying[..., 1] += 0.5
    np.testing.assert_allclose(settled(flying, FPS), flying, atol=1e-6)


def test_a_kick_that_is_cut_is_shown_up_to_the_standing() -> None:
    stand = np.repeat(waving(drift=0.0)[:1], 60, axis=0)
    lift = np.clip(np.arange(60) - 53, 0, 5) / 5
    stand[:, [7, 10], 1] += 0.5 * lift[:, None]
    after = settled(stand, FPS)
    assert after.shape == stand.shape
    assert after[-1, 7, 1] < stand[-1, 7, 1] - 0.25
    assert settled(stand[::-1], FPS)[0, 7, 1] < stand[-1, 7, 1] - 0.25


def test_quick_movement_is_sharpened_and_rest_is_not() -> None:
    """A punch of a tenth of a second, seen through a decoder that passes half of it."""
    slow = waving(drift=0.2)
    punch = slow.copy()
    punch[50:52, 21, 2] += 0.1
    after = sharpened(punch, FPS)
    assert np.ptp(after[45:57, 21, 2]) > 1.3 * np.ptp(punch[45:57, 21, 2])
    np.testing.assert_allclose(after[:40, :20], punch[:40, :20], atol=1e-3)
    generated = Corrections(sharpens=True)
    steps = replace(CleanUp(), smooth=False, bones=False, floor=False, feet=False, seats=False)
    motion = Motion(punch.astype(np.float32), FPS)
    assert np.array_equal(clean(motion, steps).joints, motion.joints)
    kept = clean(motion, replace(steps, sharpen=False), generated)
    assert np.array_equal(kept.joints, motion.joints)
    assert not np.array_equal(clean(motion, steps, generated).joints, motion.joints)


def test_only_generated_motions_get_another_timing() -> None:
    steps = replace(CleanUp(), smooth=False, bones=False, floor=False, feet=False)
    motion = Motion(waving().astype(np.float32), FPS)
    assert np.array_equal(clean(motion, steps).joints, motion.joints)
    generated = Corrections(settles=True)
    assert not np.array_equal(clean(motion, steps, generated).joints, motion.joints)
    kept = clean(motion, replace(steps, settle=False), generated)
    assert np.array_equal(kept.joints, motion.joints)
    assert generated.about() == {}


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
def test_short_motions_pass(frames: int) -> None:
    joints = waving(80)[:frames]
    assert settled(joints, FPS).shape == joints.shape
