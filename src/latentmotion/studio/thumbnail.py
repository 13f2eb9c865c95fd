"""Thumbnails: a motion as a row of stick figures, SVG of a few kilobytes."""

from __future__ import annotations

import numpy as np

from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading

_FIGURES = 5
_TURNED = np.radians(38)
"""Angle of figures from the front, so that arms and legs are seen apart."""

_WIDTH, _HEIGHT, _PIXELS = 100, 120, 58
"""Room of a figure, height of the strip, pixels per meter."""


def thumbnail(motion: Motion) -> str:
    """Returns a motion's first, last and some frames between as stick figures."""
    frames = np.linspace(0, len(motion) - 1, _FIGURES).round().astype(int)
    joints = motion.joints[frames].astype(np.float64)
    joints = joints - joints[:, :1] * (1, 0, 1)
    angle = float(heading(motion.joints[0].astype(np.float64), motion.skeleton)) - _TURNED
    across = joints @ (np.cos(angle), 0.0, -np.sin(angle))
    x = _WIDTH * (np.arange(_FIGURES)[:, None] + 0.5) + _PIXELS * across
    y = _HEIGHT - 6 - _PIXELS * (joints[..., 1] - min(0.0, float(joints[..., 1].min())))
    bones = [(j, parent) for j, parent in enumerate(motion.skeleton.parents) if parent >= 0]
    paths = []
    for number in range(_FIGURES):
        ends = zip(x[number].round(1).tolist(), y[number].round(1).tolist(), strict=True)
        points = [f"{a:g} {b:g}" for a, b in ends]
        lines = "".join(f"M{points[parent]}L{points[joint]}" for joint, parent in bones)
        paths.append(f'<path d="{lines}" opacity="{0.4 + 0.6 * number / (_FIGURES - 1):.2f}"/>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_FIGURES * _WIDTH} {_HEIGHT}" '
        'fill="none" stroke="#6f97e0" stroke-width="4" stroke-linecap="round" '
        f'stroke-linejoin="round">{"".join(paths)}</svg>'
    )
