"""Another decoder for the latents of a trained model: a cheaper one, or the same trained again.

The encoder stays bit-identical, so that the model's denoiser fits as before. A decoder that has
seen only latents of real motions is worse on a denoiser's latents, which lack detail. Latents of
real motions that are noised and denoised lack it too, and it is known what they stand for: so the
decoder learns to give back what denoising takes away.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

import torch
from jaxtyping import Bool

from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.diffusion.parametrization import add_noise
from latentmotion.errors import InputError, ModelError
from latentmotion.export.package import OF_DENOISER, check_latents, figures_of, scale_of
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.config import VAEConfig
from latentmotion.networks import checkpoint
from latentmotion.networks.vae.interface import Latents, MotionVAE, copy_encoder, encoder_state
from latentmotion.representation.interface import Scale
from latentmotion.storage.files import sha256
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.experiment import Experiment, differing_keys
from latentmotion.training.loop import train
from latentmotion.training.run_folder import MODEL, Run, open_run, provenance_of
from latentmotion.training.task_conditions import ConditionTable, required_encoder
from latentmotion.training.vae import VAEStage


class DenoisedStage(VAEStage):
    """A decoder that learns from latents as a denoiser leaves them.

    Each motion's latents are noised to a time between 0 and `latest` and denoised at once, without
    a prompt.

    Args:
        vae: The network to train.
        dataset: Motions.
        experiment: Crops and loss.
        context: The device and rank.
        model: Whose denoiser it is, and the scale of its latents.
        encoder: The model's, where it reads sentences.
        latest: The latest time, below 1.
    """

    def __init__(
        self,
        vae: MotionVAE,
        dataset: Dataset,
        experiment: Experiment,
        context: DistributedContext,
        model: checkpoint.LatentModel,
        encoder: TextEncoder | None,
        latest: float,
    ) -> None:
        super().__init__(vae, dataset, experiment, context)
        card, device = model.card, context.device
        condition = card.prompt_condition(partial(required_encoder, encoder))
        self._null, self._latest = ConditionTable(condition, [], device), latest
        denoiser = model.denoiser.eval().requires_grad_(False).to(device)
        self._denoiser = card.parametrized(denoiser.__call__)  # no part of this module
        self._scale = Scale(torch.tensor(card.latents.mean), torch.tensor(card.latents.std))

    @torch.no_grad()
    def _latents_to_decode(
        self, randomness: StepRandomness, drawn: Latents, mask: Bool[torch.Tensor, "batch tokens"]
    ) -> Latents:
        z0, t = self._scale.normalize(drawn.float()), self._latest * randomness.uniform()
        z = add_noise(z0, randomness.normal(*z0.shape[1:]), t, self._denoiser.schedule)
        output = self._denoiser.denoiser(z, t, self._null([""] * len(z)), mask)
        estimate, _ = self._denoiser.estimates(output.float(), z, t)
        return self._scale.denormalize(estimate)


def train_decoder(
    experiment: Experiment,
    data: Path,
    model: Path,
    folder: Path,
    context: DistributedContext,
    denoised: float = 0.0,
    encoder: TextEncoder | None = None,
) -> Path:
    """Trains a decoder for a model's latents, or resumes its training; returns the model's folder.

    Args:
        experiment: Its VAE has the model's encoder; stage 1's settings say how to train.
        data: Prepared folder.
        model: Model folder, with or without a denoiser.
        folder: Run folder.
        context: The device and rank.
        denoised: Latest time to which latents are noised, to learn from what the model's denoiser
            makes of them; 0 for latents as they are.
        encoder: The model's text encoder, where its denoiser reads sentences and is needed.

    Raises:
        DataError: The data cannot be used.
        ModelError: The model is missing, has no VAE, or no denoiser where one is needed.
        InputError: The run folder holds another run, or model, data and decoder do not fit.
    """
    if not 0 <= denoised < 1:
        raise InputError(f"latents noised to time {denoised}: expected 0 (not noised) to below 1")
    dataset, training = Dataset.load(data), experiment.vae_training
    trained = checkpoint.load_stages(model)
    check_data(trained.card, dataset)
    torch.manual_seed(training.seed)
    vae = vae_with_latents_of(trained, experiment.vae)
    parents = {"model": sha256(model / checkpoint.WEIGHTS_FILE), "denoised": str(denoised)}
    open_run(folder, Run("decoder", dataset.fingerprint, parents, experiment), context)
    parts = vae, dataset, experiment, context
    stage = (
        DenoisedStage(*parts, checkpoint.load_model(model), encoder, denoised)
        if denoised
        else VAEStage(*parts)
    )
    vae, seconds = train(stage, training, folder, context)
    if context.is_main:
        # What was measured of the old decoder is left out.
        before, provenance = trained.card.figures, trained.card.provenance
        figures = {f"vae_{name}": round(v, 3) for name, v in stage.validate(vae).items()}
        figures["decoder_hours"] = round(before.get("decoder_hours", 0.0) + seconds / 3600, 3)
        card = replace(
            trained.card,
            vae=experiment.vae,
            provenance=provenance_of(dataset, seconds, provenance),
            figures={**figures_of(trained.card, OF_DENOISER), **figures},
        )
        with_new_decoder = replace(trained, card=card, vae=vae)
        check_latents(trained, with_new_decoder)
        checkpoint.save_model(folder / MODEL, with_new_decoder)
    return folder / MODEL


def light_decoder_config(model: Path) -> VAEConfig:
    """Returns the configuration of a model's VAE, with the decoder that costs least.

    That may be the decoder which it has.

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


def vae_with_latents_of(trained: checkpoint.FirstStageModel, config: VAEConfig) -> MotionVAE:
    """Builds a VAE with a model's encoder, frozen.

    Raises:
        ModelError: The model has no VAE.
        InputError: The encoder is another.
    """
    if not trained.card.vae.has_weights:
        raise ModelError(f"model {trained.card.name!r} has no VAE: run latentmotion train vae")
    vae = checkpoint.build(config)
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


def _sizes(vae: MotionVAE) -> dict[str, list[int]]:
    return {name: list(value.shape) for name, value in encoder_state(vae).items()}


def _another_encoder(card: ModelCard, *how: str) -> InputError:
    return InputError(
        f"model {card.name!r} has another encoder ({', '.join(how)}); change nothing of vae but "
        "its decoder (or decoding)"
    )
