"""Evidence in the motion for a take's name, so that only pieces that show it get its sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from latentmotion.data.recording import FPS
from latentmotion.kinematics.skeleton import HUMANML3D

Joints = Float[np.ndarray, "frames 22 3"]

_J = {name: number for number, name in enumerate(HUMANML3D.names)}
_WRISTS, _FEET = [_J["left_wrist"], _J["right_wrist"]], [_J["left_foot"], _J["right_foot"]]
_ANKLES = [_J["left_ankle"], _J["right_ankle"]]
_SECOND = np.full(FPS, 1 / FPS)


def shows(evidence: str, joints: Joints, floor: float, whole: bool) -> bool:
    """Returns whether a piece shows something.

    Args:
        evidence: Names of `EVIDENCE`, separated by spaces, all of which must hold; `whole` asks
            for a piece that is nearly all of its take.
        joints: The piece at 20 frames per second, meters.
        floor: Height of the floor.
        whole: Whether the piece is nearly all of its take.
    """
    joints = joints - np.array([0.0, floor, 0.0])
    return all(whole if name == "whole" else EVIDENCE[name](joints) for name in evidence.split())


def floor_of(joints: Joints) -> float:
    """Returns the height that the lower foot of a take is at most of the time, meters."""
    return float(np.percentile(joints[:, _FEET, 1].min(1), 10))


def _height(joints: Joints) -> Float[np.ndarray, " frames"]:
    """Height of the pelvis relative to the legs' length: 1 when standing upright."""
    bones = [("left_hip", "left_knee"), ("left_knee", "left_ankle")]
    leg = sum(np.linalg.norm(joints[0, _J[a]] - joints[0, _J[b]]) for a, b in bones)
    # The pelvis is about 12 cm above the hips' and ankles' distance: hip offset and ankle height.
    return joints[:, 0, 1] / (leg + 0.12)


def _speed(joints: Joints, which: list[int]) -> Float[np.ndarray, " frames_less_one"]:
    speed = np.linalg.norm(np.diff(joints[:, which], axis=0), axis=-1).max(1) * FPS
    return np.asarray(speed)


def _path_speed(joints: Joints) -> Float[np.ndarray, " frames_less_one"]:
    """Speed of the pelvis over the floor, smoothed over a fifth of a second."""
    speed = np.linalg.norm(np.diff(joints[:, 0, ::2], axis=0), axis=-1) * FPS
    return np.convolve(speed, np.full(5, 0.2), "same")


def _turn(joints: Joints) -> float:
    """Degrees by which the hips turn from the first to the last frame, to the left."""
    across = joints[:, _J["left_hip"]] - joints[:, _J["right_hip"]]
    heading = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    return float(np.degrees(heading[-1] - heading[0]))


def _bend(joints: Joints) -> float:
    """Largest angle between the trunk and the vertical, degrees."""
    trunk = joints[:, _J["neck"]] - joints[:, 0]
    return float(np.degrees(np.arccos(trunk[:, 1] / np.linalg.norm(trunk, axis=-1))).max())


def _swing(side: str, other: str) -> Callable[[Joints], bool]:
    def swings(joints: Joints) -> bool:
        speed = _speed(joints, [_J[f"{side}_wrist"]]).max()
        return bool(speed > 3 and speed > _speed(joints, [_J[f"{other}_wrist"]]).max())

    return swings


def _halts(joints: Joints) -> bool:
    """Walks, stands for half a second, walks on."""
    walking = _path_speed(joints) > 0.5
    standing = np.convolve(_path_speed(joints) < 0.15, np.ones(10), "same") > 9
    stops = np.flatnonzero(standing)
    return len(stops) > 0 and bool(walking[: stops[0]].any() and walking[stops[-1] :].any())


EVIDENCE: Mapping[str, Callable[[Joints], bool]] = {
    "moves": lambda j: bool((_path_speed(j) > 0.3).mean() > 0.5),
    "stays": lambda j: bool((_path_speed(j) > 0.3).mean() < 0.3),
    "runs": lambda j: bool((_path_speed(j) > 1.6).mean() > 0.2),
    "steps": lambda j: bool(_path_speed(j).max() > 0.35),
    "stirs": lambda j: bool(_speed(j, [*_WRISTS, *_ANKLES]).max() > 1.5),
    "swings": lambda j: bool(_speed(j, _WRISTS).max() > 3),
    "left_swings": _swing("left", "right"),
    "right_swings": _swing("right", "left"),
    # Distance of a wrist from the pelvis over the floor.
    "reaches": lambda j: (
        float(np.linalg.norm(j[:, _WRISTS][..., ::2] - j[:, :1, ::2], axis=-1).max()) > 0.5
    ),
    "hands_up": lambda j: bool((j[:, _WRISTS, 1].max(1) > j[:, _J["neck"], 1]).sum() > 6),
    "kicks": lambda j: bool(j[:, _ANKLES, 1].max() > 0.55),
    "one_leg": lambda j: bool((j[:, _ANKLES, 1].max(1) > 0.35).mean() > 0.5),
    "jumps": lambda j: bool(j[:, _FEET, 1].min(1).max() > 0.1),
    "bends": lambda j: _bend(j) > 50,
    "lowers": lambda j: bool(_height(j).min() < 0.75),
    "low": lambda j: bool(np.median(_height(j)) < 0.75),
    "down": lambda j: bool(_height(j)[:5].max() > 0.85 and _height(j)[-5:].min() < 0.6),
    "up": lambda j: bool(_height(j)[:5].min() < 0.6 and _height(j)[-5:].max() > 0.85),
    "down_up": lambda j: bool(min(_height(j)[0], _height(j)[-1]) > 0.85 and _height(j).min() < 0.6),
    "climbs": lambda j: float(j[-5:, 0, 1].mean() - j[:5, 0, 1].mean()) > 0.2,
    "descends": lambda j: float(j[-5:, 0, 1].mean() - j[:5, 0, 1].mean()) < -0.2,
    # Means over a second, which steps do not change.
    "slopes": lambda j: float(np.ptp(np.convolve(j[:, 0, 1], _SECOND, "valid"))) > 0.2,
    "turns": lambda j: abs(_turn(j)) > 120,
    "turns_left": lambda j: _turn(j) > 30,
    "turns_right": lambda j: _turn(j) < -30,
    "halts": _halts,
}
"""Names and their thresholds: m/s, meters, degrees; heights relative to the legs' length."""
