"""From a file of the authors, or of MotionLCM's, to one of our model folders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from torch import Tensor

from latentmotion.checkpoint import FirstStageModel, LatentModel, load_weights, save_model
from latentmotion.condition.task import ActionTask, TextTask
from latentmotion.data.humanact12 import ACTIONS
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.prediction import Epsilon, Sample
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import ModelCard, Provenance
from latentmotion.model.config import DenoiserConfig
from latentmotion.model.vae_config import IdentityVAEConfig, TransformerVAEConfig
from latentmotion.networks.build import build
from latentmotion.storage.files import sha256
from latentmotion.upstream import names
from latentmotion.upstream.configurations import Unstated, denoiser_config, is_actor, vae_config
from latentmotion.upstream.reading import read_checkpoint, split_parts
from latentmotion.vae.interface import MotionVAE

_TEXT_ENCODERS = ("openai/clip-vit-large-patch14", "sentence-transformers/sentence-t5-large")
"""The text encoders of MLD and of MotionLCM."""

_FRAMES = {"text": (16, 196), "action": (60, 60)}
"""Shortest and longest motions that MLD's models were trained on."""

_REPRESENTATIONS = {263: "humanml3d", 251: "kit", 150: "smpl"}
"""Representation that a number of features means."""


@dataclass(frozen=True)
class Origin:
    """What a checkpoint leaves out, and what the user knows of it."""

    normalizer: tuple[np.ndarray, np.ndarray] | None = None
    """Mean and standard deviation of each feature, as its data set publishes them."""
    unstated: Unstated = field(default_factory=Unstated)
    """What shapes can't tell."""
    predicts: Literal["epsilon", "sample"] = "epsilon"
    """What the denoiser was trained to predict."""
    text_encoder: str | None = None
    """The text encoder it was trained with; by default MLD's or MotionLCM's."""
    labels: tuple[str, ...] = ()
    """Names of the actions, in order; by default HumanAct12's for its twelve, else numbers."""


def convert_checkpoint(
    path: str | Path, output: str | Path, origin: Origin | None = None
) -> dict[str, int]:
    """Converts the authors' checkpoint; writes the whole folder or nothing.

    Args:
        path: Lightning file, or a dictionary of tensors.
        output: The model folder to write.
        origin: What the file leaves out.

    Returns:
        How many weights of other networks (evaluators, CLIP, SMPL) were left behind, by name.

    Raises:
        ModelError: The file can't be opened safely, or is not what MLD's code writes.
        InputError: The normalizer is missing or does not fit.
    """
    origin = origin or Origin()
    parts, others = split_parts(read_checkpoint(path))
    if not any(parts.values()):
        raise ModelError(
            f"{path} has no weights under 'vae.' or 'denoiser.'; found {_some(others)}"
        )
    second = _denoiser(parts["denoiser"], origin.unstated, path) if parts["denoiser"] else None
    denoiser, config = second or (None, None)
    vae, vae_config = _vae(parts["vae"], config, origin.unstated, path)
    card = _card(Path(path), vae_config, config, origin)
    model = LatentModel(card, vae, denoiser) if denoiser else FirstStageModel(card, vae)
    save_model(output, model)
    return others


def _vae(
    weights: Mapping[str, Tensor],
    denoiser: DenoiserConfig | None,
    unstated: Unstated,
    path: str | Path,
) -> tuple[MotionVAE, TransformerVAEConfig | IdentityVAEConfig]:
    """Without weights the diffusion is on raw frames, as wide as the denoiser's latents."""
    if not weights and denoiser is not None:
        frames = IdentityVAEConfig(denoiser.latent_width)
        return build(frames), frames
    config = vae_config(weights, unstated)
    mld = names.MLD_VAE_JOINT if config.decoding == "joint" else names.MLD_VAE
    rules = names.ACTOR_VAE if is_actor(weights) else mld
    network = build(config)
    load_weights(network, names.rename(weights, rules), f"{path}, vae")
    return network, config


def _denoiser(
    weights: Mapping[str, Tensor], unstated: Unstated, path: str | Path
) -> tuple[Denoiser, DenoiserConfig]:
    config = denoiser_config(weights, unstated)
    cross = config.attention == "cross"
    # Left over from older versions, or written but never used where there is no cross-attention.
    unused = {"sequence_pos_encoding.pe"} | (set() if cross else {"mem_pos.pe"})
    used = {name: tensor for name, tensor in weights.items() if name not in unused}
    network = build(config)
    rules = names.DENOISER_CROSS if cross else names.DENOISER_IN_CONTEXT
    if config.condition_projection == "linear":
        rules = names.LINEAR_TEXT + rules
    load_weights(network, names.rename(used, rules), f"{path}, denoiser")
    return network, config


def _card(
    path: Path,
    vae: TransformerVAEConfig | IdentityVAEConfig,
    denoiser: DenoiserConfig | None,
    origin: Origin,
) -> ModelCard:
    features, encoded = vae.features, vae.has_weights
    mean, std = _normalizer(features, origin)
    condition = _condition(denoiser, origin)
    return ModelCard(
        name=path.stem,
        representation=_REPRESENTATIONS.get(features, f"unknown-{features}"),
        normalizer_mean=mean,
        normalizer_std=std,
        latents=vae.latent_space(),
        schedule=ScaledLinear() if encoded else ScaledLinear(offset=0, ends_clean=True),
        prediction=Epsilon() if origin.predicts == "epsilon" else Sample(),
        vae=vae,
        denoiser=denoiser,
        condition=condition,
        steps=50 if encoded else 1000,
        guidance=7.5,
        sampler="ddim" if encoded else "ddpm",
        frames=_FRAMES[condition.name],
        provenance=_provenance(path),
    )


def _condition(denoiser: DenoiserConfig | None, origin: Origin) -> TextTask | ActionTask:
    if denoiser is None:
        return TextTask()
    if denoiser.condition_projection == "table":
        return ActionTask(_labels(denoiser.condition_width, origin))
    usual = _TEXT_ENCODERS[denoiser.condition_projection == "linear"]
    return TextTask(origin.text_encoder or usual, denoiser.condition_width)


def _labels(count: int, origin: Origin) -> tuple[str, ...]:
    usual = ACTIONS if count == len(ACTIONS) else tuple(map(str, range(count)))
    labels = origin.labels or usual
    if len(set(labels)) != count:
        raise InputError(f"{len(set(labels))} labels for a checkpoint of {count} actions")
    return labels


def _normalizer(features: int, origin: Origin) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if origin.normalizer is None and features == 150:
        return (0.0,) * features, (1.0,) * features  # action data is not normalized
    if origin.normalizer is None:
        raise InputError(
            "the authors' checkpoints don't hold the mean and deviation of the features; pass the "
            "data set's own: --mean Mean.npy --std Std.npy (HumanML3D's are in its repository)"
        )
    mean, std = (tuple(map(float, np.ravel(values))) for values in origin.normalizer)
    if not len(mean) == len(std) == features:
        found = f"{len(mean)} means and {len(std)} deviations"
        raise InputError(f"the normalizer has {found}, the checkpoint {features} features")
    return mean, std


def _provenance(path: Path) -> Provenance:
    return Provenance(
        data_hashes={path.name: sha256(path)},
        license="as its authors say (MLD's code is MIT, MotionLCM's is for non-commercial use; the "
        "data behind it has terms of its own)",
        commands=(f"latentmotion convert {path.name}",),
    )


def _some(others: Mapping[str, int]) -> str:
    return ", ".join(list(others)[:5]) or "nothing"
