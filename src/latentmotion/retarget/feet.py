"""Feet on the floor: the rig's feet go where the source's go, at the scale of its legs.

A foot's goal follows the source's toe t and ankle a, s the ratio of the legs, Y the heading of
the foot, held while the foot stands:

    across      s t + Y (o + h)        h: by how much the rig's foot is longer than the source's,
    height      s (t − its standing height) + the rig's,        o: its hips wider

seen at the ankle while the toes point up, or are far above the floor. So a foot that stands is as
still as the source's, one that rolls over its toes stays on them, and longer feet do not enter the
floor. Hip and knee bend for the ankle to be there (`cleanup/leg_ik.py`).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.cleanup.contacts import contact_intervals, ramp
from latentmotion.cleanup.leg_ik import reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.rotations import (
    matrix_between,
    matrix_from_axis_angle,
    quaternion_from_matrix,
)
from latentmotion.retarget.humanoid import SIDES
from latentmotion.retarget.pose import Pose, Rotations
from latentmotion.retarget.rig import Rig
from latentmotion.retarget.source import SourceCharacter

Points = Float[np.ndarray, "frames 3"]
Shares = Float[np.ndarray, " frames"]

_STRETCH = 0.998
"""Share of its length that a leg is stretched to at most."""

_LOWER = 0.08
"""Of a leg's length: how far the hips may come down for feet to reach their goals."""

_LEVEL_HEIGHT = (0.1, 0.3)
"""Of a leg's length: an ankle lifted by less is leveled from side to side, by more it is not."""

_TOE_HEIGHT = (0.03, 0.08)
"""Of a leg's length: toes lifted by less lie flat where the heel rises, by more they do not."""

_SWING_HEIGHT = (0.05, 0.2)
"""Of a leg's length: toes lifted by less lead the foot, by more the ankle does."""

_MOST_TOE_BEND = np.radians(70)

_MOST_HELD = np.radians(40)
"""A foot that turns farther than this on the spot is followed."""


