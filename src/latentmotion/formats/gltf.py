"""glTF 2.0 (`.glb`, `.gltf`): a skinned mannequin, one node per joint, one animation per take.

The mannequin stands on the floor in rest pose; the y of each joint runs along its bone. Units are
meters and y is up, as glTF has it. Rotations are quaternions (x, y, z, w).
Source: Khronos glTF 2.0 specification, https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.errors import InputError
from latentmotion.formats import engines, numbered
from latentmotion.formats.bones import BoneAxes, bone_axes
from latentmotion.formats.gltf_document import INDICES, VERTICES, Document
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from latentmotion.motion import Motion, animations
from latentmotion.render.mannequin import ACCENT, GREY, Mannequin
from latentmotion.storage.reading import packaged_toml

# Meters below which two offsets are the same.
_SAME = 1e-6


def write(path: str | Path, motions: Sequence[Motion], miss: float = 0.0) -> list[Path]:
    """Writes one figure with one animation per motion.

    Args:
        path: The file.
        motions: The takes.
        miss: Meters by which bones pass the next joint; see `bone_axes`.

    Raises:
        InputError: The motions differ in skeleton, or the folder cannot be written.
    """
    make_document(motions, miss).write(path)
    return [Path(path)]


def make_document(motions: Sequence[Motion], miss: float = 0.0, mesh: bool = True) -> Document:
    """Returns the figure with all motions, not written yet; see `bone_axes` for `miss`.

    Without a mesh there are bones alone.

    Raises:
        InputError: The motions differ in skeleton.
    """
    if any(motion.skeleton.names != motions[0].skeleton.names for motion in motions):
        raise InputError("the takes of one .glb file must share a skeleton; write several files")
    animated = animations(motions)
    skeleton = animated[0].skeleton
    axes, rest = bone_axes(skeleton, miss), skeleton.offsets
    # All takes animate the same joints, those that any take moves: a program that changes takes
    # leaves what the second does not animate where the first has left it.
    moves = [np.abs(a.skeleton.offsets - rest).max(-1) > _SAME for a in animated]
    moves += [_moves(a) for a in animated]
    moving = {0, *np.flatnonzero(np.any(moves, axis=0)).tolist()}
    turns = [np.abs(a.rotations - np.eye(3)).max(axis=(0, 2, 3)) > _SAME for a in animated]
    turning = {joint for joint in range(len(skeleton)) if skeleton.children(joint)}
    turning |= set(np.flatnonzero(np.any(turns, axis=0)).tolist())  # heads and hands of recordings
    offsets = axes.offsets(np.array(rest, dtype=np.float64))
    offsets[0] = _standing(skeleton)
    rotations = _quaternions(axes.rotations(np.tile(np.eye(3), (len(skeleton), 1, 1))))
    nodes: list[dict[str, Any]] = []
    for joint, name in enumerate(skeleton.names):
        rest_pose = {"translation": offsets[joint].tolist(), "rotation": rotations[joint].tolist()}
        children = list(skeleton.children(joint))
        nodes.append({"name": name, **rest_pose} | ({"children": children} if children else {}))
    document = Document({"asset": {"version": "2.0", "generator": "latentmotion"}, "scene": 0})
    figure = [0, len(skeleton)] if mesh else [0]
    nodes += [{"name": "mannequin", "mesh": 0, "skin": 0}] if mesh else []
    objects: list[dict[str, Any]] = []  # without meshes, at the middle of their tops
    for number, motion in enumerate(motions if mesh else [], 1):
        for part in motion.objects:
            turn = np.radians(part.degrees) / 2
            objects.append(
                {
                    "name": part.name if len(motions) == 1 else f"{number}: {part.name}",
                    "translation": [part.place[0], part.height, part.place[1]],
                    "rotation": [0.0, float(np.sin(turn)), 0.0, float(np.cos(turn))],
                    "extras": part.about(),
                }
            )
    # One skin and one mesh for all takes: programs list the animations of one figure.
    document.json |= {
        "scenes": [{"nodes": [*figure, *range(len(nodes), len(nodes) + len(objects))]}],
        "nodes": [*nodes, *objects],
        **(_figure(engines.mannequin_of(skeleton), axes, document) if mesh else {}),
        "animations": [
            _animation(motion, animation, axes, moving, turning, number, document)
            for number, (motion, animation) in enumerate(zip(motions, animated, strict=True), 1)
        ],
    }
    return document


def _standing(skeleton: Skeleton) -> Float[np.ndarray, " 3"]:
    """Returns the root position at which the rest pose stands on the floor."""
    return np.array([0, -skeleton.rest_joints()[:, 1].min(), 0])


def _quaternions(rotations: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Returns quaternions in glTF's order."""
    return quaternion_from_matrix(rotations)[..., [1, 2, 3, 0]]


