"""What an evaluator sees of motions and captions, each looked at no more often than it must be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard, cast

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Caption
from latentmotion.errors import InputError
from latentmotion.evaluation.extractors.interface import ActionExtractor, TextMotionExtractor
from latentmotion.evaluation.trials import Question, Trial

Extractor = TextMotionExtractor | ActionExtractor

Motions = Sequence[Float[np.ndarray, "_ features"]]


@dataclass(frozen=True, eq=False)
class View:
    """A set of motions as an evaluator sees it."""

    features: Float[np.ndarray, "items width"]
    """Its vectors."""
    logits: Float[np.ndarray, "items labels"] | None = None
    """How much each label fits, of an action classifier."""
    labels: Int[np.ndarray, " items"] | None = None
    """The labels that were asked for, where there are such."""
    texts: Float[np.ndarray, "items width"] | None = None
    """Vectors of the captions that were asked for, where there are such."""


class Observer(ABC):
    """An evaluator that looks at the answers of a trial."""

    @abstractmethod
    def view(
        self, motions: Motions, trial: Trial, noise: np.random.Generator | None = None
    ) -> View:
        """Looks at motions that answer a trial.

        Args:
            motions: One per question.
            trial: The questions.
            noise: For an evaluator's random first state, where the protocol wants one.
        """

    @abstractmethod
    def vectors(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns its vectors of motions, whatever they answer."""

    @abstractmethod
    def captions(self, questions: Sequence[Question]) -> Float[np.ndarray, "items width"] | None:
        """Returns the captions' vectors; none where there are no captions, or they are not read."""


@dataclass(eq=False)
class TextObserver(Observer):
    """An evaluator of motions and captions, with a memory of captions."""

    extractor: TextMotionExtractor
    """The evaluator."""
    _texts: dict[Caption, Float[np.ndarray, " width"]] = field(default_factory=dict)

    def view(
        self, motions: Motions, trial: Trial, noise: np.random.Generator | None = None
    ) -> View:
        """Looks at motions and captions; there is no random state."""
        return View(self.vectors(motions), texts=self.captions(trial.questions))

    def vectors(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of motions."""
        return self.extractor.motions(motions)

    def captions(self, questions: Sequence[Question]) -> Float[np.ndarray, "items width"] | None:
        """Returns the captions' vectors; none where a question has no caption."""
        captions = [question.caption for question in questions if question.caption]
        if len(captions) < len(questions):
            return None
        new = [caption for caption in dict.fromkeys(captions) if caption not in self._texts]
        if new:
            self._texts |= dict(zip(new, self.extractor.texts(new), strict=True))
        return np.stack([self._texts[caption] for caption in captions])


@dataclass(eq=False)
class ActionObserver(Observer):
    """A classifier of actions."""

    extractor: ActionExtractor
    """The evaluator."""

    def view(
        self, motions: Motions, trial: Trial, noise: np.random.Generator | None = None
    ) -> View:
        """Recognizes motions."""
        extractor = self.extractor if noise is None else _with_random_state(self.extractor, noise)
        seen = extractor(motions)
        return View(seen.features, seen.logits, self._labels(trial.questions))

    def vectors(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the last hidden layer."""
        return self.extractor(motions).features

    def captions(self, questions: Sequence[Question]) -> None:
        """Returns none: captions are not read."""

    def _labels(self, questions: Sequence[Question]) -> Int[np.ndarray, " items"] | None:
        known = list(self.extractor.labels)
        asked = [question.item.clip.action for question in questions]
        if None in asked:
            return None
        unknown = sorted({str(label) for label in asked} - set(known))
        if unknown:
            raise InputError(
                f"the evaluator does not know the label {unknown[0]!r}, only {', '.join(known)}; "
                "take one that was trained on this data set"
            )
        return np.array([known.index(str(label)) for label in asked])


def observer_of(extractor: Extractor) -> Observer:
    """Returns the observer of an evaluator of either kind."""
    if reads_text(extractor):
        return TextObserver(extractor)
    return ActionObserver(cast(ActionExtractor, extractor))


def reads_text(extractor: Extractor | None) -> TypeGuard[TextMotionExtractor]:
    """Returns whether an evaluator reads captions.

    The one place that tells the two kinds apart: evaluators may be anybody's, so that they need
    not inherit from a class of ours that could say it.
    """
    return isinstance(extractor, TextMotionExtractor)


def _with_random_state(extractor: ActionExtractor, noise: np.random.Generator) -> ActionExtractor:
    from latentmotion.evaluation.extractors.action_network import Recognizer
    from latentmotion.evaluation.extractors.gru import drawing_states

    return drawing_states(extractor, noise) if isinstance(extractor, Recognizer) else extractor
