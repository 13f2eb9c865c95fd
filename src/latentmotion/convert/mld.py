"""MLD's and MotionLCM's checkpoints to model folders.

The shapes of the weights determine most of the configuration; the rest are options. Layouts: MLD's
for text, actions and raw frames, and MotionLCM's of the same networks (Dai et al. 2024), where a
linear map on each side makes latents narrower than the transformers.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from torch import Tensor

from latentmotion.convert import reading
from latentmotion.data.sources.actor import ACTIONS
from latentmotion.diffusion.condition import ActionTask, TextTask
from latentmotion.diffusion.parametrization import Epsilon, Sample
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.errors import InputError, ModelError
from latentmotion.model import config as configs
from latentmotion.model.card import ModelCard, Provenance
from latentmotion.networks import checkpoint
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.transformer import LEARNED_LENGTH
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.storage.files import sha256

Weights = Mapping[str, Tensor]

# The text encoders of MLD and of MotionLCM.
_TEXT_ENCODERS = ("openai/clip-vit-large-patch14", "sentence-transformers/sentence-t5-large")

# Shortest and longest motions that MLD's models were trained on.
_FRAMES = {"text": (16, 196), "action": (60, 60)}

# Representation by the number of features.
_REPRESENTATIONS = {263: "humanml3d", 251: "kit", 150: "smpl"}


@dataclasses.dataclass(frozen=True)
class Origin:
    """Facts about a checkpoint that it does not state; the defaults are the authors'."""

    # Mean and standard deviation of each feature, as its data set publishes them.
    normalizer: tuple[np.ndarray, np.ndarray] | None = None
    heads: int = 4  # Attention heads.
    dropout: float = 0.1  # Dropout rate of further training.
    activation: Literal["gelu", "relu"] = "gelu"  # Activation of the VAE's feed-forward layers.
    # Whether the VAE's layers normalize after or before their sublayers.
    norm: Literal["post", "pre"] = "post"
    # Activation between the text's embedding and its projection; by default ReLU as in MLD, and
    # none if the denoiser projects its latents, as in MotionLCM.
    text_activation: Literal["relu", "none"] | None = None
    # Quantity that the denoiser was trained to predict.
    predicts: Literal["epsilon", "sample"] = "epsilon"
    # Text encoder that it was trained with; by default MLD's or MotionLCM's.
    text_encoder: str | None = None
    # Names of the actions, in order; by default HumanAct12's for its twelve, else numbers.
    labels: tuple[str, ...] = ()
    diffusion_steps: int = 1000  # Steps of MDM's diffusion: 1,000, or 50 in its fast form.


def latent_model(
    parts: Mapping[str, Weights], path: Path, origin: Origin
) -> checkpoint.LatentModel | checkpoint.FirstStageModel:
    """Returns the model of the authors' networks.

    Args:
        parts: Weights of `reading.PARTS`, without these prefixes.
        path: The checkpoint, for the card and for error messages.
        origin: What the file does not state.

    Raises:
        ModelError: A weight is missing or has another shape.
        InputError: The normalizer is missing or does not fit.
    """
    denoiser = config = None
    if parts["denoiser"]:
        denoiser, config = load_denoiser(parts["denoiser"], origin, path)
    if parts["vae"] or config is None:
        vae, first_stage = load_vae(parts["vae"], origin, path)
    else:  # the diffusion is on raw frames, as wide as the denoiser's latents
        first_stage = configs.IdentityVAEConfig(config.latent_width)
        vae = checkpoint.build(first_stage)
    card = model_card(path, first_stage, config, origin)
    if denoiser is None:
        return checkpoint.FirstStageModel(card, vae)
    return checkpoint.LatentModel(card, vae, denoiser)


def load_vae(
    weights: Weights, origin: Origin, path: str | Path
) -> tuple[MotionVAE, configs.TransformerVAEConfig]:
    """Builds the network of an `MldVae` or `ActorVae` and loads its weights.

    Args:
        weights: Weights without the prefix `vae.`.
        origin: What shapes do not determine.
        path: The checkpoint, for error messages.

    Raises:
        ModelError: A weight is missing or has another shape.
    """
    config = vae_config(weights, origin)
    names = ("actor",) if is_actor(weights) else ("vae", f"vae_{config.decoding}")
    return loaded(lambda: checkpoint.build(config), weights, names, f"{path}, vae"), config


