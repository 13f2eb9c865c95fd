"""Timing: who idles comes to rest, ends settle, and all that moves is still shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.cleanup import CleanUp, clean
from latentmotion.cleanup.smoothing import settled
from latentmotion.corrections import Corrections
from latentmotion.motion import Motion
from tests.support.walker import walker

FPS = 20.0


def waving(frames: int = 80, drift: float = 0.2) -> np.ndarray:
    """Someone who stands, drifts at some speed in m/s, and lifts a hand in the middle."""
    joints = np.repeat(walker(2).joints()[:1].astype(np.float64), frames, axis=0)
    joints[..., 0] += drift * np.arange(frames)[:, None] / FPS
    lift = np.clip(np.arange(frames) - 30, 0, 10) / 10
    joints[:, 20, 1] += 0.6 * lift
    return joints


def speeds(joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(axis=1) * FPS


def test_who_idles_slows_down_and_the_act_stays() -> None:
    before = waving()
    after = settled(before, FPS)
    assert after.shape == before.shape
    assert speeds(after)[:25].mean() < 0.5 * speeds(before)[:25].mean()
    assert after[:, 20, 1].max() == pytest.approx(before[:, 20, 1].max(), abs=0.02)
    assert speeds(after).max() < 1.3 * speeds(before).max()
    assert speeds(after)[-1] < 0.6 * speeds(before)[-1]


def test_who_walks_or_flies_keeps_the_end() -> None:
    walk = walker(60).joints().astype(np.float64)
    np.testing.assert_allclose(settled(walk, FPS)[-1], walk[-1], atol=0.05)
    flying = waving(drift=0.75)
    flying[..., 1] += 0.5
    np.testing.assert_allclose(settled(flying, FPS), flying, atol=1e-6)


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
