"""Feet on the floor: the rig's feet follow the source's, at the scale of its legs.

A foot's goal follows the source's toe t and ankle a, s the ratio of the legs, Y the heading of
the foot, held while the foot stands:

    across      s t + Y (o + h)        h: by how much the rig's foot is longer than the source's,
    height      s (t − its standing height) + the rig's,        o: its hips wider

seen at the ankle while the toes point up, or are far above the floor. So a foot that stands is as
still as the source's, one that rolls over its toes stays on them, and longer feet do not enter the
floor. Hip and knee bend for the ankle to be there (`cleanup/leg_ik.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup import leg_ik, smoothing
from latentmotion.cleanup.contacts import ramp
from latentmotion.kinematics import rotations as rot
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.measure.signals import spans
from latentmotion.retarget.flesh import Flesh, flesh_of
from latentmotion.retarget.rig import Rig, RigPose, Rotations, SourceCharacter

Points = Float[np.ndarray, "frames 3"]

# Share of its full length to which a leg is stretched at most.
_STRETCH = 0.998

# Share of the leg's length by which hips may be lowered so that feet reach their goals.
_LOWER = 0.08

# Shares of the leg's length: an ankle lifted by less than the first is leveled from side to side,
# by more than the second it is not; in between the two are blended.
_LEVEL_HEIGHT = (0.1, 0.3)

# Shares of the leg's length: toes lifted by less than the first lie flat where the heel rises, by
# more than the second they do not.
_TOE_HEIGHT = (0.03, 0.08)

# Shares of the leg's length: toes lifted by less than the first lead the foot, by more than the
# second the ankle does.
_SWING_HEIGHT = (0.05, 0.2)

_MOST_TOE_BEND = np.radians(70)

# Rounds in which body and feet are lifted from the floor, and the depth, as a share of the leg's
# length, that needs none.
_ROUNDS, _CLOSE = 4, 0.002

# Heights of the hips, in legs, below which a body sits or lies on the floor and above which it does
# not.
_LYING = (0.3, 0.45)

# A foot that turns farther than this while it stands keeps its own heading.
_MOST_HELD = np.radians(40)


def ground_feet(pose: RigPose, source: SourceCharacter) -> RigPose:
    """Returns the pose with its feet at the source's positions, soles and toes on the floor."""
    rotations: dict[int, Rotations] = {}
    for side in SIDES:
        rotations |= _flat_foot(pose, source, side)
    pose = pose.moved(rotations)
    goals = {side: _ankle_goal(pose, source, side) for side in SIDES}
    drop = np.zeros(len(pose.hips))  # by which the hips come down for ankles to reach their goals
    for side, goal in goals.items():
        hip, knee, ankle = (pose.position(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        straight = np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)
        longest = np.maximum(_STRETCH * straight, np.linalg.norm(ankle - hip, axis=-1))
        line = goal - hip
        height = np.sqrt(np.maximum(longest**2 - (line[:, ::2] ** 2).sum(-1), 0))
        drop = np.maximum(drop, -line[:, 1] - height)
    drop = np.clip(drop, 0, _LOWER * pose.rig.leg)
    drop = smoothing.upper_envelope(drop, max(1, round(0.1 * source.fps)))
    pose = _with_ankles(pose.moved({}, pose.hips - drop[:, None] * (0, 1, 0)), goals)
    flesh = flesh_of(pose.rig)
    return pose if flesh is None else _above_floor(pose, source, goals, flesh)


def _with_ankles(pose: RigPose, goals: Mapping[str, Points]) -> RigPose:
    """Returns the pose with hips and knees bent so that ankles are at their goals."""
    legs: dict[int, Rotations] = {}
    body = pose.rig.body
    for side, goal in goals.items():
        hip, knee, ankle = (pose.position(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        new_knee, new_ankle = leg_ik.reach(hip, knee, ankle, goal, pose.world[:, body.pelvis, :, 2])
        upper, lower = body.joints[f"{side}_hip"], body.joints[f"{side}_knee"]
        legs[upper] = rot.matrix_between(knee - hip, new_knee - hip) @ pose.world[:, upper]
        legs[lower] = rot.matrix_between(ankle - knee, new_ankle - new_knee) @ pose.world[:, lower]
    return pose.moved(legs)


def _above_floor(
    pose: RigPose, source: SourceCharacter, goals: Mapping[str, Points], flesh: Flesh
) -> RigPose:
    """Returns the pose with its surface on the floor or above it.

    Feet are lifted by their legs, all else by the whole body. Below the floor is only what the
    source's joints are below it. A body that sits or lies on the floor comes down onto it.
    """
    floor = np.minimum(0, pose.rig.leg / source.leg * source.joints[..., 1].min(axis=1))
    floor = (floor + flesh.sole)[:, None]
    hips = np.mean([source.position(f"{side}_hip")[:, 1] for side in SIDES], axis=0)
    low = 1 - ramp(hips / source.leg, *_LYING)
    reached, up = max(1, round(0.1 * source.fps)), np.array([0.0, 1.0, 0.0])
    for _ in range(_ROUNDS):
        above = flesh.heights(pose) - floor
        body, *soles = (
            np.maximum(0, -above[:, flesh.part == part].min(axis=1, initial=np.inf))
            for part in ("body", *(f"{side}_foot" for side in SIDES))
        )
        feet = dict(zip(SIDES, soles, strict=True))
        hover = low * np.maximum(0, above.min(axis=1))
        if max(x.max() for x in (body, hover, *feet.values())) < _CLOSE * pose.rig.leg:
            break
        goals = {
            side: goals[side] + smoothing.upper_envelope(foot, reached)[:, None] * up
            for side, foot in feet.items()
        }
        lift = smoothing.upper_envelope(body, reached) + smoothing.upper_envelope(-hover, reached)
        pose = _with_ankles(pose.moved({}, pose.hips + lift[:, None] * up), goals)
    return pose.moved({}, pose.hips - flesh.sole * up)


def align_foot(rig: Rig, source: SourceCharacter, side: str) -> Float[np.ndarray, "3 3"]:
    """Returns the rotation about the vertical from the rig's foot at rest to the source's."""
    ankle, toe = f"{side}_ankle", f"{side}_foot"
    if toe not in rig.body.joints or toe not in source.body.joints:
        return np.eye(3)
    rest = rig.rest()
    ours = rest[rig.body.joints[toe]] - rest[rig.body.joints[ankle]]
    theirs = _rest_position(source, toe) - _rest_position(source, ankle)
    angle = np.arctan2(theirs[0], theirs[2]) - np.arctan2(ours[0], ours[2])
    return rot.matrix_from_axis_angle(np.array([0.0, angle, 0.0]))


def _flat_foot(pose: RigPose, source: SourceCharacter, side: str) -> dict[int, Rotations]:
    """Returns rotations of a foot leveled from side to side near the floor, and of flat toes."""
    body, ankle, toe = pose.rig.body, f"{side}_ankle", f"{side}_foot"
    lift = (source.position(ankle)[:, 1] - source.standing_height("ankle")) / source.leg
    foot = source.rotation(ankle)
    # The foot turns about its own length until its left is level, less the higher it is.
    left, ahead = foot[..., 0], foot[..., 2]
    horizontal = unit(np.cross((0.0, 1.0, 0.0), ahead))
    share = 1 - ramp(lift, *_LEVEL_HEIGHT)
    # Fades out from 45 degrees of tilt on: a foot at 72 degrees and more is meant to lie on its
    # side.
    share = share * ramp((left * horizontal).sum(-1), 0.3, 0.7)
    left = unit(left + share[:, None] * (horizontal - left))
    left = unit(left - ahead * (left * ahead).sum(-1, keepdims=True))
    level = np.stack([left, np.cross(ahead, left), ahead], axis=-1)
    change = level @ np.swapaxes(foot, -1, -2)
    rotations = {body.joints[ankle]: change @ pose.world[:, body.joints[ankle]]}
    if toe in body.joints and toe in source.body.joints:
        lift = (source.position(toe)[:, 1] - source.standing_height("foot")) / source.leg
        pitch = np.arcsin(np.clip(-level[:, 1, 2], 0, 1)) * (1 - ramp(lift, *_TOE_HEIGHT))
        bend = -np.minimum(pitch, _MOST_TOE_BEND)[:, None] * level[:, :, 0]
        flat = rot.matrix_from_axis_angle(bend) @ change
        rotations[body.joints[toe]] = flat @ pose.world[:, body.joints[toe]]
    return rotations


def _ankle_goal(pose: RigPose, source: SourceCharacter, side: str) -> Points:
    """Returns the positions at which the ankle should be; see the top of this file."""
    rig, ankle, toe = pose.rig, f"{side}_ankle", f"{side}_foot"
    rest, scale = rig.rest(), rig.leg / source.leg
    rotation, foot = source.rotation(ankle), rig.body.joints[ankle]
    # The rotation about the vertical, held while the foot stands.
    quaternion = rot.quaternion_from_matrix(rotation)
    angle = np.unwrap(2 * np.arctan2(quaternion[:, 2], quaternion[:, 0]))
    held, fixed = angle.copy(), np.zeros(0, int)
    for start, end in spans(source.contacts(side)):
        if np.ptp(angle[start:end]) < _MOST_HELD:
            held[start:end] = angle[start:end].mean()
            fixed = np.append(fixed, np.arange(start, end))
    for before, after in pairwise(fixed.tolist()):
        share = ramp(np.arange(before, after + 1.0), before, max(after, before + 1))
        held[before : after + 1] = held[before] + share * (held[after] - held[before])
    if len(fixed):
        held[: fixed[0]], held[fixed[-1] :] = held[fixed[0]], held[fixed[-1]]
    heading = rot.matrix_from_axis_angle(held[:, None] * np.array([0.0, 1.0, 0.0]))
    hips = [f"{side}_hip" for side in SIDES]
    ours = rest[rig.body.joints[hips[0]]] - rest[rig.body.joints[hips[1]]]
    theirs = _rest_position(source, hips[0]) - _rest_position(source, hips[1])
    wider = float(ours[0] - scale * theirs[0]) / 2
    shift = np.array([1.0 if side == SIDES[0] else -1.0, 0, 0]) * wider
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
    by_toe[:, 1] += ramp(rotation[:, 1, 2], -0.15, 0.15) * (by_ankle - by_toe)[:, 1]
    lift = (source.position(toe)[:, 1] - source.standing_height("foot")) / source.leg
    return by_toe + ramp(lift, *_SWING_HEIGHT)[:, None] * (by_ankle - by_toe)


def _rest_position(source: SourceCharacter, name: str) -> Float[np.ndarray, " 3"]:
    return source.rest()[source.body.joints[name]]
