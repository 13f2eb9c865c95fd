"""How an evaluator is trained: sizes, objective, crops, optimization; two recipes to start from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from latentmotion.data.sampling import Cropping
from latentmotion.errors import InputError, hint
from latentmotion.evaluation.extractors.contrast import InfoNCE, Margin
from latentmotion.evaluation.extractors.networks import FRAMES, TextMotionConfig
from latentmotion.experiment import TrainingSettings


@dataclass(frozen=True)
class EvaluatorExperiment:
    """Everything that decides what training an evaluator yields, but data and word vectors."""

    name: str
    """What the evaluator is called."""
    networks: TextMotionConfig
    """Sizes; those of features and words are taken from the data."""
    objective: InfoNCE | Margin
    """What is minimized."""
    training: TrainingSettings
    """How it is optimized."""
    longest: tuple[int, ...] = (196,)
    """Longest crop, in frames; several take turns by step, so that it judges short crops too."""
    mirrored: bool = True
    """Whether mirrored copies of the clips are trained on too."""

    def croppings(self) -> list[Cropping]:
        """Which parts of clips each turn sees."""
        return [Cropping(FRAMES, frames) for frames in self.longest]


def t2m() -> EvaluatorExperiment:
    """Sizes of the official evaluator, for data sets as large as HumanML3D and KIT."""
    training = TrainingSettings(
        steps=50_000, batch_size=64, learning_rate=2e-4, warm_up=500, ema_decay=0.0, sample_every=0
    )
    return EvaluatorExperiment("t2m", TextMotionConfig(), InfoNCE(), training)


def small() -> EvaluatorExperiment:
    """For some hundred clips: vectors of 64 numbers, so that FID has fewer numbers than clips."""
    networks = TextMotionConfig(movement_width=256, motion_hidden=256, text_hidden=256, width=64)
    training = TrainingSettings(
        steps=800, batch_size=64, warm_up=50, ema_decay=0.99, validate_every=50, sample_every=0
    )
    return EvaluatorExperiment("small", networks, InfoNCE(), training, longest=(64, 196))


RECIPES: dict[str, Callable[[], EvaluatorExperiment]] = {"t2m": t2m, "small": small}


def recipe_named(name: str) -> EvaluatorExperiment:
    """Returns a recipe.

    Raises:
        InputError: There is none of this name; the nearest is named.
    """
    if name not in RECIPES:
        raise InputError(f"unknown preset {name!r}; {hint(name, RECIPES)}")
    return RECIPES[name]()
