"""Interfaces of evaluators: embeddings of motions and captions, or recognized actions.

An evaluator is a folder: `evaluator.json`, whose "kind" names its loader, and
`weights.safetensors`. A scorer's folder is one, too, and `scorer` the one that ships.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Caption
from latentmotion.errors import FileFormatError, ModelError
from latentmotion.model.card import SHIPPED
from latentmotion.ranking.scorer import CARD_FILE as SCORER_FILE
from latentmotion.ranking.scorer import Scorer
from latentmotion.representation.interface import ClipFeatures
from latentmotion.storage.reading import read_json_file

EVALUATOR_FILE = "evaluator.json"  # File that makes a folder an evaluator.

WEIGHTS_FILE = "weights.safetensors"

SCORER = Path("scorer")  # Name of the scorer that ships, among the models.

# `module:function` of this package that reads a folder, by kind.
LOADERS = {"text_motion": "text_motion:load_text_motion", "action": "action:load_action_classifier"}


@runtime_checkable
class TextMotionEvaluator(Protocol):
    """Motions and captions to embeddings in one space, close if they mean the same."""

    @property
    def width(self) -> int:
        """Numbers per embedding."""
        ...

    @property
    def fingerprint(self) -> str:
        """Hash of weights and statistics, for reports."""
        ...

    def motions(self, features: Sequence[ClipFeatures]) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of motions, given in their own units; lengths may differ."""
        ...

    def texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of captions."""
        ...


@dataclass(frozen=True)
class Recognition:
    """Output of an action classifier."""

    features: Float[np.ndarray, "items width"]  # The last hidden layer, which FID compares.
    logits: Float[np.ndarray, "items labels"]  # Logits of the labels.


@runtime_checkable
class ActionEvaluator(Protocol):
    """Motions to action labels."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels in the order of the logits."""
        ...

    @property
    def fingerprint(self) -> str:
        """Hash of weights and statistics, for reports."""
        ...

    def __call__(self, features: Sequence[ClipFeatures]) -> Recognition:
        """Recognizes motions, given in their own units; lengths may differ."""
        ...


Evaluator = TextMotionEvaluator | ActionEvaluator  # An evaluator of either kind.


@dataclass(frozen=True)
class ScorerEvaluator:
    """The towers of a scorer as a text-motion evaluator: unit vectors.

    A scorer that chose among a model's takes, or that a model was trained by, is no judge of it.
    """

    scorer: Scorer  # The towers.

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.scorer.card.width

    @property
    def fingerprint(self) -> str:
        """Hash of weights and statistics."""
        return self.scorer.card.fingerprint

    def motions(self, features: Sequence[ClipFeatures]) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of motions, given in their own units."""
        return self.scorer.embed(features)

    def texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of captions."""
        return self.scorer.texts([caption.text for caption in captions])


def load_evaluator(folder: Path) -> Evaluator:
    """Reads an evaluator folder, that of the run which made one, or a scorer's.

    Args:
        folder: The folder, or `scorer` for the one that ships.

    Raises:
        ModelError: There is none, it is of an unknown kind, or it is damaged.
    """
    folder = SHIPPED / folder if folder == SCORER and not folder.exists() else folder
    if (folder / SCORER_FILE).is_file():
        return ScorerEvaluator(Scorer.load(folder))
    inside = folder / "model"  # where a training run puts it
    folder = inside if (inside / EVALUATOR_FILE).is_file() else folder
    kind = evaluator_kind(folder)
    if kind not in LOADERS:
        raise ModelError(
            f"{folder}: evaluator of kind {kind!r}, known are {', '.join(LOADERS)}; "
            "update latentmotion"
        )
    module, _, function = LOADERS[kind].partition(":")
    return getattr(import_module(f"{__package__}.{module}"), function)(Path(folder))


def evaluator_kind(folder: Path) -> str:
    """Returns the "kind" that `evaluator.json` names.

    Raises:
        ModelError: There is no such file, or it is not JSON with a kind.
    """
    path = Path(folder) / EVALUATOR_FILE
    if not path.is_file():
        raise ModelError(
            f"{folder} is not an evaluator: it has no {EVALUATOR_FILE}; make one with "
            "latentmotion train evaluator or latentmotion convert"
        )
    try:
        return str(read_json_file(path)["kind"])
    except (FileFormatError, KeyError, TypeError) as error:
        raise ModelError(f"{path} is damaged: {error!r}; make the evaluator again") from error
