"""The second stage: the denoiser is trained on the latents of a VAE (paper, section 3.2).

For diffusion on raw frames (`--vae none`) the normalized frames themselves are the latents.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Bool

from latentmotion.arrays import prefix_mask
from latentmotion.data.dataset import Crop, Cropping, Item
from latentmotion.diffusion.guidance import drop, guided
from latentmotion.diffusion.parametrization import Estimator, ParametrizedDenoiser
from latentmotion.diffusion.samplers import Sampler, SeededNoise, sample, sampler_named
from latentmotion.motion import Motion
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.interface import Latents, MotionVAE
from latentmotion.training.denoiser_loss import denoiser_loss
from latentmotion.training.distributed import DistributedContext, Ranks, StepRandomness
from latentmotion.training.experiment import Experiment
from latentmotion.training.loop import Stage
from latentmotion.training.run_folder import Previews
from latentmotion.training.task_conditions import ConditionTable
from latentmotion.training.vae import BatchSampler, FeatureCache

AT_ONCE = 64  # Crops that go through a network together.


@dataclass(frozen=True)
class KeptCropping(Cropping):
    """Chooses among crops that are kept instead of cutting new ones."""

    crops_of: Mapping[Item, tuple[Crop, ...]] = field(default_factory=dict)  # Crops of each item.

    def every(self) -> list[Crop]:
        """Returns all that are kept."""
        return [crop for crops in self.crops_of.values() for crop in crops]

    def crop(self, item: Item, generator: np.random.Generator) -> Crop:
        """Draws one of the item's kept crops and one of its sentences."""
        crops = self.crops_of[item]
        chosen = crops[int(generator.integers(len(crops)))]
        return Crop(chosen.clip, chosen.start, chosen.frames, item.draw_caption(generator))


def keep_crops(items: Sequence[Item], cropping: Cropping, per_item: int, seed: int) -> KeptCropping:
    """Cuts `per_item` crops of every item that is long enough."""
    generator = np.random.default_rng(seed)
    long_enough = (i for i in items if i.frames >= max(cropping.min_frames, cropping.unit))
    crops = {
        item: tuple(cropping.crop(item, generator) for _ in range(per_item)) for item in long_enough
    }
    return KeptCropping(cropping.unit, cropping.max_frames, cropping.min_frames, crops)


@dataclass(frozen=True)
class Posteriors:
    """Posteriors of many crops, padded to the longest."""

    mean: Latents  # Means.
    std: Latents  # Standard deviations.
    mask: Bool[torch.Tensor, "batch tokens"]  # True on real tokens.

    def take(self, rows: Sequence[int], tokens: int | None = None) -> Posteriors:
        """Returns some of them, cut to `tokens`."""
        index = torch.as_tensor(rows, device=self.mean.device)
        return Posteriors(*(x[index, :tokens] for x in (self.mean, self.std, self.mask)))

    def channel_statistics(self) -> tuple[list[float], list[float]]:
        """Returns mean and standard deviation of each channel over all drawn latents."""
        mean, std = self.mean[self.mask].double(), self.std[self.mask].double()
        # Law of total variance: that of the means, and the mean of those within the posteriors.
        variance = mean.var(dim=0, unbiased=False) + std.square().mean(dim=0)
        return mean.mean(dim=0).tolist(), variance.sqrt().tolist()

    def normalized(self, mean: Sequence[float], std: Sequence[float]) -> Posteriors:
        """Returns them in the denoiser's scale."""
        shift, scale = self.mean.new_tensor(mean), self.mean.new_tensor(std)
        return Posteriors((self.mean - shift) / scale, self.std / scale, self.mask)

    def to(self, device: torch.device) -> Posteriors:
        """Returns them on a device."""
        return Posteriors(self.mean.to(device), self.std.to(device), self.mask.to(device))


class LatentCache:
    """Posteriors by the crop that they are of.

    Args:
        crops: The crop of each row.
        posteriors: The rows.
    """

    def __init__(self, crops: Sequence[Crop], posteriors: Posteriors) -> None:
        self._rows = {_key(crop): row for row, crop in enumerate(crops)}
        self._tokens = posteriors.mask.sum(dim=1).tolist()
        self._posteriors = posteriors

    def batch(self, crops: Sequence[Crop], among: Sequence[Crop]) -> Posteriors:
        """Returns the posteriors of `crops`, padded to the longest of `among`."""
        tokens = max(self._tokens[self._rows[_key(crop)]] for crop in among)
        return self._posteriors.take([self._rows[_key(crop)] for crop in crops], tokens)


