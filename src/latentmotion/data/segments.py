"""Long takes → pieces of 1 to 10 seconds, cut where glitches, labels and stillness say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.data.glitches import clean_spans

LONGEST = 196
"""Frames of the longest piece: HumanML3D's longest features."""
SHORTEST = 20
"""Frames of the shortest piece: a second."""
USUAL = 120
"""Frames that a piece has where nothing says otherwise."""

_STAY = 0.3
"""Meters per second by which a cut may be less still for every `USUAL` frames it is off."""


def pieces(
    joints: Float[np.ndarray, "frames joints 3"],
    fps: float,
    spans: Sequence[tuple[int, int]] | None = None,
    cuts: Sequence[int] = (),
) -> Iterator[tuple[int, int]]:
    """Yields the pieces of a take, as first frame and one past the last.

    Args:
        joints: Joint positions, meters.
        fps: Frames per second.
        spans: Stretches to cut up, all of it by default; glitches are cut out of them.
        cuts: Frames where one action ends and another begins; pieces end there.
    """
    stirring = _stirring(joints, fps)
    for first, last in spans if spans is not None else [(0, len(joints))]:
        clean = clean_spans(joints[first:last], fps) if last - first >= SHORTEST else []
        for start, end in clean:
            bounds = [first + start, *_within(cuts, first + start, first + end), first + end]
            for begin, stop in pairwise(bounds):
                yield from _cut_up(stirring, begin, stop)


def _within(cuts: Sequence[int], first: int, last: int) -> list[int]:
    """Returns the cuts in a stretch that leave no piece too short."""
    kept: list[int] = []
    for cut in sorted(set(cuts)):
        if (kept[-1] if kept else first) + SHORTEST <= cut <= last - SHORTEST:
            kept.append(cut)
    return kept


def _cut_up(
    stirring: Float[np.ndarray, " frames"], first: int, last: int
) -> Iterator[tuple[int, int]]:
    """Cuts a clean stretch of one action at its stillest frames."""
    while last - first > LONGEST:
        # What is left must be long enough, and a piece may not be longer than the longest.
        low = first + 3 * SHORTEST
        high = min(first + LONGEST, last - SHORTEST)
        frames = np.arange(low, high + 1)
        price = stirring[frames] + _STAY * np.abs(frames - first - USUAL) / USUAL
        cut = int(frames[price.argmin()])
        yield first, cut
        first = cut
    if last - first >= SHORTEST:
        yield first, last


def _stirring(
    joints: Float[np.ndarray, "frames joints 3"], fps: float
) -> Float[np.ndarray, " frames"]:
    """Returns the mean speed of the joints around each frame, m/s."""
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1).mean(1) * fps
    padded = np.pad(np.concatenate([speed[:1], speed]), 2, mode="edge")
    return np.convolve(np.nan_to_num(padded, nan=1e3), np.full(5, 0.2), "valid")
