"""A made-up person for tests: walks in a circle, swings bent arms, turns their back."""

from __future__ import annotations

import numpy as np

from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation

# Rotation vector of a joint at rest, and how far it swings.
_SWINGS = {
    "left_shoulder": ((0, 0.3, -1.1), (0.2, 0.5, 0.2)),
    "right_shoulder": ((0, -0.3, 1.1), (-0.2, 0.5, 0.2)),
    "left_elbow": ((0, -0.9, 0), (0, 0.5, 0)),
    "right_elbow": ((0, 0.9, 0), (0, 0.5, 0)),
    "left_hip": ((-0.3, 0, 0), (0.5, 0, 0.1)),
    "right_hip": ((-0.3, 0, 0), (-0.5, 0, 0.1)),
    "left_knee": ((0.6, 0, 0), (0.5, 0, 0)),
    "right_knee": ((0.6, 0, 0), (-0.5, 0, 0)),
    "spine3": ((0.1, 0, 0), (0, 0.3, 0.1)),
    "neck": ((0.1, 0, 0), (0.1, 0.2, 0)),
}


def t_pose() -> Animation:
    """One frame of the T-pose that inverse kinematics makes of HumanML3D's bones."""
    return solve(HUMANML3D.rest_joints()[None], 20.0)


def walker(frames: int = 60, fps: float = 20.0) -> Animation:
    time = np.arange(frames) / fps
    vectors = np.zeros((frames, len(HUMANML3D), 3))
    for name, (mean, swing) in _SWINGS.items():
        wave = np.sin(2 * np.pi * time)[:, None] * np.array(swing)
        vectors[:, HUMANML3D.names.index(name)] = np.array(mean) + wave
    heading = 2 * np.pi * time / time[-1] if frames > 1 else np.zeros(1)
    vectors[:, 0, 1] = heading
    root = np.stack([np.sin(heading), 0.95 + 0 * heading, np.cos(heading)], axis=-1)
    return Animation(t_pose().skeleton, matrix_from_axis_angle(vectors), root, fps)
