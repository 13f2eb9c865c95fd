"""Foot sliding, jitter, floor penetration and floating against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.kinematics.plausibility import (
    floating,
    foot_sliding,
    jitter,
    penetration,
    skating_ratio,
    unfinished,
)
from latentmotion.kinematics.skeleton import HUMANML3D

FPS = 20.0
FEET = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]


def standing(frames: int = 30, height: float = 0.0) -> np.ndarray:
    joints = np.tile(HUMANML3D.rest_joints(), (frames, 1, 1))
    joints[..., 1] += 1.0
    joints[:, FEET, 1] = height
    return joints


def slide(joints: np.ndarray, speed: float) -> np.ndarray:
    joints = joints.copy()
    joints[..., 0] += speed * np.arange(len(joints))[:, None] / FPS
    return joints


def test_feet_that_stand_do_not_slide():
    assert foot_sliding(standing(), FPS) == 0
    assert skating_ratio(standing(), FPS) == 0


def test_sliding_is_the_speed_of_feet_on_the_floor_and_fades_with_their_height():
    assert foot_sliding(slide(standing(), 0.7), FPS) == pytest.approx(0.7)
    half = foot_sliding(slide(standing(height=0.025 * np.log2(1.5)), 0.7), FPS)
    assert half == pytest.approx(0.35)
    assert foot_sliding(slide(standing(height=0.025), 0.7), FPS) == pytest.approx(0, abs=1e-12)


def test_skating_counts_fast_and_low_feet_only():
    assert skating_ratio(slide(standing(), 0.6), FPS) == 1
    assert skating_ratio(slide(standing(), 0.4), FPS) == 0
    assert skating_ratio(slide(standing(height=0.06), 0.6), FPS) == 0
    half = slide(standing(31), 0.6)
    half[16:] = half[15]
    assert skating_ratio(half, FPS) == pytest.approx(0.5)


def test_jitter_is_the_third_derivative():
    time = np.arange(20)[:, None] / FPS
    joints = standing(20)
    joints[..., 2] += 5 / 6 * time**3
    assert jitter(joints, FPS) == pytest.approx(5.0)
    assert jitter(slide(standing(), 1.0), FPS) == pytest.approx(0, abs=1e-9)


def test_penetration_is_the_depth_of_the_lowest_joint():
    joints = standing(4)
    joints[1:3, FEET[0], 1] = -0.1
    assert penetration(joints) == pytest.approx(0.05)
    assert penetration(joints, floor=-0.1) == 0


def test_short_motions_have_neither_sliding_nor_jitter():
    assert foot_sliding(standing(1), FPS) == 0
    assert skating_ratio(standing(1), FPS) == 0
    assert jitter(standing(3), FPS) == 0


def test_floating_is_the_height_of_a_body_that_nothing_carries():
    assert floating(standing(height=0.05), FPS) == 0
    high = standing(height=0.25)
    # 5 frames of a quarter of a second at either end, 28 between them
    assert floating(high, FPS) == pytest.approx(0.2 * 38 / 30)
    leap = slide(high, 1.0)
    leap[[0, -1]] -= (0, 0.25, 0)
    assert floating(leap, FPS) == 0
    begins_above = leap.copy()
    begins_above[0, :, 1] += 0.25
    assert floating(begins_above, FPS) == pytest.approx(0.2 * 5 / 30)


def test_unfinished_is_the_height_of_a_flight_or_of_a_lifted_foot():
    standing_still = standing(height=0.0)
    assert unfinished(standing_still) == pytest.approx(0)
    assert unfinished(standing(height=0.25)) == pytest.approx(0.2)
    kick = standing_still.copy()
    kick[-1, list(HUMANML3D.left_foot), 1] += 0.6
    lifted = kick[-1, list(HUMANML3D.left_foot), 1].min() - 0.2
    assert unfinished(kick)[-1] == pytest.approx(lifted / 2) and unfinished(kick)[0] == 0
