"""BVH (Biovision hierarchy): a tree of joints with offsets, then one line of channels per frame.

A joint's rotation is the product of its rotation channels in the order they are listed
(`Zrotation Xrotation Yrotation` means R = Rz Rx Ry); position channels replace its offset.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.animation import Animation
from latentmotion.errors import FileFormatError
from latentmotion.files import atomic_file
from latentmotion.formats.lines import meters_per_unit, numbers, read_lines, table
from latentmotion.rotations import euler_from_matrix, matrix_from_euler
from latentmotion.skeleton import Skeleton

WRITTEN_ORDER = "ZXY"
"""Rotation order of the files we write: an upright body is far from its singularity."""

_STATEMENT = re.compile(r"([{}])|(?=\b(?:OFFSET|CHANNELS)\b)", re.IGNORECASE)
_CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)
_FRAMES = re.compile(r"\s*frames\s*:?\s*(\d+)\s*", re.IGNORECASE)
_FRAME_TIME = re.compile(r"\s*frame\s*time\s*:?\s*(\S+)\s*", re.IGNORECASE)


@dataclass
class _Node:
    """One `ROOT`, `JOINT` or `End Site` block."""

    name: str
    parent: int
    is_end: bool = False
    offset: Float[np.ndarray, " 3"] | None = None
    channels: list[tuple[str, str]] = field(default_factory=list)
    """Axis (`X`) and kind (`position` or `rotation`) of each column."""

    @property
    def order(self) -> str:
        """The axes it turns about, first to last."""
        return "".join(axis for axis, kind in self.channels if kind == "rotation")


def read_bvh(path: str | Path, unit: str | float = "centimeters") -> Animation:
    """Reads a BVH file: any hierarchy, channel order and rotation order.

    Args:
        path: The file.
        unit: Its unit of length: `centimeters`, `meters`, `millimeters`, `inches`, `feet`, `cmu`
            (the MotionBuilder-friendly conversion of CMU), or meters per unit.

    Returns:
        The animation in meters. End sites are joints named `<parent>_end`.

    Raises:
        FileFormatError: The file is damaged or not BVH.
        InputError: The unit is unknown.
    """
    scale = meters_per_unit(unit)
    lines = read_lines(path)
    header = _Header(Path(path))
    start = header.read(lines)
    count, fps, body = _read_timing(header.path, lines, start)
    width = sum(len(node.channels) for node in header.nodes)
    values = table(header.path, lines, body, width)
    if len(values) != count:
        raise FileFormatError(
            path, f"found {len(values)} frames, expected {count} as 'Frames:' says", len(lines)
        )
    return _animation(header, values, scale, fps)


def write_bvh(path: str | Path, animation: Animation) -> None:
    """Writes an animation as BVH in centimeters, angles unwrapped so that curves never jump.

    Leaf joints get an end site, since BVH demands one; joints that move besides turning get
    position channels.

    Args:
        path: The file, replaced only when all is written.
        animation: What to write.

    Raises:
        InputError: The folder does not exist or cannot be written.
    """
    skeleton, order = animation.skeleton, _depth_first(animation.skeleton)
    joints = [joint for joint in order if joint not in skeleton.end_sites]
    moving = {0} if animation.translations is None else set(joints)
    rows = _rows(animation, joints, moving)
    template = " ".join(["%.6f"] * rows.shape[1])
    with atomic_file(path) as temporary:
        lines = ["HIERARCHY", *_hierarchy(skeleton, 0, moving), "MOTION"]
        lines += [f"Frames: {len(rows)}", f"Frame Time: {1 / animation.fps:.8f}"]
        lines += [template % tuple(row) for row in rows.tolist()]
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


class _Header:
    """Reads the hierarchy, statement by statement."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.nodes: list[_Node] = []
        self._open: list[int] = []
        self._line = 1

    def read(self, lines: Sequence[str]) -> int:
        """Reads up to `MOTION` and returns the index of the line after it."""
        statements = _statements(lines)
        self._line, first = next(statements)
        self._check(first.upper() == "HIERARCHY", f"found {first[:40]!r}, expected 'HIERARCHY'")
        for self._line, statement in statements:
            if statement.upper() == "MOTION":
                self._check(not self._open, "found 'MOTION' before the last '}'")
                self._check(bool(self.nodes), "found 'MOTION' before any 'ROOT'")
                return self._line
            self._take(statement)
        raise FileFormatError(self.path, "ends before 'MOTION': the file is truncated", len(lines))

    def _take(self, statement: str) -> None:
        keyword, *words = statement.split()
        match keyword.upper():
            case "ROOT" | "JOINT":
                self._add(_Node(" ".join(words), self._parent(keyword)))
            case "END":
                parent = self._parent(keyword)
                self._add(_Node(f"{self.nodes[parent].name}_end", parent, is_end=True))
            case "{":
                self._open.append(len(self.nodes) - 1)
            case "}":
                self._close()
            case "OFFSET":
                self._current(keyword).offset = numbers(self.path, self._line, words, 3)
            case "CHANNELS":
                self._current(keyword).channels = self._channels(words)
            case _:
                raise FileFormatError(
                    self.path, f"found {statement[:40]!r}, expected a BVH keyword", self._line
                )

    def _add(self, node: _Node) -> None:
        taken = {other.name for other in self.nodes}
        name, copy = node.name, 2
        while node.name in taken:
            node.name, copy = f"{name}_{copy}", copy + 1
        self.nodes.append(node)

    def _parent(self, keyword: str) -> int:
        if keyword.upper() == "ROOT":
            self._check(not self.nodes, "found a second 'ROOT', expected one skeleton per file")
            return -1
        self._check(bool(self._open), f"found {keyword!r} outside the braces of its parent")
        return self._open[-1]

    def _close(self) -> None:
        node = self._current("}")
        self._check(node.offset is not None, f"{node.name} has no 'OFFSET'")
        self._open.pop()

    def _current(self, keyword: str) -> _Node:
        self._check(bool(self._open), f"found {keyword!r} outside any joint's braces")
        return self.nodes[self._open[-1]]

    def _channels(self, words: Sequence[str]) -> list[tuple[str, str]]:
        count, names = (words[0] if words else "none"), words[1:]
        self._check(
            count == str(len(names)), f"'CHANNELS' says {count}, but {len(names)} names follow"
        )
        found = [_CHANNEL.fullmatch(name) for name in names]
        channels = [(m[1].upper(), m[2].lower()) for m in found if m]
        self._check(
            len(channels) == len(names),
            f"found the channels {' '.join(names)!r}, expected"
            " names like 'Xposition' and 'Zrotation'",
        )
        return channels

    def _check(self, condition: bool, problem: str) -> None:
        if not condition:
            raise FileFormatError(self.path, problem, self._line)


