"""`latentmotion train evaluator|classifier`: the networks that judge generated motions.

The same command again resumes a run that was stopped.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from latentmotion.cli.options import AUTO, TEXT_ENCODER, Changes, Data, Device
from latentmotion.cli.train import RunFolder, Training, text_encoder_named
from latentmotion.errors import InputError
from latentmotion.experiment import TrainingSettings, with_changes

if TYPE_CHECKING:
    from latentmotion.evaluation.extractors.word_vectors import WordVectors

Sizes = Annotated[
    str,
    arg(
        help="Sizes to start from: t2m (those of the official evaluator) or small (for a few "
        "hundred clips). The defaults below are those of the preset."
    ),
]


def _training(preset: str) -> TrainingSettings:
    from latentmotion.evaluation.extractors.recipe import recipe_named

    return recipe_named(preset).training


def _classifier_training() -> TrainingSettings:
    from latentmotion.training.classifier_stage import ClassifierExperiment

    return ClassifierExperiment().training


@dataclass(frozen=True)
class TrainEvaluator:
    """Train an evaluator of text and motion, for FID and R-precision; write it to OUTPUT/model.

    Words are read as GloVe vectors (--glove) or through a text encoder (--text-encoder).
    """

    data: Data
    output: RunFolder
    glove: Path | None = None
    """Folder of the T2M code's our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    text_encoder: str | None = None
    """As for `latentmotion train denoiser`; by default starter, unless --glove is given."""
    preset: Sizes = "t2m"
    set: Changes = ()
    """Change any other setting, e.g. networks.width=128; repeatable."""
    device: Device = AUTO
    training: Training = field(default_factory=lambda: _training("t2m"))

    @staticmethod
    def training_of(preset: str) -> TrainingSettings:
        """Returns a preset's settings of this training."""
        return _training(preset)

    def run(self) -> None:
        """Trains to the last step."""
        from latentmotion.evaluation.extractors.recipe import recipe_named
        from latentmotion.training.devices import training_place
        from latentmotion.training.evaluators import train_evaluator

        experiment = replace(recipe_named(self.preset), training=self.training)
        experiment = with_changes(experiment, self.set)
        vectors, encoder = self._words()
        with training_place(self.device) as place:
            print(train_evaluator(experiment, self.data, vectors, self.output, place, encoder))

    def _words(self) -> tuple[WordVectors, Path | None]:
        """Returns the word vectors, and the folder of the text encoder where it can be copied."""
        from latentmotion.condition.text.cache import CachedTextEncoder
        from latentmotion.condition.text.student import StudentTextEncoder
        from latentmotion.evaluation.extractors.glove import read_glove
        from latentmotion.evaluation.extractors.word_vectors import EncodedWords
        from latentmotion.model.folder import find_model

        if self.glove and self.text_encoder:
            raise InputError("--glove and --text-encoder exclude each other: pass one of them")
        if self.glove:
            return read_glove(self.glove), None
        name = self.text_encoder or TEXT_ENCODER
        encoder = text_encoder_named(name)
        small = isinstance(encoder, StudentTextEncoder)
        cached = CachedTextEncoder(encoder, self.output / "text")
        return EncodedWords(cached), find_model(name) if small else None


@dataclass(frozen=True)
class TrainClassifier:
    """Train an action classifier for evaluation and write it to OUTPUT/model."""

    data: Data
    output: RunFolder
    mirrored_classes: bool = False
    """Give labels that only mirrored copies have classes of their own (HDM05: kicks with the right
    foot); without it, such copies are left out."""
    set: Changes = ()
    """Change any other setting, e.g. network.width=128; repeatable."""
    device: Device = AUTO
    training: Training = field(default_factory=_classifier_training)

    def run(self) -> None:
        """Trains to the last step; prints the folder and the accuracies."""
        from latentmotion.evaluation.extractors.action_classifier import describe_action_classifier
        from latentmotion.training.classifier import train_classifier
        from latentmotion.training.classifier_stage import ClassifierExperiment
        from latentmotion.training.devices import training_place

        experiment = ClassifierExperiment(
            mirrored_classes=self.mirrored_classes, training=self.training
        )
        experiment = with_changes(experiment, self.set)
        with training_place(self.device) as place:
            folder = train_classifier(experiment, self.data, self.output, place)
            about = describe_action_classifier(folder) if place.leads else None
        print(folder)
        for name, value in about.figures.items() if about else ():
            print(f"{name} {value:.3f}")
