"""Rig files: the skeleton of a file, and the same file written again with animations.

    glTF   mesh, materials and skin stay as they are; animations are added
    FBX    as glTF; Blender converts from and to it
    BVH    the hierarchy is kept to the letter; only the motion is new
    ASF    Acclaim's skeleton; motions are written as BVH with the same joint names

glTF's bones have rest rotations. With W₀ a bone's rotation in the world at rest, D its rotation
away from it, M the matrix of its parent:

    rotation    (D_p W₀_p)ᵀ D W₀            translation    M_p⁻¹ (p − p_parent)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.formats import bvh, checks, fbx, gltf_reader, numbered
from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.kinematics.skeleton import Animation, Skeleton

# Changes of a rotation or a position up to which a bone counts as resting.
_STILL = 1e-6


class RigFile(ABC):
    """A file with a skeleton."""

    path: Path  # The file.
    skeleton: Skeleton  # Its joints in rest pose, in the file's own axes and unit.
    root: Float[np.ndarray, " 3"]  # Rest position of joint 0.
    movable: frozenset[int]  # Joints that the file can translate as well as rotate.
    unit: float | None = None  # Meters per unit, where the file says so.
    # Its own frames, in its axes and unit, where the rest pose alone does not say enough.
    animation: Animation | None = None
    mirrored: bool = False  # Whether scales mirror its joints.
    # Joints by their names in VRM's humanoid, where the file has them.
    declared: Mapping[str, int] = MappingProxyType({})
    endings: tuple[str, ...] = (".bvh",)  # File endings that `write` supports.

    @abstractmethod
    def write(
        self, path: Path, animations: Sequence[Animation], names: Sequence[str]
    ) -> list[Path]:
        """Writes the file again, with these animations in its axes and unit."""


def open_rig(path: str | Path) -> RigFile:
    """Reads the skeleton of a file, whatever its names.

    Raises:
        FileFormatError: The file is damaged.
        InputError: There is no such file, or of no such kind.
    """
    source = Path(path)
    if not source.is_file():
        raise InputError(f"there is no file {source}")
    kinds: dict[str, type[GltfFile | BvhFile]] = {
        **dict.fromkeys((".glb", ".gltf", ".vrm"), GltfFile),  # VRM is GLB with an extension
        **{".fbx": FbxFile, ".bvh": BvhFile},
    }
    if source.suffix.lower() not in kinds:
        raise InputError(f"{source} is no rig that can be read; expected {', '.join(kinds)}")
    return kinds[source.suffix.lower()](source)


class GltfFile(RigFile):
    """A `.glb` or `.gltf` file.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged, or has no skeleton.
    """

    unit = 1.0
    endings = (".glb", ".gltf", ".fbx")

    def __init__(self, path: Path) -> None:
        self.path = path
        self.document = Document.read(path)
        with gltf_reader.damage(path):
            self.scene = gltf_reader.GltfScene(self.document, path)
            self.declared = self.scene.declared()
            frames = (self.scene.rest_frame(bone) for bone in self.scene.bones)
            self.mirrored = any(np.linalg.det(linear) < 0 for _, _, linear in frames)
        self.skeleton = self.scene.skeleton
        self.root = self.scene.rest.positions[0]
        self.movable = frozenset(range(len(self.skeleton)))

    def write(
        self, path: Path, animations: Sequence[Animation], names: Sequence[str]
    ) -> list[Path]:
        """Writes the document with these animations, which replace others of the same name.

        FBX is written by the user's Blender.
        """
        if path.suffix.lower() == ".fbx":
            write_glb = partial(self.write, animations=animations, names=names)
            return fbx.convert(write_glb, path, animations[0].fps)
        with gltf_reader.damage(self.path):
            document = deepcopy(self.document)
            for node, entry in self.scene.entries_at_rest():
                document.json["nodes"][node] = entry
            old = document.json.get("animations", [])
            if not isinstance(old, list):
                raise TypeError(f"animations: expected a list, found {old!r:.40}")
            entries = [entry for entry in old if entry.get("name") not in names]
            for name, animation in zip(names, animations, strict=True):
                times = (np.arange(len(animation)) / animation.fps).astype("f4")
                clock = document.add_array(times, bounds=True)
                channels, samplers = [], []
                for number, (node, channel, values) in enumerate(self._tracks(animation)):
                    entry = document.json["nodes"][node]
                    if "matrix" in entry:  # animated nodes must have its parts instead
                        entry |= self.scene.transforms[node].parts()
                        del entry["matrix"]
                    output = document.add_array(values.astype("f4"))
                    samplers.append({"input": clock, "output": output})
                    channels.append({"sampler": number, "target": {"node": node, "path": channel}})
                entries.append({"name": name, "channels": channels, "samplers": samplers})
            document.json["animations"] = entries
        document.write(path)
        return [path]

    def _tracks(self, animation: Animation) -> list[tuple[int, str, np.ndarray]]:
        """Returns node, property and values of every bone that moves."""
        tracks = []
        for joint, node in enumerate(self.scene.bones):
            start, above, linear = self.scene.rest_frame(self.scene.parents[node])
            if np.abs(animation.rotations[:, joint] - np.eye(3)).max() > _STILL:
                local = above.T @ animation.rotations[:, joint] @ self.scene.rest.rotations[joint]
                quaternions = continuous_quaternions(quaternion_from_matrix(local))
                tracks.append((node, "rotation", quaternions[:, [1, 2, 3, 0]]))
            if joint == 0:
                offsets, rest = animation.root_positions - start, self.root - start
            elif animation.translations is not None:
                offsets, rest = animation.translations[:, joint], self.skeleton.offsets[joint]
            else:
                continue
            if np.abs(offsets - rest).max() > _STILL:
                tracks.append((node, "translation", offsets @ np.linalg.inv(linear).T))
        return tracks


class FbxFile(GltfFile):
    """An FBX file, which the user's Blender converts to glTF and back.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged, or has no skeleton.
        MissingProgramError: There is no Blender.
    """

    endings = (".fbx", ".glb", ".gltf")

    def __init__(self, path: Path) -> None:
        with fbx.as_glb(path) as glb:
            super().__init__(glb)
        self.path = path


class BvhFile(RigFile):
    """A BVH file. Its frames say where it stands; in its rest pose all its angles are 0.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = checks.read_lines(path)
        self.nodes, start = bvh.read_hierarchy(path, lines)
        self.head = lines[:start]
        self.animation = bvh.read_bvh(path, 1.0)
        self.skeleton, self.root = self.animation.skeleton, np.asarray(self.nodes[0].offset)
        self.movable = frozenset(
            joint
            for joint, node in enumerate(self.nodes)
            if {axis for axis, kind in node.channels if kind == "position"} == set("XYZ")
        )

    def write(
        self, path: Path, animations: Sequence[Animation], names: Sequence[str]
    ) -> list[Path]:
        """Writes one file for each animation: `out.bvh`, or `out-1.bvh`, `out-2.bvh` and so on."""
        paths = numbered(path, len(animations))
        for target, animation in zip(paths, animations, strict=True):
            columns = []
            for joint, node in enumerate(self.nodes):
                # Angles about axes that a joint does not have are left out.
                order = node.order + "".join(axis for axis in "ZXY" if axis not in node.order)
                degrees = np.rad2deg(
                    bvh.continuous_euler(animation.rotations[:, joint, None], order)
                )
                angles = dict(zip(order, degrees[:, 0].T, strict=True))
                positions = animation.root_positions
                if joint and animation.translations is not None:
                    positions = animation.translations[:, joint]
                elif joint:
                    positions = np.tile(animation.skeleton.offsets[joint], (len(animation), 1))
                for axis, kind in node.channels:
                    position = positions[:, "XYZ".index(axis)]
                    columns.append(position if kind == "position" else angles[axis])
            bvh.write_frames(target, self.head, columns, animation.fps)
        return paths
