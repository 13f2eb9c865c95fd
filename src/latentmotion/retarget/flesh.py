"""Flesh: the points of a character's surface with which it stands, kneels, sits and lies.

Joints are inside the body: a knee on the floor has its joint a hand's breadth above it. Of each
part of the body, the points that lie farthest out in any direction are kept, so that the lowest of
them in a frame is the lowest of the surface, at a hundredth of its cost. Hair, capes, skirts and
weapons hang far from the bone that carries them; they touch floors without harm and are left out.

The surface of a character, as a skin that its rig carries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from latentmotion.errors import InputError, LatentMotionError
from latentmotion.formats.bones import matrix_of
from latentmotion.formats.gltf_reader import damage
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.humanoid import Humanoid
from latentmotion.render.mannequin import Mannequin, smooth_normals
from latentmotion.retarget.rig import Rig, RigPose
from latentmotion.retarget.rig_files import GltfFile

# Mode of glTF's primitives that are lists of triangles.
_TRIANGLES = 4


def surface_of(rig: Rig) -> Mannequin:
    """Returns the triangles of all meshes that the rig's bones carry, at rest, in meters.

    Raises:
        FileFormatError: The file is damaged.
        InputError: The file holds bones alone.
    """
    file = rig.file
    parts = []
    if isinstance(file, GltfFile):
        with damage(file.path):
            carried = [
                _primitive(file, node, primitive)
                for node, entry in enumerate(file.scene.nodes)
                if "mesh" in entry
                for primitive in file.document.entry("meshes", entry["mesh"])["primitives"]
                if primitive.get("mode", _TRIANGLES) == _TRIANGLES
            ]
            parts = [part for part in carried if part is not None]
    if not parts:
        raise InputError(
            f"{file.path} has bones but no surface that they carry; expected a .glb, .vrm or .fbx "
            "with a mesh"
        )
    starts = np.cumsum([0, *(len(vertices) for vertices, *_ in parts)])
    vertices, joints, weights = (
        np.concatenate(column) for column in list(zip(*parts, strict=True))[:3]
    )
    faces = np.concatenate([part[3] + start for part, start in zip(parts, starts, strict=False)])
    vertices = rig.meters * (vertices - file.root) @ rig.axes
    joints = np.argsort(rig.order)[joints]
    # Vertices at one place share their normals, such as at a texture's seams.
    _, first, group = np.unique(
        np.round(vertices, 5), axis=0, return_index=True, return_inverse=True
    )
    group = group.reshape(-1)
    normals = smooth_normals(vertices[first], group[faces])[group]
    return Mannequin(vertices, normals, faces, joints, weights, rig.skeleton)


_Part = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _primitive(file: GltfFile, node: int, primitive: dict[str, Any]) -> _Part | None:
    """Returns places in the world at rest, bones, weights and corners; None for no bone's."""
    document, scene = file.document, file.scene
    attributes, rank = primitive["attributes"], {bone: n for n, bone in enumerate(scene.bones)}
    places = document.array(attributes["POSITION"]).astype(np.float64)
    indices = primitive.get("indices")
    corners = np.arange(len(places)) if indices is None else document.array(indices).astype(int)
    faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if faces.size and faces.max() >= len(places):
        raise ValueError("a triangle has corners that its mesh has not")
    skin = scene.nodes[node].get("skin")
    if skin is None or "JOINTS_0" not in attributes:
        bone = next((above for above in scene.line(node) if above in rank), None)
        if bone is None:
            return None
        position, _, linear = scene.rest_frame(node)
        joints = np.zeros((len(places), 4), int) + rank[bone]
        return places @ linear.T + position, joints, np.eye(4)[np.zeros(len(places), int)], faces
    entry = document.entry("skins", skin)
    bones = entry["joints"]
    inverse = np.tile(np.eye(4), (len(bones), 1, 1))
    if "inverseBindMatrices" in entry:
        inverse = document.array(entry["inverseBindMatrices"]).astype(np.float64)
    rest = np.stack([matrix_of(scene.rest_frame(bone)) for bone in bones])
    used = document.array(attributes["JOINTS_0"]).astype(int)
    weights = document.array(attributes["WEIGHTS_0"]).astype(np.float64)
    weights = weights / np.maximum(weights.sum(-1, keepdims=True), 1e-9)
    moved = (rest @ inverse)[used]
    flat = np.concatenate([places, np.ones((len(places), 1))], axis=-1)
    world = np.einsum("vk,vkab,vb->va", weights, moved[..., :3, :], flat)
    return world, np.array([rank[bone] for bone in bones])[used], weights, faces


# Distances from the bone's line beyond which a vertex is cloth or a weapon, as shares of a leg, or
# of what the leg of a person as tall would be; half as much again for figures whose vertices are
# mostly that far away. Feet and heads have none.
_LIMITS = {"thigh": 0.2, "shank": 0.2, "trunk": 0.35, "hand": 0.25, "foot": np.inf, "head": np.inf}
_STOUT, _HEIGHT = 1.5, 0.55