def _figure(mannequin: Mannequin, axes: BoneAxes, document: Document) -> dict[str, Any]:
    # Weights below half a percent do not show, but would widen the bounds of a joint.
    weights = np.where(mannequin.weights > 0.005, mannequin.weights, 0)
    weights = (weights / weights.sum(-1, keepdims=True)).astype("f4")
    joints = np.where(weights > 0, mannequin.joints, 0).astype("u1")
    vertices = (mannequin.vertices + _standing(mannequin.skeleton)).astype("f4")
    normals = mannequin.normals.astype("f4")
    materials, primitives = [], []
    halves = np.split(mannequin.triangles, [mannequin.shell])
    for name, color, faces in zip(("body", "mannequin"), (GREY, ACCENT), halves, strict=True):
        if not len(faces):
            continue
        used = slice(faces.min(), faces.max() + 1)
        attributes = {
            "POSITION": document.add_array(vertices[used], VERTICES, bounds=True),
            "NORMAL": document.add_array(normals[used], VERTICES),
            "JOINTS_0": document.add_array(joints[used], VERTICES),
            "WEIGHTS_0": document.add_array(weights[used], VERTICES),
        }
        corners = (faces - used.start).reshape(-1)
        small = used.stop - used.start < 1 << 16  # the greatest index has a meaning of its own
        indices = document.add_array(corners.astype("u2" if small else "u4"), INDICES)
        primitives.append(
            {"attributes": attributes, "indices": indices, "material": len(materials)}
        )
        surface = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}
        materials.append({"name": name, "pbrMetallicRoughness": surface})
    skeleton = mannequin.skeleton
    positions = skeleton.rest_joints() + _standing(skeleton)
    inverse = np.tile(np.eye(4), (len(positions), 1, 1))  # from the world to each joint's axes
    inverse[:, :3, :3] = np.swapaxes(axes.world, -1, -2)
    inverse[:, :3, 3] = -np.einsum("jba,jb->ja", axes.world, positions)
    binding = document.add_array(inverse.astype("f4"))
    skin = {"name": skeleton.name, "joints": [*range(len(skeleton))], "skeleton": 0}
    return {
        "materials": materials,
        "meshes": [{"name": "mannequin", "primitives": primitives}],
        "skins": [skin | {"inverseBindMatrices": binding}],
    }


def _animation(
    motion: Motion,
    animation: Animation,
    axes: BoneAxes,
    moving: Set[int],
    turning: Set[int],
    number: int,
    document: Document,
) -> dict[str, Any]:
    times = (np.arange(len(animation)) / animation.fps).astype("f4")
    time_accessors: dict[int, int] = {}
    quaternions = continuous_quaternions(_quaternions(axes.rotations(animation.rotations)))
    of_joints = np.moveaxis(quaternions, 1, 0).astype("f4", order="C")
    moves, channels, samplers = _moves(animation), [], []

    def add(joint: int, path: str, values: np.ndarray) -> None:
        if len(values) not in time_accessors:
            time_accessors[len(values)] = document.add_array(times[: len(values)], bounds=True)
        output = document.add_array(values)
        samplers.append({"input": time_accessors[len(values)], "output": output})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": joint, "path": path}})

    for joint in range(len(axes.skeleton)):
        if joint in turning:
            add(joint, "rotation", of_joints[joint])
        if joint in moving:
            offsets = animation.skeleton.offsets[joint][None]
            if joint == 0:
                offsets = animation.root_positions
            elif animation.translations is not None and moves[joint]:
                offsets = animation.translations[:, joint]
            add(joint, "translation", (offsets @ axes.above[joint]).astype("f4"))
    extras = {"caption": motion.caption, "fps": motion.fps, **motion.metadata}
    name = f"{number}: {motion.caption}" if motion.caption else f"take {number}"
    name = str(motion.metadata.get("state", name))  # a clip of a state machine
    return {"name": name, "channels": channels, "samplers": samplers, "extras": extras}


def _moves(animation: Animation) -> Bool[np.ndarray, " joints"]:
    """Returns which joints move away from where their parents carry them."""
    if animation.translations is None:
        return np.zeros(len(animation.skeleton), bool)
    return np.ptp(animation.translations, axis=0).max(-1) > _SAME


# HumanML3D's joint → VRM's bone.
_VRM = packaged_toml(__file__, "vrm.toml")
_VRM_BONES = _VRM["trunk"] | {
    f"{side}_{ours}": side + bone for side in SIDES for ours, bone in _VRM["limbs"].items()
}


def write_vrma(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes VRM animations, which any VRM avatar can play: `out.vrma`, or `out-1.vrma` and so on.

    A VRM animation is glTF without a mesh, whose extension names the nodes that are VRM's bones.
    The nodes rest in a T-pose; only the hips move. It is read as glTF is.
    Source: https://github.com/vrm-c/vrm-specification, VRMC_vrm_animation-1.0

    Raises:
        InputError: The joints are others than HumanML3D's, or the folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    for target, motion in zip(paths, motions, strict=True):
        if motion.skeleton.names[: len(HUMANML3D)] != HUMANML3D.names:
            raise InputError(
                f"cannot write {target}: VRM's bones are known for HumanML3D's joints, not for "
                f"those of {motion.skeleton.name!r}"
            )
        document, joint = make_document([motion], mesh=False), motion.skeleton.names.index
        bones = {bone: {"node": joint(ours)} for ours, bone in _VRM_BONES.items()}
        extension = {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
        document.json["extensionsUsed"] = ["VRMC_vrm_animation"]
        document.json["extensions"] = {"VRMC_vrm_animation": extension}
        document.write(target)
    return paths
