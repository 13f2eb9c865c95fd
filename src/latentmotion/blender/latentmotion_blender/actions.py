"""Keys as an Action of an armature, in each bone's own rotation mode."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Euler, Matrix

from .bones import Keys

# Blender's number for linear interpolation.
_LINEAR = 1


def make_action(
    armature: bpy.types.Object, name: str, keys: Sequence[Keys], start: int
) -> bpy.types.Action:
    """Writes keys on whole frames from `start` on as a new Action, which becomes the active one."""
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    animation = armature.animation_data_create()
    animation.action = action
    for key in keys:
        bone = armature.pose.bones[key.bone]
        channels = [rotation_channel(key.rotations, bone.rotation_mode)]
        if key.translations is not None:
            channels.insert(0, ("location", key.translations))
        for channel, columns in channels:
            path = bone.path_from_id(channel)
            for index, values in enumerate(columns.T):
                if hasattr(action, "fcurve_ensure_for_datablock"):  # with slots, since 4.4
                    curve = action.fcurve_ensure_for_datablock(
                        armature, path, index=index, group_name=key.bone
                    )
                else:
                    curve = action.fcurves.new(path, index=index, action_group=key.bone)
                points = np.stack([start + np.arange(len(values)), values], axis=-1)
                curve.keyframe_points.add(len(values))
                curve.keyframe_points.foreach_set("co", points.ravel())
                curve.keyframe_points.foreach_set("interpolation", [_LINEAR] * len(values))
                curve.update()
    if getattr(animation, "action_slot", True) is None:
        animation.action_slot = action.slots[0]
    return action


def rotation_channel(rotations: np.ndarray, mode: str) -> tuple[str, np.ndarray]:
    """Returns the channel of a rotation mode and its values, (frames, 3 or 4).

    Quaternions and Euler angles are each the nearest to the one before, so that curves never jump.
    """
    matrices = [Matrix(rotation) for rotation in rotations]
    if mode == "QUATERNION":
        values = np.array([matrix.to_quaternion() for matrix in matrices])
        flips = np.sum(values[1:] * values[:-1], axis=-1) < 0
        values[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
        return "rotation_quaternion", values
    if mode == "AXIS_ANGLE":
        pairs = [matrix.to_quaternion().to_axis_angle() for matrix in matrices]
        return "rotation_axis_angle", np.array([(angle, *axis) for axis, angle in pairs])
    eulers: list[Euler] = []
    for matrix in matrices:
        eulers.append(matrix.to_euler(mode, eulers[-1]) if eulers else matrix.to_euler(mode))
    return "rotation_euler", np.array(eulers)