def load_denoiser(
    weights: Weights, origin: Origin, path: str | Path
) -> tuple[DenoiserNetwork, configs.DenoiserConfig]:
    """Builds the network of an `MldDenoiser` and loads its weights.

    Args:
        weights: Weights without the prefix `denoiser.`.
        origin: What shapes do not determine.
        path: The checkpoint, for error messages.

    Raises:
        ModelError: A weight is missing or has another shape.
    """
    config = denoiser_config(weights, origin)
    # Left over from older versions, or written but never used without cross-attention.
    unused = {"sequence_pos_encoding.pe"}
    unused |= set() if config.attention == "cross" else {"mem_pos.pe"}
    used = {name: tensor for name, tensor in weights.items() if name not in unused}
    text = ("linear_text",) if config.condition_projection == "linear" else ()
    names = (*text, "denoiser", f"denoiser_{config.attention}")
    return loaded(lambda: checkpoint.build(config), used, names, f"{path}, denoiser"), config


def loaded(
    make: Callable[[], checkpoint.Network], weights: Weights, names: Sequence[str], where: str
) -> checkpoint.Network:
    """Returns a network with the authors' weights.

    Args:
        make: Builds the network.
        weights: The weights under the authors' names.
        names: Parts of `names.toml` that rename them, in order.
        where: What is read, for error messages.

    Raises:
        ModelError: A weight is missing or has another shape.
    """
    return checkpoint.built(make, reading.rename(weights, reading.rules_of(*names)), where)


def model_card(
    path: Path,
    vae: configs.TransformerVAEConfig | configs.IdentityVAEConfig,
    denoiser: configs.DenoiserConfig | None,
    origin: Origin,
) -> ModelCard:
    """Returns the card of a converted model.

    Args:
        path: The checkpoint.
        vae: Configuration of the VAE.
        denoiser: Configuration of the denoiser, if the checkpoint has one.
        origin: What the checkpoint does not state.

    Raises:
        InputError: The normalizer is missing, or it or the labels do not fit.
    """
    features, encoded = vae.features, vae.has_weights
    if origin.normalizer is None and features != 150:
        raise InputError(
            "the authors' checkpoints don't hold the mean and deviation of the features; pass the "
            "data set's own: --mean Mean.npy --std Std.npy (HumanML3D's are in its repository)"
        )
    # Action data is not normalized.
    statistics = origin.normalizer or (np.zeros(features), np.ones(features))
    mean, std = (tuple(map(float, np.ravel(values))) for values in statistics)
    if not len(mean) == len(std) == features:
        sizes = f"{len(mean)} means and {len(std)} deviations"
        raise InputError(f"the normalizer has {sizes}, the checkpoint {features} features")
    condition = _condition(denoiser, origin)
    return ModelCard(
        name=path.stem,
        representation=_REPRESENTATIONS.get(features, f"unknown-{features}"),
        normalizer_mean=mean,
        normalizer_std=std,
        latents=vae.latent_space(),
        schedule=ScaledLinear() if encoded else ScaledLinear(offset=0, ends_clean=True),
        parametrization=Epsilon() if origin.predicts == "epsilon" else Sample(),
        vae=vae,
        denoiser=denoiser,
        condition=condition,
        # The authors' configuration: 50 steps on latents, all 1,000 on raw frames.
        sampling=configs.Sampling(*((50, 7.5, "ddim") if encoded else (1000, 7.5, "ddpm"))),
        frames=_FRAMES[condition.name],
        provenance=Provenance(
            data_hashes={path.name: sha256(path)},
            license="as its authors say (MLD's code is MIT, MotionLCM's is for non-commercial use; "
            "the data behind it has terms of its own)",
            commands=(f"latentmotion convert {path.name}",),
        ),
    )


def vae_config(weights: Weights, origin: Origin) -> configs.TransformerVAEConfig:
    """Returns the configuration of an `MldVae` or `ActorVae` from its weights without `vae.`."""
    if is_actor(weights):
        return configs.TransformerVAEConfig(
            features=shape(weights, "decoder.final_layer.weight")[0],
            tokens=1,
            transformer=transformer(weights, "encoder.seqTransEncoder.", origin),
            position="sine",
        )
    tokens, _ = shape(weights, "global_motion_token")
    linear = "dist_layer.weight" in weights
    joint = "decoder.middle_block.multihead_attn.out_proj.weight" not in weights
    return configs.TransformerVAEConfig(
        features=shape(weights, "final_layer.weight")[0],
        tokens=tokens if linear else tokens // 2,
        transformer=transformer(weights, "encoder.", origin),
        position=_position(weights, "query_pos_encoder.pe"),
        distribution="linear" if linear else "tokens",
        decoding="joint" if joint else "cross",
        latent_width=shape(weights, "latent_pre.weight")[0] if is_motionlcm(weights) else None,
    )


