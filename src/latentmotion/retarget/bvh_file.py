"""BVH as a rig: its hierarchy is kept to the letter, only the motion below it is new."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.formats.bvh import continuous_euler
from latentmotion.formats.bvh_hierarchy import Node, read_hierarchy
from latentmotion.formats.lines import read_lines
from latentmotion.formats.takes import numbered
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.retarget.rig_files import Take
from latentmotion.storage.files import atomic_file


class BvhFile:
    """A BVH file. Its rest pose is the one in which all its angles are 0.

    Args:
        path: The file.

    Raises:
        FileFormatError: It is damaged.
    """

    unit = None
    declared: Mapping[str, int] = {}
    endings = (".bvh",)

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = read_lines(path)
        self.nodes, start = read_hierarchy(path, lines)
        self.head = lines[:start]
        offsets = np.array([node.offset for node in self.nodes], dtype=np.float64)
        self.root = offsets[0].copy()
        offsets[0] = 0
        self.skeleton = Skeleton(
            name=path.stem,
            names=tuple(node.name for node in self.nodes),
            parents=tuple(node.parent for node in self.nodes),
            offsets=offsets,
            end_sites=tuple(joint for joint, node in enumerate(self.nodes) if node.is_end),
        )
        self.movable = frozenset(
            joint
            for joint, node in enumerate(self.nodes)
            if {axis for axis, kind in node.channels if kind == "position"} == set("XYZ")
        )

    def write(self, path: Path, takes: Sequence[Take]) -> list[Path]:
        """Writes one file for each take: `out.bvh`, or `out-1.bvh`, `out-2.bvh` and so on."""
        paths = numbered(path, len(takes))
        for target, take in zip(paths, takes, strict=True):
            rows = self._rows(take.animation)
            template = " ".join(["%.6f"] * rows.shape[1])
            timing = [f"Frames: {len(rows)}", f"Frame Time: {1 / take.animation.fps:.8f}"]
            lines = [*self.head, *timing, *(template % tuple(row) for row in rows.tolist())]
            with atomic_file(target) as temporary:
                temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return paths

    def _rows(self, animation: Animation) -> Float[np.ndarray, "frames columns"]:
        columns = []
        for joint, node in enumerate(self.nodes):
            angles = dict(zip(*_angles(node, animation.rotations[:, joint]), strict=True))
            places = _places(animation, joint)
            for axis, kind in node.channels:
                moved = places["XYZ".index(axis)] if kind == "position" else angles[axis]
                columns.append(moved)
        return np.round(np.stack(columns, axis=1), 6) + 0.0


def _angles(
    node: Node, rotations: Float[np.ndarray, "frames 3 3"]
) -> tuple[str, Float[np.ndarray, "turns frames"]]:
    """Returns the angles about a joint's axes, degrees; axes that it does not have are left out."""
    order = node.order + "".join(axis for axis in "ZXY" if axis not in node.order)
    return order, np.rad2deg(continuous_euler(rotations[:, None], order)[:, 0].T)


def _places(animation: Animation, joint: int) -> Float[np.ndarray, "3 frames"]:
    if joint == 0:
        return animation.root_positions.T
    if animation.translations is not None:
        return animation.translations[:, joint].T
    return np.repeat(animation.skeleton.offsets[joint][:, None], len(animation), axis=1)
