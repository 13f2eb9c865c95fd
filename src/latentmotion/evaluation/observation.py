"""What an evaluator sees of motions and captions, each looked at no more often than it must be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Caption
from latentmotion.errors import InputError
from latentmotion.evaluation.extractors.interface import ActionExtractor, TextMotionExtractor
from latentmotion.evaluation.trials import Question, Trial

Extractor = TextMotionExtractor | ActionExtractor


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


@dataclass(eq=False)
class Observer:
    """An evaluator with a memory of captions."""

    extractor: Extractor
    """The evaluator."""
    _texts: dict[Caption, Float[np.ndarray, " width"]] = field(default_factory=dict)

    def view(
        self,
        motions: Sequence[Float[np.ndarray, "_ features"]],
        trial: Trial,
        noise: np.random.Generator | None = None,
    ) -> View:
        """Looks at motions that answer a trial.

        Args:
            motions: One per question.
            trial: The questions.
            noise: For an evaluator's random first state, where the protocol wants one.
        """
        if isinstance(self.extractor, TextMotionExtractor):
            features = self.extractor.motions(motions)
            return View(features, texts=self.captions(trial.questions))
        extractor = self.extractor if noise is None else _with_random_state(self.extractor, noise)
        seen = extractor(motions)
        return View(seen.features, seen.logits, self._labels(trial.questions))

    def captions(self, questions: Sequence[Question]) -> Float[np.ndarray, "items width"] | None:
        """Returns the captions' vectors; none where there are no captions, or they are not read."""
        captions = [question.caption for question in questions if question.caption]
        if not isinstance(self.extractor, TextMotionExtractor):
            return None
        if len(captions) < len(questions):
            return None
        new = [caption for caption in dict.fromkeys(captions) if caption not in self._texts]
        if new:
            self._texts |= dict(zip(new, self.extractor.texts(new), strict=True))
        return np.stack([self._texts[caption] for caption in captions])

    def _labels(self, questions: Sequence[Question]) -> Int[np.ndarray, " items"] | None:
        assert isinstance(self.extractor, ActionExtractor)
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


def _with_random_state(extractor: ActionExtractor, noise: np.random.Generator) -> ActionExtractor:
    from latentmotion.evaluation.extractors.action_network import Recognizer
    from latentmotion.evaluation.extractors.gru import drawing_states

    return drawing_states(extractor, noise) if isinstance(extractor, Recognizer) else extractor
