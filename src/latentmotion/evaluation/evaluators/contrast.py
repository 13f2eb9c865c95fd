"""Contrastive losses of text-motion evaluators: sentences close to their motions, far from others.

D² is the matrix of squared distances between sentences and motions of a batch. A pair of different
rows whose sentence also describes that motion is no contrast and is left out.

* InfoNCE (van den Oord et al. 2018): −log softmax(−D²/temperature), over motions and sentences.
* Margin (Hadsell et al. 2006, as the T2M code has it): D² of pairs + max(0, margin − D)² of each
  sentence with one other motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch.nn import functional as F

_NEVER = -1e9
"""Logit of pairs that are no contrast."""


@dataclass(frozen=True)
class InfoNCE:
    """Each sentence is distinguished from all other motions of the batch, and vice versa."""

    temperature: float = 10.0
    """Squared distance that counts as one unit of evidence."""

    def __call__(
        self,
        squared: Float[torch.Tensor, "batch batch"],
        matches: Bool[torch.Tensor, "batch batch"],
    ) -> Float[torch.Tensor, ""]:
        """Returns the loss; `matches` is True if a sentence (row) describes a motion (column)."""
        diagonal = torch.eye(len(matches), dtype=torch.bool, device=matches.device)
        logits = (-squared / self.temperature).masked_fill(matches & ~diagonal, _NEVER)
        own = torch.arange(len(logits), device=logits.device)
        return (F.cross_entropy(logits, own) + F.cross_entropy(logits.T, own)) / 2


@dataclass(frozen=True)
class Margin:
    """Each sentence is pulled to its motion and pushed from the next one of the batch."""

    margin: float = 10.0
    """Distance from which on other motions are far enough."""

    def __call__(
        self,
        squared: Float[torch.Tensor, "batch batch"],
        matches: Bool[torch.Tensor, "batch batch"],
    ) -> Float[torch.Tensor, ""]:
        """Returns the loss; `matches` is True if a sentence (row) describes a motion (column)."""
        near = squared.diagonal()
        # The square root has no slope at zero.
        far = squared.roll(-1, 1).diagonal().clamp(min=1e-6).sqrt()
        contrast = ~matches.roll(-1, 1).diagonal()
        return (near + contrast * F.relu(self.margin - far) ** 2).mean()


def squared_distances(
    sentences: Float[torch.Tensor, "sentences width"], motions: Float[torch.Tensor, "motions width"]
) -> Float[torch.Tensor, "sentences motions"]:
    """Returns the squared distance of each sentence to each motion."""
    return ((sentences[:, None] - motions[None]) ** 2).sum(-1)


def top_hits(
    squared: Float[torch.Tensor, "sentences motions"],
    matches: Bool[torch.Tensor, "sentences motions"],
    most: int = 3,
) -> list[float]:
    """Returns how often a motion that the sentence describes is among the nearest 1, 2, 3.

    Unlike R-precision, any such motion counts, not only the sentence's own.
    """
    nearest = torch.where(matches, squared, torch.inf).min(1).values
    before = ((squared < nearest[:, None]) & ~matches).sum(1)
    return [float((before < k).float().mean()) for k in range(1, most + 1)]
