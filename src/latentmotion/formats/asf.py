"""ASF, the skeleton of Acclaim's ASF/AMC: the bones of one person, their axes and channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.lines import numbers, read_lines
from latentmotion.kinematics.rotations import matrix_from_euler
from latentmotion.storage.limits import MOST_JOINTS

_INCH = 0.0254
_UNITS = 1e-6, 1e6
"""Inverse of inches per unit of length; CMU's files have 0.45."""

_ROTATIONS = frozenset({"RX", "RY", "RZ"})
_TRANSLATIONS = frozenset({"TX", "TY", "TZ"})
_Line = tuple[int, list[str]]
"""Number of a line, from 1, and its words."""


@dataclass
class Bone:
    """One bone; the root is a bone of length 0."""

    name: str = ""
    """Its name in ASF and AMC."""
    direction: Float[np.ndarray, " 3"] | None = None
    """Unit vector from its start to its end; None until its line is read."""
    length: float | None = None
    """Meters; None until its line is read."""
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    """C: its own axes in world axes, in the columns."""
    channels: tuple[str, ...] = ()
    """Meaning of each of its numbers in the AMC, e.g. RX."""

    @property
    def order(self) -> str:
        """The axes it rotates about, in the order of application."""
        return "".join(channel[1] for channel in self.channels if channel in _ROTATIONS)

    @property
    def vector(self) -> Float[np.ndarray, " 3"]:
        """From its start to its end in the rest pose, meters."""
        return np.zeros(3) if self.direction is None else self.direction * (self.length or 0.0)


@dataclass(frozen=True)
class Figure:
    """The content of an ASF file."""

    meters: float
    """Meters per unit of length."""
    degrees: bool
    """Whether angles are in degrees rather than radians."""
    position: Float[np.ndarray, " 3"]
    """Root position in the rest pose, in the file's unit."""
    bones: dict[str, Bone]
    """By name, each after its parent, the root first."""
    parents: dict[str, str]
    """Name of each bone's parent; the root has none."""


def read_asf(path: str | Path) -> Figure:
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
    reader = _Reader(Path(path), degrees, _INCH / unit)
    position = reader.root(sections["root"])
    reader.bonedata(sections["bonedata"])
    parents = reader.hierarchy(sections["hierarchy"])
    bones = {name: reader.bones[name] for name in ["root", *parents]}
    return Figure(reader.meters, degrees, position, bones, parents)


def turned_in_order(
    angles: Float[np.ndarray, "*batch axes"], order: str
) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotates about fixed axes one after the other: intrinsic rotation in the reverse order.

    Args:
        angles: Radians.
        order: The axis of each angle; `XYZ` means Rz Ry Rx.
    """
    return matrix_from_euler(angles[..., ::-1], order[::-1])


class _Reader:
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
                if keyword != "begin":
                    raise FileFormatError(self.path, f"found {word!r}, expected 'begin'", line)
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
                    if not bone.name or bone.direction is None or bone.length is None:
                        problem = f"bone {bone.name!r} lacks its name, direction or length"
                        raise FileFormatError(self.path, problem, line)
                    if bone.name in self.bones:
                        raise FileFormatError(self.path, f"found bone {bone.name!r} twice", line)
                    if len(self.bones) >= MOST_JOINTS:
                        raise FileFormatError(self.path, f"more than {MOST_JOINTS:,} bones", line)
                    self.bones[bone.name] = bone
                    bone = None
        if bone is not None:
            problem = f"ends inside bone {bone.name!r}: 'end' is missing"
            raise FileFormatError(self.path, problem, lines[-1][0])

    def hierarchy(self, lines: list[_Line]) -> dict[str, str]:
        """Reads `:hierarchy` and returns each bone's parent, parents first."""
        if [words[0].lower() for _, words in (lines[0], lines[-1])] != ["begin", "end"]:
            problem = "':hierarchy' does not run from 'begin' to 'end': truncated"
            raise FileFormatError(self.path, problem, lines[-1][0])
        parents: dict[str, str] = {}
        for line, (parent, *children) in lines[1:-1]:
            for child in children:
                for name in (parent, child):
                    if name not in self.bones:
                        problem = f"found bone {name!r}, not in ':bonedata'"
                        raise FileFormatError(self.path, problem, line)
                if child in parents or child == "root" or parent not in ("root", *parents):
                    problem = f"bone {child!r} below {parent!r} makes no tree from the root down"
                    raise FileFormatError(self.path, problem, line)
                parents[child] = parent
        return parents

    def _axes(self, line: int, words: list[str]) -> Float[np.ndarray, "3 3"]:
        order = words[-1].upper() if words else ""
        if sorted(order) != ["X", "Y", "Z"]:
            raise FileFormatError(self.path, "found no order of axes, expected e.g. 'XYZ'", line)
        angles = numbers(self.path, line, words[:-1], 3)
        return turned_in_order(np.deg2rad(angles) if self.degrees else angles, order)

    def _channels(self, line: int, words: list[str], known: frozenset[str]) -> tuple[str, ...]:
        channels = tuple(word.upper() for word in words)
        if set(channels) - known or len(set(channels)) < len(channels):
            problem = f"found the channels {words}, expected some of {sorted(known)}, each once"
            raise FileFormatError(self.path, problem, line)
        return channels
