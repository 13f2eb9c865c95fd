from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.recording import joints_at
from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import interpolate
from tests.support.mocap_folders import swaying


@pytest.mark.parametrize(("native", "step"), [(120, 6), (120.0005, 6), (60, 3), (20, 1)])
def test_every_nth_frame_where_exact(native: float, step: int) -> None:
    animation = swaying(121, native)
    np.testing.assert_allclose(joints_at(animation, 20, native), animation.joints()[::step])


@pytest.mark.parametrize("native", [30.0, 50.0, 12.5])
def test_between_frames_elsewhere(native: float) -> None:
    fine = swaying(5 * 600 + 1, 600).joints()
    coarse = joints_at(swaying(round(5 * native) + 1, native), 20, native)
    assert len(coarse) in (100, 101)
    assert np.abs(coarse - fine[:: 600 // 20][: len(coarse)]).max() < 0.02


def test_interpolation_is_exact_on_straight_lines() -> None:
    line = np.arange(10.0)[:, None, None] * np.ones((1, 22, 3))
    np.testing.assert_allclose(interpolate(line, 1.5)[:, 0, 0], [0, 1.5, 3, 4.5, 6, 7.5, 9])


def test_too_few_frames_per_second() -> None:
    with pytest.raises(DataError, match="too few"):
        joints_at(swaying(10), 20, 5)
