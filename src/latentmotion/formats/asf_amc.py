"""Acclaim's ASF/AMC: a skeleton of bones (ASF), and the angles of each bone per frame (AMC).

A bone rotates about its start, in its own axes: with C the rotation of its `axis` line and M that
of its angles, its rotation relative to its parent is C M C⁻¹; its end lies `length · direction`
from its start. Angles apply in the order listed: `XYZ` means Rz Ry Rx.

A joint is a bone's start and takes the bone's name (`lfemur` is the left hip, `ltibia` the
left knee); a bone without children ends in an end site, `<bone>_end`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.checks import check_filled, checked_animation, numbers, read_lines, table
from latentmotion.kinematics.rotations import matrix_from_euler
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.storage.limits import LEAST_FPS, MOST_FPS, MOST_JOINTS
from latentmotion.storage.reading import blamed_on

_INCH = 0.0254
# Inverse of inches per unit of length; CMU's files have 0.45.
_UNITS = 1e-6, 1e6

_ROTATIONS = frozenset({"RX", "RY", "RZ"})
_TRANSLATIONS = frozenset({"TX", "TY", "TZ"})
# Number of a line, from 1, and its words.
_Line = tuple[int, list[str]]


@dataclass
class Bone:
    """One bone; the root is a bone of length 0."""

    name: str = ""  # Its name in ASF and AMC.
    # Unit vector from its start to its end; None until its line is read.
    direction: Float[np.ndarray, " 3"] | None = None
    length: float | None = None  # Meters; None until its line is read.
    # C: its own axes in world axes, in the columns.
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    channels: tuple[str, ...] = ()  # Meaning of each of its numbers in the AMC, e.g. RX.

    @property
    def order(self) -> str:
        """The axes it rotates about, in the order of application."""
        return "".join(channel[1] for channel in self.channels if channel in _ROTATIONS)

    @property
    def vector(self) -> Float[np.ndarray, " 3"]:
        """From its start to its end in the rest pose, meters."""
        return np.zeros(3) if self.direction is None else self.direction * (self.length or 0.0)


@dataclass(frozen=True)
class AsfSkeleton:
    """The content of an ASF file."""

    meters: float  # Meters per unit of length.
    degrees: bool  # Whether angles are in degrees rather than radians.
    position: Float[np.ndarray, " 3"]  # Root position in the rest pose, in the file's unit.
    bones: dict[str, Bone]  # By name, each after its parent, the root first.
    parents: dict[str, str]  # Name of each bone's parent; the root has none.


def read_asf(path: str | Path) -> AsfSkeleton:
    """Reads a skeleton. Joint limits are ignored.

    Raises:
        FileFormatError: The file is damaged or not ASF.
    """
    sections: dict[str, list[_Line]] = {}
    keyword = ""
    for line, text in enumerate(read_lines(path), 1):
        words = text.split("#")[0].split()
        if words and words[0].startswith(":"):
            keyword = words[0][1:].lower()
            sections[keyword] = []
        elif words:
            sections.setdefault(keyword, []).append((line, words))
    for needed in ("root", "bonedata", "hierarchy"):
        if not sections.get(needed):
            raise FileFormatError(path, f"has no ':{needed}' section; not ASF, or truncated")
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get("units", [])}
    line, length = units.get("length", (1, ["1"]))
    unit = float(numbers(path, line, length, 1)[0])
    if not _UNITS[0] <= unit <= _UNITS[1]:
        expected = f"expected {_UNITS[0]:g} to {_UNITS[1]:g}"
        raise FileFormatError(path, f"found a unit of length of {unit}, {expected}", line)
    degrees = not " ".join(units.get("angle", (1, []))[1]).lower().startswith("rad")
    reader = _AsfReader(Path(path), degrees, _INCH / unit)
    position = reader.root(sections["root"])
    reader.bonedata(sections["bonedata"])
    parents = reader.hierarchy(sections["hierarchy"])
    bones = {name: reader.bones[name] for name in ["root", *parents]}
    return AsfSkeleton(reader.meters, degrees, position, bones, parents)


def turned_in_order(
    angles: Float[np.ndarray, "*batch axes"], order: str
) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotates about fixed axes one after the other: intrinsic rotation in the reverse order.

    Args:
        angles: Radians.
        order: The axis of each angle; `XYZ` means Rz Ry Rx.
    """
    return matrix_from_euler(angles[..., ::-1], order[::-1])


