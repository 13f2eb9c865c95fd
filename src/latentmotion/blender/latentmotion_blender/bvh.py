"""BVH, as `latentmotion` writes it: how a take turns its joints; and the rest pose of an armature.

Lengths are meters here and centimeters in the files; y is up and the figure looks along z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_CENTIMETERS = 100.0
_POSITIONS = "Xposition Yposition Zposition"
_TURNS = "Zrotation Xrotation Yrotation"


@dataclass(frozen=True)
class Take:
    """One motion."""

    names: list[str]
    """Of the joints, parents before children; tips that do not turn are left out."""
    parents: list[int]
    """Index of each joint's parent; -1 for the root."""
    offsets: np.ndarray
    """(joints, 3) each joint from its parent at rest."""
    places: np.ndarray
    """(frames, joints, 3) the same while it moves; of the root: its place."""
    turns: np.ndarray
    """(frames, joints, 3, 3) how each joint is turned from its rest, in the world's axes."""

    def rest(self) -> np.ndarray:
        """Returns (joints, 3) where the joints are at rest."""
        places = np.zeros_like(self.offsets)
        for joint, parent in enumerate(self.parents):
            places[joint] = self.offsets[joint] + (places[parent] if parent >= 0 else 0)
        return places


def read_take(path: Path) -> Take:
    """Reads a file.

    Raises:
        ValueError: It is not BVH as we know it.
    """
    head, found, tail = path.read_text(encoding="utf-8").partition("MOTION")
    if not found:
        raise ValueError(f"{path.name} is not a BVH file")
    names, parents, offsets, channels = _hierarchy(head)
    rows = [line.split() for line in tail.split("\n") if line.strip()][2:]
    values = np.array([[float(word) for word in row] for row in rows])
    places = np.repeat(offsets[None], len(values), axis=0)
    turns = np.tile(np.eye(3), (len(values), len(names), 1, 1))
    for column, (joint, channel) in enumerate(channels):
        axis = "XYZ".index(channel[0].upper())
        if channel[1:].lower() == "position":
            places[:, joint, axis] = values[:, column] / _CENTIMETERS
        else:
            turns[:, joint] = turns[:, joint] @ _turn(axis, np.radians(values[:, column]))
    for joint, parent in enumerate(parents):
        if parent >= 0:
            turns[:, joint] = turns[:, parent] @ turns[:, joint]
    return Take(names, parents, offsets, places, turns)


def _hierarchy(
    text: str,
) -> tuple[list[str], list[int], np.ndarray, list[tuple[int, str]]]:
    names, parents, offsets, channels = [], [], [], []
    open_blocks: list[int] = []
    joint = -1
    for line in text.splitlines():
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
            offsets.append([float(word) / _CENTIMETERS for word in words[1:4]])
        elif keyword == "CHANNELS":
            channels += [(joint, channel) for channel in words[2:]]
    return names, parents, np.array(offsets, dtype=np.float64), channels


def _turn(axis: int, angles: np.ndarray) -> np.ndarray:
    """Returns (frames, 3, 3) turns about an axis."""
    matrices = np.tile(np.eye(3), (len(angles), 1, 1))
    one, two = (axis + 1) % 3, (axis + 2) % 3
    matrices[:, one, one] = matrices[:, two, two] = np.cos(angles)
    matrices[:, two, one] = np.sin(angles)
    matrices[:, one, two] = -np.sin(angles)
    return matrices


def write_rest(
    path: Path,
    names: Sequence[str],
    parents: Sequence[int],
    places: np.ndarray,
    tips: np.ndarray,
    movable: Sequence[bool],
) -> None:
    """Writes a rest pose as a file of one frame, all turns zero.

    Args:
        path: Where to.
        names: Of the joints, parents before children, without blanks.
        parents: Index of each joint's parent; -1 for the root.
        places: (joints, 3) where they are.
        tips: (joints, 3) where the bones of joints without children end.
        movable: Which joints may move from their parent; the root may.
    """
    above = np.array(parents)
    offsets = places - np.where(above[:, None] < 0, 0, places[above])
    joints = [
        f"CHANNELS 6 {_POSITIONS} {_TURNS}" if moves else f"CHANNELS 3 {_TURNS}"
        for moves in movable
    ]
    heads = [[f"OFFSET {_triple(o)}", c] for o, c in zip(offsets, joints, strict=True)]
    order: list[int] = []
    ends = [f"OFFSET {_triple(tip - place)}" for tip, place in zip(tips, places, strict=True)]
    blocks = _block(0, names, parents, heads, ends, order)
    rows = [(f"{_triple(offsets[j])} " if movable[j] else "") + "0 0 0" for j in order]
    timing = ["Frames: 1", "Frame Time: 0.033333", " ".join(rows)]
    lines = ["HIERARCHY", *blocks, "MOTION", *timing]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _block(
    joint: int,
    names: Sequence[str],
    parents: Sequence[int],
    heads: Sequence[list[str]],
    ends: Sequence[str],
    order: list[int],
) -> list[str]:
    """Returns the lines of a joint and of all below it; notes the order of the joints."""
    order.append(joint)
    below = [child for child, parent in enumerate(parents) if parent == joint]
    inside = list(heads[joint])
    for child in below:
        inside += _block(child, names, parents, heads, ends, order)
    if not below:
        inside += ["End Site", "{", ends[joint], "}"]
    return [f"{'ROOT' if parents[joint] < 0 else 'JOINT'} {names[joint]}", "{", *inside, "}"]


def _triple(values: np.ndarray) -> str:
    return " ".join(f"{_CENTIMETERS * value:.6f}" for value in values)
