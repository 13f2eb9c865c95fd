"""More captions for clips that have some: the same spans in other words, for training only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from latentmotion.data.clip import Caption
from latentmotion.describe.rewording import rewordings


def reworded_captions(
    captions: Sequence[Caption], generator: np.random.Generator, count: int
) -> tuple[Caption, ...]:
    """Returns captions that say the same of the same frames in other words.

    Only for clips of the train split: a test set keeps the words that people wrote.

    Args:
        captions: What a clip has.
        generator: Source of every choice.
        count: How many wordings to try for each caption.

    Returns:
        The new captions alone, without tokens; none that the clip has already.
    """
    known = {(c.text.rstrip(". "), c.start_frame, c.end_frame) for c in captions}
    found: list[Caption] = []
    for caption in captions:
        for text in rewordings(caption.text, generator, count):
            key = (text.rstrip(". "), caption.start_frame, caption.end_frame)
            if key not in known:
                known.add(key)
                found.append(Caption(text, caption.start_frame, caption.end_frame))
    return tuple(found)
