"""Embeddings of motions and captions by an evaluator; captions are embedded only once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard, cast

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Caption
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.action import Recognizer, drawing_states
from latentmotion.evaluation.evaluators.interface import (
    ActionEvaluator,
    Evaluator,
    TextMotionEvaluator,
)
from latentmotion.evaluation.test_set import Replication, TestPrompt

Motions = Sequence[Float[np.ndarray, "_ features"]]


@dataclass(frozen=True, eq=False)
class Embeddings:
    """An evaluator's embeddings of a set of motions and of their prompts."""

    motions: Float[np.ndarray, "items width"]
    """Embeddings of the motions."""
    logits: Float[np.ndarray, "items labels"] | None = None
    """Logits of an action classifier."""
    labels: Int[np.ndarray, " items"] | None = None
    """Labels of the prompts, if they have such."""
    texts: Float[np.ndarray, "items width"] | None = None
    """Embeddings of the captions, if there are such."""


class EmbeddingCache(ABC):
    """An evaluator with the embeddings that it need not compute twice."""

    @abstractmethod
    def embed(
        self, motions: Motions, replication: Replication, noise: np.random.Generator | None = None
    ) -> Embeddings:
        """Embeds motions and their prompts.

        Args:
            motions: One per test prompt.
            replication: The test prompts.
            noise: Source of an evaluator's random first state, if the protocol has one.
        """

    @abstractmethod
    def motions(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of motions, whatever their prompts."""

    @abstractmethod
    def texts(self, prompts: Sequence[TestPrompt]) -> Float[np.ndarray, "items width"] | None:
        """Returns the embeddings of captions; None if there are none or they are not read."""


@dataclass(eq=False)
class TextMotionCache(EmbeddingCache):
    """An evaluator of motions and captions, with a cache of captions."""

    evaluator: TextMotionEvaluator
    """The evaluator."""
    _texts: dict[Caption, Float[np.ndarray, " width"]] = field(default_factory=dict)

    def embed(
        self, motions: Motions, replication: Replication, noise: np.random.Generator | None = None
    ) -> Embeddings:
        """Embeds motions and captions; there is no random state."""
        return Embeddings(self.motions(motions), texts=self.texts(replication.prompts))

    def motions(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of motions."""
        return self.evaluator.motions(motions)

    def texts(self, prompts: Sequence[TestPrompt]) -> Float[np.ndarray, "items width"] | None:
        """Returns the embeddings of captions; None if a prompt has no caption."""
        captions = [prompt.caption for prompt in prompts if prompt.caption]
        if len(captions) < len(prompts):
            return None
        new = [caption for caption in dict.fromkeys(captions) if caption not in self._texts]
        if new:
            self._texts |= dict(zip(new, self.evaluator.texts(new), strict=True))
        return np.stack([self._texts[caption] for caption in captions])


@dataclass(eq=False)
class ActionCache(EmbeddingCache):
    """An action classifier."""

    evaluator: ActionEvaluator
    """The evaluator."""

    def embed(
        self, motions: Motions, replication: Replication, noise: np.random.Generator | None = None
    ) -> Embeddings:
        """Recognizes motions.

        Raises:
            InputError: The evaluator does not know a label.
        """
        evaluator = self.evaluator
        if noise is not None and isinstance(evaluator, Recognizer):
            evaluator = drawing_states(evaluator, noise)
        recognition = evaluator(motions)
        actions = [prompt.item.clip.action for prompt in replication.prompts]
        if None in actions:
            return Embeddings(recognition.features, recognition.logits)
        known = list(self.evaluator.labels)
        unknown = sorted({str(label) for label in actions} - set(known))
        if unknown:
            raise InputError(
                f"the evaluator does not know the label {unknown[0]!r}, only {', '.join(known)}; "
                "take one that was trained on this data set"
            )
        labels = np.array([known.index(str(label)) for label in actions])
        return Embeddings(recognition.features, recognition.logits, labels)

    def motions(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the last hidden layer."""
        return self.evaluator(motions).features

    def texts(self, prompts: Sequence[TestPrompt]) -> None:
        """Returns None: captions are not read."""


def embedding_cache(evaluator: Evaluator) -> EmbeddingCache:
    """Returns an empty cache of an evaluator of either kind."""
    if reads_text(evaluator):
        return TextMotionCache(evaluator)
    return ActionCache(cast(ActionEvaluator, evaluator))


def reads_text(evaluator: Evaluator | None) -> TypeGuard[TextMotionEvaluator]:
    """Returns whether an evaluator reads captions.

    This is the only place that tells the two kinds apart: evaluators can be written by users, and
    need not inherit from a class of this package.
    """
    return isinstance(evaluator, TextMotionEvaluator)
