"""BVH (Biovision hierarchy): a tree of joints with offsets, then one line of channels per frame.

A joint's rotation is the product of its rotation channels in the order they are listed
(`Zrotation Xrotation Yrotation` means R = Rz Rx Ry); position channels replace its offset.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, ReadingWarning
from latentmotion.formats import EngineName, checks, numbered
from latentmotion.kinematics.rotations import euler_from_matrix, matrix_from_euler
from latentmotion.kinematics.skeleton import Animation, Joints, Skeleton
from latentmotion.kinematics.standing import meters_per_unit
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.storage.files import write_file
from latentmotion.storage.limits import MOST_JOINTS
from latentmotion.storage.reading import blamed_on

_STATEMENT = re.compile(r"([{}])|(?=\b(?:OFFSET|CHANNELS)\b)", re.IGNORECASE)
_KEYWORDS = frozenset({"ROOT", "JOINT", "END", "{", "}", "OFFSET", "CHANNELS", "MOTION"})
_CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)


@dataclass
class BvhNode:
    """One `ROOT`, `JOINT` or `End Site` block."""

    name: str  # Its name; an end site is `<parent>_end`.
    parent: int  # Index of its parent; -1 for the root.
    is_end: bool = False  # Whether it is an end site.
    # From its parent, in the file's unit; None until its line is read.
    offset: Float[np.ndarray, " 3"] | None = None
    # Axis (`X`) and kind (`position` or `rotation`) of each of its columns.
    channels: list[tuple[str, str]] = field(default_factory=list)

    @property
    def order(self) -> str:
        """The axes of its rotation channels, first to last."""
        return "".join(axis for axis, kind in self.channels if kind == "rotation")


def read_hierarchy(path: Path, lines: Sequence[str]) -> tuple[list[BvhNode], int]:
    """Reads up to `MOTION`.

    Args:
        path: The file, for errors.
        lines: All its lines.

    Returns:
        The joints, parents first, and the index of the line after `MOTION`.

    Raises:
        FileFormatError: The hierarchy is damaged.
    """
    reader = _BvhReader(path)
    for number, line in enumerate(lines, 1):
        for statement in _STATEMENT.split(line):  # several may share a line
            if statement and statement.strip():
                reader.read(number, statement.strip())
                if reader.ended:
                    return reader.nodes, number
    raise FileFormatError(path, "ends before 'MOTION': the file is truncated", len(lines))


def hierarchy_lines(
    skeleton: Skeleton, moving: Collection[int], layout: BvhLayout, joint: int = 0
) -> list[str]:
    """Returns the lines of a joint's block and of all below it.

    Args:
        skeleton: The tree of joints.
        moving: Joints that get position channels.
        layout: Rotation order and unit.
        joint: The joint.
    """
    children = skeleton.children(joint)
    positions = [f"{axis}position" for axis in "XYZ"] if joint in moving else []
    channels = positions + [f"{axis}rotation" for axis in layout.order]
    place = np.asarray(skeleton.offsets[joint], np.float64)
    # Adding zero makes 0 of the -0 that rounding leaves.
    offset, half = (
        "OFFSET "
        + " ".join(f"{value:.6f}" for value in np.round(share / layout.meters * place, 6) + 0.0)
        for share in (1.0, 0.5)
    )
    if joint in skeleton.end_sites:
        return ["End Site", "{", f"\t{offset}", "}"]
    inside = [offset, f"CHANNELS {len(channels)} {' '.join(channels)}"]
    for child in children:
        inside += hierarchy_lines(skeleton, moving, layout, child)
    if not children:
        # BVH requires a tip. The true one is unknown; half the bone before it looks right.
        inside += ["End Site", "{", f"\t{half}", "}"]
    name = "_".join(skeleton.names[joint].split())
    return [f"{'JOINT' if joint else 'ROOT'} {name}", "{", *("\t" + s for s in inside), "}"]


class _BvhReader:
    """Reads a hierarchy statement by statement."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.nodes: list[BvhNode] = []
        self.ended = False
        self._line = 0
        self._open: list[int] = []
        self._taken: set[str] = set()
        self._copies: dict[str, int] = {}
        self._unopened: int | None = None
        """The joint whose `{` must come next."""

    def read(self, line: int, statement: str) -> None:
        """Reads one statement of line `line`."""
        word, *values = statement.split()
        keyword, near = word.upper(), f"found {statement[:40]!r}"
        is_first, self._line = self._line == 0, line
        if is_first:
            self._check(keyword == "HIERARCHY", f"{near}, expected 'HIERARCHY': not BVH")
            return
        self._check(keyword in _KEYWORDS, f"{near}, expected a keyword of BVH")
        self._check((self._unopened is not None) == (keyword == "{"), f"{near} at a wrong place")
        match keyword:
            case "ROOT":
                self._check(not self.nodes, "found a second 'ROOT', expected one skeleton per file")
                self._add(BvhNode(" ".join(values), -1))
            case "JOINT":
                self._add(BvhNode(" ".join(values), self._current()))
            case "END":
                parent = self._current()
                self._add(BvhNode(f"{self.nodes[parent].name}_end", parent, is_end=True))
            case "{":
                assert self._unopened is not None
                self._open.append(self._unopened)
                self._unopened = None
            case "}":
                node = self.nodes[self._current()]
                self._check(node.offset is not None, f"{node.name} has no 'OFFSET'")
                self._open.pop()
            case "OFFSET":
                self.nodes[self._current()].offset = checks.numbers(self.path, line, values, 3)
            case "CHANNELS":
                count, names = (values[0] if values else "none"), values[1:]
                problem = f"'CHANNELS' says {count}, but {len(names)} names follow"
                self._check(count == str(len(names)), problem)
                matches = [match for name in names if (match := _CHANNEL.fullmatch(name))]
                problem = (
                    f"found the channels {names}, expected names like 'Xposition' and 'Zrotation'"
                )
                self._check(len(matches) == len(names), problem)
                node = self.nodes[self._current()]
                node.channels = [(match[1].upper(), match[2].lower()) for match in matches]
            case "MOTION":
                self._check(bool(self.nodes), "found 'MOTION' before any 'ROOT'")
                self._check(not self._open, "found 'MOTION' before the last '}'")
                self.ended = True

    def _add(self, node: BvhNode) -> None:
        self._check(len(self.nodes) < MOST_JOINTS, f"more than {MOST_JOINTS:,} joints")
        name, copy = node.name, self._copies.get(node.name, 2)
        while node.name in self._taken:
            node.name, copy = f"{name}_{copy}", copy + 1
        self._copies[name] = copy
        self._taken.add(node.name)
        self._unopened = len(self.nodes)
        self.nodes.append(node)

    def _current(self) -> int:
        self._check(bool(self._open), "found a statement outside the braces of any joint")
        return self._open[-1]

    def _check(self, condition: bool, problem: str) -> None:
        if not condition:
            raise FileFormatError(self.path, problem, self._line)