def is_actor(weights: Weights) -> bool:
    """Returns whether these are the weights of an `ActorVae`."""
    return "encoder.mu_token" in weights


def is_motionlcm(weights: Weights) -> bool:
    """Returns whether a VAE or denoiser maps its latents to another width, as MotionLCM's do."""
    return "latent_pre.weight" in weights


def denoiser_config(weights: Weights, origin: Origin) -> configs.DenoiserConfig:
    """Returns the configuration of an `MldDenoiser` from its weights without `denoiser.`.

    Raises:
        ModelError: The denoiser is a distilled one, or a weight is missing.
    """
    if "time_embedding.cond_proj.weight" in weights:
        raise ModelError(
            "this denoiser takes the guidance scale as an input, as the distilled models of "
            "MotionLCM do; only the model it was distilled from can be converted (mld_humanml.ckpt)"
        )
    cross = any(name.startswith("decoder.") for name in weights)
    # The denoiser's constructor ignored settings that the VAE's applied.
    always = dataclasses.replace(origin, activation="gelu", norm="post")
    stack = transformer(weights, "decoder." if cross else "encoder.", always)
    frames = "pose_embd.weight" in weights
    in_context = "context_first" if frames else "latents_first"
    projections = [n for n in ("pose_embd.weight", "latent_pre.weight") if n in weights]
    projection: Literal["linear", "relu_linear", "table", "none"] = "none"
    condition_width = stack.width
    if "emb_proj.action_embedding" in weights:
        projection = "table"
        condition_width = shape(weights, "emb_proj.action_embedding")[0]
    elif "emb_proj.1.weight" in weights:
        usual = "none" if is_motionlcm(weights) else "relu"
        linear = (origin.text_activation or usual) == "none"
        projection = "linear" if linear else "relu_linear"
        condition_width = shape(weights, "emb_proj.1.weight")[1]
    return configs.DenoiserConfig(
        latent_width=shape(weights, projections[0])[1] if projections else stack.width,
        condition_width=condition_width,
        transformer=stack,
        project_latents=frames or is_motionlcm(weights),
        condition_projection=projection,
        attention="cross" if cross else "in_context",
        positions="separate" if cross else in_context,
        position=_position(weights, "query_pos.pe"),
        sine_width=shape(weights, "time_embedding.linear_1.weight")[1],
        attends_to_padding=frames,
    )


def _condition(denoiser: configs.DenoiserConfig | None, origin: Origin) -> TextTask | ActionTask:
    if denoiser is None:
        return TextTask()
    if denoiser.condition_projection == "table":
        count = denoiser.condition_width
        usual = ACTIONS if count == len(ACTIONS) else tuple(map(str, range(count)))
        labels = origin.labels or usual
        if len(set(labels)) != count:
            raise InputError(f"{len(set(labels))} labels for a checkpoint of {count} actions")
        return ActionTask(labels)
    encoder = origin.text_encoder or _TEXT_ENCODERS[denoiser.condition_projection == "linear"]
    return TextTask(encoder, denoiser.condition_width)


def transformer(weights: Weights, stack: str, origin: Origin) -> configs.TransformerConfig:
    """Returns the configuration of the layers whose names begin with `stack`."""
    skips = f"{stack}middle_block.linear1.weight" in weights
    one_layer = "middle_block" if skips else "layers.0"
    hidden, width = shape(weights, f"{stack}{one_layer}.linear1.weight")
    return configs.TransformerConfig(
        width=width,
        layers=_count(weights, f"{stack}input_blocks.") * 2 + 1
        if skips
        else _count(weights, f"{stack}layers."),
        heads=origin.heads,
        hidden=hidden,
        dropout=origin.dropout,
        activation=origin.activation,
        norm=origin.norm,
        skips=skips,
        final_norm=f"{stack}norm.weight" in weights,
    )


def _count(weights: Weights, prefix: str) -> int:
    names = (name.removeprefix(prefix) for name in weights if name.startswith(prefix))
    return len({name.partition(".")[0] for name in names})


def _position(weights: Weights, name: str) -> configs.PositionKind:
    return "learned" if shape(weights, name)[0] <= LEARNED_LENGTH else "sine"


def shape(weights: Weights, name: str) -> tuple[int, ...]:
    """Returns the shape of a weight; raises ModelError where it is missing."""
    if name not in weights:
        raise ModelError(f"the weights {name!r} are missing; it is another variant")
    return tuple(weights[name].shape)
