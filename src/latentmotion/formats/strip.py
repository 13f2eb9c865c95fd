"""Picture strips as in papers: a motion as a row of frames, or as fading figures along its path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from latentmotion.errors import InputError
from latentmotion.files import atomic_file
from latentmotion.formats import figure
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


def _chosen(motion: Motion, figures: int) -> list[int]:
    return np.unique(np.linspace(0, len(motion) - 1, figures).round().astype(int)).tolist()


def _row(motion: Motion, figures: int) -> Picture:
    frames = _chosen(motion, figures)
    bodies = figure.make_bodies(motion, frames)
    floor, height = bodies.floor, 2.0
    width = height * _ROW[0] / _ROW[1]
    target = np.array([0.0, floor + 0.86, 0.0])
    azimuth = figure.facing(motion.joints, motion.skeleton.names) + np.radians(38)
    camera = figure.camera_around(target, azimuth, np.radians(9), 40, _oversampled(_ROW), height)
    right = camera.axes()[0]
    places = (np.arange(len(frames)) + 0.5) * (width / len(frames)) - width / 2
    moved = []
    for number, place in enumerate(places):
        root = bodies.joints[number, 0] * (1, 0, 1)
        moved.append(bodies.moved(number, place * right - root))
    picture = figure.new_picture(_ROW)
    figure.paint_floor(picture, camera, floor, reach=width * 0.62)
    figure.paint_shadow(picture, camera, moved, 0, floor)
    figure.paint_bodies(picture, camera, moved, 0, [figure.COLORS[0]] * len(moved))
    small = figure.reduced(picture)
    for frame, place in zip(frames, places, strict=True):
        spot = (_ROW[0] * (0.5 + place / width), _ROW[1] - 10)
        figure.paint_text(small, f"{frame / motion.fps:.1f} s", spot, 13, "mm")
    return small


def _path(motion: Motion, figures: int) -> Picture:
    frames = _chosen(motion, figures)
    bodies = figure.make_bodies(motion, frames)
    floor = bodies.floor
    roots = motion.joints[:, 0].astype(np.float64)
    low, high = bodies.vertices.min((0, 1)), bodies.vertices.max((0, 1))
    spread = roots - roots.mean(0)
    azimuth = figure.facing(motion.joints, motion.skeleton.names) + np.radians(38)
    if np.ptp(spread[:, [0, 2]], axis=0).max() > 0.6:
        along = np.linalg.svd(spread[:, [0, 2]], full_matrices=False)[2][0]
        azimuth = float(np.arctan2(along[1], -along[0])) + np.radians(25)
    center = (low + high) / 2
    size = _oversampled(_PATH)
    visible = 2.2
    for _ in range(12):
        camera = figure.camera_around(center, azimuth, np.radians(16), 9, size, visible)
        pixels = camera.project(bodies.vertices)[0]
        share = np.abs(pixels / np.array(size) - 0.5).max()
        visible *= share / 0.46
    picture = figure.new_picture(_PATH)
    figure.paint_floor(picture, camera, floor, reach=visible * 1.6)
    whole = figure.Bodies(
        bodies.vertices,
        bodies.normals,
        bodies.quads,
        motion.joints.astype(np.float64),
        bodies.parents,
        bodies.names,
    )
    figure.paint_trail(picture, camera, whole, floor)
    moved = [bodies.moved(number, np.zeros(3)) for number in range(len(frames))]
    figure.paint_shadow(picture, camera, moved, 0, floor)
    strengths = np.linspace(0.3, 1, len(frames)) if len(frames) > 1 else [1.0]
    colors = [figure.faded(figure.COLORS[0], float(strength)) for strength in strengths]
    figure.paint_bodies(picture, camera, moved, 0, colors)
    return figure.reduced(picture)


def _oversampled(size: tuple[int, int]) -> tuple[int, int]:
    return size[0] * figure.OVERSAMPLING, size[1] * figure.OVERSAMPLING


def _captioned(strip: Picture, caption: str) -> Picture:
    whole = figure.Image.new("RGB", (strip.width, strip.height + _BAND), figure.BACKGROUND)
    whole.paste(strip, (0, _BAND))
    figure.paint_text(whole, caption, (18, _BAND / 2 + 3), 18, "lm")
    return whole
