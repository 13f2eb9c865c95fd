"""glTF in: the bones of any skinned `.glb` or `.gltf` file and how its animations move them.

Positions take all scales and all nodes above the bones into account; `bones.py` makes plain
bones of them, whose rests have neither rotation nor scale.

Channels are steps, straight lines and great arcs, or cubic splines. Between keys k and k + 1, d
seconds apart, at the share s of the way, glTF's cubic spline is Hermite's with the tangents d b_k
and d a_{k+1}; its keys are triples (in-tangent a, value, b).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.bones import WorldPose, even_rate, plain_animation, plain_skeleton
from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from latentmotion.motion import Motion

_PATHS = ("translation", "rotation", "scale")

Frame = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Where a node is in the world: its position, its rotation, and its matrix with all scales."""


def read_animations(path: str | Path) -> list[Animation]:
    """Reads all animations of a file, sampled at the rate of their keys, 30 fps where uneven.

    The skeleton is that of the skin with the most joints, or all animated nodes where there is
    no skin. A file without animations gives its rest pose as one frame.

    Raises:
        FileFormatError: The file is damaged, or holds neither a skin nor an animation.
    """
    return animations_of(Document.read(path))


def animations_of(document: Document) -> list[Animation]:
    """Returns the animations of a document that was read; see `read_animations`."""
    path = document.path or Path("glTF")
    try:
        scene = Scene(document, path)
        takes = [read_tracks(document, take) for take in document.json.get("animations", [])]
        return [scene.animation(tracks) for tracks in takes if tracks] or [scene.animation([])]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(path, f"damaged glTF: {error!r}") from error


