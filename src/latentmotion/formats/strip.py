"""Picture strips as in papers: a motion as a row of frames, or as fading figures along its path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.files import atomic_file
from latentmotion.formats import figure
from latentmotion.formats.camera import Camera, camera_around
from latentmotion.motion import Motion

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

Style = Literal["row", "path"]

_ROW = (1280, 268)
_PATH = (1280, 560)
_BAND = 34
"""Height of the line with the caption, pixels."""


def write(
    path: str | Path, motions: Sequence[Motion], style: Style = "row", figures: int = 9
) -> list[Path]:
    """Writes a PNG with one strip for each motion, under each other.

    Args:
        path: Where to.
        motions: What to show.
        style: `row`: figures at even distances from left to right, without their travel;
            `path`: figures where they are, the earlier the paler.
        figures: How many frames of each motion.

    Raises:
        InputError: Unknown style, no figures, or a folder that cannot be written.
        MissingExtraError: Pillow is not installed.
    """
    painters = {"row": _row, "path": _path}
    if style not in painters:
        raise InputError(f"strip style {style!r}; expected one of {', '.join(painters)}")
    if figures < 1:
        raise InputError(f"{figures} figures in a strip; expected at least 1")
    strips = [_captioned(painters[style](m, figures), m.caption) for m in motions]
    sheet = figure.Image.new("RGB", (strips[0].width, sum(strip.height for strip in strips)))
    for number, strip in enumerate(strips):
        sheet.paste(strip, (0, number * strip.height))
    with atomic_file(path) as temporary:
        sheet.save(temporary, format="PNG", optimize=False)
    return [Path(path)]


def _row(motion: Motion, figures: int) -> Picture:
    frames = np.unique(np.linspace(0, len(motion) - 1, figures).round().astype(int)).tolist()
    bodies = figure.make_bodies(motion, frames)
    floor = bodies.floor
    height = max(1.7, float(bodies.vertices[..., 1].max()) - floor) + 0.36
    width = height * _ROW[0] / _ROW[1]
    target = np.array([0.0, floor + height / 2 - 0.26, 0.0])
    camera = camera_around(target, _front(motion), np.radians(9), 40, _oversampled(_ROW), height)
    places = (np.arange(len(frames)) + 0.5) * (width / len(frames)) - width / 2
    steps = places[:, None] * camera.axes()[0] - bodies.joints[:, 0] * (1, 0, 1)
    moved = [bodies.moved(number, step) for number, step in enumerate(steps)]
    picture = _painted(_ROW, camera, moved, [figure.COLORS[0]] * len(moved), floor, 0.62 * width)
    for frame, place in zip(frames, places, strict=True):
        spot = (_ROW[0] * (0.5 + place / width), _ROW[1] - 11)
        figure.paint_text(picture, f"{frame / motion.fps:.1f} s", spot, 13, "mm")
    return picture


def _path(motion: Motion, figures: int) -> Picture:
    bodies = figure.make_bodies(motion, _along_path(motion, figures), cell=0.017)
    count = len(bodies.joints)
    camera, height = _camera_of_all(motion, bodies)
    moved = [bodies.moved(number, np.zeros(3)) for number in range(count)]
    colors = [figure.faded(figure.COLORS[0], s) for s in np.linspace(0.35, 1, count).tolist()]
    trail = motion.joints[:, 0].astype(np.float64)
    return _painted(_PATH, camera, moved, colors, bodies.floor, 1.6 * height, trail)


def _painted(
    size: tuple[int, int],
    camera: Camera,
    bodies: Sequence[figure.Bodies],
    colors: Sequence[tuple[int, int, int]],
    floor: float,
    reach: float,
    trail: Float[np.ndarray, "frames 3"] | None = None,
) -> Picture:
    picture = figure.new_picture(size)
    figure.paint_floor(picture, camera, floor, reach)
    figure.paint_shadow(picture, camera, bodies, 0, floor)
    if trail is not None:
        figure.paint_trail(picture, camera, trail, floor)
    figure.paint_bodies(picture, camera, bodies, 0, colors)
    return figure.reduced(picture)


def _along_path(motion: Motion, figures: int) -> list[int]:
    """Picks frames evenly along the way; where nobody walks, evenly in time."""
    steps = np.linalg.norm(np.diff(motion.joints[:, 0, [0, 2]], axis=0), axis=-1)
    way = np.concatenate([[0.0], np.cumsum(steps + 0.05 / motion.fps)])
    wanted = np.linspace(0, way[-1], figures)
    return np.unique(np.searchsorted(way, wanted).clip(0, len(motion) - 1)).tolist()


def _camera_of_all(motion: Motion, bodies: figure.Bodies) -> tuple[Camera, float]:
    """Looks across the path, from as far as it takes to see all figures."""
    center = (bodies.vertices.min((0, 1)) + bodies.vertices.max((0, 1))) / 2
    azimuth, size, height = _across(motion), _oversampled(_PATH), 2.2
    for _ in range(12):
        camera = camera_around(center, azimuth, np.radians(16), 9, size, height)
        pixels, _ = camera.project(bodies.vertices)
        height *= float(np.abs(pixels / np.array(size) - 0.5).max()) / 0.46
    return camera, height


def _across(motion: Motion) -> float:
    """Returns the side from which the path is seen at length and the person not from behind."""
    spread = motion.joints[:, 0][:, [0, 2]].astype(np.float64)
    spread = spread - spread.mean(0)
    front = _front(motion)
    if np.linalg.norm(np.ptp(spread, axis=0)) < 0.8:
        return front
    x, z = np.linalg.svd(spread, full_matrices=False)[2][0]
    side = float(np.arctan2(z, -x))
    return side if np.cos(side - front) > 0 else side + np.pi


def _front(motion: Motion) -> float:
    """Returns the azimuth from which the person is seen half from the front at the start."""
    return figure.facing(motion.joints, motion.skeleton.names) - np.radians(38)


def _oversampled(size: tuple[int, int]) -> tuple[int, int]:
    return size[0] * figure.OVERSAMPLING, size[1] * figure.OVERSAMPLING


def _captioned(strip: Picture, caption: str) -> Picture:
    whole = figure.Image.new("RGB", (strip.width, strip.height + _BAND), figure.BACKGROUND)
    whole.paste(strip, (0, _BAND))
    figure.paint_text(whole, caption, (18, _BAND / 2 + 3), 18, "lm", room=strip.width - 36)
    return whole
