"""Another decoder for the latents of a trained model: a cheaper one, or the same trained again.

The encoder stays bit-identical, so that the model's denoiser fits as before. A decoder that has
seen only latents of real motions is worse on a denoiser's latents. The ends of a teacher's
trajectories, which distillation keeps, are such latents; what the decoder that they were generated
for makes of them can be the target of the new one (knowledge distillation).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.export.swap_decoder import check_latents, other_figures, scale_of
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.config import VAEConfig
from latentmotion.networks.build import build
from latentmotion.networks.checkpoint import WEIGHTS_FILE, FirstStageModel, load_stages, save_model
from latentmotion.networks.vae.interface import (
    MotionVAE,
    copy_encoder,
    encoder_state,
    feature_losses,
    weighted_sum,
)
from latentmotion.representation.interface import Scale
from latentmotion.storage.files import sha256
from latentmotion.training.distillation.trajectories import TRAJECTORIES_FILE, ends_of
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment, differing_keys
from latentmotion.training.loop import train
from latentmotion.training.run_folder import MODEL, Run, open_run, provenance_of
from latentmotion.training.vae import VAEStage


@dataclass(frozen=True)
class Imitation:
    """Latents, the shortest first, and the decoder that answers to them."""

    latents: Float[torch.Tensor, "motions tokens width"]
    """Latents in the VAE's own scale."""
    mask: Bool[torch.Tensor, "motions tokens"]
    """True on real tokens."""
    frames_per_token: int
    """Frames per latent token."""
    vae: MotionVAE
    """The VAE whose output is learned, frozen."""
    fingerprint: str
    """Hash of the latents and of its weights."""

    def rows(self, step: int, batch: int, seed: int) -> range:
        """Returns the rows of step number `step`: neighbors, so of similar length."""
        last = max(len(self.mask) - batch, 0)
        first = int(np.random.default_rng([seed, step]).integers(last + 1))
        return range(first, min(first + batch, len(self.mask)))

    def batch(
        self, rows: range, frames: int
    ) -> tuple[Float[torch.Tensor, "batch tokens width"], Bool[torch.Tensor, "batch frames"]]:
        """Returns latents for at most so many frames, and the mask of the frames."""
        mask = self.mask[list(rows)]
        tokens = min(int(mask.sum(dim=1).max()), frames // self.frames_per_token)
        frame_mask = mask[:, :tokens].repeat_interleave(self.frames_per_token, dim=1)
        return self.latents[list(rows), :tokens], frame_mask


class ImitatingStage(VAEStage):
    """A VAE that learns from motions and, as much, from another decoder on generated latents.

    Args:
        vae: The network to train.
        dataset: Motions.
        experiment: Crops and loss.
        context: The device and rank.
        imitation: Generated latents and who decodes them.
    """

    def __init__(
        self,
        vae: MotionVAE,
        dataset: Dataset,
        experiment: Experiment,
        context: DistributedContext,
        imitation: Imitation,
    ) -> None:
        super().__init__(vae, dataset, experiment, context)
        self._imitation = imitation
        imitation.vae.to(context.device)
        self._most = experiment.vae_cropping.max_frames

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`; "imitated" is that on generated latents."""
        losses = super().forward(step)
        settings, context = self._settings, self._context
        rows = self._imitation.rows(step, settings.batch_size, settings.seed)
        batch = self._imitation.batch(rows[context.ranks.shard(len(rows))], self._most)
        latents, mask = (part.to(context.device) for part in batch)
        with torch.no_grad(), torch.autocast(context.device.type, enabled=False):
            true = self._imitation.vae.decode(latents, mask)
        decoded = self.network.decode(latents, mask).float()
        fps, objective = self._dataset.representation.fps, self._objective
        parts = feature_losses(decoded, true, mask, self._joints, fps, objective, self.skeleton)
        imitated = weighted_sum(parts, objective)
        return {**losses, "total": losses["total"] + imitated, "imitated": imitated}


def load_imitation(run: Path, model: FirstStageModel) -> Imitation:
    """Reads what a distillation generated, and the decoder that its model has.

    Args:
        run: Run folder of a distillation that ended.
        model: The model for whose latents a decoder is trained.

    Raises:
        ModelError: The run has made no model.
        InputError: It keeps no trajectories, or its latents are others, or have no time axis.
    """
    student = load_stages(run / MODEL)
    check_latents(model, student)
    trajectories, space = run / TRAJECTORIES_FILE, student.card.latents
    if not trajectories.is_file() or space.frames_per_token is None:
        raise InputError(
            f"{run}: expected latents over time in {TRAJECTORIES_FILE}; pass the run folder of a "
            "distillation by TrajectoryRegression of a model that has such"
        )
    ends, mask = ends_of(trajectories)
    by_length = mask.sum(dim=1).argsort(stable=True)
    latents = Scale(torch.tensor(space.mean), torch.tensor(space.std)).denormalize(ends)
    vae = student.vae.eval().requires_grad_(False)
    fingerprint = sha256(trajectories) + sha256(run / MODEL / WEIGHTS_FILE)
    latents, mask = latents[by_length], mask[by_length]
    return Imitation(latents, mask, space.frames_per_token, vae, fingerprint)


def train_decoder(
    experiment: Experiment,
    data: Path,
    model: Path,
    folder: Path,
    context: DistributedContext,
    imitated: Path | None = None,
) -> Path:
    """Trains a decoder for a model's latents, or resumes its training; returns the model's folder.

    Args:
        experiment: Its VAE has the model's encoder; stage 1's settings say how to train.
        data: Prepared folder.
        model: Model folder, with or without a denoiser.
        folder: Run folder.
        context: The device and rank.
        imitated: Run folder of a distillation, to learn from its decoder on what it generated.

    Raises:
        DataError: The data cannot be used.
        ModelError: The model is missing or has no VAE, or the distillation has not ended.
        InputError: The run folder holds another run, or model, data and decoder do not fit.
    """
    dataset, training = Dataset.load(data), experiment.vae_training
    trained = load_stages(model)
    check_data(trained.card, dataset)
    torch.manual_seed(training.seed)
    vae = vae_with_latents_of(trained, experiment.vae)
    imitation = load_imitation(imitated, trained) if imitated else None
    parents = {"model": sha256(model / WEIGHTS_FILE)}
    if imitation:
        parents["imitated"] = imitation.fingerprint
    open_run(folder, Run("decoder", dataset.fingerprint, parents, experiment), context)
    parts = vae, dataset, experiment, context
    stage = ImitatingStage(*parts, imitation) if imitation else VAEStage(*parts)
    vae, seconds = train(stage, training, folder, context)
    if context.is_main:
        card = decoder_card(trained.card, experiment, dataset, seconds, stage.validate(vae))
        with_new_decoder = replace(trained, card=card, vae=vae)
        check_latents(trained, with_new_decoder)
        save_model(folder / MODEL, with_new_decoder)
    return folder / MODEL


def light_decoder_config(model: Path) -> VAEConfig:
    """Returns the configuration of a model's VAE, with the decoder that costs least.

    Raises:
        ModelError: The model is missing, or there is no cheaper decoder for its VAE.
    """
    card = read_card(model)
    config = card.vae.with_light_decoder()
    if config is None:
        raise ModelError(
            f"model {card.name!r} has a VAE {type(card.vae).__name__}, for which there is no "
            "cheaper decoder; take a convolutional or a transformer VAE"
        )
    return config


def vae_with_latents_of(trained: FirstStageModel, config: VAEConfig) -> MotionVAE:
    """Builds a VAE with a model's encoder, frozen.

    Raises:
        ModelError: The model has no VAE.
        InputError: The encoder is another.
    """
    if not trained.card.vae.has_weights:
        raise ModelError(f"model {trained.card.name!r} has no VAE: run latentmotion train vae")
    vae = build(config)
    actual, expected = _sizes(vae), _sizes(trained.vae)
    if actual != expected:
        raise _another_encoder(trained.card, *islice(differing_keys(expected, actual), 3))
    copy_encoder(vae, trained.vae)
    # Weights do not tell dilations, heads and such: what both make of the same does.
    width, frames = len(trained.card.normalizer_mean), trained.card.frames[1]
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(1, frames, width, generator=generator)
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    with torch.no_grad():
        means = [model.eval().encode(features, mask).mean for model in (vae, trained.vae)]
    if not torch.equal(*means):
        raise _another_encoder(trained.card, "of weights of the same shapes")
    return vae


def check_data(card: ModelCard, dataset: Dataset) -> None:
    """Compares a model's features with those of prepared data.

    Raises:
        InputError: They are others, or scaled otherwise.
    """
    mean, std = dataset.normalizer.mean, dataset.normalizer.std
    if (dataset.representation.name, tuple(mean.tolist()), tuple(std.tolist())) != scale_of(card):
        raise InputError(
            f"{dataset.folder} has other features than model {card.name!r} knows, or another "
            "normalizer; use the data that it was trained on"
        )


def decoder_card(
    trained: ModelCard,
    experiment: Experiment,
    dataset: Dataset,
    seconds: float,
    figures: dict[str, float],
) -> ModelCard:
    """Describes a model with its new decoder; what was measured of the old one is left out."""
    rounded = {f"vae_{name}": round(value, 3) for name, value in figures.items()}
    before = trained.figures.get("decoder_hours", 0.0)
    hours = {"decoder_hours": round(before + seconds / 3600, 3)}
    return replace(
        trained,
        vae=experiment.vae,
        provenance=provenance_of(dataset, seconds, trained.provenance),
        figures={**other_figures(trained), **rounded, **hours},
    )


def _sizes(vae: MotionVAE) -> dict[str, list[int]]:
    return {name: list(value.shape) for name, value in encoder_state(vae).items()}


def _another_encoder(card: ModelCard, *how: str) -> InputError:
    return InputError(
        f"model {card.name!r} has another encoder ({', '.join(how)}); change nothing of vae but "
        "its decoder (or decoding)"
    )
