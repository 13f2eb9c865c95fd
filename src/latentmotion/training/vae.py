"""The first stage: the VAE is trained on crops of motions (paper, section 3.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.arrays import prefix_mask
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Crop, Cropping, Dataset, Item, items_of, plan_epoch
from latentmotion.errors import DataError
from latentmotion.evaluation.metrics import mpjpe
from latentmotion.kinematics.smpl import SkinnedBody
from latentmotion.motion import Motion
from latentmotion.networks.vae.interface import Latents, MotionVAE, vae_losses
from latentmotion.representation.interface import Normalizer
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.experiment import Experiment
from latentmotion.training.loop import Stage


class BatchSampler:
    """Which crops each step shows: epochs of items in random order, batches of similar length.

    Args:
        items: Items to draw from.
        batch_size: Crops of a step.
        cropping: Lengths of crops.
        seed: Changes order and crops.
    """

    def __init__(
        self, items: Sequence[Item], batch_size: int, cropping: Cropping, seed: int
    ) -> None:
        shortest = max(cropping.min_frames, cropping.unit)
        self._items = [item for item in items if item.frames >= shortest]
        self._per_epoch = max(len(self._items) // batch_size, 1)
        self._epoch = lru_cache(maxsize=1)(
            partial(plan_epoch, self._items, batch_size, cropping, seed)
        )

    def __call__(self, step: int) -> list[Crop]:
        """Returns the crops of step number `step`."""
        epoch, index = divmod(step, self._per_epoch)
        return self._epoch(epoch)[index]


# Bytes of features that training keeps in memory: 14 hours a GB. Of more, none are kept, and crops
# are read from the data's shards, where the system keeps what it has room for.
MOST_CACHED = 1 << 33


class FeatureCache:
    """Features of clips, read once and given out normalized, each crop as a clip of its own.

    Args:
        dataset: Data set of the features.
        clips: Clips to read.
        normalizer: Mean and scale of the features.

    Raises:
        DataError: There is no clip.
        InputError: The features are not normalized: the normalizer is of other data.
    """

    def __init__(self, dataset: Dataset, clips: Sequence[Clip], normalizer: Normalizer) -> None:
        if not clips:
            raise DataError("no clip to train on; see what there is: latentmotion data check")
        self._dataset, self._representation = dataset, dataset.representation
        self._normalizer = normalizer
        size = 4 * dataset.representation.width * sum(clip.frames for clip in clips)
        every = math.ceil(size / MOST_CACHED)
        read = {clip.id: dataset.features(clip) for clip in clips[::every]}
        if self._representation.normalized:
            features = np.concatenate(list(read.values()))
            normalizer.check(normalizer.normalize(features), self._representation.blocks)
        self._features = read if every == 1 else {}

    def batch(
        self, crops: Sequence[Crop], frames: int
    ) -> tuple[Float[torch.Tensor, "batch frames features"], Bool[torch.Tensor, "batch frames"]]:
        """Returns crops padded with zeros to `frames`, and the mask of what is real."""
        parts = []
        for crop in crops:
            whole = self._features.get(crop.clip.id)
            whole = self._dataset.features(crop.clip) if whole is None else whole
            part = self._representation.restart(whole[crop.start : crop.start + crop.frames])
            parts.append(self._normalizer.normalize(part))
        features = np.zeros((len(crops), frames, parts[0].shape[1]), np.float32)
        for row, part in zip(features, parts, strict=True):
            row[: len(part)] = part
        lengths = torch.tensor([crop.frames for crop in crops])
        return torch.from_numpy(features), prefix_mask(lengths, frames)


def items_by_length(clips: Sequence[Clip], most: int) -> list[Item]:
    """Returns the items of clips, one that has room for n crops of `most` frames n times."""
    return [item for item in items_of(clips) for _ in range(math.ceil(item.frames / most))]


LOOKED_AT = 64  # Clips of each split that a validation rebuilds.


class VAEStage(Stage[MotionVAE]):
    """Training of the VAE: the network, its training crops and its held-out clips.

    Args:
        vae: The network to train.
        dataset: Motions.
        experiment: Crops and loss.
        context: The device and rank.
        body: Whose vertices are compared, where the objective does.
        memory: Features of the data's clips, where another stage has read them.
    """

    def __init__(
        self,
        vae: MotionVAE,
        dataset: Dataset,
        experiment: Experiment,
        context: DistributedContext,
        body: SkinnedBody | None = None,
        memory: FeatureCache | None = None,
    ) -> None:
        super().__init__()
        self.network = vae
        self._dataset, self._context = dataset, context
        self._objective, self._settings = experiment.vae_objective, experiment.vae_training
        self._body = body.like(torch.zeros(1, device=context.device)) if body else None
        self._longest = experiment.latents.cropping.max_frames
        train = dataset.clips("train", mirrored=experiment.mirrored)
        self._looked_at = {split: spread(dataset.clips(split)) for split in ("train", "val")}
        self.memory = memory or FeatureCache(
            dataset, [*train, *self._looked_at["val"]], dataset.normalizer
        )
        cropping = experiment.vae_cropping
        items = items_by_length(train, cropping.max_frames)
        self._batches = BatchSampler(
            items, self._settings.batch_size, cropping, self._settings.seed
        )

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        crops, context = self._batches(step), self._context
        shard = crops[context.ranks.shard(len(crops))]
        features, mask = self.memory.batch(shard, max(crop.frames for crop in crops))
        seed, device = self._settings.seed, context.device
        randomness = StepRandomness(seed, step, len(crops), context.ranks, device)
        # Not every representation has one.
        compares = self._objective.contacts > 0 or self._objective.bones > 0
        skeleton = self._dataset.representation.skeleton if compares else None
        return vae_losses(
            vae=self.network,
            features=features.to(device),
            mask=mask.to(device),
            noise=randomness.normal,
            joints_of=self._joints,
            fps=self._dataset.representation.fps,
            objective=self._objective,
            vertices_of=self._vertices if self._body else None,
            skeleton=skeleton,
            latents_of=partial(self._latents_to_decode, randomness),
        )

    def _latents_to_decode(
        self, randomness: StepRandomness, drawn: Latents, mask: Bool[torch.Tensor, "batch tokens"]
    ) -> Latents:
        """Returns the latents that the decoder learns from: those that were drawn."""
        return drawn

    @torch.no_grad()
    def validate(self, network: MotionVAE) -> dict[str, float]:
        """Mean joint error in millimeters of rebuilt clips, root-aligned and in the world."""
        figures = {}
        for split, clips in self._looked_at.items():
            if not clips:
                continue
            pairs = [self._rebuild(network, clip) for clip in clips]
            for name, align in (("mm", True), ("world_mm", False)):
                errors = [mpjpe(decoded, true, align) for decoded, true in pairs]
                figures[f"{split}_{name}"] = sum(errors) / len(errors)
        return figures

    @torch.no_grad()
    def sample(self, network: MotionVAE) -> list[Motion]:
        """Two held-out clips beside their reconstructions; training clips if none is held out."""
        motions = []
        for clip in (self._looked_at["val"] or self._looked_at["train"])[:2]:
            rebuilt, true = self._rebuild(network, clip)
            motions += [self._motion(true, f"{clip.id}"), self._motion(rebuilt, "rebuilt")]
        return motions

    def _rebuild(
        self, network: MotionVAE, clip: Clip
    ) -> tuple[Float[torch.Tensor, "frames joints 3"], Float[torch.Tensor, "frames joints 3"]]:
        crop = Crop(clip, 0, min(clip.frames, self._longest), "")
        features, mask = (
            x.to(self._context.device) for x in self.memory.batch([crop], crop.frames)
        )
        rebuilt = network.decode(network.encode(features, mask).mean, mask)
        return self._joints(rebuilt)[0], self._joints(features)[0]

    def _joints(
        self, features: Float[torch.Tensor, "batch frames features"]
    ) -> Float[torch.Tensor, "batch frames joints 3"]:
        dataset = self._dataset
        return dataset.representation.decode(dataset.normalizer.denormalize(features))

    def _vertices(
        self, features: Float[torch.Tensor, "batch frames features"]
    ) -> Float[torch.Tensor, "batch frames vertices 3"]:
        part, body = self._dataset.representation, self._body
        assert isinstance(part, SmplRepresentation) and body is not None  # checked at the start
        rotations, _ = part.pose(self._dataset.normalizer.denormalize(features))
        return body.posed(rotations)

    def _motion(self, joints: Float[torch.Tensor, "frames joints 3"], caption: str) -> Motion:
        part = self._dataset.representation
        return Motion(joints.cpu().numpy(), part.fps, part.skeleton, caption)


def spread(clips: Sequence[Clip], most: int = LOOKED_AT) -> list[Clip]:
    """Returns at most `most` clips, evenly spaced."""
    return list(clips[:: max(1, -(-len(clips) // most))])
