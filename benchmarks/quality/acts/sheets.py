"""Sheets of numbered motions for a judge: twelve figures of each, and its path from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from latentmotion import Motion
from latentmotion.render import painter, strip
from latentmotion.storage.files import atomic_file

PER_SHEET = 5  # Motions of a picture.

FIGURES, WIDTH = 12, 1560  # Figures of a motion, and the pixels that they take.

_INK, _TRAIL, _GRID = (58, 64, 76), (88, 128, 196), (205, 211, 220)


def write_sheets(motions: Sequence[Motion], numbers: Sequence[int], folder: Path) -> list[Path]:
    """Writes `sheet_NN.png`, five motions each, with their numbers and lengths as only words."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for first in range(0, len(motions), PER_SHEET):
        chosen = [
            Motion(m.joints, m.fps, m.skeleton, f"number {n}: {m.seconds:.1f} s, end {_rise(m)}")
            for m, n in zip(
                motions[first : first + PER_SHEET], numbers[first : first + PER_SHEET], strict=True
            )
        ]
        path = folder / f"sheet_{first // PER_SHEET:02d}.png"
        strip.write(path, chosen, figures=FIGURES, width=WIDTH)
        with Image.open(path) as picture:
            rows = picture.convert("RGB")
        side = rows.height // len(chosen)
        sheet = Image.new("RGB", (WIDTH + side, rows.height), painter.BACKGROUND)
        sheet.paste(rows, (0, 0))
        for row, motion in enumerate(chosen):
            sheet.paste(way(motion, side), (WIDTH, row * side))
        with atomic_file(path) as temporary:
            sheet.save(temporary, format="PNG")
        written.append(path)
    return written


def way(motion: Motion, side: int) -> Image.Image:
    """Returns the pelvis' path from above, the start's front upwards, with the body's front.

    A dot is the start, an arrow each twelfth of the motion points to where the body faces; a square
    of the grid is half a meter.
    """
    path, front = _seen_from_start(motion)
    middle = (path.max(0) + path.min(0)) / 2
    meters = max(2.0, 1.25 * float(np.ptp(path, axis=0).max()))

    def pixel(point: np.ndarray) -> tuple[float, float]:
        x, y = (point - middle) / meters * side
        return side / 2 + float(x), side / 2 - float(y)

    picture = Image.new("RGB", (side, side), painter.BACKGROUND)
    draw = ImageDraw.Draw(picture)
    for n in range(-int(meters), int(meters) + 1):
        for horizontal in (False, True):
            line = np.array([[n / 2, -99.0], [n / 2, 99.0]]) + middle.round()
            ends = [pixel(p[::-1] if horizontal else p) for p in line]
            draw.line([*ends[0], *ends[1]], fill=_GRID)
    draw.line([v for p in path for v in pixel(p)], fill=_TRAIL, width=3)
    for frame in np.linspace(0, len(path) - 1, FIGURES).round().astype(int).tolist():
        base = np.array(pixel(path[frame]))
        tip = base + 22 * front[frame] * (1, -1)
        draw.line([*base.tolist(), *tip.tolist()], fill=_INK, width=2)
        across = np.array([-front[frame][1], front[frame][0]]) * (1, -1)
        back = base + 15 * front[frame] * (1, -1)
        head = [tip, back + 4 * across, back - 4 * across]
        draw.polygon([tuple(p.tolist()) for p in head], fill=_INK)
    x, y = pixel(path[0])
    draw.ellipse((x - 6, y - 6, x + 6, y + 6), fill=(200, 60, 50))
    return picture


def _seen_from_start(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Returns path and front of the body in right and ahead of the first frame, (frames, 2)."""
    names, joints = motion.skeleton.names, motion.joints.astype(np.float64)
    across = joints[:, names.index("right_hip")] - joints[:, names.index("left_hip")]
    front = np.stack([across[:, 2], -across[:, 0]], axis=-1)
    front /= np.linalg.norm(front, axis=-1, keepdims=True)
    ahead = front[0]
    right = np.array([-ahead[1], ahead[0]])
    basis = np.stack([right, ahead], axis=-1)
    path = joints[:, 0][:, [0, 2]]
    return (path - path[0]) @ basis, front @ basis


def _rise(motion: Motion) -> str:
    """Returns how much higher or lower the pelvis ends, which figures without path do not show."""
    rise = 100 * float(motion.joints[-1, 0, 1] - motion.joints[0, 0, 1])
    return f"{rise:+.0f} cm"
