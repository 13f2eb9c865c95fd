"""Picture strips as in papers: a motion as a row of frames, or as fading figures along its path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.render import Style, mannequin, painter
from latentmotion.render.painter import camera_around, camera_of_all, half_front
from latentmotion.storage.files import atomic_file

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

WIDTH = 1280  # Default width, pixels.

WIDTHS = (200, 8000)  # The narrowest and the widest strip.

# Heights of a row, of a path and of the line with the caption, in widths.
_ROW, _PATH, _BAND = 268 / 1280, 560 / 1280, 34 / 1280


def write(
    path: str | Path,
    motions: Sequence[Motion],
    style: Style = "row",
    figures: int = 9,
    width: int = WIDTH,
    figure: mannequin.Figure = mannequin.mannequin_of,
) -> list[Path]:
    """Writes a PNG with one strip for each motion, under each other.

    Args:
        path: The file.
        motions: The motions to show.
        style: `row`: figures evenly spaced from left to right, without root motion;
            `path`: figures at their positions, the earlier the paler.
        figures: Number of frames of each motion.
        width: Pixels from left to right.
        figure: Kind of figure.

    Raises:
        InputError: Unknown style, no figures, a width that makes no picture, or a folder that
            cannot be written.
        MissingExtraError: Pillow is not installed.
    """
    painters = {"row": _row, "path": _path}
    if style not in painters:
        raise InputError(f"strip style {style!r}; expected one of {', '.join(painters)}")
    if figures < 1:
        raise InputError(f"{figures} figures in a strip; expected at least 1")
    if not WIDTHS[0] <= width <= WIDTHS[1]:
        raise InputError(f"a strip {width} pixels wide; expected {WIDTHS[0]} to {WIDTHS[1]}")
    strips = [painters[style](motion, figures, width, figure) for motion in motions]
    band, letters = round(_BAND * width), _text(18, width)
    heights = [band + strip.height for strip in strips]
    sheet = painter.Image.new("RGB", (width, sum(heights)), painter.BACKGROUND)
    for number, (motion, strip) in enumerate(zip(motions, strips, strict=True)):
        top = number * heights[number]
        sheet.paste(strip, (0, top + band))
        position, room = (letters, top + 0.6 * band), width - 2 * letters
        painter.paint_text(sheet, motion.caption, position, letters, "lm", room)
    with atomic_file(path) as temporary:
        sheet.save(temporary, format="PNG", optimize=False)
    return [Path(path)]


def _row(motion: Motion, figures: int, across: int, figure: mannequin.Figure) -> Picture:
    frames = np.unique(np.linspace(0, len(motion) - 1, figures).round().astype(int)).tolist()
    bodies = painter.make_bodies(motion, frames, figure=figure)
    floor = bodies.floor
    # At least as high as an adult, so that a crouching person looks small; 0.36 m are the margins,
    # of which 0.26 m are below for the times.
    height = max(1.7, float(bodies.vertices[..., 1].max()) - floor) + 0.36
    size = across, round(_ROW * across)
    width = height * size[0] / size[1]
    target = np.array([0.0, floor + height / 2 - 0.26, 0.0])
    pixels = painter.oversampled(size)
    camera = camera_around(target, half_front(motion), np.radians(9), 40, pixels, height)
    aside = (bodies.vertices - bodies.joints[:, :1] * (1, 0, 1)) @ camera.axes()[0]
    half = width / len(frames) / 2  # the first and the last have room for all of their reach
    start, end = max(half, 0.12 - aside[0].min()), max(half, 0.12 + aside[-1].max())
    positions = np.linspace(start - width / 2, width / 2 - end, len(frames))
    steps = positions[:, None] * camera.axes()[0] - bodies.joints[:, 0] * (1, 0, 1)
    moved = [bodies.moved(number, step) for number, step in enumerate(steps)]
    colors = [painter.COLORS[0]] * len(moved)
    picture = painter.painted(camera, moved, 0, floor, 0.62 * width, colors)
    for frame, position in zip(frames, positions, strict=True):
        pixel = (size[0] * (0.5 + position / width), size[1] - across * 11 / WIDTH)
        painter.paint_text(picture, f"{frame / motion.fps:.1f} s", pixel, _text(13, across), "mm")
    return picture


def _path(motion: Motion, figures: int, across: int, figure: mannequin.Figure) -> Picture:
    # Frames at even distances along the path; where nobody walks, evenly in time.
    steps = np.linalg.norm(np.diff(motion.joints[:, 0, [0, 2]], axis=0), axis=-1)
    # 5 cm/s besides the path let time pass where nobody walks.
    distance = np.concatenate([[0.0], np.cumsum(steps + 0.05 / motion.fps)])
    even = np.searchsorted(distance, np.linspace(0, distance[-1], figures))
    frames = np.unique(even.clip(0, len(motion) - 1)).tolist()
    bodies = painter.make_bodies(motion, frames, figure)
    count = len(bodies.joints)
    size = across, round(_PATH * across)
    camera, height = camera_of_all(motion, bodies.vertices, painter.oversampled(size))
    moved = [bodies.moved(number, np.zeros(3)) for number in range(count)]
    # The first figures are faint, so that the eye reads from them to the last.
    strengths = np.linspace(0.35, 1, count).tolist()
    trail = motion.joints[:, 0].astype(np.float64)
    colors = [painter.COLORS[0]] * count
    floor, reach = bodies.floor, 1.6 * height
    return painter.painted(camera, moved, 0, floor, reach, colors, strengths, trail)


def _text(size: int, across: int) -> int:
    """Returns the size of letters that are `size` pixels high on a strip of usual width."""
    return max(10, round(size * across / WIDTH))
