"""Rigs for tests, built by code: T-pose in centimeters, A-pose with z along bones, child of VRM.

Each is written as a `.glb` whose skin is one box a bone, so that pictures show how bones turn.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.formats.gltf_document import INDICES, VERTICES, Document
from latentmotion.kinematics.rotations import quaternion_between, quaternion_from_matrix

# Joint → its parent and its place in rest pose, meters, y up, facing +z.
Tree = Mapping[str, tuple[str | None, tuple[float, float, float]]]


@dataclass(frozen=True)
class RigShape:
    """A character to be written."""

    tree: Tree
    # The local axis that runs along bones; none where bones have the world's axes.
    along: tuple[float, float, float] | None = None
    unit: float = 1.0  # Meters per unit of the file's nodes.
    above: dict = field(default_factory=dict)  # What the node above all bones has: rotation, scale.
    extensions: dict = field(default_factory=dict)


def _shape(
    marks: Sequence[str], middle: Mapping[str, list], left: Mapping[str, list], **settings: Any
) -> RigShape:
    """Returns a character of the table, whose left side is mirrored."""
    tree = {name: (parent or None, tuple(place)) for name, (parent, *place) in middle.items()}
    for side, sign in zip(marks, (1, -1), strict=True):
        for name, (parent, x, y, z) in left.items():
            tree[name.replace("@", side)] = (parent.replace("@", side), (sign * x, y, z))
    return RigShape(tree, **settings)


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

RIGS = {name: _shape(**row) for name, row in _TABLE.items()}
MIXAMO, UNREAL, CHILD = RIGS.values()


def write_rig(path: Path, shape: RigShape) -> Path:
    """Writes a rig as `.glb` or `.gltf`."""
    names = list(shape.tree)
    places = np.array([shape.tree[name][1] for name in names], float) / shape.unit
    parents = [-1 if (p := shape.tree[n][0]) is None else names.index(p) for n in names]
    turns = np.stack([_axes(shape, places, parents, joint) for joint in range(len(names))])
    nodes = [{"name": "Armature", "children": [1], **shape.above}]
    for joint, name in enumerate(names):
        above = turns[parents[joint]] if parents[joint] >= 0 else np.eye(3)
        start = places[parents[joint]] if parents[joint] >= 0 else np.zeros(3)
        quaternion = quaternion_from_matrix(above.T @ turns[joint])
        node = {"name": name, "translation": (above.T @ (places[joint] - start)).tolist()}
        node["rotation"] = quaternion[[1, 2, 3, 0]].tolist()
        below = [child + 1 for child, parent in enumerate(parents) if parent == joint]
        nodes.append(node | ({"children": below} if below else {}))
    document = Document()
    mesh = _boxes(document, places, parents)
    inverse = np.tile(np.eye(4, dtype="f4"), (len(names), 1, 1))
    inverse[:, :3, :3] = np.swapaxes(turns, 1, 2)
    inverse[:, :3, 3] = -np.einsum("jba,jb->ja", turns, places)
    skin = {"joints": list(range(1, len(names) + 1)), "skeleton": 1}
    surface = {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.5, 0.3, 1]}, "name": "clay"}
    document.json |= {
        "scene": 0,
        "scenes": [{"nodes": [0, len(nodes)]}],
        "nodes": [*nodes, {"name": "Body", "mesh": 0, "skin": 0}],
        "materials": [surface],
        "meshes": [{"name": "Body", "primitives": [mesh]}],
        "skins": [skin | {"inverseBindMatrices": document.add_array(inverse)}],
        **shape.extensions,
    }
    document.write(path)
    return path


def _axes(shape: RigShape, places: np.ndarray, parents: list[int], joint: int) -> np.ndarray:
    """Returns a bone's axes in rest pose, with its own axis along it."""
    if shape.along is None:
        return np.eye(3)
    ends = [child for child, parent in enumerate(parents) if parent == joint]
    end = places[ends[0]] - places[joint] if ends else places[joint] - places[parents[joint]]
    if np.linalg.norm(end) < 1e-9:
        return np.eye(3)
    from latentmotion.kinematics.rotations import matrix_from_quaternion

    return matrix_from_quaternion(quaternion_between(np.array(shape.along, float), end))


def _boxes(document: Document, places: np.ndarray, parents: list[int]) -> dict:
    """Adds a box along every bone, flat ones for feet and hands so that twists are seen."""
    vertices, normals, joints, triangles = [], [], [], []
    size = np.ptp(places[:, 1])
    ground = [joint for joint in range(len(places)) if places[joint, 1] < 0.01 * size]
    for joint in range(len(places)):
        ends = [child for child, parent in enumerate(parents) if parent == joint]
        start = places[joint]
        end = max(
            (places[child] for child in ends), key=lambda p: np.linalg.norm(p - start), default=None
        )
        end = start + 0.5 * (start - places[parents[joint]]) if end is None else end
        if joint in ground or parents[joint] in ground[1:]:
            continue
        corners, facing = _box(start, end, size)
        triangles.append(np.arange(36) + 36 * len(vertices))
        vertices.append(corners)
        normals.append(facing)
        joints.append(np.full(36, joint))
    weights = np.zeros((36 * len(vertices), 4), "f4")
    weights[:, 0] = 1
    owners = np.zeros((len(weights), 4), "u2")
    owners[:, 0] = np.concatenate(joints)
    attributes = {
        "POSITION": document.add_array(
            np.concatenate(vertices).astype("f4"), VERTICES, bounds=True
        ),
        "NORMAL": document.add_array(np.concatenate(normals).astype("f4"), VERTICES),
        "JOINTS_0": document.add_array(owners, VERTICES),
        "WEIGHTS_0": document.add_array(weights, VERTICES),
    }
    indices = document.add_array(np.concatenate(triangles).astype("u4"), INDICES)
    return {"attributes": attributes, "indices": indices, "material": 0}


def _box(start: np.ndarray, end: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    along = end - start
    length = max(float(np.linalg.norm(along)), 1e-3 * size)
    along = along / length if np.linalg.norm(along) > 0 else np.array([0.0, 1, 0])
    side = np.cross(along, (0, 0, 1) if abs(along[2]) < 0.8 else (0, 1, 0))
    side /= np.linalg.norm(side)
    other = np.cross(along, side)
    width = np.array([0.03, 0.018]) * size
    if start[1] < 0.08 * size:
        width = np.array([0.03, 0.008]) * size
    faces = []
    for axis in range(3):
        for sign in (-1, 1):
            quad = [(-1, -1), (1, -1), (1, 1), (-1, 1)][::sign]
            faces.append([np.insert(np.array(p, float), axis, sign) for p in quad])
    units = np.array(faces)
    scaled = units * (0.5 * length, width[0], width[1]) + (0.5 * length, 0, 0)
    frame = np.stack([along, side, other])
    corners = start + scaled @ frame
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normals = np.cross(b - a, c - b)
    outward = (normals * (a - corners.mean((0, 1)))).sum(-1)
    corners = np.where(outward[:, None, None] < 0, corners[:, ::-1], corners)
    normals = normals * np.sign(outward)[:, None]
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    order = [0, 1, 2, 0, 2, 3]
    return corners[:, order].reshape(36, 3), np.repeat(normals, 6, axis=0)
