"""Hands of the rig: its own palms and fingertips at the goals of the motion, and above the floor.

A goal that the motion met is met by the rig, too, where its arm reaches there; elsewhere the hand
stays as it was retargeted, at the scale of the legs. Hands below the floor are lifted onto it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup import contacts, leg_ik, smoothing
from latentmotion.cleanup.pipeline import CleanUpWarning
from latentmotion.kinematics import rotations as rot
from latentmotion.kinematics.bone_names import BEYOND_WRIST, SIDES
from latentmotion.kinematics.humanoid import fingers_below
from latentmotion.representation.canonical import turn
from latentmotion.retarget.flesh import Flesh, flesh_of
from latentmotion.retarget.rig import Rig, RigPose, SourceCharacter

Points = Float[np.ndarray, "frames 3"]

# Seconds in which a hand leaves its own way for a goal and returns to it.
_BLEND = 0.5

# Height of the fingertips of a hand that lies on the floor, as a share of its length.
_THICK = 0.1

# Share of its full length to which an arm is stretched at most.
_STRETCH = 0.999


def place_hands(
    pose: RigPose, source: SourceCharacter, goals: Sequence[Mapping[str, Any]] = ()
) -> RigPose:
    """Returns the pose with its hands at the goals that its arms reach, and above the floor.

    Args:
        pose: The rig.
        source: What it was retargeted from.
        goals: Entries of the motion's goal report.

    Warns:
        CleanUpWarning: A goal is beyond the rig's arm.
    """
    points = [f"{side}_{part}" for side in SIDES for part in ("wrist", *BEYOND_WRIST)]
    hands = [goal for goal in goals if goal.get("joint") in points]
    # A hand whose place counts from another joint comes after that one.
    for goal in sorted(hands, key=lambda goal: "relative_to" in goal):
        pose = _at_goal(pose, goal, source.fps)
    scale, flesh = pose.rig.leg / source.leg, flesh_of(pose.rig)
    floor = np.minimum(0, scale * source.joints[..., 1].min(axis=1))
    for side in SIDES:
        elbow, wrist = (source.position(f"{side}_{joint}") for joint in ("elbow", "wrist"))
        source_tips = wrist + BEYOND_WRIST["fingertips"] * unit(wrist - elbow)
        pose = _lifted(pose, side, source.fps, np.minimum(0, scale * source_tips[:, 1]))
        pose = _flat_on_floor(pose, side, source.fps)
        if flesh is not None and f"{side}_hand" in flesh.part:
            pose = _lifted(pose, side, source.fps, floor, flesh)
    return pose


Heights = Float[np.ndarray, " frames"]


def _lifted(
    pose: RigPose, side: str, fps: float, floor: Heights, flesh: Flesh | None = None
) -> RigPose:
    """Returns the pose with fingertips, or a hand's flesh, lifted by the arm to the floor."""
    tips, reach = f"{side}_fingertips", max(1, round(0.1 * fps))
    for _ in range(2):  # the hand turns with its forearm
        height = point_of(pose, tips)[:, 1]
        if flesh is not None:
            height = flesh.heights(pose)[:, flesh.part == f"{side}_hand"].min(axis=1)
        lift = smoothing.upper_envelope(np.maximum(0, floor - height), reach)
        pose = _bent(pose, tips, lift[:, None] * np.array([0.0, 1.0, 0.0]))
    return pose


def _flat_on_floor(pose: RigPose, side: str, fps: float) -> RigPose:
    """Returns the pose with a hand that would enter the floor flat on it, bent at the wrist."""
    body, rest = pose.rig.body, _beyond(pose.rig, side, "fingertips")
    wrist, length = body.joints[f"{side}_wrist"], float(np.linalg.norm(rest))
    place, before = pose.joints[:, wrist], pose.world[:, wrist]
    tip = place + before @ rest
    need = smoothing.upper_envelope(np.maximum(0, -tip[:, 1]), max(1, round(0.1 * fps)))
    if not need.any():
        return pose
    # Fingers point ahead of somebody who stands, to the head of somebody on all fours.
    pelvis = pose.world[:, body.pelvis]
    ahead = unit((pelvis[..., 2] + pelvis[..., 1]) * (1, 0, 1))
    level = unit((tip - place) * (1, 0, 1) / length + 0.5 * ahead)
    slope = np.clip(_THICK - place[:, 1] / length, -0.7, 0.7)[:, None]
    along = level * np.sqrt(1 - slope**2) + slope * np.array([0.0, 1.0, 0.0])
    flat = _frame(along) @ np.swapaxes(_frame(unit(rest)), -1, -2)  # palms are down at rest
    turned = rot.slerp(
        rot.quaternion_from_matrix(before),
        rot.quaternion_from_matrix(flat),
        contacts.ramp(need, 0, length / 4),
    )
    change = rot.matrix_from_quaternion(turned) @ np.swapaxes(before, -1, -2)
    below = [joint for joint in {wrist, *pose.rotations} if wrist in body.lines[joint]]
    return pose.moved({joint: change @ pose.world[:, joint] for joint in below})


