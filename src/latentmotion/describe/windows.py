"""Parts of a motion, of random length and place, each with sentences that hold there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.describe.acts import acts_of
from latentmotion.describe.facts import Description
from latentmotion.describe.holding import holds
from latentmotion.describe.reading import describe
from latentmotion.describe.sentences import sentences

Row = tuple[str, int, int]
"""A sentence, the first frame that it tells of, and one past the last."""


@dataclass(frozen=True)
class Windows:
    """How many parts, how long, with how many sentences."""

    count: int = 3
    """Parts per motion."""
    shortest: int = 20
    """Frames."""
    longest: int = 196
    """Frames."""
    sentences: int = 2
    """Measured sentences per part."""
    whole: int = 2
    """Measured sentences about the whole motion."""
    acts: int = 0
    """Most acts that a part may show to be told of; zero is any number."""


def caption_windows(
    joints: Float[np.ndarray, "frames 22 3"],
    captions: Sequence[Row],
    generator: np.random.Generator,
    windows: Windows = Windows(),
) -> list[Row]:
    """Returns sentences about a motion and about parts of it.

    Args:
        joints: As `describe` takes them.
        captions: What is already said about it; these rows are not repeated.
        generator: What draws parts and wording.
        windows: How many parts, how long.
    """
    frames = len(joints)
    rows: list[Row] = []
    if frames <= windows.longest and windows.whole:
        whole = describe(joints)
        rows += [(text, 0, frames) for text in sentences(whole, generator, count=windows.whole)]
    known: dict[tuple[int, int], Description] = {}
    for start, end in draw_windows(frames, generator, windows):
        part = describe(joints[start:end])
        if windows.acts and len(acts_of(part)) > windows.acts:
            continue
        texts = sentences(part, generator, count=windows.sentences)
        for text, first, last in captions:
            if first <= start and end <= last and text not in texts:
                if (first, last) not in known:
                    known[first, last] = describe(joints[first:last])
                if holds(text, known[first, last], part):
                    texts.append(text)
        rows += [(text, start, end) for text in texts]
    return rows


def draw_windows(
    frames: int, generator: np.random.Generator, windows: Windows
) -> list[tuple[int, int]]:
    """Draws parts; short and long ones are as likely (their logarithm is even), each is another."""
    longest = min(windows.longest, frames)
    if frames < 1.25 * windows.shortest:
        return []
    found: list[tuple[int, int]] = []
    for _ in range(windows.count):
        low, high = np.log(windows.shortest), np.log(longest)
        length = min(int(np.exp(generator.uniform(low, high)) + 0.5), longest)
        start = int(generator.integers(frames - length + 1))
        if (start, start + length) not in found and length < frames:
            found.append((start, start + length))
    return found
