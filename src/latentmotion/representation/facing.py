"""Where a body faces: a heading about the vertical, 0 towards +z and positive towards +x.

forward = y × across, across = the way from the left side of the body to its right (radians).
"""

from __future__ import annotations

from math import exp
from typing import Any

from jaxtyping import Float

from latentmotion.arrays import array_namespace
from latentmotion.kinematics.skeleton import Skeleton

SMOOTHING_FRAMES = 20.0
"""Standard deviation of the Gaussian that HumanML3D smooths the heading with."""


def heading(joints: Float[Any, "*frames joints 3"], skeleton: Skeleton) -> Float[Any, "*frames"]:
    """Returns where hips and shoulders together face."""
    xp = array_namespace(joints)
    across = _across(joints, skeleton, "hip") + _across(joints, skeleton, "shoulder")
    return xp.atan2(across[..., 2], -across[..., 0])


def smooth_heading(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton
) -> Float[Any, " frames"]:
    """Returns the heading as HumanML3D's inverse kinematics measures it.

    There the hips arrive swapped, so that they work against the shoulders; published features
    can only be met by doing the same.
    """
    xp = array_namespace(joints)
    across = _across(joints, skeleton, "shoulder") - _across(joints, skeleton, "hip")
    across = across / (xp.sqrt(xp.sum(across * across, axis=-1, keepdims=True)) + 1e-12)
    forward = gaussian_smooth(xp.stack([across[:, 2], -across[:, 0]], axis=-1), SMOOTHING_FRAMES)
    return xp.atan2(forward[:, 0], forward[:, 1])


def gaussian_smooth(signal: Float[Any, "frames n"], sigma: float) -> Float[Any, "frames n"]:
    """Smooths along the first axis; the ends are continued by their own value.

    Args:
        signal: Values over time.
        sigma: Standard deviation in frames; the kernel ends at four of them, as SciPy's does.
    """
    xp = array_namespace(signal)
    frames, radius = signal.shape[0], int(4 * sigma + 0.5)
    weights = [exp(-0.5 * (n / sigma) ** 2) for n in range(radius + 1)]
    padded = xp.concat([signal[:1]] * radius + [signal] + [signal[-1:]] * radius, axis=0)
    total = signal * weights[0]
    for n in range(1, radius + 1):
        before, after = radius - n, radius + n
        total = total + weights[n] * (
            padded[before : before + frames] + padded[after : after + frames]
        )
    return total / (2 * sum(weights) - weights[0])


def turn(vectors: Float[Any, "*#batch 3"], angle: Float[Any, "*#batch"]) -> Float[Any, "*batch 3"]:
    """Turns vectors about the vertical by an angle that moves +z towards +x."""
    xp = array_namespace(vectors, angle)
    c, s = xp.cos(angle), xp.sin(angle)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return xp.stack([c * x + s * z, y + 0 * c, c * z - s * x], axis=-1)


def _across(
    joints: Float[Any, "*frames joints 3"], skeleton: Skeleton, part: str
) -> Float[Any, "*frames 3"]:
    right, left = skeleton.names.index(f"right_{part}"), skeleton.names.index(f"left_{part}")
    return joints[..., right, :] - joints[..., left, :]