@torch.no_grad()
def encode_crops(
    vae: MotionVAE, memory: FeatureCache, crops: Sequence[Crop], context: DistributedContext
) -> Posteriors:
    """Encodes crops, those of similar length together."""
    # By length, so that little of a batch is padding.
    order = sorted(range(len(crops)), key=lambda index: crops[index].frames)
    rows: dict[int, tuple[torch.Tensor, torch.Tensor]] = {}
    for start in range(0, len(order), AT_ONCE):
        part = order[start : start + AT_ONCE]
        frames = crops[part[-1]].frames
        features, mask = memory.batch([crops[index] for index in part], frames)
        features, mask = features.to(context.device), mask.to(context.device)
        posterior = vae.encode(features, mask)
        real = vae.latent_mask(mask)
        for row, index in enumerate(part):
            rows[index] = posterior.mean[row][real[row]].cpu(), posterior.std[row][real[row]].cpu()
    means, stds = ([rows[index][part] for index in range(len(crops))] for part in range(2))
    pad = torch.nn.utils.rnn.pad_sequence
    lengths = torch.tensor([len(mean) for mean in means])
    return Posteriors(
        pad(means, batch_first=True), pad(stds, batch_first=True), prefix_mask(lengths)
    )


def _key(crop: Crop) -> tuple[str, int, int]:
    return crop.clip.id, crop.start, crop.frames


class FreshLatents:
    """Answers like a `LatentCache`, but encodes crops when they are asked for.

    So there is no limit to the crops of a motion. The latents of raw frames are the frames.

    Args:
        vae: The first stage, frozen.
        memory: Normalized features.
        device: Device of the result.
    """

    def __init__(self, vae: MotionVAE, memory: FeatureCache, device: torch.device) -> None:
        self._vae, self._memory, self._device = vae.to(device), memory, device

    @torch.no_grad()
    def batch(self, crops: Sequence[Crop], among: Sequence[Crop]) -> Posteriors:
        """Returns the posteriors of `crops`, padded to the longest of `among`."""
        batch = self._memory.batch(crops, max(crop.frames for crop in among))
        features, mask = (part.to(self._device) for part in batch)
        with torch.autocast(self._device.type, enabled=False):
            posterior = self._vae.encode(features, mask)
        return Posteriors(posterior.mean, posterior.std, self._vae.latent_mask(mask))


DRAWS = 4  # Times and noises at which held-out motions are measured.

# Shares of the schedule at which a validation measures what the sentence saves. At one time errors
# of noise, clean latents and velocity are proportional, so these shares compare denoisers of any.
READ_AT = (0.5, 0.9)

SAMPLING_STEPS = 20  # Most sampling steps of a validation, and of the motions in a picture.

SAMPLED = 32  # Most latents that a validation samples.


@dataclass(frozen=True)
class LatentData:
    """Training items of stage 2."""

    batches: BatchSampler  # Which crops each step shows.
    held_out: tuple[Crop, ...]  # Crops that are only measured.
    latents: LatentCache | FreshLatents  # Posteriors of all these crops, in the denoiser's scale.
    prompts: ConditionTable  # Embeddings of all their captions.


