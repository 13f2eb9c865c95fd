"""Feet on the floor: the rig's feet go where the source's go, at the scale of its legs.

A foot's goal follows the source's toe t and ankle a, s the ratio of the legs, Y the turn of the
foot about the vertical, held while the foot stands:

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

from latentmotion.cleanup.contacts import spans
from latentmotion.cleanup.leg_ik import reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.rotations import (
    matrix_from_axis_angle,
    matrix_from_quaternion,
    quaternion_between,
    quaternion_from_matrix,
)
from latentmotion.retarget.humanoid import SIDES
from latentmotion.retarget.pose import Pose, Turns
from latentmotion.retarget.rig import Rig
from latentmotion.retarget.source import Actor

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


def ground_feet(pose: Pose, actor: Actor) -> Pose:
    """Returns the pose with its feet where the source's are, soles and toes on the floor."""
    turns: dict[int, Turns] = {}
    for side in SIDES:
        turns |= _soles(pose, actor, side)
    pose = pose.moved(turns)
    goals = {side: _goal(pose, actor, side) for side in SIDES}
    pose = pose.moved({}, pose.hips - _lowering(pose, goals, actor.fps)[:, None] * (0, 1, 0))
    legs: dict[int, Turns] = {}
    for side, goal in goals.items():
        legs |= _leg(pose, side, goal)
    return pose.moved(legs)


def align_foot(rig: Rig, actor: Actor, side: str) -> Float[np.ndarray, "3 3"]:
    """Returns the turn about the vertical from the rig's foot at rest to the source's."""
    ankle, toe = f"{side}_ankle", f"{side}_foot"
    if toe not in rig.body.joints or toe not in actor.body.joints:
        return np.eye(3)
    rest = rig.rest()
    ours = rest[rig.body.joints[toe]] - rest[rig.body.joints[ankle]]
    theirs = _rest_place(actor, toe) - _rest_place(actor, ankle)
    turn = np.arctan2(theirs[0], theirs[2]) - np.arctan2(ours[0], ours[2])
    return matrix_from_axis_angle(np.array([0.0, turn, 0.0]))


def _soles(pose: Pose, actor: Actor, side: str) -> dict[int, Turns]:
    """Levels a foot near the floor from side to side, and toes whose heel rises."""
    body, ankle, toe = pose.rig.body, f"{side}_ankle", f"{side}_foot"
    lift = (actor.place(ankle)[:, 1] - actor.standing_height("ankle")) / actor.leg
    seen = _turn(actor, ankle)
    level = _leveled(seen, 1 - _ramp(lift, *_LEVEL_HEIGHT))
    change = level @ np.swapaxes(seen, -1, -2)
    turns = {body.joints[ankle]: change @ pose.world[:, body.joints[ankle]]}
    if toe in body.joints and toe in actor.body.joints:
        lift = (actor.place(toe)[:, 1] - actor.standing_height("foot")) / actor.leg
        pitch = np.arcsin(np.clip(-level[:, 1, 2], 0, 1)) * (1 - _ramp(lift, *_TOE_HEIGHT))
        bend = -np.minimum(pitch, _MOST_TOE_BEND)[:, None] * level[:, :, 0]
        flat = matrix_from_axis_angle(bend) @ change
        turns[body.joints[toe]] = flat @ pose.world[:, body.joints[toe]]
    return turns


def _goal(pose: Pose, actor: Actor, side: str) -> Points:
    """Returns where the ankle should be."""
    rig, ankle, toe = pose.rig, f"{side}_ankle", f"{side}_foot"
    rest, scale = rig.rest(), rig.leg / actor.leg
    seen, foot = _turn(actor, ankle), rig.body.joints[ankle]
    heading = _heading(seen, actor.contacts(side))
    shift = np.array([1.0 if side == SIDES[0] else -1.0, 0, 0]) * _wider(pose, actor)
    rise = rest[foot, 1] - scale * actor.standing_height("ankle")
    by_ankle = scale * actor.place(ankle) + heading @ shift + (0, rise, 0)
    if toe not in rig.body.joints or toe not in actor.body.joints:
        return by_ankle
    tip = rig.body.joints[toe]
    bone = rest[tip] - rest[foot]
    longer = align_foot(rig, actor, side) @ bone
    longer = longer - scale * (_rest_place(actor, toe) - _rest_place(actor, ankle))
    shift = shift + longer * (1, 0, 1)
    rise = rest[tip, 1] - scale * actor.standing_height("foot")
    by_toe = scale * actor.place(toe) + heading @ shift + (0, rise, 0)
    by_toe = by_toe - pose.world[:, foot] @ bone
    by_toe[:, 1] += _ramp(seen[:, 1, 2], -0.15, 0.15) * (by_ankle - by_toe)[:, 1]
    lift = (actor.place(toe)[:, 1] - actor.standing_height("foot")) / actor.leg
    return by_toe + _ramp(lift, *_SWING_HEIGHT)[:, None] * (by_ankle - by_toe)


