"""BVH: reads takes as `latentmotion` writes them, and writes the rest pose of an armature.

Lengths are meters here and centimeters in the files; y is up and the figure faces z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_CENTIMETERS = 100.0
_POSITIONS = "Xposition Yposition Zposition"
_ROTATIONS = "Zrotation Xrotation Yrotation"


@dataclass(frozen=True)
class BvhTake:
    """One motion."""

    names: list[str]  # Names of the joints, parents before children; end sites are left out.
    parents: list[int]  # Index of each joint's parent; -1 for the root.
    offsets: np.ndarray  # (joints, 3) each joint from its parent at rest.
    # (frames, joints, 3) each joint from its parent over time; the root from the origin.
    positions: np.ndarray
    # (frames, joints, 3, 3) of each joint from its rest, in the world's axes.
    rotations: np.ndarray

    def rest(self) -> np.ndarray:
        """Returns (joints, 3) the rest positions of the joints."""
        positions = np.zeros_like(self.offsets)
        for joint, parent in enumerate(self.parents):
            positions[joint] = self.offsets[joint] + (positions[parent] if parent >= 0 else 0)
        return positions


def read_take(path: Path) -> BvhTake:
    """Reads a file.

    Raises:
        ValueError: It is not BVH as we know it.
    """
    head, separator, tail = path.read_text(encoding="utf-8").partition("MOTION")
    if not separator:
        raise ValueError(f"{path.name} is not a BVH file")
    names, parents, steps, channels = [], [], [], []
    open_blocks: list[int] = []
    joint = -1
    for line in head.splitlines():
        words = line.split()
        keyword = words[0].upper() if words else ""
        if keyword in ("ROOT", "JOINT"):
            parents.append(open_blocks[-1] if open_blocks else -1)
            names.append(" ".join(words[1:]))
            joint = len(names) - 1
        elif keyword == "END":
            joint = -1
        elif keyword == "{":
            open_blocks.append(joint)
        elif keyword == "}":
            open_blocks.pop()
        elif keyword == "OFFSET" and joint >= 0:
            steps.append([float(word) / _CENTIMETERS for word in words[1:4]])
        elif keyword == "CHANNELS":
            channels += [(joint, channel) for channel in words[2:]]
    offsets = np.array(steps, dtype=np.float64)
    rows = [line.split() for line in tail.split("\n") if line.strip()][2:]
    values = np.array([[float(word) for word in row] for row in rows])
    positions = np.repeat(offsets[None], len(values), axis=0)
    rotations = np.tile(np.eye(3), (len(values), len(names), 1, 1))
    for column, (joint, channel) in enumerate(channels):
        axis = "XYZ".index(channel[0].upper())
        if channel[1:].lower() == "position":
            positions[:, joint, axis] = values[:, column] / _CENTIMETERS
        else:
            angles, (y, z) = np.radians(values[:, column]), ((axis + 1) % 3, (axis + 2) % 3)
            matrices = np.tile(np.eye(3), (len(angles), 1, 1))
            matrices[:, y, y] = matrices[:, z, z] = np.cos(angles)
            matrices[:, z, y] = np.sin(angles)
            matrices[:, y, z] = -np.sin(angles)
            rotations[:, joint] = rotations[:, joint] @ matrices
    for joint, parent in enumerate(parents):
        if parent >= 0:
            rotations[:, joint] = rotations[:, parent] @ rotations[:, joint]
    return BvhTake(names, parents, offsets, positions, rotations)


def write_rest(
    path: Path,
    names: Sequence[str],
    parents: Sequence[int],
    positions: np.ndarray,
    tips: np.ndarray,
    movable: Sequence[bool],
) -> None:
    """Writes a rest pose as a file of one frame, all rotations zero.

    Args:
        path: The file.
        names: Names of the joints, parents before children, without spaces.
        parents: Index of each joint's parent; -1 for the root.
        positions: (joints, 3) of the joints.
        tips: (joints, 3) ends of the bones of joints without children.
        movable: Whether each joint may move from its parent; the root may.
    """
    above = np.array(parents)
    offsets = positions - np.where(above[:, None] < 0, 0, positions[above])
    values: list[str] = []  # of the frame, in the order of the file

    def block(joint: int) -> list[str]:
        """Returns the lines of a joint and all its descendants."""
        moves = movable[joint]
        channels = f"6 {_POSITIONS} {_ROTATIONS}" if moves else f"3 {_ROTATIONS}"
        values.append((f"{_triple(offsets[joint])} " if moves else "") + "0 0 0")
        below = [child for child, parent in enumerate(parents) if parent == joint]
        inside = [line for child in below for line in block(child)]
        tip = ["End Site", "{", f"OFFSET {_triple(tips[joint] - positions[joint])}", "}"]
        kind = "ROOT" if parents[joint] < 0 else "JOINT"
        head = [f"OFFSET {_triple(offsets[joint])}", f"CHANNELS {channels}"]
        return [f"{kind} {names[joint]}", "{", *head, *(inside or tip), "}"]

    lines = ["HIERARCHY", *block(0), "MOTION", "Frames: 1", "Frame Time: 0.033333"]
    path.write_text("\n".join([*lines, " ".join(values)]) + "\n", encoding="utf-8")


def _triple(values: np.ndarray) -> str:
    return " ".join(f"{_CENTIMETERS * value:.6f}" for value in values)
