"""Fit: how well a drawn clip shows what a sentence asks for, by all its captions and their words.

Captions of drawn clips are short, so that one of them may be near a sentence for a single word:
"bow and arrow" is nearer to "bows to the queen" than "a person bows". The other captions of the
clip, and the words that they share with the sentence, tell the two apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.language.words import content_words, named_sides, other_forms
from latentmotion.retrieval.index import ABOUT, DRAWN, ClipIndex, Neighbor

# Weights of the mean cosine of all captions of a clip, and of the share of a sentence's words that
# they have, beside the cosine of the nearest. Of 4,393 captions of drawn clips, left out one at a
# time, 63 % then find their clip among all, 53 % by the nearest caption alone.
BY_ALL, BY_WORDS = 0.5, 0.3

# Cosine of the nearest caption from which a clip fits whatever the others say, and sum of the mean
# cosine and the share of words from which it does below: of 31 prompts of the lists that lie below,
# 24 asked for something else, three for the same.
NEARLY_ALIKE, LEAST_SUM = 0.8, 0.75

MOST_COMPARED = 16  # Clips among which those that fit best are looked for.

# How much nearer a mirror image has to be than a clip of the side that is asked for.
MIRRORED = 0.02

ALIKE = 0.03  # How much worse than the best a clip may fit to be another start.


@dataclass(frozen=True)
class Fit:
    """How well a drawn clip fits a sentence."""

    nearest: float  # Cosine of its nearest caption.
    mean: float  # Mean cosine of all its captions.
    share: float  # Share of the weight of the sentence's words that its captions have.

    @property
    def score(self) -> float:
        """What clips are compared by."""
        return self.nearest + BY_ALL * self.mean + BY_WORDS * self.share

    @property
    def is_enough(self) -> bool:
        """Whether its captions say enough of the sentence for it to be started from."""
        return self.nearest >= NEARLY_ALIKE or self.mean + self.share >= LEAST_SUM


def fit(
    neighbor: Neighbor, sides: Float[np.ndarray, "sides width"], sentence: str, index: ClipIndex
) -> Fit:
    """Returns how well the clip of a drawn caption fits a sentence.

    Args:
        neighbor: The nearest caption of the clip.
        sides: Embedding of the sentence, as for `ClipIndex.nearest`.
        sentence: The sentence.
        index: The clips.
    """
    rows = index.captions_of[neighbor.caption.clip]
    mean = float(np.mean([index.neighbor(row, sides).cosine for row in rows]))
    words = frozenset().union(*(content_words(index.captions[row].text) for row in rows))
    forms = [other_forms(word) | {word} for word in content_words(sentence)]
    weights = [index.weight(every) for every in forms]
    said = sum(weight for weight, every in zip(weights, forms, strict=True) if words & every)
    return Fit(neighbor.cosine, mean, said / max(sum(weights), 1e-6))


def fitting(
    near: Sequence[Neighbor],
    sides: Float[np.ndarray, "sides width"],
    sentence: str,
    index: ClipIndex,
) -> list[Neighbor]:
    """Returns clips near a sentence, of the drawn ones only those that fit enough and best.

    Nothing is returned where what is left is much farther than what was not fit: then it is near
    for the same chance.

    Args:
        near: The nearest caption of each, the nearest first.
        sides: Embedding of the sentence, as for `ClipIndex.nearest`.
        sentence: The sentence.
        index: The clips.
    """
    named = named_sides(sentence)
    itself = max(
        (n.cosine for n in near if named and named == named_sides(n.caption.text)), default=0.0
    )
    # No mirror image of a drawn clip where another shows the side itself.
    near = [
        n
        for n in near
        if n.caption.support != DRAWN
        or not n.mirrored
        or named == named_sides(n.caption.text)  # its other sentences are nearer by chance
        or n.cosine > itself + MIRRORED
    ]
    fits = {n: fit(n, sides, sentence, index) for n in near if n.caption.support == DRAWN}
    best = sorted(fits, key=lambda neighbor: -fits[neighbor].score)
    least = fits[best[0]].score - ALIKE if best else 0.0
    drawn = [n for n in best if fits[n].score >= least and fits[n].is_enough]
    first = max((n.cosine for n in drawn), default=0.0)
    others = [n for n in near if n not in fits]
    left = [
        *(n for n in others if n.cosine > first),
        *drawn,
        *(n for n in others if n.cosine <= first),
    ]
    misfit = bool(fits) and not fits[max(fits, key=lambda n: n.cosine)].is_enough
    far = bool(left) and left[0].cosine < near[0].cosine - ABOUT
    return [] if misfit and far else left