@dataclass(frozen=True)
class BvhLayout:
    """How a BVH file is written."""

    # Axes of the rotation channels; with ZXY an upright body is far from the singularity.
    order: str = "ZXY"
    meters: float = 0.01  # Meters per unit.


OURS = BvhLayout()  # The layout of the files that we write.


# Meters up to which a joint counts as staying at its offset.
_SAME = 1e-7

_FRAMES = re.compile(r"\s*frames\s*:?\s*(\d{1,12})\s*", re.IGNORECASE)
_FRAME_TIME = re.compile(r"\s*frame\s*time\s*:?\s*(\S+)\s*", re.IGNORECASE)


def read_bvh(path: str | Path, unit: str | float = "centimeters") -> Animation:
    """Reads a BVH file: any hierarchy, channel order and rotation order.

    Args:
        path: The file.
        unit: Unit of length: `centimeters`, `meters`, `millimeters`, `inches`, `feet`, `cmu`
            (the MotionBuilder-friendly conversion of CMU), or meters per unit.

    Returns:
        The animation in meters. End sites are joints named `<parent>_end`.

    Raises:
        FileFormatError: The file is damaged or not BVH.
        InputError: The unit is unknown.
    """
    scale = meters_per_unit(unit)
    lines = checks.read_lines(path)
    nodes, start = read_hierarchy(Path(path), lines)
    count, fps, body = _read_timing(Path(path), lines, start)
    columns = [(joint, *channel) for joint, node in enumerate(nodes) for channel in node.channels]
    rows = [(n, words) for n, line in enumerate(lines[body:], body + 1) if (words := line.split())]
    values = checks.table(path, rows, len(columns))
    if abs(len(values) - count) > 1:
        problem = f"found {len(values)} frames, expected {count} as 'Frames:' says"
        raise FileFormatError(path, problem, len(lines))
    if len(values) != count:  # one off, as in Rokoko's exports
        problem = f"found {len(values)} frames, of which 'Frames:' says {count}; all are read"
        warnings.warn(f"{path}: {problem}", ReadingWarning, stacklevel=2)
        count = len(values)
    checks.check_filled(path, count, len(nodes), values.size)
    offsets = scale * np.array([node.offset for node in nodes])
    translations = np.repeat(offsets[None], count, axis=0)
    rotation_columns: dict[int, list[int]] = {}
    for column, (joint, axis, kind) in enumerate(columns):
        if kind == "position":
            translations[:, joint, "XYZ".index(axis)] = scale * values[:, column]
        else:
            rotation_columns.setdefault(joint, []).append(column)
    rotations = np.tile(np.eye(3), (count, len(nodes), 1, 1))
    for order in {nodes[joint].order for joint in rotation_columns}:  # all its joints at once
        joints = [joint for joint in rotation_columns if nodes[joint].order == order]
        angles = np.deg2rad(values[:, [rotation_columns[joint] for joint in joints]])
        rotations[:, joints] = matrix_from_euler(angles, order)
    offsets[0] = 0
    with blamed_on(path):
        skeleton = Skeleton(
            name=Path(path).stem,
            names=tuple(node.name for node in nodes),
            parents=tuple(node.parent for node in nodes),
            offsets=offsets,
            end_sites=tuple(joint for joint, node in enumerate(nodes) if node.is_end),
        )
    moves = any(kind == "position" for node in nodes[1:] for _, kind in node.channels)
    root = translations[:, 0].copy()
    animation = Animation(skeleton, rotations, root, fps, translations if moves else None)
    return checks.checked_animation(path, animation)