def read_takes(path: str | Path) -> list[Motion]:
    """Reads all animations as motions, with the captions of those that we wrote.

    Raises:
        FileFormatError: The file is damaged.
        DataError: No joint map fits the skeleton.
    """
    from latentmotion.formats.takes import motion_of

    document = Document.read(path)
    notes = [take.get("extras") for take in document.json.get("animations", [])]
    animations = animations_of(document)
    notes = notes if len(notes) == len(animations) else [None] * len(animations)
    return [
        motion_of(animation, note if isinstance(note, dict) else {})
        for animation, note in zip(animations, notes, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Place:
    """A node's place relative to its parent, over time or at rest."""

    translation: Float[np.ndarray, "... 3"]
    rotation: Float[np.ndarray, "... 3 3"]
    scale: Float[np.ndarray, "... 3"]


class Scene:
    """The nodes of a document, and which of them are bones.

    Args:
        document: The file.
        path: Its name, for errors.
    """

    def __init__(self, document: Document, path: Path) -> None:
        self.nodes: list[dict[str, Any]] = document.json.get("nodes", [])
        self.parents = _parents(self.nodes, path)
        self.places = [_place(node) for node in self.nodes]
        self.bones = self._bones(document, path)
        rank = {node: number for number, node in enumerate(self.bones)}
        self.bone_parents = tuple(rank[self.parents[b]] if n else -1 for n, b in enumerate(rank))
        self.rest = self._world(self.places)
        names = [self.nodes[bone].get("name") or f"node_{bone}" for bone in self.bones]
        self.skeleton = plain_skeleton(path.stem, names, self.bone_parents, self.rest)

    def animation(self, tracks: Sequence[Track]) -> Animation:
        """Returns how one animation moves the bones."""
        fps, times = clock(tracks)
        values = {(track.node, track.path): track.sample(times) for track in tracks}
        places = []
        for node, rest in enumerate(self.places):
            turns = values.get((node, "rotation"))
            places.append(
                _Place(
                    values.get((node, "translation"), rest.translation),
                    rest.rotation if turns is None else _matrix(turns),
                    values.get((node, "scale"), rest.scale),
                )
            )
        pose = self._world(places)
        moved = WorldPose(
            np.broadcast_to(pose.positions, (len(times), *pose.positions.shape[-2:])),
            np.broadcast_to(pose.turns, (len(times), *pose.turns.shape[-3:])),
        )
        return plain_animation(self.skeleton, self.rest, moved, fps)

    def _world(self, places: Sequence[_Place]) -> WorldPose:
        """Returns positions and rotations of the bones in the world."""
        known = self._frames(places, self.bones)
        bones = [known[bone] for bone in self.bones]
        return WorldPose(
            _stacked([bone[0] for bone in bones], 1), _stacked([bone[1] for bone in bones], 2)
        )

    def rest_frame(self, node: int) -> Frame:
        """Returns where a node is in rest pose; -1 is the world itself."""
        return self._frames(self.places, [node])[node]

    def _frames(self, places: Sequence[_Place], nodes: Sequence[int]) -> dict[int, Frame]:
        """Returns where nodes are, and all above them."""
        known: dict[int, Frame] = {-1: (np.zeros(3), np.eye(3), np.eye(3))}
        needed = {ancestor for node in nodes for ancestor in self._line(node)}
        for node in sorted(needed, key=lambda node: len(self._line(node))):
            place = places[node]
            start, turn, linear = known[self.parents[node]]
            known[node] = (
                start + np.einsum("...ab,...b->...a", linear, place.translation),
                turn @ place.rotation,
                linear @ (place.rotation * place.scale[..., None, :]),
            )
        return known

    def _line(self, node: int) -> list[int]:
        """Returns a node and those above it, upward."""
        line = []
        while node >= 0:
            line.append(node)
            node = self.parents[node]
        return line

    def _bones(self, document: Document, path: Path) -> list[int]:
        """Returns the nodes that are bones, the root first and parents before children."""
        groups = [list(skin["joints"]) for skin in document.json.get("skins", [])]
        if not groups:
            takes = document.json.get("animations", [])
            targets = [channel["target"] for take in takes for channel in take["channels"]]
            groups = [sorted({target["node"] for target in targets if "node" in target})]
        main = max(groups, key=len)
        if not main:
            raise FileFormatError(path, "has neither a skin nor an animation; expected a figure")
        root = self._root(main, path)
        listed = dict.fromkeys(node for group in (main, *groups) for node in group)
        below = {node: self._line(node) for node in listed if root in self._line(node)}
        lines = [line[: line.index(root) + 1] for line in below.values()]
        needed = dict.fromkeys([*below, *(node for line in lines for node in line)])
        order = [root, *(node for node in needed if node != root)]
        rank = {node: number for number, node in enumerate(order)}
        if all(rank[self.parents[node]] < rank[node] for node in order[1:]):
            return order
        return sorted(order, key=lambda node: len(self._line(node)))

    def _root(self, bones: Sequence[int], path: Path) -> int:
        """Returns the lowest node that all these are, or hang below."""
        shared = set(self._line(bones[0]))
        for bone in bones[1:]:
            shared &= set(self._line(bone))
        if not shared:
            raise FileFormatError(path, "the joints of its skin hang on no common node")
        return max(shared, key=lambda node: len(self._line(node)))


def _parents(nodes: Sequence[Mapping[str, Any]], path: Path) -> list[int]:
    parents = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parents[child] != -1:
                raise FileFormatError(path, f"node {child} has two parents, expected a tree")
            parents[child] = number
    for node in range(len(nodes)):
        above, steps = node, 0
        while above >= 0:
            above, steps = parents[above], steps + 1
            if steps > len(nodes):
                raise FileFormatError(path, f"node {node} is its own ancestor, expected a tree")
    return parents


def _place(node: Mapping[str, Any]) -> _Place:
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        scale[0] *= np.sign(np.linalg.det(matrix[:3, :3])) or 1.0
        turn = matrix[:3, :3] / np.where(scale == 0, 1, scale)
        return _Place(matrix[:3, 3], matrix_from_quaternion(quaternion_from_matrix(turn)), scale)
    return _Place(
        np.array(node.get("translation", (0, 0, 0)), dtype=np.float64),
        _matrix(np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)),
        np.array(node.get("scale", (1, 1, 1)), dtype=np.float64),
    )


def _matrix(quaternions: Float[np.ndarray, "*frames 4"]) -> Float[np.ndarray, "*frames 3 3"]:
    """Turns glTF's quaternions (x, y, z, w) into matrices."""
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return matrix_from_quaternion((quaternions / length)[..., [3, 0, 1, 2]])


def _stacked(arrays: Sequence[np.ndarray], dimensions: int) -> np.ndarray:
    """Stacks what the bones have, still or over time, with the bones before the last axes."""
    lead = np.broadcast_shapes(*(array.shape[:-dimensions] for array in arrays))
    whole = [np.broadcast_to(array, (*lead, *array.shape[-dimensions:])) for array in arrays]
    return np.stack(whole, axis=-dimensions - 1)


@dataclass(frozen=True, eq=False)
class Track:
    """One property of one node over time."""

    node: int
    """Whose it is."""
    path: str
    """`translation`, `rotation` or `scale`."""
    times: Float[np.ndarray, " keys"]
    """Seconds, rising."""
    values: Float[np.ndarray, "rows values"]
    """One row a key, or three of a cubic spline; quaternions are (x, y, z, w)."""
    interpolation: str
    """`LINEAR`, `STEP` or `CUBICSPLINE`."""

    def sample(self, times: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames values"]:
        """Returns its values at any times; before the first and after the last key it holds."""
        last = max(len(self.times) - 2, 0)
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, last)
        after = np.minimum(before + 1, len(self.times) - 1)
        span = self.times[after] - self.times[before]
        share = (times - self.times[before]) / np.where(span > 0, span, 1)
        share = np.clip(np.where(span > 0, share, 0), 0, 1)
        if self.interpolation == "CUBICSPLINE":
            keys, s, span = (
                self.values.reshape(len(self.times), 3, -1),
                share[:, None],
                span[:, None],
            )
            return (
                (2 * s**3 - 3 * s**2 + 1) * keys[before, 1]
                + (s**3 - 2 * s**2 + s) * (span * keys[before, 2])
                + (3 * s**2 - 2 * s**3) * keys[after, 1]
                + (s**3 - s**2) * (span * keys[after, 0])
            )
        if self.interpolation == "STEP":
            return self.values[np.where(share > 1 - 1e-6, after, before)]
        start, end = self.values[before], self.values[after]
        if self.path == "rotation":
            return slerp(start, end, share)
        return start + share[:, None] * (end - start)


def read_tracks(document: Document, animation: Mapping[str, Any]) -> list[Track]:
    """Returns the channels of one animation that move nodes; shapes that morph are left out."""
    tracks = []
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        if "node" in target and target["path"] in _PATHS:
            times, values = (document.array(sampler[side]) for side in ("input", "output"))
            kind = sampler.get("interpolation", "LINEAR")
            tracks.append(_track(target["node"], target["path"], times, values, kind))
    return tracks


def clock(tracks: Sequence[Track]) -> tuple[float, Float[np.ndarray, " frames"]]:
    """Returns the rate at which all keys fall on frames, and the time of each frame."""
    times = [track.times for track in tracks]
    return even_rate(np.unique(np.concatenate(times)) if times else np.zeros(0))


def _track(node: int, path: str, times: np.ndarray, values: np.ndarray, kind: str) -> Track:
    rows, width = len(times) * (3 if kind == "CUBICSPLINE" else 1), 4 if path == "rotation" else 3
    if values.shape != (rows, width) or not len(times):
        raise ValueError(f"{path} of node {node} has {values.shape}, expected {(rows, width)}")
    times, values = times.astype(np.float64), values.astype(np.float64)
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise ValueError(f"{path} of node {node} has NaN, or times that do not rise")
    return Track(node, path, times, values, kind)
