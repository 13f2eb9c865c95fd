"""glTF reader: the bones of any skinned `.glb` or `.gltf` file and the animations that move them.

Positions include all scales and all nodes above the bones; `bones.py` turns them into bones whose
rest pose has neither rotation nor scale.

Channels interpolate by steps, by straight lines and great arcs, or by cubic splines. Between keys k
and k + 1, d seconds apart, at the share s between them, glTF's cubic spline is Hermite's with the
tangents d b_k and d a_{k+1}; its keys are triples (in-tangent a, value, out-tangent b).
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats import bones as bone_poses
from latentmotion.formats.checks import check_filled, checked_animation
from latentmotion.formats.gltf_document import Document
from latentmotion.formats.takes import SkeletonTake
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from latentmotion.kinematics.skeleton import Animation
from latentmotion.storage.limits import MOST_DEPTH, MOST_JOINTS, MOST_NODES, MOST_NUMBER
from latentmotion.storage.reading import blamed_on

_PATHS = ("translation", "rotation", "scale")
_DAMAGE = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError)


def read_animations(path: str | Path) -> list[Animation]:
    """Reads all animations of a file, sampled at the rate of their keys, 30 fps where uneven.

    The skeleton is that of the skin with the most joints, or all animated nodes where there is
    no skin. A file without animations gives its rest pose as one frame.

    Raises:
        FileFormatError: The file is damaged, or holds neither a skin nor an animation.
    """
    return animations_of(Document.read(path))[0]


def animations_of(document: Document) -> tuple[list[Animation], Mapping[str, int]]:
    """Returns the animations of a document that was read, and VRM's names of its joints, if any."""
    path = document.path or Path("glTF")
    with damage(path):
        scene = GltfScene(document, path)
        takes = [read_tracks(document, take) for take in document.json.get("animations", [])]
        animations = [scene.animation(tracks) for tracks in takes if tracks]
        return animations or [scene.animation([])], scene.declared()


@contextmanager
def damage(path: Path) -> Iterator[None]:
    """Turns the errors of JSON of other types than glTF's into errors of the file.

    Raises:
        FileFormatError: The block raised one of them.
    """
    damaged = blamed_on(path, *_DAMAGE, problem="damaged glTF: {error!r:.300}")
    with damaged, np.errstate(all="ignore"), blamed_on(path):  # results are checked to be finite
        yield