def write_bvh(path: str | Path, animation: Animation, layout: BvhLayout = OURS) -> None:
    """Writes an animation as BVH, by default in centimeters, angles unwrapped so as not to jump.

    Leaf joints get an end site, which BVH requires; joints with animated offsets get position
    channels.

    Args:
        path: The file, replaced only when all is written.
        animation: The animation.
        layout: Rotation order and unit.

    Raises:
        InputError: The folder does not exist or cannot be written.
    """
    skeleton, order = animation.skeleton, _depth_first(animation.skeleton)
    joints = [joint for joint in order if joint not in skeleton.end_sites]
    moving = {0}
    if animation.translations is not None:
        away = np.abs(animation.translations - skeleton.offsets).max((0, 2))
        moving |= {joint for joint in joints if away[joint] > _SAME}
    rotations = np.asarray(animation.rotations[:, joints], np.float64)
    angles = continuous_euler(rotations, layout.order)
    columns = []
    for number, joint in enumerate(joints):
        if joint in moving:
            track = animation.translations
            positions = animation.root_positions if not joint or track is None else track[:, joint]
            columns.append(np.asarray(positions, np.float64) / layout.meters)
        columns.append(np.rad2deg(angles[:, number]))
    head = ["HIERARCHY", *hierarchy_lines(skeleton, moving, layout), "MOTION"]
    write_frames(path, head, columns, animation.fps)