def _statements(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yields the line, from 1, and the text of each statement; several may share a line."""
    for number, line in enumerate(lines, 1):
        for part in _STATEMENT.split(line):
            if part and part.strip():
                yield number, part.strip()


def _read_timing(path: Path, lines: Sequence[str], start: int) -> tuple[int, float, int]:
    """Returns the number of frames, the frames per second and the index of the first frame."""
    found = [(i, line) for i, line in enumerate(lines[start : start + 20], start) if line.strip()]
    if len(found) < 2:
        raise FileFormatError(path, "ends after 'MOTION': the file is truncated", len(lines))
    (at, first), (then, second) = found[:2]
    frames, time = _FRAMES.fullmatch(first), _FRAME_TIME.fullmatch(second)
    if frames is None or int(frames[1]) == 0:
        raise FileFormatError(path, f"found {first[:40]!r}, expected 'Frames: <count>'", at + 1)
    if time is None:
        raise FileFormatError(path, f"found {second[:40]!r}, expected 'Frame Time: <s>'", then + 1)
    seconds = float(numbers(path, then + 1, [time[1]], 1)[0])
    if seconds <= 0:
        raise FileFormatError(path, f"a frame time of {seconds} s; expected more", then + 1)
    return int(frames[1]), _frames_per_second(seconds), then + 1


def _frames_per_second(seconds: float) -> float:
    """Undoes the rounding of the frame time: 0.0083333 s means 120 frames per second."""
    fps = 1 / seconds
    return float(round(fps)) if abs(fps - round(fps)) < 1e-4 * fps else fps


def _animation(
    header: _Header, values: Float[np.ndarray, "frames columns"], scale: float, fps: float
) -> Animation:
    nodes = header.nodes
    offsets = scale * np.array([node.offset for node in nodes])
    moved = _translations(nodes, values, offsets, scale)
    offsets[0] = 0
    skeleton = Skeleton(
        name=header.path.stem,
        names=tuple(node.name for node in nodes),
        parents=tuple(node.parent for node in nodes),
        offsets=offsets,
        end_sites=tuple(joint for joint, node in enumerate(nodes) if node.is_end),
    )
    moves = any(kind == "position" for node in nodes[1:] for _, kind in node.channels)
    track = moved if moves else None
    return Animation(skeleton, _rotations(nodes, values), moved[:, 0].copy(), fps, track)


def _translations(
    nodes: Sequence[_Node],
    values: Float[np.ndarray, "frames columns"],
    offsets: Float[np.ndarray, "joints 3"],
    scale: float,
) -> Float[np.ndarray, "frames joints 3"]:
    moved = np.repeat(offsets[None], len(values), axis=0)
    for column, (joint, axis, kind) in enumerate(_columns(nodes)):
        if kind == "position":
            moved[:, joint, "XYZ".index(axis)] = scale * values[:, column]
    return moved


def _rotations(
    nodes: Sequence[_Node], values: Float[np.ndarray, "frames columns"]
) -> Float[np.ndarray, "frames joints 3 3"]:
    """Turns all joints of the same rotation order at once."""
    turning: dict[int, list[int]] = {}
    for column, (joint, _, kind) in enumerate(_columns(nodes)):
        if kind == "rotation":
            turning.setdefault(joint, []).append(column)
    rotations = np.tile(np.eye(3), (len(values), len(nodes), 1, 1))
    for order in {nodes[joint].order for joint in turning}:
        joints = [joint for joint in turning if nodes[joint].order == order]
        angles = np.deg2rad(values[:, [turning[joint] for joint in joints]])
        rotations[:, joints] = matrix_from_euler(angles, order)
    return rotations


def _columns(nodes: Sequence[_Node]) -> list[tuple[int, str, str]]:
    return [(joint, *channel) for joint, node in enumerate(nodes) for channel in node.channels]


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    return [joint, *(j for c in skeleton.children(joint) for j in _depth_first(skeleton, c))]


def _hierarchy(skeleton: Skeleton, joint: int, moving: set[int]) -> list[str]:
    """Returns the lines of a joint's block and of all below it."""
    children = skeleton.children(joint)
    name = "_".join(skeleton.names[joint].split())
    positions = [f"{axis}position" for axis in "XYZ"] if joint in moving else []
    channels = positions + [f"{axis}rotation" for axis in WRITTEN_ORDER]
    inside = [_offset(skeleton, joint), f"CHANNELS {len(channels)} {' '.join(channels)}"]
    for child in children:
        end = child in skeleton.end_sites
        inside += _end(_offset(skeleton, child)) if end else _hierarchy(skeleton, child, moving)
    if not children:
        # The true tip is unknown; half the bone before it looks right in every viewer.
        inside += _end(_offset(skeleton, joint, 0.5))
    return [f"{'JOINT' if joint else 'ROOT'} {name}", "{", *("\t" + s for s in inside), "}"]


def _end(offset: str) -> list[str]:
    return ["End Site", "{", "\t" + offset, "}"]


def _offset(skeleton: Skeleton, joint: int, share: float = 1.0) -> str:
    centimeters = np.round(100 * share * np.asarray(skeleton.offsets[joint], np.float64), 6) + 0.0
    return "OFFSET " + " ".join(f"{value:.6f}" for value in centimeters)


def _rows(
    animation: Animation, joints: Sequence[int], moving: set[int]
) -> Float[np.ndarray, "frames columns"]:
    angles = _continuous_euler(np.asarray(animation.rotations[:, joints], np.float64))
    blocks = []
    for number, joint in enumerate(joints):
        if joint in moving:
            blocks.append(100 * _positions(animation, joint))
        blocks.append(np.rad2deg(angles[:, number]))
    # Adding zero turns the -0 that rounding leaves into 0.
    return np.round(np.concatenate(blocks, axis=1), 6) + 0.0


def _positions(animation: Animation, joint: int) -> Float[np.ndarray, "frames 3"]:
    if joint == 0 or animation.translations is None:
        return np.asarray(animation.root_positions, np.float64)
    return np.asarray(animation.translations[:, joint], np.float64)


def _continuous_euler(
    rotations: Float[np.ndarray, "frames joints 3 3"],
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns ZXY angles in radians, each frame the nearest to the one before.

    Every rotation has two triples, (z, x, y) and (z + π, π - x, y + π). Going from one to the
    other keeps distances, so whether to change sides depends on two frames only, and the side is
    the parity of the changes so far.
    """
    direct = euler_from_matrix(rotations, WRITTEN_ORDER)
    flipped = direct * np.array([1, -1, 1]) + np.pi
    change = _distance(direct[:-1], flipped[1:]) < _distance(direct[:-1], direct[1:])
    side = (
        np.concatenate([np.zeros_like(change[:1]), np.cumsum(change, axis=0) % 2 == 1])
        if len(change)
        else np.zeros(direct.shape[:-1], bool)
    )
    return np.unwrap(np.where(side[..., None], flipped, direct), axis=0)


def _distance(
    a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    return np.sum(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi), axis=-1)
