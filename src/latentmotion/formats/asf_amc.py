"""Acclaim's ASF/AMC: a skeleton of bones (ASF), and the angles of each bone per frame (AMC).

A bone turns about its start, in its own axes: with C the rotation of its `axis` line and M that
of its angles, its rotation relative to its parent is C M C⁻¹, and it ends `length · direction`
further on. Angles apply in the order listed: `XYZ` means Rz Ry Rx.

Here a joint is a bone's start and takes the bone's name (`lfemur` is the left hip, `ltibia` the
left knee); a bone without children ends in an end site, `<bone>_end`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.animation import Animation
from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.lines import numbers, read_lines
from latentmotion.rotations import matrix_from_euler
from latentmotion.skeleton import Skeleton

_INCH = 0.0254
_Line = tuple[int, list[str]]
"""Number of a line, from 1, and its words."""


@dataclass
class _Bone:
    """One bone; the root is a bone of length 0."""

    name: str = ""
    direction: Float[np.ndarray, " 3"] | None = None
    """From its start to its end, of length 1."""
    length: float | None = None
    """Meters."""
    axes: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    """C: its own axes in the world's."""
    channels: tuple[str, ...] = ()
    """What each of its numbers in the AMC means, e.g. RX."""

    @property
    def order(self) -> str:
        """The axes it turns about, in the order of application."""
        return "".join(channel[1] for channel in self.channels if channel[0] == "R")


@dataclass
class _Figure:
    """What an ASF file holds."""

    meters: float
    """Meters per unit of length."""
    degrees: bool
    position: Float[np.ndarray, " 3"]
    """Of the root in the rest pose, in the file's unit."""
    bones: dict[str, _Bone]
    """By name, each after its parent, the root first."""
    parents: dict[str, str]


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
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"found a frame rate of {fps}; expected a positive number")
    lines = read_lines(amc)
    figure = _read_figure(Path(asf) if asf is not None else _find_asf(Path(amc)))
    degrees, start = _read_preamble(Path(amc), lines, figure.degrees)
    values = _read_frames(Path(amc), lines, start, figure)
    return _animation(Path(amc).stem, figure, values, degrees, fps)


def _find_asf(amc: Path) -> Path:
    found = sorted(p for p in amc.absolute().parent.iterdir() if p.suffix.lower() == ".asf")
    named = [path for path in found if amc.stem.startswith(path.stem)]
    if named:
        return max(named, key=lambda path: len(path.stem))
    if len(found) == 1:
        return found[0]
    expected = f"{amc.stem.split('_')[0]}.asf"
    raise FileFormatError(
        amc,
        f"found {len(found) or 'no'} ASF files beside it, none with its name; expected the "
        f"skeleton as {expected} in the same folder, or pass asf=",
    )


def _read_figure(path: Path) -> _Figure:
    sections = _sections(path)
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get("units", [])}
    line, length = units.get("length", (1, ["1"]))
    meters = _INCH / float(numbers(path, line, length, 1)[0])
    degrees = not units.get("angle", (1, ["deg"]))[1][0].lower().startswith("rad")
    root = _Bone("root", np.zeros(3), 0.0)
    position = _read_root(path, sections["root"], degrees, root)
    bones = {"root": root, **_read_bones(path, sections["bonedata"], degrees, meters)}
    parents = _read_hierarchy(path, sections["hierarchy"], bones)
    ordered = {name: bones[name] for name in ["root", *parents]}
    return _Figure(meters, degrees, position, ordered, parents)


def _sections(path: Path) -> dict[str, list[_Line]]:
    """Returns the lines below each `:keyword`, comments and blank lines aside."""
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
    return sections


def _read_root(path: Path, lines: list[_Line], degrees: bool, root: _Bone) -> np.ndarray:
    entries = {words[0].lower(): (line, words[1:]) for line, words in lines}
    zero = (1, ["0", "0", "0"])
    line, order = entries.get("order", (1, ["TX", "TY", "TZ", "RX", "RY", "RZ"]))
    root.channels = _channels(path, line, order, {"TX", "TY", "TZ", "RX", "RY", "RZ"})
    axis = entries.get("axis", (1, ["XYZ"]))[1]
    line, angles = entries.get("orientation", zero)
    root.axes = _axes(path, line, [*angles, *axis], degrees)
    line, position = entries.get("position", zero)
    return numbers(path, line, position, 3)


def _read_bones(path: Path, lines: list[_Line], degrees: bool, meters: float) -> dict[str, _Bone]:
    bones: dict[str, _Bone] = {}
    bone: _Bone | None = None
    for line, words in lines:
        match words[0].lower():
            case "begin":
                bone = _Bone()
            case "end":
                _finish(path, line, bone, bones)
                bone = None
            case _ if bone is None:
                raise FileFormatError(path, f"found {words[0]!r}, expected 'begin'", line)
            case keyword:
                _set(path, line, bone, keyword, words[1:], degrees, meters)
    if bone is not None:
        raise FileFormatError(path, "ends inside a bone: the file is truncated", lines[-1][0])
    return bones


def _set(
    path: Path,
    line: int,
    bone: _Bone,
    keyword: str,
    words: list[str],
    degrees: bool,
    meters: float,
) -> None:
    match keyword:
        case "name":
            bone.name = " ".join(words)
        case "direction":
            direction = numbers(path, line, words, 3)
            bone.direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
        case "length":
            bone.length = meters * float(numbers(path, line, words, 1)[0])
        case "axis":
            bone.axes = _axes(path, line, words, degrees)
        case "dof":
            bone.channels = _channels(path, line, words, {"RX", "RY", "RZ"})


def _finish(path: Path, line: int, bone: _Bone | None, bones: dict[str, _Bone]) -> None:
    if bone is None:
        raise FileFormatError(path, "found 'end' without its 'begin'", line)
    if not bone.name or bone.direction is None or bone.length is None:
        problem = f"bone {bone.name!r} lacks its name, direction or length"
        raise FileFormatError(path, problem, line)
    if bone.name in bones:
        raise FileFormatError(path, f"found bone {bone.name!r} twice", line)
    bones[bone.name] = bone


def _axes(path: Path, line: int, words: list[str], degrees: bool) -> np.ndarray:
    order = words[-1].upper()
    if sorted(order) != ["X", "Y", "Z"]:
        raise FileFormatError(path, f"found axis order {words[-1]!r}, expected e.g. 'XYZ'", line)
    angles = numbers(path, line, words[:-1], 3)
    return _applied_in_order(np.deg2rad(angles) if degrees else angles, order)


def _channels(path: Path, line: int, words: list[str], known: set[str]) -> tuple[str, ...]:
    channels = tuple(word.upper() for word in words)
    if set(channels) - known or len(set(channels)) < len(channels):
        raise FileFormatError(
            path, f"found the channels {' '.join(words)!r}, expected some of {sorted(known)}", line
        )
    return channels


def _read_hierarchy(path: Path, lines: list[_Line], bones: Mapping[str, _Bone]) -> dict[str, str]:
    if lines[-1][1][0].lower() != "end":
        raise FileFormatError(path, "ends inside ':hierarchy': truncated", lines[-1][0])
    parents: dict[str, str] = {}
    for line, (parent, *children) in lines[1:-1]:
        for name in (parent, *children):
            if name not in bones:
                raise FileFormatError(path, f"found bone {name!r}, not in ':bonedata'", line)
        for child in children:
            if child in parents or child == "root" or (parent != "root" and parent not in parents):
                raise FileFormatError(path, f"bone {child!r} does not fit into one tree", line)
            parents[child] = parent
    return parents


def _read_preamble(path: Path, lines: Sequence[str], degrees: bool) -> tuple[bool, int]:
    """Returns whether angles are in degrees, and the index of the line that opens frame one."""
    for index, text in enumerate(lines):
        word = text.strip().lower()
        if word.isdecimal():
            return degrees, index
        if word in (":degrees", ":radians"):
            degrees = word == ":degrees"
        elif word and word[0] not in "#:":
            problem = f"found {text[:40]!r}, expected a frame number: not AMC, or damaged"
            raise FileFormatError(path, problem, index + 1)
    raise FileFormatError(path, "holds no frames: the file is truncated", len(lines))


def _read_frames(
    path: Path, lines: Sequence[str], start: int, figure: _Figure
) -> dict[str, Float[np.ndarray, "frames channels"]]:
    """Reads all frames at once: every frame has the words of the first, other numbers aside."""
    layout = _layout(path, lines, start, figure)
    words = " ".join(lines[start:]).split()
    width = 1 + sum(1 + len(figure.bones[name].channels) for name in layout)
    columns, column = {}, 1
    for name in layout:
        count = len(figure.bones[name].channels)
        columns[name] = slice(column + 1, column + 1 + count)
        column += 1 + count
    regular = len(words) % width == 0 and all(
        set(words[columns[name].start - 1 :: width]) == {name} for name in layout
    )
    try:
        grid = np.array(words if regular else [], dtype=object).reshape(-1, width)
        values = {name: grid[:, columns[name]].astype(np.float64) for name in layout}
        regular &= all(np.isfinite(block).all() for block in values.values())
    except ValueError:
        regular = False
    if not regular:
        raise _first_problem(path, lines, start, layout, figure)
    return values


def _layout(path: Path, lines: Sequence[str], start: int, figure: _Figure) -> list[str]:
    """Returns the bones of the first frame, in its order."""
    layout: list[str] = []
    for index, text in enumerate(lines[start + 1 :], start + 1):
        words = text.split()
        if words and words[0].isdecimal():
            return layout
        if words:
            _check_pose(path, index + 1, words, figure)
            layout.append(words[0])
    missing = [name for name, bone in figure.bones.items() if bone.channels and name not in layout]
    if missing:
        raise FileFormatError(path, f"ends before bone {missing[0]!r}: truncated", len(lines))
    return layout


def _check_pose(path: Path, line: int, words: list[str], figure: _Figure) -> None:
    name, *rest = words
    if name not in figure.bones:
        known = ", ".join(figure.bones)
        raise FileFormatError(path, f"found bone {name!r}; the ASF has {known}", line)
    count = len(figure.bones[name].channels)
    if len(rest) != count:
        problem = f"found {len(rest)} numbers for bone {name!r}, expected {count} as in the ASF"
        raise FileFormatError(path, problem, line)
    numbers(path, line, rest, count)


def _first_problem(
    path: Path, lines: Sequence[str], start: int, layout: Sequence[str], figure: _Figure
) -> FileFormatError:
    """Goes line by line through a file known to be damaged."""
    expected = [None, *layout]
    place = 0
    for index, text in enumerate(lines[start:], start):
        words = text.split()
        if not words:
            continue
        name = expected[place % len(expected)]
        if name is None and (len(words) > 1 or not words[0].isdecimal()):
            return FileFormatError(path, f"found {text[:40]!r}, expected a frame", index + 1)
        if name is not None and words[0] != name:
            return FileFormatError(path, f"found {words[0]!r}, expected bone {name!r}", index + 1)
        if name is not None:
            _check_pose(path, index + 1, words, figure)
        place += 1
    return FileFormatError(path, "ends inside a frame: the file is truncated", len(lines))


def _animation(
    name: str,
    figure: _Figure,
    values: Mapping[str, Float[np.ndarray, "frames channels"]],
    degrees: bool,
    fps: float,
) -> Animation:
    skeleton = _skeleton(name, figure)
    frames = len(next(iter(values.values())))
    rotations = np.tile(np.eye(3), (frames, len(skeleton), 1, 1))
    axes = np.stack([bone.axes for bone in figure.bones.values()])
    for order in {figure.bones[bone].order for bone in values} - {""}:
        names = [bone for bone in values if figure.bones[bone].order == order]
        angles = np.stack([_angles(figure.bones[bone], values[bone]) for bone in names], axis=1)
        joints = [skeleton.names.index(bone) for bone in names]
        turns = _applied_in_order(np.deg2rad(angles) if degrees else angles, order)
        rotations[:, joints] = axes[joints] @ turns @ axes[joints].swapaxes(-1, -2)
    root_positions = _root_positions(figure, values.get("root"), frames)
    return Animation(skeleton, rotations, root_positions, float(fps))


def _skeleton(name: str, figure: _Figure) -> Skeleton:
    names = list(figure.bones)
    parents = [-1, *(names.index(parent) for parent in figure.parents.values())]
    offsets = [np.zeros(3), *(_vector(figure.bones[p]) for p in figure.parents.values())]
    tips = [bone for bone in names if bone not in figure.parents.values()]
    return Skeleton(
        name=name,
        names=(*names, *(f"{bone}_end" for bone in tips)),
        parents=(*parents, *(names.index(bone) for bone in tips)),
        offsets=np.stack([*offsets, *(_vector(figure.bones[bone]) for bone in tips)]),
        end_sites=tuple(range(len(names), len(names) + len(tips))),
    )


def _vector(bone: _Bone) -> Float[np.ndarray, " 3"]:
    assert bone.direction is not None and bone.length is not None
    return bone.direction * bone.length


def _angles(
    bone: _Bone, values: Float[np.ndarray, "frames channels"]
) -> Float[np.ndarray, "frames turns"]:
    return values[:, [n for n, channel in enumerate(bone.channels) if channel[0] == "R"]]


def _root_positions(
    figure: _Figure, values: Float[np.ndarray, "frames channels"] | None, frames: int
) -> Float[np.ndarray, "frames 3"]:
    positions = np.tile(figure.position, (frames, 1))
    for column, channel in enumerate(figure.bones["root"].channels):
        if channel[0] == "T" and values is not None:
            positions[:, "XYZ".index(channel[1])] += values[:, column]
    return figure.meters * positions


def _applied_in_order(
    angles: Float[np.ndarray, "*batch turns"], order: str
) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotates about fixed axes one after the other: intrinsic rotation in the reverse order."""
    return matrix_from_euler(angles[..., ::-1], order[::-1])