class DenoiserStage(Stage[DenoiserNetwork]):
    """Training of the denoiser: the network, its training latents and its held-out ones.

    Args:
        denoiser: The network to train.
        data: Latents and prompts.
        previews: Generates sample motions during training.
        experiment: Settings of the loss.
        context: The device and rank.
    """

    def __init__(
        self,
        denoiser: DenoiserNetwork,
        data: LatentData,
        previews: Previews,
        experiment: Experiment,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = denoiser
        self._data, self._previews, self._context = data, previews, context
        self._experiment, self._null = experiment, data.prompts([""])
        self._spread = float(experiment.latents.sampled)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        crops, ranks = self._data.batches(step), self._context.ranks
        seed = self._experiment.denoiser_training.seed
        randomness = StepRandomness(seed, step, len(crops), ranks, self._context.device)
        shard = crops[ranks.shard(len(crops))]
        dropped = self._experiment.denoiser_objective.dropped
        return {"total": self._loss(self.network, shard, crops, randomness, dropped)}

    @torch.no_grad()
    def validate(self, network: DenoiserNetwork) -> dict[str, float]:
        """Mean loss of held-out motions and of as many seen ones, at the same times and noises.

        `prompt_saves_50`, `prompt_saves_90` are the shares of the error at 0.5 and 0.9 of the
        schedule that prompts save: 0 if they are not read. `latent_size` is the size of sampled
        latents over that of true ones: 1 at best.
        """
        held_out = self._data.held_out
        if not held_out:
            return {}
        # The crops of step 0, and the same noise each time, so that validations can be compared.
        train = self._data.batches(0)[: len(held_out)]
        device = self._context.device

        def mean_loss(crops: Sequence[Crop], dropped: float, at: float | None = None) -> float:
            draws = (StepRandomness(n, 0, len(crops), Ranks(), device) for n in range(DRAWS))
            every = [self._loss(network, crops, crops, draw, dropped, at) for draw in draws]
            return float(torch.stack(every).mean())

        losses = {"loss": mean_loss(held_out, 0.0), "loss_of_seen": mean_loss(train, 0.0)}
        for at in READ_AT:
            saved = 1 - mean_loss(held_out, 0.0, at) / mean_loss(held_out, 1.0, at)
            losses[f"prompt_saves_{100 * at:.0f}"] = saved
        crops = held_out[:SAMPLED]
        true = self._data.latents.batch(crops, crops)
        noise = SeededNoise(range(len(crops)), true.mask.sum(dim=1).tolist())
        z = torch.from_numpy(noise(tuple(true.mean.shape))).to(device)
        condition = self._data.prompts([crop.caption for crop in crops])
        model, sampler, steps = self._sampling(network)
        sampled = sample(model, sampler, z, condition, true.mask, steps, noise)[true.mask]
        squared = true.mean.square() + (self._spread * true.std).square()
        latent_size = float((sampled.square().mean() / squared[true.mask].mean()).sqrt())
        return {**losses, "latent_size": latent_size}

    def _sampling(self, network: DenoiserNetwork) -> tuple[Estimator, Sampler, int]:
        objective, sampling = self._experiment.denoiser_objective, self._experiment.sampling
        model = ParametrizedDenoiser(network, objective.parametrization, objective.schedule)
        model = guided(sampling.guidance_rule, model, self._null, sampling.guidance)
        sampler = sampler_named(sampling.sampler, objective.schedule)
        return model, sampler, min(SAMPLING_STEPS, sampling.steps)

    @torch.no_grad()
    def sample(self, network: DenoiserNetwork) -> list[Motion]:
        """Motions for the prompts of a few held-out clips."""
        every = [crop.caption for crop in self._data.held_out]
        captions = [caption for caption in every if caption] or every
        # Four, spread over the held-out clips, fit into one picture.
        captions = captions[:: max(1, len(captions) // 4)][:4]
        if not captions:
            return []
        condition = self._data.prompts(captions)
        return self._previews.sample(*self._sampling(network), condition, captions)

    def _loss(
        self,
        network: DenoiserNetwork,
        crops: Sequence[Crop],
        among: Sequence[Crop],
        randomness: StepRandomness,
        dropped: float,
        at: float | None = None,
    ) -> torch.Tensor:
        objective, spread = self._experiment.denoiser_objective, self._spread
        latents = self._data.latents.batch(crops, among)
        shape = latents.mean.shape[1:]
        z0 = latents.mean + spread * latents.std * randomness.normal(*shape)
        epsilon, t = randomness.normal(*shape), objective.time(randomness.normal())
        if at is not None:
            t = objective.schedule.time_at(torch.full_like(t, at))
        condition = self._data.prompts([crop.caption for crop in crops])
        condition = drop(condition, self._null, randomness.chance(dropped))
        return denoiser_loss(network, z0, epsilon, t, condition, latents.mask, objective)
