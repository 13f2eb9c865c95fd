"""Draws by rarity: sentences with few supporting clips are drawn more often, frequent ones less.

    weight(s) = min(most, (usual / support(s))^power)

Sentences of composed sequences name two acts, which makes them all rare; their weights are scaled
so that no more than a share of the draws are of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.data.dataset import Item
from latentmotion.data.store import COMPOSED
from latentmotion.retrieval.teach import support

Embed = Callable[[Sequence[str]], Float[np.ndarray, "sentences width"]]
"""Sentences to their pooled embeddings, of any length."""

# Sentences that are embedded together.
_AT_ONCE = 512


@dataclass(frozen=True)
class RarityDraws:
    """How strongly draws depend on the support of sentences; the trial in retrieval.md chose it."""

    power: float = 0.0
    """0 draws all items equally often, 1 all movements."""
    usual: float = 300.0
    """Support of a sentence of weight 1, clips."""
    most: float = 12.0
    """Highest weight."""
    composed: float = 1 / 3
    """Largest share of draws that are of composed sequences."""

    def weigh(self, items: Sequence[Item], embed: Embed) -> list[Item]:
        """Returns items with weights of their sentences.

        Args:
            items: Recorded and composed ones, mirrored copies too.
            embed: Embeds the sentences.
        """
        if self.power == 0:
            return list(items)
        texts = sorted({caption for item in items for caption in item.captions})
        row = {text: number for number, text in enumerate(texts)}
        parts = [embed(texts[n : n + _AT_ONCE]) for n in range(0, len(texts), _AT_ONCE)]
        vectors = unit(np.concatenate(parts))
        clips: dict[str, set[int]] = {}
        for item in items:
            if item.clip.source != COMPOSED and item.captions:
                name = item.clip.id.removeprefix("M") if item.clip.mirrored else item.clip.id
                clips.setdefault(name, set()).update(row[text] for text in item.captions)
        counts = support(vectors, vectors, [sorted(rows) for rows in clips.values()])
        weights = np.minimum((self.usual / counts.clip(1)) ** self.power, self.most).tolist()
        weighed = [
            replace(item, weights=tuple(weights[row[text]] for text in item.captions))
            for item in items
        ]
        return self._without_most_composed(weighed)

    def _without_most_composed(self, items: list[Item]) -> list[Item]:
        """Scales the weights of composed sequences down to their share."""
        composed = sum(item.weight for item in items if item.clip.source == COMPOSED)
        others = sum(item.weight for item in items) - composed
        allowed = others * self.composed / (1 - self.composed) if self.composed < 1 else composed
        if composed <= allowed:
            return items
        scale = allowed / composed
        return [
            replace(item, weights=tuple(scale * weight for weight in item.weights))
            if item.clip.source == COMPOSED
            else item
            for item in items
        ]