class _AsfReader:
    """Reads the sections of one file, line by line."""

    def __init__(self, path: Path, degrees: bool, meters: float) -> None:
        self.path = path
        self.degrees = degrees
        self.meters = meters
        self.bones: dict[str, Bone] = {}

    def root(self, lines: list[_Line]) -> Float[np.ndarray, " 3"]:
        """Reads `:root` and returns its position, in the file's unit."""
        entries = {words[0].lower(): (line, words[1:]) for line, words in lines}
        zero = (1, ["0", "0", "0"])
        line, order = entries.get("order", (1, ["TX", "TY", "TZ", "RX", "RY", "RZ"]))
        channels = self._channels(line, order, _TRANSLATIONS | _ROTATIONS)
        line, angles = entries.get("orientation", zero)
        axes = self._axes(line, [*angles, *entries.get("axis", (1, ["XYZ"]))[1]])
        self.bones["root"] = Bone("root", np.zeros(3), 0.0, axes, channels)
        line, position = entries.get("position", zero)
        return numbers(self.path, line, position, 3)

    def bonedata(self, lines: list[_Line]) -> None:
        """Reads `:bonedata`, one `begin` … `end` block per bone."""
        bone: Bone | None = None
        for line, (word, *values) in lines:
            keyword = word.lower()
            if bone is None:
                self._check(keyword == "begin", f"found {word!r}, expected 'begin'", line)
                bone = Bone()
                continue
            match keyword:
                case "begin":
                    raise FileFormatError(self.path, "found 'begin' inside a bone", line)
                case "name":
                    bone.name = " ".join(values)
                case "direction":
                    direction = numbers(self.path, line, values, 3)
                    bone.direction = direction / (np.linalg.norm(direction) or 1.0)
                case "length":
                    bone.length = self.meters * float(numbers(self.path, line, values, 1)[0])
                case "axis":
                    bone.axes = self._axes(line, values)
                case "dof":
                    bone.channels = self._channels(line, values, _ROTATIONS)
                case "end":
                    full = bone.name and bone.direction is not None and bone.length is not None
                    problem = f"bone {bone.name!r} lacks its name, direction or length"
                    self._check(bool(full), problem, line)
                    self._check(
                        bone.name not in self.bones, f"found bone {bone.name!r} twice", line
                    )
                    self._check(
                        len(self.bones) < MOST_JOINTS, f"more than {MOST_JOINTS:,} bones", line
                    )
                    self.bones[bone.name] = bone
                    bone = None
        if bone is not None:
            problem = f"ends inside bone {bone.name!r}: 'end' is missing"
            raise FileFormatError(self.path, problem, lines[-1][0])

    def hierarchy(self, lines: list[_Line]) -> dict[str, str]:
        """Reads `:hierarchy` and returns each bone's parent, parents first."""
        whole = [words[0].lower() for _, words in (lines[0], lines[-1])] == ["begin", "end"]
        problem = "':hierarchy' does not run from 'begin' to 'end': truncated"
        self._check(whole, problem, lines[-1][0])
        parents: dict[str, str] = {}
        for line, (parent, *children) in lines[1:-1]:
            for child in children:
                for name in (parent, child):
                    self._check(
                        name in self.bones, f"found bone {name!r}, not in ':bonedata'", line
                    )
                new = child not in ("root", *parents) and parent in ("root", *parents)
                problem = f"bone {child!r} below {parent!r} makes no tree from the root down"
                self._check(new, problem, line)
                parents[child] = parent
        return parents

    def _axes(self, line: int, words: list[str]) -> Float[np.ndarray, "3 3"]:
        order = words[-1].upper() if words else ""
        problem = "found no order of axes, expected e.g. 'XYZ'"
        self._check(sorted(order) == ["X", "Y", "Z"], problem, line)
        angles = numbers(self.path, line, words[:-1], 3)
        return turned_in_order(np.deg2rad(angles) if self.degrees else angles, order)

    def _channels(self, line: int, words: list[str], allowed: frozenset[str]) -> tuple[str, ...]:
        channels = tuple(word.upper() for word in words)
        problem = f"found the channels {words}, expected some of {sorted(allowed)}, each once"
        self._check(allowed.issuperset(channels), problem, line)
        self._check(len(set(channels)) == len(channels), problem, line)
        return channels

    def _check(self, condition: bool, problem: str, line: int) -> None:
        if not condition:
            raise FileFormatError(self.path, problem, line)


