"""Sizes up to which a batch is filled with padding, so that few shapes occur.

A recorded or compiled chain is made anew for every shape; a motion is the same in any bucket,
as padding moves nothing. Where it would, sizes stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.model.card import ModelCard

FRAMES = 32
"""Lengths are filled up to a multiple of this."""
WORDS = 8
"""Words beside the pooled sentence likewise."""


@dataclass(frozen=True)
class Buckets:
    """Powers of two of motions, 1 + 8 n words, 32 n frames."""

    card: ModelCard
    """Says whether padding moves anything, and how long a motion can be."""

    def rows(self, count: int) -> int:
        """Returns the next power of two."""
        return 1 << (count - 1).bit_length()

    def words(self, count: int) -> int:
        """Returns the next 1 + 8 n; no words stay none."""
        # Where the context stands before the latents, more words would move their places.
        if count == 0 or self.card.trained_denoiser.places == "context_first":
            return count
        return 1 + _multiple(count - 1, WORDS)

    def frames(self, longest: int) -> int:
        """Returns the next 32 n, or the longest motion that the model makes."""
        if not self.card.masks_padding:
            return longest
        return max(longest, min(_multiple(longest, FRAMES), self.card.frames[1]))


def _multiple(count: int, of: int) -> int:
    return -(-count // of) * of
