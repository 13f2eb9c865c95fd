"""glTF as a rig: mesh, materials and skin stay as they are, the file only gains animations.

With W₀ a bone's rotation in the world at rest, D its turn from there, M the matrix of its parent:

    its rotation    (D_p W₀_p)ᵀ D W₀            its translation    M_p⁻¹ (p − p_parent)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.gltf_document import Document
from latentmotion.formats.gltf_reader import Scene
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.retarget.rig_files import Take

_STILL = 1e-6
"""Changes of a rotation or a place below which a bone rests."""


class GltfFile:
    """A `.glb` or `.gltf` file.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged, or has no skeleton.
    """

    unit = 1.0
    endings = (".glb", ".gltf")

    def __init__(self, path: Path) -> None:
        self.path = path
        self.document = Document.read(path)
        try:
            self.scene = Scene(self.document, path)
            self.declared = _humanoid(self.document.json, self.scene)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
            raise FileFormatError(path, f"damaged glTF: {error!r}") from error
        self.skeleton = self.scene.skeleton
        self.root = self.scene.rest.positions[0]
        self.movable = frozenset(range(len(self.skeleton)))

    def write(self, path: Path, takes: Sequence[Take]) -> list[Path]:
        """Writes the document with these animations; those that it has of the same name go."""
        document = Document.read(self.path)
        fresh = {take.name for take in takes}
        kept = [a for a in document.json.get("animations", []) if a.get("name") not in fresh]
        document.json["animations"] = kept + [self._animation(document, take) for take in takes]
        document.write(path)
        return [path]

    def _animation(self, document: Document, take: Take) -> dict[str, Any]:
        animation = take.animation
        times = (np.arange(len(animation)) / animation.fps).astype("f4")
        clock = document.add_array(times, bounds=True)
        channels, samplers = [], []
        for node, path, values in self._tracks(animation):
            _free(document.json["nodes"][node])
            samplers.append({"input": clock, "output": document.add_array(values.astype("f4"))})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
        return {"name": take.name, "channels": channels, "samplers": samplers}

    def _tracks(self, animation: Animation) -> list[tuple[int, str, np.ndarray]]:
        """Returns node, property and values of everything that moves."""
        tracks = []
        for joint, node in enumerate(self.scene.bones):
            if np.abs(animation.rotations[:, joint] - np.eye(3)).max() > _STILL:
                tracks.append((node, "rotation", self._turned(animation, joint)))
            places = self._moved(animation, joint)
            if places is not None:
                tracks.append((node, "translation", places))
        return tracks

    def _turned(self, animation: Animation, joint: int) -> Float[np.ndarray, "frames 4"]:
        node = self.scene.bones[joint]
        above = self.scene.rest_frame(self.scene.parents[node])[1]
        turns = above.T @ animation.rotations[:, joint] @ self.scene.rest.turns[joint]
        return continuous_quaternions(quaternion_from_matrix(turns))[:, [1, 2, 3, 0]]

    def _moved(self, animation: Animation, joint: int) -> Float[np.ndarray, "frames 3"] | None:
        """Returns a bone's place in its parent, where it moves; bones above it rest."""
        start, _, linear = self.scene.rest_frame(self.scene.parents[self.scene.bones[joint]])
        if joint == 0:
            steps, rest = animation.root_positions - start, self.root - start
        elif animation.translations is not None:
            steps, rest = animation.translations[:, joint], self.skeleton.offsets[joint]
        else:
            return None
        if np.abs(steps - rest).max() <= _STILL:
            return None
        return steps @ np.linalg.inv(linear).T


def _humanoid(json: Mapping[str, Any], scene: Scene) -> dict[str, int]:
    """Returns the bones that VRM's extension names, 0.x or 1.0."""
    extensions = json.get("extensions", {})
    bones = extensions.get("VRMC_vrm", {}).get("humanoid", {}).get("humanBones", {})
    nodes = {name: bone["node"] for name, bone in bones.items()}
    older = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
    nodes |= {bone["bone"]: bone["node"] for bone in older}
    rank = {node: joint for joint, node in enumerate(scene.bones)}
    return {name: rank[node] for name, node in nodes.items() if node in rank}


def _free(node: dict[str, Any]) -> None:
    """Gives a node that rests as a matrix its parts, as animated nodes must have them."""
    if "matrix" not in node:
        return
    matrix = np.array(node.pop("matrix"), dtype=np.float64).reshape(4, 4).T
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    scale[0] *= np.sign(np.linalg.det(matrix[:3, :3])) or 1.0
    turn = quaternion_from_matrix(matrix[:3, :3] / scale)
    node |= {
        "translation": matrix[:3, 3].tolist(),
        "rotation": turn[[1, 2, 3, 0]].tolist(),
        "scale": scale.tolist(),
    }
