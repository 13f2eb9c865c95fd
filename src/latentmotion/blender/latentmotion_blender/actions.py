"""Keys as an Action of an armature, in whatever way each bone counts its turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import bpy
import numpy as np
from mathutils import Euler, Matrix

from .bones import Keys

_LINEAR = 1
"""Blender's number for straight lines between keys."""


def make_action(
    armature: bpy.types.Object, name: str, keys: Sequence[Keys], start: int
) -> bpy.types.Action:
    """Writes keys on whole frames from `start` on as a new Action, which becomes the active one."""
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    animation = armature.animation_data_create()
    animation.action = action
    add_curve = _curve_maker(action, armature)
    for key in keys:
        bone = armature.pose.bones[key.bone]
        for path, columns in _channels(bone, key):
            whole = bone.path_from_id(path)
            for index, values in enumerate(columns.T):
                _fill(add_curve(whole, index, key.bone), values, start)
    if getattr(animation, "action_slot", True) is None:
        animation.action_slot = action.slots[0]
    return action


def _curve_maker(
    action: bpy.types.Action, armature: bpy.types.Object
) -> Callable[[str, int, str], bpy.types.FCurve]:
    """Returns how curves are made in this Blender: Actions have slots since 4.4."""
    if hasattr(action, "fcurve_ensure_for_datablock"):
        return lambda path, index, group: action.fcurve_ensure_for_datablock(
            armature, path, index=index, group_name=group
        )
    return lambda path, index, group: action.fcurves.new(path, index=index, action_group=group)


def _channels(bone: bpy.types.PoseBone, key: Keys) -> Iterator[tuple[str, np.ndarray]]:
    if key.places is not None:
        yield "location", key.places
    mode = bone.rotation_mode
    if mode == "QUATERNION":
        yield "rotation_quaternion", _quaternions(key.turns)
    elif mode == "AXIS_ANGLE":
        yield "rotation_axis_angle", _axis_angles(key.turns)
    else:
        yield "rotation_euler", _eulers(key.turns, mode)


def _quaternions(turns: np.ndarray) -> np.ndarray:
    """Returns (frames, 4), each on the side of the one before, so that curves never jump."""
    values = np.array([Matrix(turn).to_quaternion() for turn in turns])
    flips = np.sum(values[1:] * values[:-1], axis=-1) < 0
    values[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return values


def _axis_angles(turns: np.ndarray) -> np.ndarray:
    pairs = [Matrix(turn).to_quaternion().to_axis_angle() for turn in turns]
    return np.array([(angle, *axis) for axis, angle in pairs])


def _eulers(turns: np.ndarray, order: str) -> np.ndarray:
    """Returns (frames, 3), each the nearest to the one before."""
    values: list[Euler] = []
    for turn in turns:
        matrix = Matrix(turn)
        values.append(matrix.to_euler(order, values[-1]) if values else matrix.to_euler(order))
    return np.array(values)


def _fill(curve: bpy.types.FCurve, values: np.ndarray, start: int) -> None:
    points = np.stack([start + np.arange(len(values)), values], axis=-1)
    curve.keyframe_points.add(len(values))
    curve.keyframe_points.foreach_set("co", points.ravel())
    curve.keyframe_points.foreach_set("interpolation", [_LINEAR] * len(values))
    curve.update()
