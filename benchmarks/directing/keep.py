"""Kept frames: parts of recordings generated anew between what is before and after them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.directing.bench import CLIP, Bench, Recording, Rows, Values, blended, jerk
from latentmotion.control.edit import generate_edited
from latentmotion.control.exact import inertialized
from latentmotion.errors import InputError
from latentmotion.motion import Motion

_NEAR = 5  # Frames to either side of a seam in which its jerk is.

# First frame of each gap and the frame after its last, by the frames of a recording.
GAPS: dict[str, Callable[[int], tuple[int, int]]] = {
    "gap of 1 s": lambda frames: (frames // 2 - 10, frames // 2 + 10),
    "middle half": lambda frames: (frames // 4, frames - frames // 4),
    "first and last frame kept": lambda frames: (1, frames - 1),
}

# Fills a recording's frames from start to end: bench, recording, start, end, seed.
Fill = Callable[[Bench, Recording, int, int, int], Motion]


def keep_rows(bench: Bench) -> Rows:
    """Measures gaps of a second, of the middle half, and between two poses."""
    recordings = bench.recordings(3.0, 5.0)
    rows: dict[str, Values] = {
        "real motion": _row(bench, [(r, r.motion, None) for r in recordings])
    }
    every, clip_of = bench.repeated(recordings)
    for gap, span in GAPS.items():
        for name, fill in _FILLS.items():
            made, kept = [], []
            # Lines are the same for all seeds.
            for seed in range(0, len(every), 1 if name == "edit" else bench.seeds):
                each = every[seed]
                start, end = span(len(each.motion))
                try:
                    made.append((each, fill(bench, each, start, end, seed), (start, end)))
                except InputError:
                    continue  # too far in so short a time
                kept.append(clip_of[seed])
            rows[f"{gap}: {name}"] = {**_row(bench, made), CLIP: np.array(kept)}
    return rows


def _inertialized(bench: Bench, each: Recording, start: int, end: int, seed: int) -> Motion:
    joints = each.motion.joints
    piece = inertialized(
        blended(joints, start, end)[start:end],
        joints[max(0, start - 3) : start],
        joints[end : end + 3],
        each.motion.skeleton,
        12,
    )
    made = np.concatenate([joints[:start], piece.astype(np.float32), joints[end:]])
    return replace(each.motion, joints=made)


_FILLS: dict[str, Fill] = {
    "edit": lambda bench, each, start, end, seed: generate_edited(
        bench.generate,
        each.motion,
        each.text,
        (start / each.motion.fps, end / each.motion.fps),
        seed,
    ),
    "linear interpolation": lambda _, each, start, end, __: replace(
        each.motion, joints=blended(each.motion.joints, start, end)
    ),
    "linear, inertialized": _inertialized,
}


def _row(
    bench: Bench, made: Sequence[tuple[Recording, Motion, tuple[int, int] | None]]
) -> dict[str, np.ndarray]:
    usual = bench.usual_columns([motion for _, motion, _ in made], [each.text for each, *_ in made])
    gaps = [(each.motion.joints, motion.joints, span) for each, motion, span in made if span]
    if not gaps:
        return dict(usual)
    kept, off, seams, ratios = [], [], [], []
    for own, joints, (start, end) in gaps:
        apart = np.linalg.norm(joints - own, axis=-1)
        kept.append(1000 * max(apart[:start].max(initial=0), apart[end:].max(initial=0)))
        off.append(100 * apart[start:end].mean())
        ours, real = (
            max(found[max(0, seam - _NEAR) : seam + _NEAR].max() for seam in (start, end - 3))
            for found in (jerk(joints), jerk(own))
        )
        seams.append(ours)
        ratios.append(ours / max(real, 1e-3))
    return {
        "Kept frames off, mm, worst": np.array(kept),
        "Gap off, cm": np.array(off),
        "Seam jerk, m": np.array(seams),
        "Seam jerk / recorded, median": np.array(ratios),
        **usual,
    }