def write_frames(
    path: str | Path, head: Sequence[str], columns: Sequence[np.ndarray], fps: float
) -> None:
    """Writes a file of lines that end with `MOTION` and the columns of its channels."""
    # Adding zero makes 0 of the -0 that rounding leaves.
    rows = np.round(np.column_stack(columns), 6) + 0.0
    template = " ".join(["%.6f"] * rows.shape[1])
    lines = [*head, f"Frames: {len(rows)}", f"Frame Time: {1 / fps:.8f}"]
    lines += [template % tuple(row) for row in rows.tolist()]
    write_file(path, "\n".join(lines) + "\n")


def _read_timing(path: Path, lines: Sequence[str], start: int) -> tuple[int, float, int]:
    """Returns the number of frames, the frames per second and the index of the first frame."""
    filled = [(i, line) for i, line in enumerate(lines[start : start + 20], start) if line.strip()]
    if len(filled) < 2:
        raise FileFormatError(path, "ends after 'MOTION': the file is truncated", len(lines))
    (at, first), (then, second) = filled[:2]
    frames, time = _FRAMES.fullmatch(first), _FRAME_TIME.fullmatch(second)
    if frames is None or int(frames[1]) == 0:
        raise FileFormatError(path, f"found {first[:40]!r}, expected 'Frames: <count>'", at + 1)
    if time is None:
        raise FileFormatError(path, f"found {second[:40]!r}, expected 'Frame Time: <s>'", then + 1)
    seconds = float(checks.numbers(path, then + 1, [time[1]], 1)[0])
    if seconds <= 0:
        raise FileFormatError(path, f"a frame time of {seconds} s; expected more", then + 1)
    fps = checks.checked_rate(path, 1 / max(seconds, 1e-300), then + 1)
    return int(frames[1]), checks.whole_rate(fps), then + 1


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    return [joint, *(j for c in skeleton.children(joint) for j in _depth_first(skeleton, c))]


def continuous_euler(rotations: Float[np.ndarray, "frames joints 3 3"], order: str) -> Joints:
    """Returns angles about the axes of `order` in radians, each frame the nearest to the last.

    Every rotation has two triples of angles, for ZXY (z, x, y) and (z + π, π - x, y + π). Changing
    both of two frames keeps their distance, so whether to change depends on two frames only, and
    which triple a frame takes is the parity of the changes so far.

    Args:
        rotations: Local rotations.
        order: A permutation of XYZ.
    """
    direct = euler_from_matrix(rotations, order)
    flipped = direct * np.array([1, -1, 1]) + np.pi
    changed_by, kept_by = (
        np.abs((direct[:-1] - after[1:] + np.pi) % (2 * np.pi) - np.pi).sum(axis=-1)
        for after in (flipped, direct)
    )
    change = changed_by < kept_by
    changed = np.cumsum(change, axis=0) % 2 == 1
    side = np.concatenate([np.zeros_like(changed, shape=(1, *changed.shape[1:])), changed])
    return np.unwrap(np.where(side[..., None], flipped, direct), axis=0)


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one BVH file for each motion: `out.bvh`, or `out-1.bvh`, `out-2.bvh` and so on.

    A motion that was read from a skeleton is written on that one, with all its joints.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    animations = [
        motion.recorded.animation if motion.recorded else motion.animation()
        for motion in counted(motions, "finding rotations")
    ]
    for target, animation in zip(paths, animations, strict=True):
        layout = OURS
        if animation.skeleton.name in get_args(EngineName):
            from latentmotion.formats.engines import engines  # a tenth of the command's imports

            layout = engines()[animation.skeleton.name].bvh
        write_bvh(target, animation, layout)
    return paths
