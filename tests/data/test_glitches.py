from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.quality import find_glitch
from latentmotion.data.recording import every
from tests.support.mocap_folders import swaying

FPS = 20.0


@pytest.fixture
def joints() -> np.ndarray:
    return every(swaying(360), 6).joints()


def test_a_walking_figure_is_clean(joints: np.ndarray) -> None:
    assert find_glitch(joints, FPS) is None


def test_not_finite(joints: np.ndarray) -> None:
    joints[17, 3, 1] = np.nan
    assert find_glitch(joints, FPS) == "joints that are not finite in frame 17"


def test_a_body_that_jumps(joints: np.ndarray) -> None:
    joints[30:] += [0, 0.4, 0]
    assert "pelvis jumps" in str(find_glitch(joints, FPS))


def test_a_body_that_flies_off(joints: np.ndarray) -> None:
    joints[:, :, 0] += np.arange(len(joints))[:, None]
    assert "20 m/s" in str(find_glitch(joints, FPS))


def test_swapped_markers(joints: np.ndarray) -> None:
    wrists = joints[25, [20, 21]]
    elbows = joints[25, [18, 19]]
    joints[25, [20, 21]] = elbows + (elbows - wrists) * 1.2 + [0, 0.3, 0]
    assert "frame 2" in str(find_glitch(joints, FPS))


def test_a_torn_bone(joints: np.ndarray) -> None:
    joints[20:30, 20] += [0, 0.5, 0]
    assert "the bone to left_wrist is" in str(find_glitch(joints, FPS))


def test_the_wrong_unit(joints: np.ndarray) -> None:
    assert "check the unit of length" in str(find_glitch(joints * 100, FPS))
