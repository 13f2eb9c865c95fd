"""The surface of a character, as a skin that its rig carries."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from latentmotion.errors import InputError
from latentmotion.formats.gltf_reader import damage
from latentmotion.render.mannequin import Mannequin
from latentmotion.retarget.rig import Rig
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
            for node, entry in enumerate(file.scene.nodes):
                primitives = (
                    file.document.entry("meshes", entry["mesh"])["primitives"]
                    if ("mesh" in entry)
                    else []
                )
                triangles = [
                    primitive
                    for primitive in primitives
                    if primitive.get("mode", _TRIANGLES) == _TRIANGLES
                ]
                carried = [_primitive(file, node, primitive) for primitive in triangles]
                parts += [part for part in carried if part is not None]
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
    return Mannequin(vertices, _normals(vertices, faces), faces, joints, weights, rig.skeleton)


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
        line = scene.line(node)
        bone = next((above for above in line if above in rank), None)
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
    rest = np.tile(np.eye(4), (len(bones), 1, 1))
    for number, bone in enumerate(bones):
        rest[number, :3, 3], _, rest[number, :3, :3] = scene.rest_frame(bone)
    used = document.array(attributes["JOINTS_0"]).astype(int)
    weights = document.array(attributes["WEIGHTS_0"]).astype(np.float64)
    weights = weights / np.maximum(weights.sum(-1, keepdims=True), 1e-9)
    moved = (rest @ inverse)[used]
    flat = np.concatenate([places, np.ones((len(places), 1))], axis=-1)
    world = np.einsum("vk,vkab,vb->va", weights, moved[..., :3, :], flat)
    return world, np.array([rank[bone] for bone in bones])[used], weights, faces


def _normals(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Returns smooth normals; vertices at one place share theirs, such as at a texture's seams."""
    _, corner_group = np.unique(np.round(vertices, 5), axis=0, return_inverse=True)
    corner_group = corner_group.reshape(-1)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    total = np.zeros((corner_group.max() + 1, 3))
    for corner in range(3):
        np.add.at(total, corner_group[faces[:, corner]], np.cross(b - a, c - a))
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return (total / np.where(length > 0, length, 1))[corner_group]