def read_takes(path: str | Path) -> list[SkeletonTake]:
    """Reads all animations, with the captions of files that `gltf.write` wrote.

    Raises:
        FileFormatError: The file is damaged.
    """
    document = Document.read(path)
    animations, declared = animations_of(document)
    with blamed_on(path):
        notes = [take.get("extras") for take in document.json.get("animations", [])]
        notes = notes if len(notes) == len(animations) else [None] * len(animations)
    return [
        SkeletonTake(animation, note if isinstance(note, dict) else {}, declared)
        for animation, note in zip(animations, notes, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Transform:
    """A node's transform relative to its parent, over time or at rest."""

    translation: Float[np.ndarray, "... 3"]
    rotation: Float[np.ndarray, "... 3 3"]
    scale: Float[np.ndarray, "... 3"]

    @classmethod
    def of(cls, node: Mapping[str, Any]) -> _Transform:
        """Returns the rest transform of a node."""
        if "matrix" in node:
            matrix = _numbers(node["matrix"], 16).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            scale[0] *= np.sign(np.linalg.det(matrix[:3, :3])) or 1.0
            rotation = matrix[:3, :3] / np.where(scale == 0, 1, scale)
            rotation = matrix_from_quaternion(quaternion_from_matrix(rotation))
            return cls(matrix[:3, 3], rotation, scale)
        return cls(
            _numbers(node.get("translation", (0, 0, 0)), 3),
            _matrix(_numbers(node.get("rotation", (0, 0, 0, 1)), 4)),
            _numbers(node.get("scale", (1, 1, 1)), 3),
        )

    def parts(self) -> dict[str, list[float]]:
        """Returns what a node at rest says of it."""
        rotation = quaternion_from_matrix(self.rotation)[[1, 2, 3, 0]]
        parts = (self.translation, rotation, self.scale)
        return {name: part.tolist() for name, part in zip(_PATHS, parts, strict=True)}


# Difference of matrices, some 6°, beyond which nodes do not stand as the skin was bound.
_TURNED = 0.1

# Determinant of an inverse bind matrix that says nothing.
_FLAT = 1e-12


class GltfScene:
    """The nodes of a document, and which of them are bones.

    Args:
        document: The file.
        path: Name of the file, for errors.
    """

    def __init__(self, document: Document, path: Path) -> None:
        self.nodes: list[dict[str, Any]] = document.json.get("nodes", [])
        self.path = path
        self._extensions = document.json.get("extensions", {})
        if len(self.nodes) > MOST_NODES:
            raise FileFormatError(path, f"{len(self.nodes):,} nodes, at most {MOST_NODES:,}")
        self.parents = [-1] * len(self.nodes)
        for number, node in enumerate(self.nodes):
            for child in node.get("children", []):
                document.entry("nodes", child)
                if self.parents[child] != -1:
                    raise FileFormatError(path, f"node {child} has two parents, expected a tree")
                self.parents[child] = number
        self.bones = self._bones(document, path)
        needed = {node for bone in self.bones for node in self.line(bone)}
        self.transforms = {node: _Transform.of(self.nodes[node]) for node in sorted(needed)}
        self._stated = len(document.binary) // 4
        self._frames_made = 0
        rank = {node: number for number, node in enumerate(self.bones)}
        self.bone_parents = tuple(rank[self.parents[b]] if n else -1 for n, b in enumerate(rank))
        self.at_rest = self._bound(document) or self.transforms
        self.rest = self._world(self.at_rest)
        names = [str(self.nodes[bone].get("name") or f"node_{bone}") for bone in self.bones]
        self.skeleton = bone_poses.plain_skeleton(path.stem, names, self.bone_parents, self.rest)

    def declared(self) -> dict[str, int]:
        """Returns the bones that VRM's extension names, by these names."""
        index = {node: joint for joint, node in enumerate(self.bones)}
        return {name: index[node] for name, node in self.humanoid().items() if node in index}

    def humanoid(self) -> dict[str, int]:
        """Returns the nodes that VRM's extension names, 1.0 or 0.x, by these names."""
        nodes = {
            name: bone["node"]
            for extension in ("VRMC_vrm", "VRMC_vrm_animation")
            for name, bone in self._extensions.get(extension, {})
            .get("humanoid", {})
            .get("humanBones", {})
            .items()
        }
        older = self._extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
        return nodes | {bone["bone"]: bone["node"] for bone in older}

    def animation(self, tracks: Sequence[Track]) -> Animation:
        """Returns how one animation moves the bones."""
        keys = [track.times for track in tracks]
        seconds = np.unique(np.concatenate(keys)) if keys else np.zeros(0)
        fps, times = bone_poses.even_rate(self.path, seconds)
        self._frames_made += len(times)
        check_filled(self.path, self._frames_made, len(self.transforms), self._stated)
        tracks = [track for track in tracks if track.node in self.transforms]
        values = {(track.node, track.path): track.sample(times) for track in tracks}
        transforms = {}
        for node, rest in self.transforms.items():
            quaternions = values.get((node, "rotation"))
            transforms[node] = _Transform(
                values.get((node, "translation"), rest.translation),
                rest.rotation if quaternions is None else _matrix(quaternions),
                values.get((node, "scale"), rest.scale),
            )
        moved = self._world(transforms, len(times))
        animation = bone_poses.plain_animation(self.skeleton, self.rest, moved, fps)
        return checked_animation(self.path, animation)

    def _world(self, transforms: Mapping[int, _Transform], *frames: int) -> bone_poses.WorldPose:
        """Returns positions and rotations of the bones in the world, over frames or at rest."""
        bones = self._frames(transforms, self.bones)
        places = [np.broadcast_to(bones[bone][0], (*frames, 3)) for bone in self.bones]
        turns = [np.broadcast_to(bones[bone][1], (*frames, 3, 3)) for bone in self.bones]
        return bone_poses.WorldPose(np.stack(places, axis=-2), np.stack(turns, axis=-3))

    def rest_frame(self, node: int) -> bone_poses.Frame:
        """Returns the frame of a node in rest pose; -1 is the world itself."""
        line = {above: _Transform.of(self.nodes[above]) for above in self.line(node)}
        return self._frames(line | self.at_rest, [node])[node]

    def entries_at_rest(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yields nodes that stand otherwise in the file, as they are at rest."""
        for node, rest in self.at_rest.items():
            if rest is not self.transforms[node]:
                entry = {key: value for key, value in self.nodes[node].items() if key != "matrix"}
                yield node, entry | rest.parts()

    def _bound(self, document: Document) -> dict[int, _Transform] | None:
        """Returns the transforms in which the skin was bound, where the nodes stand otherwise.

        A file that was exported in the middle of a clip has nodes in one of its poses. The skin's
        inverse bind matrices say where bones were: G B = K for all of them, G the matrix of a node
        and K that of the mesh.
        """
        skins = [skin for skin in document.json.get("skins", []) if "inverseBindMatrices" in skin]
        if not skins:
            return None
        skin = max(skins, key=lambda skin: len(skin["joints"]))
        bones = [bone for bone in skin["joints"] if bone in self.bones]
        inverse = document.array(skin["inverseBindMatrices"]).astype(np.float64)
        if len(bones) < len(skin["joints"]) or np.abs(np.linalg.det(inverse)).min() < _FLAT:
            return None
        frames = self._frames(self.transforms, bones)
        mesh = np.stack([bone_poses.matrix_of(frames[bone]) for bone in bones]) @ inverse
        first = bones.index(min(bones, key=lambda bone: len(self.line(bone))))
        scale = np.cbrt(abs(np.linalg.det(mesh[first, :3, :3])))
        if np.abs(mesh[:, :3, :3] - mesh[first, :3, :3]).max() < _TURNED * scale:
            return None
        world = dict(zip(bones, mesh[first] @ np.linalg.inv(inverse), strict=True))
        transforms = dict(self.transforms)
        for bone in sorted(bones, key=lambda bone: len(self.line(bone))):
            above, parent = world.get(self.parents[bone]), self.parents[bone]
            if above is None:
                above = bone_poses.matrix_of(self._frames(transforms, [parent])[parent])
            local = np.linalg.inv(above) @ world[bone]
            transforms[bone] = _Transform.of({"matrix": local.T.ravel().tolist()})
        return transforms

    def _frames(
        self, transforms: Mapping[int, _Transform], nodes: Sequence[int]
    ) -> dict[int, bone_poses.Frame]:
        """Returns the frames of nodes and of all their ancestors."""
        frames: dict[int, bone_poses.Frame] = {-1: (np.zeros(3), np.eye(3), np.eye(3))}
        needed = {ancestor for node in nodes for ancestor in self.line(node)}
        for node in sorted(needed, key=lambda node: len(self.line(node))):
            local, above = transforms[node], frames[self.parents[node]]
            frames[node] = bone_poses.placed(above, local.translation, local.rotation, local.scale)
        return frames

    def line(self, node: int) -> list[int]:
        """Returns a node and its ancestors, upward."""
        line = []
        while node >= 0:
            line.append(node)
            node = self.parents[node]
            if len(line) > MOST_DEPTH:
                problem = (
                    "is its own ancestor" if node in line else f"is below {len(line):,} others"
                )
                raise FileFormatError(self.path, f"node {line[0]} {problem}, expected a tree")
        return line

    def _bones(self, document: Document, path: Path) -> list[int]:
        """Returns the nodes that are bones, the root first and parents before children."""
        groups = [list(skin["joints"]) for skin in document.json.get("skins", [])]
        if not groups:
            takes = document.json.get("animations", [])
            targets = [channel["target"] for take in takes for channel in take["channels"]]
            moved = {target["node"] for target in targets if "node" in target}
            groups = [sorted(set(self.humanoid().values()) or moved)]
        joints = {node for group in groups for node in group}
        for node in joints:
            document.entry("nodes", node)
        main = max(groups, key=len)
        if len(joints) > MOST_JOINTS:
            raise FileFormatError(path, f"has more than {MOST_JOINTS:,} bones")
        if not main:
            raise FileFormatError(path, "has neither a skin nor an animation; expected a figure")
        shared = set(self.line(main[0])).intersection(*(self.line(bone) for bone in main[1:]))
        if not shared:
            raise FileFormatError(path, "the joints of its skin hang on no common node")
        root = max(shared, key=lambda node: len(self.line(node)))  # the lowest above all
        listed = dict.fromkeys(node for group in (main, *groups) for node in group)
        below = {node: self.line(node) for node in listed if root in self.line(node)}
        lines = [line[: line.index(root) + 1] for line in below.values()]
        needed = dict.fromkeys([*below, *(node for line in lines for node in line)])
        order = [root, *(node for node in needed if node != root)]
        rank = {node: number for number, node in enumerate(order)}
        if all(rank[self.parents[node]] < rank[node] for node in order[1:]):
            return order
        return sorted(order, key=lambda node: len(self.line(node)))


def _matrix(quaternions: Float[np.ndarray, "*frames 4"]) -> Float[np.ndarray, "*frames 3 3"]:
    """Converts glTF's quaternions (x, y, z, w) to matrices."""
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return matrix_from_quaternion((quaternions / length)[..., [3, 0, 1, 2]])


def _numbers(values: Any, count: int) -> Float[np.ndarray, " count"]:
    """Returns numbers of the JSON; raises ValueError for others."""
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != (count,) or not (np.abs(numbers) <= MOST_NUMBER).all():
        raise ValueError(f"found {reprlib.repr(values)}, expected {count} numbers")
    return numbers


@dataclass(frozen=True, eq=False)
class Track:
    """One property of one node over time."""

    node: int  # Index of the node.
    path: str  # `translation`, `rotation` or `scale`.
    times: Float[np.ndarray, " keys"]  # Seconds, rising.
    # One row per key, three for a cubic spline; quaternions are (x, y, z, w).
    values: Float[np.ndarray, "rows values"]
    interpolation: str  # `LINEAR`, `STEP` or `CUBICSPLINE`.

    def sample(self, times: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames values"]:
        """Returns its values at any times; before the first and after the last key it holds."""
        last = max(len(self.times) - 2, 0)
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, last)
        after = np.minimum(before + 1, len(self.times) - 1)
        length = self.times[after] - self.times[before]
        share = (times - self.times[before]) / np.where(length > 0, length, 1)
        share = np.clip(np.where(length > 0, share, 0), 0, 1)
        if self.interpolation == "CUBICSPLINE":
            keys, s = self.values.reshape(len(self.times), 3, -1), share[:, None]
            d = length[:, None]
            return (
                (2 * s**3 - 3 * s**2 + 1) * keys[before, 1]
                + (s**3 - 2 * s**2 + s) * (d * keys[before, 2])
                + (3 * s**2 - 2 * s**3) * keys[after, 1]
                + (s**3 - s**2) * (d * keys[after, 0])
            )
        if self.interpolation == "STEP":
            return self.values[np.where(share > 1 - 1e-6, after, before)]
        start, end = self.values[before], self.values[after]
        if self.path == "rotation":
            return slerp(start, end, share)
        return start + share[:, None] * (end - start)


def read_tracks(document: Document, animation: Mapping[str, Any]) -> list[Track]:
    """Returns the channels of one animation that move nodes; morph targets are left out."""
    tracks: dict[tuple[int, str], Track] = {}
    arrays: dict[int, np.ndarray] = {}  # several channels share their times
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        if "node" in target and target["path"] in _PATHS:
            node, path = target["node"], target["path"]
            document.entry("nodes", node)
            if (node, path) in tracks:
                raise ValueError(f"{path} of node {node} has two channels")
            for accessor in (sampler["input"], sampler["output"]):
                if accessor not in arrays:
                    arrays[accessor] = document.array(accessor).astype(np.float64)
            times, values = arrays[sampler["input"]], arrays[sampler["output"]]
            kind = sampler.get("interpolation", "LINEAR")
            rows = len(times) * (3 if kind == "CUBICSPLINE" else 1)
            expected = (rows, 4 if path == "rotation" else 3)
            if values.shape != expected or times.ndim != 1 or not len(times):
                raise ValueError(f"{path} of node {node} has {values.shape}, expected {expected}")
            finite = np.isfinite(times).all() and (np.abs(values) <= MOST_NUMBER).all()
            if not (finite and (np.diff(times) > 0).all()):
                raise ValueError(f"{path} of node {node} has NaN, or times that do not rise")
            tracks[node, path] = Track(node, path, times, values, kind)
    return list(tracks.values())