def read_asf_amc(amc: str | Path, asf: str | Path | None = None, fps: float = 120.0) -> Animation:
    """Reads a motion in Acclaim's format, as CMU and HDM05 publish theirs.

    Args:
        amc: The motion.
        asf: Its skeleton; by default the ASF file in the same folder whose name the motion's
            begins with (`01.asf` for `01_02.amc`), or the only one there.
        fps: Frames per second; the format does not say.

    Returns:
        The animation in meters. Joints are the starts of bones; see the top of this file.

    Raises:
        FileFormatError: A file is damaged, or there is no skeleton, or it has other bones.
        InputError: The frame rate is not positive.
    """
    if not LEAST_FPS <= fps <= MOST_FPS:
        problem = f"found a frame rate of {fps}; expected a positive number"
        raise InputError(f"{problem}, {LEAST_FPS:g} to {MOST_FPS:,.0f}")
    path, lines = Path(amc), read_lines(amc)
    figure = read_asf(find_asf(path) if asf is None else asf)
    degrees, values = _read_frames(path, lines, figure)
    # The bones as joints; see the top of this file.
    names, parents = list(figure.bones), figure.parents
    inner, rank = set(parents.values()), {name: number for number, name in enumerate(names)}
    tips = [bone for bone in names if bone not in inner]
    starts = [*(parents[bone] for bone in names[1:]), *tips]
    with blamed_on(path):
        skeleton = Skeleton(
            name=path.stem,
            names=(*names, *(f"{tip}_end" for tip in tips)),
            parents=(-1, *(rank[bone] for bone in starts)),
            offsets=np.stack([np.zeros(3), *(figure.bones[bone].vector for bone in starts)]),
            end_sites=tuple(range(len(names), len(names) + len(tips))),
        )
    stated = sum(block.size for block in values.values())
    check_filled(path, len(values["root"]), len(skeleton), stated)
    rotations = np.tile(np.eye(3), (len(values["root"]), len(skeleton), 1, 1))
    for order in {figure.bones[name].order for name in values} - {""}:  # all bones of it at once
        bones = [figure.bones[name] for name in values if figure.bones[name].order == order]
        channels = [[n for n, c in enumerate(bone.channels) if c[0] == "R"] for bone in bones]
        angles = np.stack(
            [values[bone.name][:, columns] for bone, columns in zip(bones, channels, strict=True)],
            axis=1,
        )
        bent = turned_in_order(np.deg2rad(angles) if degrees else angles, order)
        axes = np.stack([bone.axes for bone in bones])
        joints = [skeleton.names.index(bone.name) for bone in bones]
        rotations[:, joints] = axes @ bent @ axes.swapaxes(-1, -2)
    positions = np.tile(figure.position, (len(values["root"]), 1))
    for column, channel in enumerate(figure.bones["root"].channels):
        if channel[0] == "T":
            positions[:, "XYZ".index(channel[1])] += values["root"][:, column]
    animation = Animation(skeleton, rotations, figure.meters * positions, float(fps))
    return checked_animation(path, animation)


def find_asf(amc: str | Path) -> Path:
    """Returns the skeleton of a motion: the ASF whose name the motion's begins with, or the only.

    It lies beside the motion, or in the nearest of two folders above that has any.

    Raises:
        FileFormatError: There is none, or several of other names.
    """
    path = Path(amc).absolute()
    folders = (
        sorted(p for p in folder.iterdir() if p.suffix.lower() == ".asf")
        for folder in list(path.parents)[:3]
        if os.access(folder, os.R_OK)
    )
    beside = next(filter(None, folders), [])
    named = [asf for asf in beside if path.stem.startswith(asf.stem)]
    if named or len(beside) == 1:
        return max(named or beside, key=lambda asf: len(asf.stem))
    raise FileFormatError(
        amc,
        f"found {len(beside) or 'no'} ASF files beside it, none with its name; expected its "
        f"skeleton as {path.stem.split('_')[0]}.asf in the same folder, or pass asf=",
    )


def _read_frames(
    path: Path, lines: Sequence[str], figure: AsfSkeleton
) -> tuple[bool, dict[str, Float[np.ndarray, "frames channels"]]]:
    """Returns whether angles are in degrees, and the values of each bone.

    Every frame has the bones of the first, in its order; the others keep their rest pose.
    """
    degrees, frames, start = figure.degrees, 0, 0
    place = 0  # number of bones that were read of the present frame
    rows: dict[str, list[_Line]] = {}
    order: list[str] = []
    for line, text in enumerate(lines, 1):
        name, *words = text.split() or [""]
        problem = ""
        if name.isdecimal() and not words and place == len(order):
            if frames == 1 and "root" not in rows:
                raise FileFormatError(path, "found a frame without 'root'", start)
            frames, place, start = frames + 1, 0, start or line
        elif not frames and name and name[0] not in "#:":
            problem = f"found {text[:40]!r}, expected a frame number: not AMC, or damaged"
        elif not frames and name.lower() in (":degrees", ":radians"):
            degrees = name.lower() == ":degrees"
        elif frames and name:
            if frames == 1 and name not in rows:
                order.append(name)
            if place == len(order):
                problem = f"found {name!r}, expected a frame number"
            elif name != order[place]:
                problem = f"found {name!r}, expected bone {order[place]!r} as in the first frame"
            elif name not in figure.bones:
                problem = f"found bone {name!r}; the ASF has {', '.join(figure.bones)}"
            elif len(words) != (count := len(figure.bones[name].channels)):
                problem = f"found {len(words)} numbers for bone {name!r}, expected {count}"
                problem += " as in the ASF"
            rows.setdefault(name, []).append((line, words))
            place += 1
        if problem:
            raise FileFormatError(path, problem, line)
    # A single frame cannot be told from a file cut short, unless it is complete.
    missing = [name for name, bone in figure.bones.items() if bone.channels and name not in rows]
    if not frames:
        raise FileFormatError(path, "holds no frames: the file is truncated", len(lines))
    if frames == 1 and missing:
        problem = f"ends before bone {missing[0]!r}: the file is truncated"
        raise FileFormatError(path, problem, len(lines))
    if place < len(order):
        raise FileFormatError(path, "ends inside a frame: the file is truncated", len(lines))
    if "root" not in rows:
        raise FileFormatError(path, "found a frame without 'root'", start)
    widths = {name: len(figure.bones[name].channels) for name in order}
    return degrees, {name: table(path, rows[name], width) for name, width in widths.items()}
