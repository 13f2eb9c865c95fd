"""Transfer: how a body moves, carried to bones of other lengths, rest directions and numbers.

D is a joint's turn in the world away from its rest pose, d its bone's direction at rest.

    limbs          D_rig = D A,      A the shortest turn, joint by joint down the limb, with
                                     A d_rig = d:  bones point where the source's point, and A-poses
                                     lie down into T-poses without a twist
    feet           D_rig = D A,      A about the vertical: a sole that is level stays level
    pelvis, head,
    collars        D_rig = D
    spine, neck    D_rig at the share k/n of the way from pelvis to chest, from chest to head
    all others     at rest in their parent

Hips move as the source's do, times the ratio of the legs. `feet.py` puts the feet on the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import (
    matrix_from_quaternion,
    quaternion_between,
    quaternion_from_matrix,
    slerp,
)
from latentmotion.motion import Motion
from latentmotion.retarget.feet import align_foot, ground_feet
from latentmotion.retarget.humanoid import SIDES, Body
from latentmotion.retarget.pose import Pose
from latentmotion.retarget.rig import Rig
from latentmotion.retarget.source import Actor

Turns = Float[np.ndarray, "frames 3 3"]

_LIMBS = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))


def retarget(source: Motion | Animation, rig: Rig, body: Body | None = None) -> Animation:
    """Carries a motion to a rig.

    Args:
        source: The motion, its floor at height 0. Of an animation, bones whose joints are known
            by their names are carried over with their twist.
        rig: The skeleton to move.
        body: Which joint of the source is which; by default found by their names.

    Returns:
        The animation of the rig's skeleton, meters, y up. `Rig.in_file` turns it into what the
        rig's file has.

    Raises:
        DataError: The joints of the source are unknown.
    """
    actor = Actor.of(source, body)
    turns = _torso(actor, rig.body) | _arms_and_legs(actor, rig)
    turns |= _feet(actor, rig)
    pose = Pose(rig, turns, _hips(actor, rig))
    return ground_feet(pose, actor).animation(actor.fps)


def _torso(actor: Actor, body: Body) -> dict[int, Turns]:
    seen = actor.body
    spine = [seen.pelvis, *seen.spine]
    turns = {body.pelvis: actor.world[:, seen.pelvis]}
    turns |= _chain([actor.world[:, joint] for joint in spine], body.spine)
    if "head" in seen.joints:
        neck = [seen.chest, *seen.neck]
        turns |= _chain([actor.world[:, joint] for joint in neck], body.neck)
        if "head" in body.joints:
            turns[body.joints["head"]] = actor.world[:, seen.joints["head"]]
    for side in SIDES:
        collar = actor.turn(f"{side}_collar")
        if collar is not None and f"{side}_collar" in body.joints:
            turns[body.joints[f"{side}_collar"]] = collar
    return turns


def _chain(seen: Sequence[Turns], joints: Sequence[int]) -> dict[int, Turns]:
    """Spreads the turns of one chain evenly over another with any number of joints."""
    quaternions = [quaternion_from_matrix(turn) for turn in seen]
    turns = {}
    for number, joint in enumerate(joints, 1):
        place = number / len(joints) * (len(seen) - 1)
        before = min(int(place), max(len(seen) - 2, 0))
        after = min(before + 1, len(seen) - 1)
        between = slerp(quaternions[before], quaternions[after], place - before)
        turns[joint] = matrix_from_quaternion(between)
    return turns


def _arms_and_legs(actor: Actor, rig: Rig) -> dict[int, Turns]:
    turns, rest, seen = {}, rig.rest(), actor.rest()
    for side in SIDES:
        for limb in _LIMBS:
            names = [f"{side}_{joint}" for joint in limb]
            align = np.eye(3)
            for upper, lower in pairwise(names):
                bone = _bone(rest, rig.body, upper, lower)
                align = _shortest(align @ bone, _bone(seen, actor.body, upper, lower)) @ align
                turns[rig.body.joints[upper]] = actor.world[:, actor.body.joints[upper]] @ align
            turns[rig.body.joints[names[-1]]] = actor.world[:, actor.body.joints[names[-1]]] @ align
    return turns


def _feet(actor: Actor, rig: Rig) -> dict[int, Turns]:
    turns = {}
    for side in SIDES:
        align = align_foot(rig, actor, side)
        for name in (f"{side}_ankle", f"{side}_foot"):
            turn = actor.turn(name)
            if turn is not None and name in rig.body.joints:
                turns[rig.body.joints[name]] = turn @ align
    return turns


def _hips(actor: Actor, rig: Rig) -> Float[np.ndarray, "frames 3"]:
    """Returns where the middle of the rig's hips goes."""
    hips = np.mean([actor.place(f"{side}_hip") for side in SIDES], axis=0)
    scale = rig.leg / actor.leg
    up = scale * actor.standing_height("ankle")
    rest = np.mean([rig.rest()[rig.body.joints[f"{side}_ankle"], 1] for side in SIDES])
    return scale * hips + (0, rest - up, 0)


def _bone(
    rest: Float[np.ndarray, "joints 3"], body: Body, upper: str, lower: str
) -> Float[np.ndarray, " 3"]:
    bone = rest[body.joints[lower]] - rest[body.joints[upper]]
    return bone / max(float(np.linalg.norm(bone)), 1e-12)


def _shortest(a: Float[np.ndarray, " 3"], b: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    return matrix_from_quaternion(quaternion_between(a, b))
