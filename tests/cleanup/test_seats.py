"""Seats: a sitter stays at its height, others are left alone."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.cleanup.floor import hold_seats
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.walker import walker


def sitter(frames: int, sinks: float) -> np.ndarray:
    """A body that stands for a second, sits on a chair, and sinks."""
    joints = np.repeat(walker(1).joints(), frames, axis=0).astype(float)
    joints[..., ::2] -= joints[:1, :1, ::2]
    joints[..., 1] -= joints[..., 1].min()
    names, share = HUMANML3D.names.index, np.clip((np.arange(frames) - 20) / 20, 0, 1)
    sinking = np.clip((np.arange(frames) - 45) / 40, 0, 1) * sinks
    for side in ("left", "right"):
        hip, knee, ankle, foot = (names(f"{side}_{j}") for j in ("hip", "knee", "ankle", "foot"))
        thigh, shank = (
            np.linalg.norm(joints[0, b] - joints[0, a]) for a, b in ((hip, knee), (knee, ankle))
        )
        seat = joints[:, hip].copy()
        angle = share * np.pi / 2
        toes = joints[:, foot] - joints[:, ankle]
        joints[:, knee] = seat + thigh * np.stack(
            [np.zeros(frames), -np.cos(angle), np.sin(angle)], axis=-1
        )
        joints[:, ankle] = joints[:, knee] - (0, shank, 0)
        joints[:, foot] = joints[:, ankle] + toes
    joints[..., 1] -= joints[..., names("left_foot"), 1][:, None]
    held = {names(f"{s}_{j}") for s in ("left", "right") for j in ("knee", "ankle", "foot")}
    body = [joint for joint in range(22) if joint not in held]
    joints[:, body, 1] -= sinking[:, None]
    return joints[:, None]


def test_a_sitter_does_not_sink_and_feet_stay() -> None:
    joints = sitter(120, 0.15)
    held = hold_seats(joints, 20.0, HUMANML3D)
    before, after = (np.ptp(one[60:, 0, 0, 1]) for one in (joints, held))
    assert before > 0.09 and after < 1e-6
    feet = [7, 8, 10, 11]
    np.testing.assert_allclose(held[:, :, feet], joints[:, :, feet], atol=1e-9)
    np.testing.assert_array_equal(held[:15], joints[:15])
    bends = np.abs(np.diff(held[:, 0, 0, 1], n=2)).max()
    assert bends < np.abs(np.diff(joints[:, 0, 0, 1], n=2)).max() + 0.01


@pytest.mark.parametrize("kind", ["stands", "walks", "squats", "sits for a moment"])
def test_who_does_not_sit_is_left_alone(kind: str) -> None:
    joints = sitter(120, 0.1)
    if kind == "stands":
        joints = np.repeat(joints[:1], 120, axis=0)
    if kind == "walks":
        joints = walker(120).joints().astype(float)[:, None]
    if kind == "squats":  # the feet are below the pelvis
        joints[:, :, [4, 5, 7, 8, 10, 11], 2] -= 0.4
    if kind == "sits for a moment":
        joints = np.concatenate([joints[:42], joints[:42][::-1]])
        joints = joints[36:48]
    np.testing.assert_array_equal(hold_seats(joints, 20.0, HUMANML3D), joints)
