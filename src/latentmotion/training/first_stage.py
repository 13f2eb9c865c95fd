"""What stage 2 builds on: a trained VAE, and the latents that it makes of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from latentmotion.data.dataset import Crop, Dataset, Item
from latentmotion.engine.backend import normalizer_of
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import CARD_FILE, ModelCard
from latentmotion.model.config import LatentSpace
from latentmotion.networks.build import build
from latentmotion.networks.checkpoint import WEIGHTS_FILE, load_stages
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.storage.files import sha256
from latentmotion.training import denoiser
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment, LatentSettings
from latentmotion.training.run_folder import MODEL, NAME
from latentmotion.training.task_conditions import ConditionTable, TaskConditioning, items_to_learn
from latentmotion.training.vae import BatchSampler, FeatureCache

HELD_OUT = 128
"""Most held-out crops that a validation looks at."""


@dataclass(frozen=True)
class FirstStage:
    """A trained VAE."""

    vae: MotionVAE
    """The network, frozen."""
    card: ModelCard
    """What it is."""
    fingerprint: str
    """Hash of its weights."""


def load_first_stage(folder: Path) -> FirstStage:
    """Loads the VAE that `latentmotion train vae` made, from its run folder or model folder.

    Raises:
        ModelError: There is none, or it is not trained to the end.
    """
    model = folder / MODEL if (folder / MODEL / CARD_FILE).is_file() else folder
    if not (model / CARD_FILE).is_file():
        state = "a run that has not ended" if (folder / NAME).is_file() else "no trained model"
        raise ModelError(
            f"{folder} holds {state}; stage 2 needs a trained VAE: run latentmotion train vae "
            "to its end and pass its run folder"
        )
    trained = load_stages(model)
    vae = trained.vae.eval().requires_grad_(False)
    return FirstStage(vae, trained.card, sha256(model / WEIGHTS_FILE))


def frames_as_first_stage(experiment: Experiment, dataset: Dataset) -> FirstStage:
    """Returns the first stage of a diffusion on raw frames, which needs no training.

    Raises:
        InputError: The frames should be normalized as latents.
    """
    config, card = denoiser.frames_card(experiment, dataset)
    return FirstStage(build(config), card, "none")


def check_fit(
    experiment: Experiment, dataset: Dataset, first: FirstStage, conditioning: TaskConditioning
) -> None:
    """Compares the parts of stage 2.

    Raises:
        InputError: Two of them do not fit.
    """
    pairs = {
        "representation of data and VAE": (dataset.representation.name, first.card.representation),
        "denoiser.latent_width and the VAE's": (
            experiment.denoiser.latent_width,
            first.vae.latent_width,
        ),
        "denoiser.condition_width and the text encoder's": (
            experiment.denoiser.condition_width,
            conditioning.width,
        ),
    }
    for name, (one, other) in pairs.items():
        if one != other:
            raise InputError(f"{name}: {one} and {other}, expected the same; change one of them")


def prepare_latents(
    experiment: Experiment,
    dataset: Dataset,
    first: FirstStage,
    conditioning: TaskConditioning,
    folder: Path,
    context: DistributedContext,
    space: LatentSpace | None = None,
) -> tuple[denoiser.LatentData, LatentSpace]:
    """Encodes crops and prompts, or reads them from the run folder.

    Latents are scaled as `space` says; by default their statistics are measured.
    """
    settings, training = experiment.latents, experiment.denoiser_training
    clips = dataset.clips("train", mirrored=experiment.mirrored), dataset.clips("val")
    seen, held_out = (items_to_learn(conditioning.task, part) for part in clips)
    held_out = held_out[:HELD_OUT]
    unseen = denoiser.keep_crops(held_out, settings.cropping, 1, training.seed).every()
    features = partial(FeatureCache, dataset, [*clips[0], *clips[1]], normalizer_of(first.card))
    if not first.card.vae.has_weights:
        cropping, space = settings.cropping, space or first.card.latents
        latents = denoiser.FrameCache(features(), context.device)
    else:
        cropping = denoiser.keep_crops(seen, settings.cropping, settings.per_item, training.seed)
        latents, space = _encode(
            settings, first, features, (cropping.every(), unseen), folder, context, space
        )
    prompts = ConditionTable(
        conditioning.condition, captions_of([*seen, *held_out]), context.device
    )
    batches = BatchSampler(seen, training.batch_size, cropping, training.seed)
    return denoiser.LatentData(batches, tuple(unseen), latents, prompts), space


def _encode(
    settings: LatentSettings,
    first: FirstStage,
    features: Callable[[], FeatureCache],
    crops: tuple[list[Crop], list[Crop]],
    folder: Path,
    context: DistributedContext,
    space: LatentSpace | None,
) -> tuple[denoiser.LatentCache, LatentSpace]:
    """Encodes seen and unseen crops, or reads their posteriors.

    The seen ones give the scale where no space is given.
    """
    every = [*crops[0], *crops[1]]

    def encode() -> denoiser.Posteriors:
        return denoiser.encode_crops(first.vae.to(context.device), features(), every, context)

    posteriors = denoiser.cached_posteriors(folder / "latents.safetensors", encode, context)
    if space is None:
        space = first.card.latents
        if settings.normalized:
            space = measured(space, posteriors.take(range(len(crops[0]))))
    posteriors = posteriors.normalized(space.mean, space.std).to(context.device)
    return denoiser.LatentCache(every, posteriors), space


def measured(space: LatentSpace, posteriors: denoiser.Posteriors) -> LatentSpace:
    """Returns the latent space with mean and deviation per channel as these have them."""
    mean, std = posteriors.channel_statistics()
    return replace(space, mean=tuple(mean), std=tuple(std))


def captions_of(items: list[Item]) -> set[str]:
    """Returns all prompts of some items."""
    return {caption for item in items for caption in item.captions}