def _frame(along: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Returns axes along a hand, across it and down from its palm, in the columns."""
    across = unit(np.cross(along, (0.0, 1.0, 0.0)))
    return np.stack([along, across, np.cross(along, across)], axis=-1)


def _at_goal(pose: RigPose, goal: Mapping[str, Any], fps: float) -> RigPose:
    """Returns the pose with a point of a hand at its goal, if the arm reaches there."""
    name, last = goal["joint"], len(pose.hips) - 1
    first, end = (
        min(max(round(at * fps), 0), last) for at in (goal["at"], goal.get("until", goal["at"]))
    )
    now = point_of(pose, name)
    to = np.array([np.nan if value is None else value for value in goal["to"]], float)
    place = np.tile(to, (len(now), 1))
    if "relative_to" in goal:
        ahead = pose.world[:, pose.rig.body.pelvis, :, 2]
        yaw = np.arctan2(ahead[:, 0], ahead[:, 2])
        place = point_of(pose, goal["relative_to"]) + turn(np.nan_to_num(place), yaw)
    place = np.where(np.isnan(to), now, place)
    side = name.partition("_")[0]
    shoulder, elbow = (pose.position(f"{side}_{joint}") for joint in ("shoulder", "elbow"))
    whole = np.linalg.norm(elbow - shoulder, axis=-1) + np.linalg.norm(now - elbow, axis=-1)
    short = (np.linalg.norm(place - shoulder, axis=-1) - _STRETCH * whole)[first : end + 1].max()
    if short > 0:
        warnings.warn(
            f"{name} at {goal['at']:g} s: this character's arm is {1e2 * short:.0f} cm too short "
            "for the goal; the hand is where it is at the scale of its legs",
            CleanUpWarning,
            stacklevel=4,
        )
        return pose
    offsets = {frame: (place - now)[frame] for frame in range(first, end + 1)}
    return _bent(pose, name, smoothing.spread(offsets, len(now), _BLEND * fps))


def _bent(pose: RigPose, name: str, offset: Points) -> RigPose:
    """Returns the pose with a point of a hand moved by bending the arm; the hand goes with it."""
    if not offset.any():
        return pose
    body, side = pose.rig.body, name.partition("_")[0]
    chain = [body.joints[f"{side}_{joint}"] for joint in ("shoulder", "elbow", "wrist")]
    shoulder, elbow, end = pose.joints[:, chain[0]], pose.joints[:, chain[1]], point_of(pose, name)
    middle = np.mean([pose.position(f"{other}_shoulder") for other in SIDES], axis=0)
    out = elbow - (shoulder + end) / 2 + 0.1 * (shoulder - middle)
    bent, tip = leg_ik.reach(shoulder, elbow, end, end + offset, out)
    moved = np.abs(offset).max(axis=-1) > 0
    upper = rot.matrix_between(elbow - shoulder, bent - shoulder)
    lower = rot.matrix_between(end - elbow, tip - bent)
    upper[~moved] = lower[~moved] = np.eye(3)
    rotations = {chain[0]: upper @ pose.world[:, chain[0]]}
    for joint in {chain[1], chain[2], *pose.rotations}:
        if joint == chain[1] or chain[2] in body.lines[joint]:
            rotations[joint] = lower @ pose.world[:, joint]
    return pose.moved(rotations)


def point_of(pose: RigPose, name: str) -> Points:
    """Returns the positions of a joint or of a point of a hand."""
    side, _, part = name.partition("_")
    if part not in BEYOND_WRIST:
        return pose.position(name)
    wrist = pose.rig.body.joints[f"{side}_wrist"]
    return pose.joints[:, wrist] + pose.world[:, wrist] @ _beyond(pose.rig, side, part)


def _beyond(rig: Rig, side: str, part: str) -> Float[np.ndarray, " 3"]:
    """Returns the way from the wrist to a point of the hand at rest, by its fingers if any."""
    body, rest = rig.body, rig.rest()
    elbow, wrist = (rest[body.joints[f"{side}_{joint}"]] for joint in ("elbow", "wrist"))
    fingers = fingers_below(body, f"{side}_wrist")
    finger = fingers.get("middle") or fingers.get("index")
    if finger is None:
        return BEYOND_WRIST[part] * rig.leg / _USUAL_LEG * unit(wrist - elbow)
    last = finger[-1]
    tip = next(iter(body.skeleton.children(last)), last)
    return rest[finger[0] if part == "hand" else tip] - wrist


# Meters of the legs of a body whose hands are as long as `BEYOND_WRIST` says.
_USUAL_LEG = 0.82
