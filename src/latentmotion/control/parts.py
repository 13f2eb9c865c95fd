"""Body parts of one motion on another: the bones of a part, turned with the body that carries it.

A part hangs on a joint that stays where it is. Its bones are taken relative to the joints around
that one (Kabsch's rotation between both motions), and get the lengths that they have there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError, hint
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]


@dataclass(frozen=True)
class BodyPart:
    """A part of the body, by names of joints."""

    joints: tuple[str, ...]
    """Those that move, from the body outward; their parents are known before them."""
    carried_by: tuple[str, ...]
    """Those that say how the body is turned that carries it."""


_CHEST = ("spine3", "neck", "left_shoulder", "right_shoulder", "left_collar", "right_collar")
_HIPS = ("pelvis", "left_hip", "right_hip", "spine1")


def _side(side: str) -> dict[str, BodyPart]:
    arm, leg = (f"{side}_elbow", f"{side}_wrist"), ("knee", "ankle", "foot")
    return {
        f"{side}_arm": BodyPart(arm, _CHEST),
        f"{side}_leg": BodyPart(tuple(f"{side}_{joint}" for joint in leg), _HIPS),
    }


_TRUNK = ("spine2", "spine3", "neck", "head", "left_collar", "right_collar")
_SIDES = {**_side("left"), **_side("right")}
PARTS: Mapping[str, BodyPart] = MappingProxyType(
    {
        **_SIDES,
        "arms": BodyPart(_SIDES["left_arm"].joints + _SIDES["right_arm"].joints, _CHEST),
        "legs": BodyPart(_SIDES["left_leg"].joints + _SIDES["right_leg"].joints, _HIPS),
        "head": BodyPart(("head",), _CHEST),
        "upper_body": BodyPart(
            (
                *_TRUNK,
                *(f"{s}_{j}" for j in ("shoulder", "elbow", "wrist") for s in ("left", "right")),
            ),
            _HIPS,
        ),
    }
)
"""The parts that can be generated alone."""


def parts_named(names: Sequence[str], skeleton: Skeleton) -> list[BodyPart]:
    """Returns parts of the body.

    Raises:
        InputError: A name is unknown, a part is named twice or within another, or the skeleton
            lacks its joints.
    """
    if isinstance(names, str):
        raise InputError(f"parts is {names!r}: expected a list of names, such as [{names!r}]")
    chosen, owners = [], dict[str, str]()
    for name in names:
        if name not in PARTS:
            raise InputError(f"unknown part {name!r}: {hint(name, PARTS)}")
        part = PARTS[name]
        lacking = [joint for joint in part.joints + part.carried_by if joint not in skeleton.names]
        if lacking:
            raise InputError(f"skeleton {skeleton.name!r} lacks {lacking[0]}, which {name} needs")
        for joint in part.joints:
            if joint in owners:
                raise InputError(f"{joint} belongs to both {owners[joint]} and {name}: leave one")
            owners[joint] = name
        chosen.append(part)
    return chosen


def with_parts(own: Joints, other: Joints, parts: Sequence[BodyPart], skeleton: Skeleton) -> Joints:
    """Returns a motion with some parts of another; all other joints are the same numbers.

    Args:
        own: The motion that is kept.
        other: The motion that has the parts.
        parts: The parts.
        skeleton: Of both.
    """
    moved, names = own.astype(np.float64), skeleton.names
    for part in parts:
        carried = [names.index(name) for name in part.carried_by]
        turned = _rotation(other[:, carried], own[:, carried])
        for name in part.joints:
            joint = names.index(name)
            parent = skeleton.parents[joint]
            bone = np.einsum("tij,tj->ti", turned, other[:, joint] - other[:, parent])
            length = np.linalg.norm(own[:, joint] - own[:, parent], axis=-1, keepdims=True)
            bone *= length / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-9)
            moved[:, joint] = moved[:, parent] + bone
    changed = [names.index(name) for part in parts for name in part.joints]
    replaced = own.copy()
    replaced[:, changed] = moved[:, changed]
    return replaced


def _rotation(
    start: Float[np.ndarray, "frames few 3"], end: Float[np.ndarray, "frames few 3"]
) -> Float[np.ndarray, "frames 3 3"]:
    """Returns the rotations that bring points onto others best (Kabsch 1976)."""
    a, b = (points - points.mean(axis=1, keepdims=True) for points in (start, end))
    u, _, vt = np.linalg.svd(np.einsum("tci,tcj->tij", b.astype(float), a.astype(float)))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt
