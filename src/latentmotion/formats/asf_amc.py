"""Acclaim's ASF/AMC: a skeleton of bones (ASF), and the angles of each bone per frame (AMC).

A bone rotates about its start, in its own axes: with C the rotation of its `axis` line and M that
of its angles, its rotation relative to its parent is C M C⁻¹; its end lies `length · direction`
from its start. Angles apply in the order listed: `XYZ` means Rz Ry Rx.

A joint is a bone's start and takes the bone's name (`lfemur` is the left hip, `ltibia` the
left knee); a bone without children ends in an end site, `<bone>_end`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.asf import Figure, read_asf, turned_in_order
from latentmotion.formats.checks import check_filled, checked_animation
from latentmotion.formats.lines import numbers, read_lines
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.limits import LEAST_FPS, MOST_FPS, MOST_NUMBER
from latentmotion.storage.reading import blamed_on


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
    with blamed_on(path):
        skeleton = figure_skeleton(path.stem, figure)
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
    """Returns the skeleton beside a motion: the ASF whose name the motion's begins with.

    Raises:
        FileFormatError: There is none, or several of other names.
    """
    path = Path(amc).absolute()
    beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    named = [asf for asf in beside if path.stem.startswith(asf.stem)]
    if named or len(beside) == 1:
        return max(named or beside, key=lambda asf: len(asf.stem))
    raise FileFormatError(
        amc,
        f"found {len(beside) or 'no'} ASF files beside it, none with its name; expected its "
        f"skeleton as {path.stem.split('_')[0]}.asf in the same folder, or pass asf=",
    )


def _read_frames(
    path: Path, lines: Sequence[str], figure: Figure
) -> tuple[bool, dict[str, Float[np.ndarray, "frames channels"]]]:
    """Returns whether angles are in degrees, and the values of each bone.

    All frames are read at once: apart from the numbers, every frame has the words of the first.
    """
    degrees, start = figure.degrees, None
    for index, text in enumerate(lines):
        word = text.strip().lower()
        if word.isdecimal():
            start = index
            break
        if word in (":degrees", ":radians"):
            degrees = word == ":degrees"
        elif word and word[0] not in "#:":
            problem = f"found {text[:40]!r}, expected a frame number: not AMC, or damaged"
            raise FileFormatError(path, problem, index + 1)
    if start is None:
        raise FileFormatError(path, "holds no frames: the file is truncated", len(lines))
    layout = _first_frame_bones(path, lines, start, figure)
    words = " ".join(lines[start:]).split()
    counts = [1 + len(figure.bones[name].channels) for name in layout]
    width = 1 + sum(counts)
    begins = np.cumsum([1, *counts[:-1]])
    same = all(set(words[b::width]) == {n} for n, b in zip(layout, begins, strict=True))
    same &= all(number.isdecimal() for number in words[::width])
    try:
        grid = np.array(words if same else [], dtype=object).reshape(-1, width)
        values = {
            name: grid[:, begin + 1 : begin + count].astype(np.float64)
            for name, begin, count in zip(layout, begins, counts, strict=True)
        }
    except ValueError:
        values = {}
    if not (same and values and all((np.abs(v) <= MOST_NUMBER).all() for v in values.values())):
        raise _first_problem(path, lines, start, layout, figure)
    return degrees, values


def _first_frame_bones(path: Path, lines: Sequence[str], start: int, figure: Figure) -> list[str]:
    """Returns the bones of the first frame, in its order; the others keep their rest pose."""
    layout: list[str] = []
    for index, text in enumerate(lines[start + 1 :], start + 1):
        words = text.split()
        if words and words[0].isdecimal():
            break
        if words:
            _check_bone(path, index + 1, words, figure)
            layout.append(words[0])
    else:
        # A single frame cannot be told from a file cut short, unless it is complete.
        missing = [n for n, bone in figure.bones.items() if bone.channels and n not in layout]
        if missing:
            problem = f"ends before bone {missing[0]!r}: the file is truncated"
            raise FileFormatError(path, problem, len(lines))
    if "root" not in layout:
        raise FileFormatError(path, "found a frame without 'root'", start + 1)
    return layout


def _check_bone(path: Path, line: int, words: list[str], figure: Figure) -> None:
    name, *values = words
    if name not in figure.bones:
        known = ", ".join(figure.bones)
        raise FileFormatError(path, f"found bone {name!r}; the ASF has {known}", line)
    count = len(figure.bones[name].channels)
    if len(values) != count:
        problem = f"found {len(values)} numbers for bone {name!r}, expected {count} as in the ASF"
        raise FileFormatError(path, problem, line)
    numbers(path, line, values, count)


def _first_problem(
    path: Path, lines: Sequence[str], start: int, layout: Sequence[str], figure: Figure
) -> FileFormatError:
    """Finds the first error, line by line, in a file known to be damaged."""
    filled = [(i, text.split()) for i, text in enumerate(lines[start:], start + 1) if text.strip()]
    for index, (line, words) in enumerate(filled):
        number = index % (1 + len(layout))
        if number == 0 and (len(words) > 1 or not words[0].isdecimal()):
            return FileFormatError(path, f"found {words[0]!r}, expected a frame number", line)
        if number > 0 and words[0] != layout[number - 1]:
            expected = f"expected bone {layout[number - 1]!r} as in the first frame"
            return FileFormatError(path, f"found {words[0]!r}, {expected}", line)
        if number > 0:
            _check_bone(path, line, words, figure)
    return FileFormatError(path, "ends inside a frame: the file is truncated", len(lines))


def figure_skeleton(name: str, figure: Figure) -> Skeleton:
    """Returns the bones of an ASF file as joints; see the top of this file."""
    names, parents = list(figure.bones), figure.parents
    inner, rank = set(parents.values()), {name: number for number, name in enumerate(names)}
    tips = [bone for bone in names if bone not in inner]
    starts = [*(parents[bone] for bone in names[1:]), *tips]
    return Skeleton(
        name=name,
        names=(*names, *(f"{tip}_end" for tip in tips)),
        parents=(-1, *(rank[bone] for bone in starts)),
        offsets=np.stack([np.zeros(3), *(figure.bones[bone].vector for bone in starts)]),
        end_sites=tuple(range(len(names), len(names) + len(tips))),
    )
