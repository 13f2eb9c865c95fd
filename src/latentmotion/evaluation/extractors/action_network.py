"""A network that recognizes actions, in two halves, and the extractor around any of them.

    what it sees of a motion → features (width), which FID compares → logits (labels)

Motions of one length go through the network together, so no network ever sees padding here and
each motion is judged as it would be alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.evaluation.extractors.interface import Recognition

AT_ONCE = 64
"""Most motions that go through a network together."""


class ActionNetwork(nn.Module, ABC):
    """A classifier whose last hidden layer can be asked for.

    Attributes:
        published: Whether it is one whose authors' weights papers use.
        sees_joints: Whether it looks at joints, so that the body matters.
    """

    published: ClassVar[bool] = False
    sees_joints: ClassVar[bool] = False

    @abstractmethod
    def features(self, motions: Float[Tensor, "batch frames *what_it_sees"]) -> Tensor:
        """Returns the last hidden layer (batch, width) of motions of one length."""

    @abstractmethod
    def classify(self, features: Float[Tensor, "batch width"]) -> Tensor:
        """Returns the logits (batch, labels) of what `features` returned."""


Preparation = Callable[[np.ndarray], np.ndarray]
"""Features (frames, features) in their own units → what a network sees, frames first."""


@dataclass(frozen=True, eq=False)
class Recognizer:
    """An `ActionExtractor`: a network, and what it sees of features."""

    labels: tuple[str, ...]
    """The labels, in the order of the logits."""
    fingerprint: str
    """Hash of weights and description."""
    network: ActionNetwork
    """The classifier, in `eval()` mode."""
    prepare: Preparation
    """Features to what it sees."""
    width: int
    """Features a frame that `prepare` takes."""

    def __call__(self, features: Sequence[Float[np.ndarray, "_ _"]]) -> Recognition:
        """Recognizes motions, given in their own units; lengths may differ.

        Raises:
            InputError: There is no motion, an empty one, or one of another representation.
        """
        self._check(features)
        found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for rows in _by_length(features):
            seen = np.stack([self.prepare(features[row]) for row in rows])
            hidden, logits = self._run(torch.from_numpy(seen).float())
            found |= {row: (hidden[i], logits[i]) for i, row in enumerate(rows)}
        in_order = [found[row] for row in range(len(features))]
        return Recognition(*(np.stack(part) for part in zip(*in_order, strict=True)))

    @property
    def official(self) -> bool:
        """Whether it is one that papers use."""
        return self.network.published

    @torch.no_grad()
    def _run(self, seen: Tensor) -> tuple[np.ndarray, np.ndarray]:
        place = next(self.network.parameters()).device
        hidden = self.network.features(seen.to(place))
        return hidden.cpu().numpy(), self.network.classify(hidden).cpu().numpy()

    def _check(self, features: Sequence[np.ndarray]) -> None:
        if not features:
            raise InputError("no motion to recognize; give at least one")
        for motion in features:
            if not len(motion) or motion.shape[-1] != self.width:
                raise InputError(
                    f"this action classifier takes motions of one frame or more with {self.width} "
                    f"features, found {motion.shape}; use the evaluator of this data set"
                )


def _by_length(features: Sequence[np.ndarray]) -> list[list[int]]:
    rows: dict[int, list[int]] = {}
    for row, motion in enumerate(features):
        rows.setdefault(len(motion), []).append(row)
    return [same[i : i + AT_ONCE] for same in rows.values() for i in range(0, len(same), AT_ONCE)]
