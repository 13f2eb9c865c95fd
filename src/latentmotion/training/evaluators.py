"""An evaluator from data: networks, loop, evaluator folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.extractors.networks import TextMotionConfig
from latentmotion.evaluation.extractors.recipe import EvaluatorExperiment
from latentmotion.evaluation.extractors.text_motion import TextMotionCard, TextMotionEvaluator
from latentmotion.evaluation.extractors.text_motion_folder import save_text_motion
from latentmotion.evaluation.extractors.word_vectors import GloveWords, WordVectors
from latentmotion.training.devices import Place
from latentmotion.training.evaluator_stage import EvaluatorStage
from latentmotion.training.loop import train
from latentmotion.training.provenance import provenance_of
from latentmotion.training.run_folder import MODEL, open_run


@dataclass(frozen=True)
class EvaluatorRun:
    """What a run folder was made with."""

    data: str
    """Fingerprint of the prepared data."""
    words: str
    """Name of the word vectors."""
    experiment: EvaluatorExperiment
    """Everything else that decides what the run yields."""
    stage: str = "evaluator"
    """What distinguishes it from other runs."""


def train_evaluator(
    experiment: EvaluatorExperiment,
    data: Path,
    vectors: WordVectors,
    folder: Path,
    place: Place,
    encoder: Path | None = None,
) -> Path:
    """Trains an evaluator, or goes on with it; returns the evaluator folder.

    Args:
        experiment: Sizes and training.
        data: Folder that `latentmotion data prepare` made.
        vectors: Sentences to word vectors.
        folder: The run folder.
        place: The device and rank.
        encoder: Folder of the small text encoder behind `vectors`, copied into the result.

    Raises:
        DataError: The data cannot be used.
        InputError: The run folder holds another run.
    """
    dataset, settings = Dataset.load(data), experiment.training
    fitted = fit_to(experiment.networks, dataset, vectors)
    experiment = replace(experiment, networks=fitted)
    open_run(folder, EvaluatorRun(dataset.fingerprint, vectors.name, experiment), place)
    torch.manual_seed(settings.seed)
    stage = EvaluatorStage(fitted.build(), vectors, dataset, experiment, place)
    networks, seconds = train(stage, settings, folder, place)
    if place.leads:
        card = _card(experiment, dataset, vectors, seconds, stage.validate(networks))
        evaluator = TextMotionEvaluator(card, networks.cpu(), dataset.normalizer, vectors)
        save_text_motion(folder / MODEL, evaluator, encoder)
    return folder / MODEL


def fit_to(config: TextMotionConfig, dataset: Dataset, vectors: WordVectors) -> TextMotionConfig:
    """Returns the sizes with those that data and word vectors dictate."""
    contacts = dataset.representation.blocks.get("contacts", slice(0, 0))
    return replace(
        config,
        features=dataset.representation.width,
        left_out=contacts.stop - contacts.start,
        word_width=vectors.width,
    )


def _card(
    experiment: EvaluatorExperiment,
    dataset: Dataset,
    vectors: WordVectors,
    seconds: float,
    figures: Mapping[str, float],
) -> TextMotionCard:
    return TextMotionCard(
        name=experiment.name,
        representation=dataset.representation.name,
        networks=experiment.networks,
        words=vectors.name,
        vocabulary=vectors.words if isinstance(vectors, GloveWords) else (),
        provenance=provenance_of(dataset, seconds),
        figures={f"val_{name}": round(value, 4) for name, value in figures.items()},
    )
