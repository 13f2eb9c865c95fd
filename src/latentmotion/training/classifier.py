"""Training of an action classifier: crops → cross entropy, into an evaluator folder; resumable.

The weights with the best accuracy on the val split are kept. Mirrored copies are trained on where
their labels are among those of the data: a kick to the left mirrored is a kick to the right, a
squat stays a squat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors import safe_open
from safetensors.torch import load_file

from latentmotion.data.clip import SPLITS, Clip
from latentmotion.data.dataset import Crop, Cropping, Dataset, Item
from latentmotion.errors import DataError
from latentmotion.evaluation.evaluators.action import (
    ActionClassifier,
    Recognizer,
    TemporalClassifier,
    TemporalClassifierConfig,
    recognizer_of,
    save_action_classifier,
)
from latentmotion.representation.interface import Normalizer
from latentmotion.storage.provenance import command_line
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.experiment import TrainingSettings, optimization
from latentmotion.training.loop import Stage, train
from latentmotion.training.run_folder import MODEL, open_run, write_tensors
from latentmotion.training.vae import BatchSampler, FeatureCache


@dataclass(frozen=True)
class ClassifierExperiment:
    """Everything that decides what training a classifier yields, but the data."""

    # The network; its features and labels are taken from the data.
    network: TemporalClassifierConfig = field(default_factory=TemporalClassifierConfig)
    mirrored_classes: bool = False  # Whether labels that only mirrored copies have are classes too.
    # Which parts of clips are shown.
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=64))
    noise: float = 0.2  # Deviation of the noise that is added to normalized features in training.
    smoothing: float = 0.1  # Part of the target that is spread over all labels.
    # Optimization.
    training: TrainingSettings = field(default_factory=partial(optimization, "classifier"))


@dataclass(frozen=True)
class LabelledData:
    """Training items of a classifier."""

    labels: tuple[str, ...]  # The labels, in the order of the logits.
    train: tuple[Clip, ...]  # Clips that are shown, mirrored copies included.
    val: tuple[Clip, ...]  # Clips by which the weights are chosen.
    memory: FeatureCache  # Normalized features of both.

    def targets(self, crops: Sequence[Crop]) -> torch.Tensor:
        """Returns the label number of each crop."""
        return torch.tensor([self.labels.index(crop.clip.action or "") for crop in crops])


def labels_of(dataset: Dataset, mirrored_classes: bool) -> tuple[str, ...]:
    """Returns the labels of a data set, sorted."""
    every = [c for split in ("train", "val", "test") for c in dataset.clips(split, mirrored=True)]
    actions = {c.action for c in every if c.action and (mirrored_classes or not c.mirrored)}
    return tuple(sorted(actions))


def labelled(dataset: Dataset, split: str, labels: Sequence[str]) -> list[Clip]:
    """Returns the clips of a split that have one of the labels, mirrored copies included."""
    return [clip for clip in dataset.clips(split, mirrored=True) if clip.action in labels]


class ClassifierStage(Stage[TemporalClassifier]):
    """Training of the classifier: the network, its training crops and the clips that select it.

    Args:
        network: The network to train.
        data: Labelled clips.
        experiment: Which crops, which objective.
        best: File of the best weights so far.
        context: The device and rank.
    """

    def __init__(
        self,
        network: TemporalClassifier,
        data: LabelledData,
        experiment: ClassifierExperiment,
        best: Path,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = network
        self._data, self._experiment, self._best, self._context = data, experiment, best, context
        items = [Item(clip, 0, clip.frames, ()) for clip in data.train]
        training = experiment.training
        self._batches = BatchSampler(items, training.batch_size, experiment.cropping, training.seed)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        crops, ranks, device = self._batches(step), self._context.ranks, self._context.device
        shard = crops[ranks.shard(len(crops))]
        features, mask = self._data.memory.batch(shard, max(crop.frames for crop in crops))
        seed = self._experiment.training.seed
        noise = StepRandomness(seed, step, len(crops), ranks, device).normal(*features.shape[1:])
        features = features.to(device) + self._experiment.noise * noise
        logits = self._logits(self.network, features, mask.to(device))
        targets = self._data.targets(shard).to(device)
        loss = F.cross_entropy(logits, targets, label_smoothing=self._experiment.smoothing)
        return {"total": loss, "accuracy": (logits.argmax(1) == targets).float().mean()}

    @torch.no_grad()
    def validate(self, network: TemporalClassifier) -> dict[str, float]:
        """Accuracy and loss on whole held-out clips; keeps the weights if the loss is the least."""
        crops = [Crop(clip, 0, clip.frames, "") for clip in self._data.val]
        if not crops:
            return {}
        features, mask = self._data.memory.batch(crops, max(crop.frames for crop in crops))
        device = self._context.device
        logits = self._logits(network, features.to(device), mask.to(device)).cpu()
        targets = self._data.targets(crops)
        loss = float(F.cross_entropy(logits, targets))
        if loss < best_loss(self._best):
            write_tensors(self._best, network.state_dict(), {"loss": repr(loss)})
        return {"loss": loss, "accuracy": float((logits.argmax(1) == targets).float().mean())}

    def _logits(
        self, network: TemporalClassifier, features: torch.Tensor, mask: torch.Tensor
    ) -> torch.Tensor:
        return network.classify(network.features(features, mask))


def best_loss(path: Path) -> float:
    """Returns the validation loss of the kept weights; infinity where there are none."""
    if not path.exists():
        return math.inf
    with safe_open(path, "pt") as file:
        return float(file.metadata()["loss"])


BEST = "best.safetensors"  # File in a run folder with the weights that were best on the val split.


def train_classifier(
    experiment: ClassifierExperiment, data: Path, folder: Path, context: DistributedContext
) -> Path:
    """Trains a classifier, or resumes its training; returns the evaluator folder.

    Raises:
        DataError: The data cannot be used.
        InputError: The run folder holds another run.
    """
    dataset = Dataset.load(data)
    labels = labels_of(dataset, experiment.mirrored_classes)
    if len(labels) < 2:
        raise DataError(
            f"{dataset.folder} has {len(labels)} action labels, a classifier needs 2 or more; "
            "prepare data with labels, e.g. latentmotion data prepare hdm05"
        )
    # Measured anew, since a data set may leave its features as they are.
    normalizer = Normalizer.fit(
        [dataset.features(clip) for clip in dataset.clips("train", mirrored=True)],
        dataset.representation.blocks,
    )
    sizes = {"features": dataset.representation.width, "labels": len(labels)}
    experiment = replace(experiment, network=replace(experiment.network, **sizes))
    run = {"kind": "ClassifierRun", "stage": "classifier", "data": dataset.fingerprint}
    open_run(folder, {**run, "experiment": experiment}, context)
    torch.manual_seed(experiment.training.seed)
    learned, held_out = (labelled(dataset, part, labels) for part in ("train", "val"))
    memory = FeatureCache(dataset, [*learned, *held_out], normalizer)
    labelled_data = LabelledData(labels, tuple(learned), tuple(held_out), memory)
    network, best = experiment.network.build(), folder / BEST
    stage = ClassifierStage(network, labelled_data, experiment, best, context)
    network = train(stage, experiment.training, folder, context)[0].cpu()
    if context.is_main:
        if best.exists():  # the weights that did best on the val split, where there is one
            network.load_state_dict(load_file(best))
        sources = "; ".join(f"{source.name}: {source.credit}" for source in dataset.sources)
        description = ActionClassifier(
            labels=labels,
            representation=dataset.representation.name,
            network=experiment.network,
            mean=tuple(normalizer.mean.tolist()),
            std=tuple(normalizer.std.tolist()),
            origin=f"{command_line()} (data {dataset.fingerprint[:12]}; {sources})",
            license="; ".join(dict.fromkeys(source.license for source in dataset.sources)),
        )
        recognizer, frames = recognizer_of(description, network, ""), experiment.cropping.max_frames
        accuracies = {split: accuracy(recognizer, dataset, split, frames) for split in SPLITS}
        figures = {f"{k}_accuracy": round(v, 4) for k, v in accuracies.items() if v is not None}
        save_action_classifier(
            folder / MODEL, replace(description, figures=figures), network.state_dict()
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
    clips = labelled(dataset, split, recognizer.labels)
    if not clips:
        return None
    motions = []
    for clip in clips:
        features = dataset.features(clip)
        start = max(0, (len(features) - frames) // 2)
        motions.append(dataset.representation.restart(features[start : start + frames]))
    predicted = recognizer(motions).logits.argmax(axis=1)
    hits = [
        recognizer.labels[row] == clip.action for row, clip in zip(predicted, clips, strict=True)
    ]
    return sum(hits) / len(hits)
