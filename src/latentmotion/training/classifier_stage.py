"""Training of an action classifier: crops → cross entropy; the best weights by the val split stay.

Mirrored copies are trained on where their labels are among those asked for: a kick to the left
mirrored is a kick to the right, a squat stays a squat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors import safe_open
from safetensors.torch import save_file

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop, Cropping, Item
from latentmotion.evaluation.extractors.temporal import (
    TemporalClassifier,
    TemporalClassifierConfig,
)
from latentmotion.experiment import TrainingSettings
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_file
from latentmotion.training.crops import FeatureMemory, Plan
from latentmotion.training.devices import Place
from latentmotion.training.loop import Stage
from latentmotion.training.randomness import StepRandomness


@dataclass(frozen=True)
class ClassifierExperiment:
    """Everything that decides what training a classifier yields, but the data."""

    network: TemporalClassifierConfig = field(default_factory=TemporalClassifierConfig)
    """The network; its features and labels are taken from the data."""
    mirrored_classes: bool = False
    """Whether labels that only mirrored copies have are classes too."""
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=64))
    """Which parts of clips are shown."""
    noise: float = 0.2
    """Deviation of the noise that is added to normalized features in training."""
    smoothing: float = 0.1
    """Part of the target that is spread over all labels."""
    training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(
            steps=1000, weight_decay=0.05, ema_decay=0.99, validate_every=50, sample_every=0
        )
    )
    """How it is optimized."""


@dataclass(frozen=True)
class LabelledData:
    """What a classifier learns from."""

    labels: tuple[str, ...]
    """The labels, in the order of the logits."""
    train: tuple[Clip, ...]
    """Clips that are shown, mirrored copies included."""
    val: tuple[Clip, ...]
    """Clips by which the weights are chosen."""
    memory: FeatureMemory
    """Normalized features of both."""

    def targets(self, crops: Sequence[Crop]) -> torch.Tensor:
        """Returns the label number of each crop."""
        return torch.tensor([self.labels.index(crop.clip.action or "") for crop in crops])


def labels_of(dataset: Dataset, mirrored_classes: bool) -> tuple[str, ...]:
    """Returns the labels of a data set, sorted."""
    every = [c for split in ("train", "val", "test") for c in dataset.clips(split, mirrored=True)]
    seen = {c.action for c in every if c.action and (mirrored_classes or not c.mirrored)}
    return tuple(sorted(seen))


def labelled(dataset: Dataset, split: str, labels: Sequence[str], mirrored: bool) -> list[Clip]:
    """Returns the clips of a split that have one of the labels."""
    return [clip for clip in dataset.clips(split, mirrored) if clip.action in labels]


class ClassifierStage(Stage[TemporalClassifier]):
    """The classifier, the crops it is shown, and the clips by which it is chosen.

    Args:
        network: The network to train.
        data: Labelled clips.
        experiment: Which crops, which objective.
        best: File of the best weights so far.
        place: The device and rank.
    """

    def __init__(
        self,
        network: TemporalClassifier,
        data: LabelledData,
        experiment: ClassifierExperiment,
        best: Path,
        place: Place,
    ) -> None:
        super().__init__()
        self.network = network
        self._data, self._experiment, self._best, self._place = data, experiment, best, place
        items = [Item(clip, 0, clip.frames, ()) for clip in data.train]
        training = experiment.training
        self._plan = Plan(items, training.batch_size, experiment.cropping, training.seed)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        crops, ranks, device = self._plan(step), self._place.ranks, self._place.device
        own = crops[ranks.share(len(crops))]
        features, mask = self._data.memory.batch(own, max(crop.frames for crop in crops))
        seed = self._experiment.training.seed
        noise = StepRandomness(seed, step, len(crops), ranks, device).normal(*features.shape[1:])
        features = features.to(device) + self._experiment.noise * noise
        logits = self._logits(self.network, features, mask.to(device))
        targets = self._data.targets(own).to(device)
        smoothing = self._experiment.smoothing
        loss = F.cross_entropy(logits, targets, label_smoothing=smoothing)
        return {"total": loss, "accuracy": (logits.argmax(1) == targets).float().mean()}

    @torch.no_grad()
    def validate(self, network: TemporalClassifier) -> dict[str, float]:
        """Accuracy and loss on whole held-out clips; keeps the weights if the loss is the least."""
        crops = [Crop(clip, 0, clip.frames, "") for clip in self._data.val]
        if not crops:
            return {}
        features, mask = self._data.memory.batch(crops, max(crop.frames for crop in crops))
        device = self._place.device
        logits = self._logits(network, features.to(device), mask.to(device)).cpu()
        targets = self._data.targets(crops)
        loss = float(F.cross_entropy(logits, targets))
        if loss < best_loss(self._best):
            _keep(self._best, network, loss)
        accuracy = float((logits.argmax(1) == targets).float().mean())
        return {"loss": loss, "accuracy": accuracy}

    def sample(self, network: TemporalClassifier) -> list[Motion]:
        """A classifier makes no motions."""
        return []

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


def _keep(path: Path, network: TemporalClassifier, loss: float) -> None:
    with atomic_file(path) as temporary:
        weights = {key: tensor.cpu().contiguous() for key, tensor in network.state_dict().items()}
        save_file(weights, temporary, {"loss": repr(loss)})