def ground_feet(pose: Pose, source: SourceCharacter) -> Pose:
    """Returns the pose with its feet where the source's are, soles and toes on the floor."""
    rotations: dict[int, Rotations] = {}
    for side in SIDES:
        rotations |= _soles(pose, source, side)
    pose = pose.moved(rotations)
    goals = {side: _goal(pose, source, side) for side in SIDES}
    pose = pose.moved({}, pose.hips - _lowering(pose, goals, source.fps)[:, None] * (0, 1, 0))
    legs: dict[int, Rotations] = {}
    body = pose.rig.body
    for side, goal in goals.items():  # hip and knee bend so that the ankle is at its goal
        hip, knee, ankle = (pose.position(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        new_knee, new_ankle = reach(hip, knee, ankle, goal, pose.world[:, body.pelvis, :, 2])
        upper, lower = body.joints[f"{side}_hip"], body.joints[f"{side}_knee"]
        legs[upper] = matrix_between(knee - hip, new_knee - hip) @ pose.world[:, upper]
        legs[lower] = matrix_between(ankle - knee, new_ankle - new_knee) @ pose.world[:, lower]
    return pose.moved(legs)


def align_foot(rig: Rig, source: SourceCharacter, side: str) -> Float[np.ndarray, "3 3"]:
    """Returns the rotation about the vertical from the rig's foot at rest to the source's."""
    ankle, toe = f"{side}_ankle", f"{side}_foot"
    if toe not in rig.body.joints or toe not in source.body.joints:
        return np.eye(3)
    rest = rig.rest()
    ours = rest[rig.body.joints[toe]] - rest[rig.body.joints[ankle]]
    theirs = _rest_position(source, toe) - _rest_position(source, ankle)
    angle = np.arctan2(theirs[0], theirs[2]) - np.arctan2(ours[0], ours[2])
    return matrix_from_axis_angle(np.array([0.0, angle, 0.0]))


def _soles(pose: Pose, source: SourceCharacter, side: str) -> dict[int, Rotations]:
    """Levels a foot near the floor from side to side, and toes whose heel rises."""
    body, ankle, toe = pose.rig.body, f"{side}_ankle", f"{side}_foot"
    lift = (source.position(ankle)[:, 1] - source.standing_height("ankle")) / source.leg
    seen = source.rotation(ankle)
    level = _leveled(seen, 1 - ramp(lift, *_LEVEL_HEIGHT))
    change = level @ np.swapaxes(seen, -1, -2)
    rotations = {body.joints[ankle]: change @ pose.world[:, body.joints[ankle]]}
    if toe in body.joints and toe in source.body.joints:
        lift = (source.position(toe)[:, 1] - source.standing_height("foot")) / source.leg
        pitch = np.arcsin(np.clip(-level[:, 1, 2], 0, 1)) * (1 - ramp(lift, *_TOE_HEIGHT))
        bend = -np.minimum(pitch, _MOST_TOE_BEND)[:, None] * level[:, :, 0]
        flat = matrix_from_axis_angle(bend) @ change
        rotations[body.joints[toe]] = flat @ pose.world[:, body.joints[toe]]
    return rotations


def _goal(pose: Pose, source: SourceCharacter, side: str) -> Points:
    """Returns where the ankle should be."""
    rig, ankle, toe = pose.rig, f"{side}_ankle", f"{side}_foot"
    rest, scale = rig.rest(), rig.leg / source.leg
    seen, foot = source.rotation(ankle), rig.body.joints[ankle]
    heading = _heading(seen, source.contacts(side))
    shift = np.array([1.0 if side == SIDES[0] else -1.0, 0, 0]) * _wider(pose, source)
    rise = rest[foot, 1] - scale * source.standing_height("ankle")
    by_ankle = scale * source.position(ankle) + heading @ shift + (0, rise, 0)
    if toe not in rig.body.joints or toe not in source.body.joints:
        return by_ankle
    tip = rig.body.joints[toe]
    bone = rest[tip] - rest[foot]
    longer = align_foot(rig, source, side) @ bone
    longer = longer - scale * (_rest_position(source, toe) - _rest_position(source, ankle))
    shift = shift + longer * (1, 0, 1)
    rise = rest[tip, 1] - scale * source.standing_height("foot")
    by_toe = scale * source.position(toe) + heading @ shift + (0, rise, 0)
    by_toe = by_toe - pose.world[:, foot] @ bone
    by_toe[:, 1] += ramp(seen[:, 1, 2], -0.15, 0.15) * (by_ankle - by_toe)[:, 1]
    lift = (source.position(toe)[:, 1] - source.standing_height("foot")) / source.leg
    return by_toe + ramp(lift, *_SWING_HEIGHT)[:, None] * (by_ankle - by_toe)


def _lowering(pose: Pose, goals: dict[str, Points], fps: float) -> Shares:
    """Returns how far the hips come down for both ankles to reach their goals."""
    need = np.zeros(len(pose.hips))
    for side, goal in goals.items():
        hip, knee, ankle = (pose.position(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        whole = _length(knee - hip) + _length(ankle - knee)
        longest = np.maximum(_STRETCH * whole, _length(ankle - hip))
        line = goal - hip
        height = np.sqrt(np.maximum(longest**2 - (line[:, ::2] ** 2).sum(-1), 0))
        need = np.maximum(need, -line[:, 1] - height)
    need = np.clip(need, 0, _LOWER * pose.rig.leg)
    return upper_envelope(need, max(1, round(0.1 * fps)))


def _wider(pose: Pose, source: SourceCharacter) -> float:
    """Returns how much farther than the source's each hip is from the middle."""
    rest, hips = pose.rig.rest(), [pose.rig.body.joints[f"{side}_hip"] for side in SIDES]
    ours = rest[hips[0]] - rest[hips[1]]
    theirs = _rest_position(source, f"{SIDES[0]}_hip") - _rest_position(source, f"{SIDES[1]}_hip")
    return float(ours[0] - pose.rig.leg / source.leg * theirs[0]) / 2


def _leveled(rotations: Rotations, share: Shares) -> Rotations:
    """Turns feet about their own length until their left is level, as far as `share` says."""
    left, ahead = rotations[..., 0], rotations[..., 2]
    level = unit(np.cross((0.0, 1.0, 0.0), ahead))
    share = share * ramp((left * level).sum(-1), 0.3, 0.7)
    left = unit(left + share[:, None] * (level - left))
    left = unit(left - ahead * (left * ahead).sum(-1, keepdims=True))
    return np.stack([left, np.cross(ahead, left), ahead], axis=-1)


def _heading(rotations: Rotations, standing: Bool[np.ndarray, " frames"]) -> Rotations:
    """Returns the part of rotations that is about the vertical, held while a foot stands."""
    quaternion = quaternion_from_matrix(rotations)
    angle = np.unwrap(2 * np.arctan2(quaternion[:, 2], quaternion[:, 0]))
    held, known = angle.copy(), np.zeros(0, int)
    for start, end in contact_intervals(standing):
        if np.ptp(angle[start:end]) < _MOST_HELD:
            held[start:end] = angle[start:end].mean()
            known = np.append(known, np.arange(start, end))
    for before, after in pairwise(known.tolist()):
        share = ramp(np.arange(before, after + 1.0), before, max(after, before + 1))
        held[before : after + 1] = held[before] + share * (held[after] - held[before])
    if len(known):
        held[: known[0]], held[known[-1] :] = held[known[0]], held[known[-1]]
    return matrix_from_axis_angle(held[:, None] * np.array([0.0, 1.0, 0.0]))


def _rest_position(source: SourceCharacter, name: str) -> Float[np.ndarray, " 3"]:
    return source.rest()[source.body.joints[name]]


def _length(vectors: Points) -> Shares:
    return np.linalg.norm(vectors, axis=-1)
