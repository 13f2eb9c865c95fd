"""Seats: who sits on something stays at its height until getting up.

Nothing in a generated motion carries a sitter, so the pelvis sinks. While thighs are level, shanks
and trunk upright, and the feet ahead of a pelvis that hardly moves, the pelvis is held at the
height at which the body came to rest; it comes and goes from there by a quintic. Feet stay where
they are, legs bend.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.cleanup.contacts import contact_intervals
from latentmotion.cleanup.leg_ik import find_legs, reach
from latentmotion.kinematics.skeleton import Skeleton

_LOW = (0.35, 0.78), (0.25, 0.85)
"""Height of a seated pelvis, in lengths of a leg, where sitting begins, and while it lasts; so are
all limits."""

_LEVEL, _UPRIGHT = (0.6, 0.85), (0.75, 0.5)
"""Greatest rise of a thigh, least rise of shank and trunk, as shares of their lengths; a trunk that
leans forward to get up still sits."""

_AHEAD = 0.25, 0.1
"""Least distance of the feet ahead of the pelvis, in lengths of a leg; a squat has less."""

_SLOW = 0.25, 0.4
"""Meters per second up to which the pelvis of a sitter moves down or up, and up."""

_SHORTEST, _SETTLED = 0.6, 0.5
"""Seconds that somebody sits at least, and from whose heights that of the seat is taken."""

_BLEND = 0.5
"""Seconds in which the pelvis goes to the height of the seat and leaves it."""


def hold_seats(
    joints: Float[np.ndarray, "frames motions joints 3"], fps: float, skeleton: Skeleton
) -> Float[np.ndarray, "frames motions joints 3"]:
    """Returns the joints with sitters that do not sink.

    Args:
        joints: Positions, meters, the floor at height 0.
        fps: Frames per second.
        skeleton: Says what legs are.
    """
    legs = find_legs(skeleton)
    if len(legs) < 2 or len(joints) < _SHORTEST * fps:
        return joints
    (begins, lasts), height = _seated(joints, fps, skeleton), joints[:, :, 0, 1]
    if not begins.any():
        return joints
    shift, frames = np.zeros(height.shape), np.arange(len(joints), dtype=float)
    for motion in range(joints.shape[1]):
        for first, end in contact_intervals(lasts[:, motion]):
            start = first + int(begins[first:end, motion].argmax())
            if begins[first:end, motion].sum() < _SHORTEST * fps:
                continue
            settled = height[start : start + max(1, round(_SETTLED * fps)), motion]
            gap = np.median(settled) - height[:, motion]
            gap = np.where(frames < start, gap[start], np.where(frames >= end, gap[end - 1], gap))
            away = np.maximum(start - frames, frames - (end - 1)) / (_BLEND * fps)
            u = np.clip(1 - np.maximum(away, 0), 0, 1)
            shift[:, motion] += gap * u**3 * (10 - 15 * u + 6 * u**2)
    up, moved = np.array([0.0, 1.0, 0.0]) * shift[..., None], joints.copy()
    held = {joint for leg in legs for joint in (leg.ankle, *leg.below)}
    body = [joint for joint in range(len(skeleton)) if joint not in held]
    moved[:, :, body] += up[:, :, None]
    across = moved[:, :, legs[0].hip] - moved[:, :, legs[1].hip]
    for leg in legs:
        hip, ankle = moved[:, :, leg.hip], joints[:, :, leg.ankle]
        ahead = np.cross(across, hip - ankle)
        knee, tip = reach(hip, moved[:, :, leg.knee], ankle + up, ankle, ahead)
        moved[:, :, leg.knee], moved[:, :, leg.ankle] = knee, tip
        moved[:, :, list(leg.below)] += (tip - ankle)[:, :, None]
    return np.where(shift[..., None, None] == 0, joints, moved)


def _seated(
    joints: Float[np.ndarray, "frames motions joints 3"], fps: float, skeleton: Skeleton
) -> tuple[Bool[np.ndarray, "frames motions"], Bool[np.ndarray, "frames motions"]]:
    """Returns whether somebody surely sits on something higher than the floor, and may still."""
    legs, pelvis = find_legs(skeleton), joints[:, :, 0]
    hips, knees, ankles = (
        joints[:, :, [getattr(leg, name) for leg in legs]] for name in ("hip", "knee", "ankle")
    )
    thighs, shanks = hips - knees, knees - ankles
    lengths = [np.linalg.norm(bone, axis=-1) for bone in (thighs, shanks)]
    leg = np.maximum((lengths[0] + lengths[1]).mean(axis=-1), 1e-6)
    rise = (thighs[..., 1] / np.maximum(lengths[0], 1e-6)).max(axis=-1)
    upright = (shanks[..., 1] / np.maximum(lengths[1], 1e-6)).min(axis=-1)
    trunk = np.ones(upright.shape)
    if "neck" in skeleton.names:
        trunk = unit(joints[:, :, skeleton.names.index("neck")] - pelvis)[..., 1]
    across = unit((hips[:, :, 0] - hips[:, :, 1]) * (1, 0, 1))
    ahead = np.cross(across, np.array([0.0, 1.0, 0.0]))
    feet = ((ankles.mean(axis=2) - pelvis) * ahead).sum(axis=-1) / leg
    height = pelvis[..., 1] / leg
    climb = np.gradient(pelvis[..., 1], axis=0) * fps
    begins, lasts = (
        (height > _LOW[n][0])
        & (height < _LOW[n][1])
        & (rise < _LEVEL[n])
        & (upright > _UPRIGHT[n])
        & (feet > _AHEAD[n])
        & (climb < _SLOW[n])
        for n in (0, 1)
    )
    still = (np.abs(climb) < _SLOW[0]) & (trunk > _UPRIGHT[0])
    return begins & lasts & still, lasts
