"""An evaluator learns which sentences tell of which motions, by contrast within batches.

Unlike the T2M authors' training, the movement encoder is not pretrained as an autoencoder: all
three networks are trained together. Over several ranks each contrasts its own share of a batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop, items_of
from latentmotion.errors import DataError
from latentmotion.evaluation.extractors.contrast import squared_distances, top_hits
from latentmotion.evaluation.extractors.networks import FRAMES, TextMotionNetworks
from latentmotion.evaluation.extractors.recipe import EvaluatorExperiment
from latentmotion.evaluation.extractors.word_vectors import WordVectors
from latentmotion.motion import Motion
from latentmotion.training.crops import FeatureMemory, Plan
from latentmotion.training.devices import Place
from latentmotion.training.loop import Stage
from latentmotion.training.randomness import StepRandomness

GROUP = 32
"""Motions among which a validation looks for the right one."""


class EvaluatorStage(Stage[TextMotionNetworks]):
    """The networks, the crops and sentences they are shown, and those they are measured on.

    Args:
        networks: What to train.
        vectors: Sentences to word vectors.
        dataset: Motions and captions.
        experiment: Which crops, which objective.
        place: The device and rank.

    Raises:
        DataError: The training split has no captions.
    """

    def __init__(
        self,
        networks: TextMotionNetworks,
        vectors: WordVectors,
        dataset: Dataset,
        experiment: EvaluatorExperiment,
        place: Place,
    ) -> None:
        super().__init__()
        self.network = networks
        self._vectors, self._place, self._experiment = vectors, place, experiment
        train = captioned(dataset.clips("train", mirrored=experiment.mirrored))
        if not train:
            raise DataError(f"{dataset.folder} has no captioned clip in its train split")
        held_out = captioned(dataset.clips("val"))
        self._held_out = [crop for clip in held_out for crop in _crops(clip, experiment.longest)]
        self._captions = {c.text: c for clip in train + held_out for c in clip.captions}
        self._tell_of = {clip.id: {c.text for c in clip.captions} for clip in train + held_out}
        self._memory = FeatureMemory(dataset, [*train, *held_out], dataset.normalizer)
        batch, seed = experiment.training.batch_size, experiment.training.seed
        items = items_of(train)
        self._plans = [Plan(items, batch, cropping, seed) for cropping in experiment.croppings()]

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        turn, number = step % len(self._plans), step // len(self._plans)
        crops, ranks = self._plans[turn](number), self._place.ranks
        # Only dropout is random here; it is seeded by the step.
        StepRandomness(self._experiment.training.seed, step, len(crops), ranks)
        own = crops[ranks.share(len(crops))]
        squared = self._distances(self.network, [crop.caption for crop in own], own)
        return {"total": self._experiment.objective(squared, self._told(own, own))}

    @torch.no_grad()
    def validate(self, network: TextMotionNetworks) -> dict[str, float]:
        """Loss, and how often one of the right held-out motions is among the nearest 1, 2, 3."""
        groups = _groups(self._held_out)
        figures = [self._figures(network, group) for group in groups]
        names = ("loss", "top_1", "top_2", "top_3")
        means = np.mean(figures, axis=0).tolist() if figures else ()
        return dict(zip(names, means, strict=False))

    def sample(self, network: TextMotionNetworks) -> list[Motion]:
        """Nothing: an evaluator makes no motions."""
        return []

    def _figures(self, network: TextMotionNetworks, crops: Sequence[Crop]) -> list[float]:
        squared = self._distances(network, [crop.caption for crop in crops], crops)
        told = self._told(crops, crops)
        loss = float(self._experiment.objective(squared, told))
        return [loss, *top_hits(squared, told)]

    def _distances(
        self, network: TextMotionNetworks, sentences: Sequence[str], crops: Sequence[Crop]
    ) -> Float[torch.Tensor, "sentences crops"]:
        device = self._place.device
        features, mask = self._memory.batch(crops, max(crop.frames for crop in crops))
        read = self._vectors([self._captions[text] for text in sentences])
        words, parts, seen = (torch.from_numpy(x) for x in (read.words, read.parts, read.mask))
        motions = network.motions(features.to(device), mask.to(device))
        texts = network.texts(words.to(device), parts.to(device), seen.to(device))
        return squared_distances(texts, motions)

    def _told(
        self, sentences: Sequence[Crop], motions: Sequence[Crop]
    ) -> Bool[torch.Tensor, "sentences motions"]:
        rows = [[s.caption in self._tell_of[m.clip.id] for m in motions] for s in sentences]
        return torch.tensor(rows, device=self._place.device)


def captioned(clips: Sequence[Clip]) -> list[Clip]:
    """Returns the clips that have captions and a movement to look at."""
    return [clip for clip in clips if clip.captions and clip.frames >= FRAMES]


def _crops(clip: Clip, longest: Sequence[int]) -> list[Crop]:
    """One crop per caption of a clip, of the lengths that take turns in training."""
    return [
        Crop(clip, 0, min(clip.frames, longest[turn % len(longest)]) // FRAMES * FRAMES, c.text)
        for turn, c in enumerate(clip.captions)
    ]


def _groups(crops: Sequence[Crop]) -> list[list[Crop]]:
    """Groups of `GROUP` in a fixed random order; fewer make one group."""
    order = np.random.default_rng(0).permutation(len(crops))
    whole = max(len(crops) // GROUP, 1) if len(crops) else 0
    return [[crops[i] for i in order[n * GROUP : (n + 1) * GROUP]] for n in range(whole)]
