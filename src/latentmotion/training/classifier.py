"""Trains an action classifier on a labelled data set into an evaluator folder, resumable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from safetensors.torch import load_file

from latentmotion.data.clip import SPLITS
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.extractors.action_classifier import (
    ActionClassifier,
    recognizer_of,
    save_action_classifier,
)
from latentmotion.evaluation.extractors.action_network import Recognizer
from latentmotion.evaluation.extractors.temporal import TemporalClassifier
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.provenance import command_line
from latentmotion.training.classifier_stage import (
    ClassifierExperiment,
    ClassifierStage,
    LabelledData,
    labelled,
    labels_of,
)
from latentmotion.training.crops import FeatureMemory
from latentmotion.training.devices import Place
from latentmotion.training.loop import train
from latentmotion.training.run_folder import MODEL, open_run

BEST = "best.safetensors"
"""Where in a run folder the weights are kept that did best on the val split."""


@dataclass(frozen=True)
class ClassifierRun:
    """What the run folder of a classifier was made with."""

    stage: str
    """`classifier`."""
    data: str
    """Fingerprint of the prepared data."""
    experiment: ClassifierExperiment
    """Everything else that decides what the run yields."""


def train_classifier(
    experiment: ClassifierExperiment, data: Path, folder: Path, place: Place
) -> Path:
    """Trains a classifier, or goes on with it; returns the evaluator folder.

    Raises:
        DataError: The data cannot be used.
        InputError: The run folder holds another run.
    """
    dataset = Dataset.load(data)
    labels, normalizer = _labels(dataset, experiment), _normalizer(dataset)
    sizes = {"features": dataset.representation.width, "labels": len(labels)}
    experiment = replace(experiment, network=replace(experiment.network, **sizes))
    open_run(folder, ClassifierRun("classifier", dataset.fingerprint, experiment), place)
    torch.manual_seed(experiment.training.seed)
    seen = _labelled_data(dataset, labels, normalizer)
    network = experiment.network.build()
    stage = ClassifierStage(network, seen, experiment, folder / BEST, place)
    network, _ = train(stage, experiment.training, folder, place)
    if place.leads:
        network = _chosen(network.cpu(), folder / BEST)
        about = _describe(experiment, dataset, labels, normalizer)
        figures = _accuracies(recognizer_of(about, network, ""), dataset, experiment)
        save_action_classifier(
            folder / MODEL, replace(about, figures=figures), network.state_dict()
        )
    return folder / MODEL


def accuracy(recognizer: Recognizer, dataset: Dataset, split: str, frames: int) -> float | None:
    """Returns the part of a split's labelled clips, mirrored ones too, that is recognized.

    Args:
        recognizer: The classifier.
        dataset: The data set.
        split: Which split; None is returned where it has no such clip.
        frames: Clips are cut to this many frames, from their middle.
    """
    clips = labelled(dataset, split, recognizer.labels, mirrored=True)
    if not clips:
        return None
    restart = dataset.representation.restart
    motions = [restart(_middle(dataset.features(clip), frames)) for clip in clips]
    found = recognizer(motions).logits.argmax(axis=1)
    hits = [recognizer.labels[row] == clip.action for row, clip in zip(found, clips, strict=True)]
    return sum(hits) / len(hits)


def _middle(features, frames: int):
    start = max(0, (len(features) - frames) // 2)
    return features[start : start + frames]


def _labels(dataset: Dataset, experiment: ClassifierExperiment) -> tuple[str, ...]:
    labels = labels_of(dataset, experiment.mirrored_classes)
    if len(labels) < 2:
        raise DataError(
            f"{dataset.folder} has {len(labels)} action labels, a classifier needs 2 or more; "
            "prepare data with labels, e.g. latentmotion data prepare hdm05"
        )
    return labels


def _normalizer(dataset: Dataset) -> Normalizer:
    """Measured anew, since a data set may leave its features as they are."""
    features = [dataset.features(clip) for clip in dataset.clips("train", mirrored=True)]
    return Normalizer.fit(features, dataset.representation.blocks)


def _labelled_data(
    dataset: Dataset, labels: tuple[str, ...], normalizer: Normalizer
) -> LabelledData:
    clips = [labelled(dataset, split, labels, mirrored=True) for split in ("train", "val")]
    memory = FeatureMemory(dataset, [*clips[0], *clips[1]], normalizer)
    return LabelledData(labels, tuple(clips[0]), tuple(clips[1]), memory)


def _chosen(network: TemporalClassifier, best: Path) -> TemporalClassifier:
    """The weights that did best on the val split, where there is one."""
    if best.exists():
        network.load_state_dict(load_file(best))
    return network


def _describe(
    experiment: ClassifierExperiment,
    dataset: Dataset,
    labels: tuple[str, ...],
    normalizer: Normalizer,
) -> ActionClassifier:
    sources = "; ".join(f"{source.name}: {source.credit}" for source in dataset.sources)
    return ActionClassifier(
        labels=labels,
        representation=dataset.representation.name,
        network=experiment.network,
        mean=tuple(normalizer.mean.tolist()),
        std=tuple(normalizer.std.tolist()),
        origin=f"{command_line()} (data {dataset.fingerprint[:12]}; {sources})",
        license="; ".join(dict.fromkeys(source.license for source in dataset.sources)),
    )


def _accuracies(
    recognizer: Recognizer, dataset: Dataset, experiment: ClassifierExperiment
) -> dict[str, float]:
    frames = experiment.cropping.max_frames
    found = {split: accuracy(recognizer, dataset, split, frames) for split in SPLITS}
    return {f"{k}_accuracy": round(v, 4) for k, v in found.items() if v is not None}