# Directions in which the farthest points of each part are kept, evenly on a spiral.
_HEIGHTS = (np.arange(48) + 0.5) / 48 * 2 - 1
_ANGLES, _RADII = np.arange(48) * np.pi * (3 - 5**0.5), np.sqrt(1 - _HEIGHTS**2)
_DIRECTIONS = np.stack([_RADII * np.cos(_ANGLES), _HEIGHTS, _RADII * np.sin(_ANGLES)], axis=-1)


@dataclass(frozen=True, eq=False)
class Flesh:
    """Points of a surface, each carried by up to four joints."""

    places: Float[np.ndarray, "points 4 3"]  # Positions away from each of its joints at rest.
    joints: Int[np.ndarray, "points 4"]  # The joints that carry a point.
    weights: Float[np.ndarray, "points 4"]  # The share of each; the sum is 1.
    # The part of each: `left_foot`, `right_foot`, `left_hand`, `right_hand` or `body`.
    part: Shaped[np.ndarray, " points"]
    sole: float  # Height of the soles at rest above the floor of the rig, meters.

    def heights(self, pose: RigPose) -> Float[np.ndarray, "frames points"]:
        """Returns the heights of all points, by linear blend skinning."""
        up = np.einsum("fvkb,vkb->fvk", pose.world[:, self.joints, 1], self.places)
        return ((up + pose.joints[:, self.joints, 1]) * self.weights).sum(axis=-1)


@lru_cache(maxsize=4)
def flesh_of(rig: Rig) -> Flesh | None:
    """Returns the points of a rig's surface; None for a file of bones alone."""
    try:
        surface = surface_of(rig)
    except LatentMotionError:  # its bones move all the same
        return None
    body, rest = rig.body, rig.skeleton.rest_joints()
    carrier = surface.joints[np.arange(len(surface.joints)), surface.weights.argmax(axis=-1)]
    head = body.joints.get("head", body.chest)
    size = max(rig.leg, _HEIGHT * float(rest[head, 1] + rig.root[1]))
    chosen, parts = [], []
    for name, bones, line in _parts(body):
        vertices = np.flatnonzero(np.isin(carrier, list(bones)))
        # How far points are from the line that ends at both joints.
        places, (start, end) = surface.vertices[vertices], rest[list(line)]
        along = end - start
        share = np.clip((places - start) @ along / max(float(along @ along), 1e-12), 0, 1)
        away = np.linalg.norm(places - (start + share[:, None] * along), axis=-1)
        limit = _LIMITS[name.rpartition("_")[2]] * size
        if len(vertices):
            limit = max(limit, _STOUT * min(limit, float(np.median(away))))
        vertices = vertices[away <= limit]
        if len(vertices):
            far = (surface.vertices[vertices] @ _DIRECTIONS.T).argmax(axis=0)
            far = vertices[np.unique(far)]
            chosen.append(far)
            part = np.full(len(far), name if name.endswith(("_foot", "_hand")) else "body")
            if name.endswith("_shank"):  # its half toward the ankle goes where the foot goes
                knee, ankle = (surface.vertices[far] - rest[joint] for joint in line)
                lower = (ankle**2).sum(axis=-1) < (knee**2).sum(axis=-1)
                part = np.where(lower, name.replace("shank", "foot"), "body")
            parts.append(part)
    if not chosen:
        return None
    points, part = np.concatenate(chosen), np.concatenate(parts)
    heights = surface.vertices[points, 1] + rig.root[1]
    sole = float(heights[np.char.endswith(part, "_foot")].min(initial=np.inf))
    return Flesh(
        places=surface.vertices[points, None] - rest[surface.joints[points]],
        joints=surface.joints[points],
        weights=surface.weights[points],
        part=part,
        sole=sole if abs(sole) < _SOLE * rig.leg else 0.0,
    )


# Share of the leg's length beyond which soles that are off the rig's floor are not its soles.
_SOLE = 0.15


def _parts(body: Humanoid) -> Iterator[tuple[str, set[int], tuple[int, int]]]:
    """Yields parts of the body, the bones that carry them, and both ends of their lines."""
    joints, torso = body.joints, [body.pelvis, *body.spine]
    named = {*torso, *body.neck, *joints.values()}
    carried: dict[int, set[int]] = {joint: set() for joint in named}
    for joint, line in enumerate(body.lines):  # bones without a name go with the next one above
        above = next((other for other in line if other in named), None)
        if above is not None:
            carried[above].add(joint)
    for joint, end in zip(torso, [*torso[1:], (body.neck or torso)[-1]], strict=True):
        yield "trunk", carried[joint], (joint, end)
    for joint in {*body.neck, joints.get("head", body.chest)} - {body.chest}:
        yield "head", {joint}, (joint, joint)
    for side in SIDES:
        leg = [joints[f"{side}_{name}"] for name in ("hip", "knee", "ankle")]
        for part, (start, end) in zip(("thigh", "shank"), pairwise(leg), strict=True):
            yield f"{side}_{part}", carried[start], (start, end)
        for part, joint in (("foot", leg[-1]), ("hand", joints[f"{side}_wrist"])):
            bones = {bone for bone, line in enumerate(body.lines) if joint in line}
            yield f"{side}_{part}", bones, (joint, joint)