def _leg(pose: Pose, side: str, goal: Points) -> dict[int, Turns]:
    """Bends hip and knee so that the ankle is at its goal."""
    body = pose.rig.body
    hip, knee, ankle = (pose.place(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
    new_knee, new_ankle = reach(hip, knee, ankle, goal, pose.world[:, body.pelvis, :, 2])
    thigh = _between(knee - hip, new_knee - hip)
    shank = _between(ankle - knee, new_ankle - new_knee)
    upper, lower = body.joints[f"{side}_hip"], body.joints[f"{side}_knee"]
    return {upper: thigh @ pose.world[:, upper], lower: shank @ pose.world[:, lower]}


def _lowering(pose: Pose, goals: dict[str, Points], fps: float) -> Shares:
    """Returns how far the hips come down for both ankles to reach their goals."""
    need = np.zeros(len(pose.hips))
    for side, goal in goals.items():
        hip, knee, ankle = (pose.place(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        whole = _length(knee - hip) + _length(ankle - knee)
        longest = np.maximum(_STRETCH * whole, _length(ankle - hip))
        line = goal - hip
        height = np.sqrt(np.maximum(longest**2 - (line[:, ::2] ** 2).sum(-1), 0))
        need = np.maximum(need, -line[:, 1] - height)
    need = np.clip(need, 0, _LOWER * pose.rig.leg)
    return upper_envelope(need, max(1, round(0.1 * fps)))


def _wider(pose: Pose, actor: Actor) -> float:
    """Returns how much farther than the source's each hip is from the middle."""
    rest, hips = pose.rig.rest(), [pose.rig.body.joints[f"{side}_hip"] for side in SIDES]
    ours = rest[hips[0]] - rest[hips[1]]
    theirs = _rest_place(actor, f"{SIDES[0]}_hip") - _rest_place(actor, f"{SIDES[1]}_hip")
    return float(ours[0] - pose.rig.leg / actor.leg * theirs[0]) / 2


def _leveled(turns: Turns, share: Shares) -> Turns:
    """Turns feet about their own length until their left is level, as far as `share` says."""
    left, ahead = turns[..., 0], turns[..., 2]
    level = _unit(np.cross((0.0, 1.0, 0.0), ahead))
    share = share * _ramp((left * level).sum(-1), 0.3, 0.7)
    left = _unit(left + share[:, None] * (level - left))
    left = _unit(left - ahead * (left * ahead).sum(-1, keepdims=True))
    return np.stack([left, np.cross(ahead, left), ahead], axis=-1)


def _heading(turns: Turns, standing: Bool[np.ndarray, " frames"]) -> Turns:
    """Returns the part of turns that is about the vertical, held while a foot stands."""
    quaternion = quaternion_from_matrix(turns)
    angle = np.unwrap(2 * np.arctan2(quaternion[:, 2], quaternion[:, 0]))
    held, known = angle.copy(), np.zeros(0, int)
    for start, end in spans(standing):
        if np.ptp(angle[start:end]) < _MOST_HELD:
            held[start:end] = angle[start:end].mean()
            known = np.append(known, np.arange(start, end))
    for before, after in pairwise(known.tolist()):
        share = _ramp(np.arange(before, after + 1.0), before, max(after, before + 1))
        held[before : after + 1] = held[before] + share * (held[after] - held[before])
    if len(known):
        held[: known[0]], held[known[-1] :] = held[known[0]], held[known[-1]]
    return matrix_from_axis_angle(held[:, None] * np.array([0.0, 1.0, 0.0]))


def _turn(actor: Actor, name: str) -> Turns:
    turn = actor.turn(name)
    assert turn is not None
    return turn


def _rest_place(actor: Actor, name: str) -> Float[np.ndarray, " 3"]:
    return actor.rest()[actor.body.joints[name]]


def _between(a: Points, b: Points) -> Turns:
    return matrix_from_quaternion(quaternion_between(a, b))


def _length(vectors: Points) -> Shares:
    return np.linalg.norm(vectors, axis=-1)


def _unit(vectors: Points) -> Points:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def _ramp(values: Shares, low: float, high: float) -> Shares:
    u = np.clip((values - low) / (high - low), 0, 1)
    return u * u * (3 - 2 * u)
