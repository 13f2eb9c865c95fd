"""What the shapes in a checkpoint tell of its networks, and what they can't tell.

Layouts: MLD's for text, actions and raw frames, and MotionLCM's of the same networks (Dai et al.
2024), where a linear map on each side makes latents narrower than the transformers.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from torch import Tensor

from latentmotion.errors import ModelError
from latentmotion.model.config import DenoiserConfig, PositionKind, TransformerConfig
from latentmotion.model.vae_config import TransformerVAEConfig
from latentmotion.nn.position import LEARNED_LENGTH

Weights = Mapping[str, Tensor]


@dataclass(frozen=True)
class Unstated:
    """What shapes can't tell; the defaults are what the authors trained."""

    heads: int = 4
    """Attention heads."""
    dropout: float = 0.1
    """Share of numbers dropped in further training."""
    activation: Literal["gelu", "relu"] = "gelu"
    """Activation of the VAE's feed-forward parts."""
    norm: Literal["post", "pre"] = "post"
    """Whether the VAE's layers normalize after or before their parts."""
    text_activation: Literal["relu", "none"] | None = None
    """What is between the text's embedding and its projection; by default ReLU as MLD has it, and
    nothing where the denoiser projects its latents, as MotionLCM has it."""


def vae_config(weights: Weights, unstated: Unstated) -> TransformerVAEConfig:
    """Returns the configuration of an `MldVae` or `ActorVae` with the prefix `vae.` removed."""
    return _actor(weights, unstated) if is_actor(weights) else _mld(weights, unstated)


def is_actor(weights: Weights) -> bool:
    """Returns whether these are the weights of an `ActorVae`."""
    return "encoder.mu_token" in weights


def is_motionlcm(weights: Weights) -> bool:
    """Returns whether a VAE or denoiser maps its latents to another width."""
    return "latent_pre.weight" in weights


def _mld(weights: Weights, unstated: Unstated) -> TransformerVAEConfig:
    tokens, _ = _shape(weights, "global_motion_token")
    linear = "dist_layer.weight" in weights
    joint = "decoder.middle_block.multihead_attn.out_proj.weight" not in weights
    return TransformerVAEConfig(
        features=_shape(weights, "final_layer.weight")[0],
        tokens=tokens if linear else tokens // 2,
        transformer=_transformer(weights, "encoder.", unstated),
        position=_position(weights, "query_pos_encoder.pe"),
        distribution="linear" if linear else "tokens",
        decoding="joint" if joint else "cross",
        latent_width=_shape(weights, "latent_pre.weight")[0] if is_motionlcm(weights) else None,
    )


def _actor(weights: Weights, unstated: Unstated) -> TransformerVAEConfig:
    return TransformerVAEConfig(
        features=_shape(weights, "decoder.final_layer.weight")[0],
        tokens=1,
        transformer=_transformer(weights, "encoder.seqTransEncoder.", unstated),
        position="sine",
    )


def denoiser_config(weights: Weights, unstated: Unstated) -> DenoiserConfig:
    """Returns the configuration of an `MldDenoiser` with the prefix `denoiser.` removed."""
    if "time_embedding.cond_proj.weight" in weights:
        raise ModelError(
            "this denoiser takes the guidance scale as an input, as the distilled models of "
            "MotionLCM do; only the model it was distilled from can be converted (mld_humanml.ckpt)"
        )
    cross = any(name.startswith("decoder.") for name in weights)
    # The denoiser's constructor ignored what the VAE's obeyed.
    always = dataclasses.replace(unstated, activation="gelu", norm="post")
    transformer = _transformer(weights, "decoder." if cross else "encoder.", always)
    frames = "pose_embd.weight" in weights
    in_context = "context_first" if frames else "latents_first"
    projection, condition_width = _condition(weights, transformer.width, unstated)
    return DenoiserConfig(
        latent_width=_latent_width(weights, transformer.width),
        condition_width=condition_width,
        transformer=transformer,
        project_latents=frames or is_motionlcm(weights),
        condition_projection=projection,
        attention="cross" if cross else "in_context",
        places="separate" if cross else in_context,
        position=_position(weights, "query_pos.pe"),
        sine_width=_shape(weights, "time_embedding.linear_1.weight")[1],
        sees_padding=frames,
    )


def _latent_width(weights: Weights, width: int) -> int:
    projections = (n for n in ("pose_embd.weight", "latent_pre.weight") if n in weights)
    return next((_shape(weights, name)[1] for name in projections), width)


def _condition(
    weights: Weights, width: int, unstated: Unstated
) -> tuple[Literal["linear", "relu_linear", "table", "none"], int]:
    if "emb_proj.action_embedding" in weights:
        return "table", _shape(weights, "emb_proj.action_embedding")[0]
    if "emb_proj.1.weight" in weights:
        usual = "none" if is_motionlcm(weights) else "relu"
        linear = (unstated.text_activation or usual) == "none"
        found = _shape(weights, "emb_proj.1.weight")[1]
        return "linear" if linear else "relu_linear", found
    return "none", width


def _transformer(weights: Weights, stack: str, unstated: Unstated) -> TransformerConfig:
    skips = f"{stack}middle_block.linear1.weight" in weights
    one_layer = "middle_block" if skips else "layers.0"
    hidden, width = _shape(weights, f"{stack}{one_layer}.linear1.weight")
    return TransformerConfig(
        width=width,
        layers=_count(weights, f"{stack}input_blocks.") * 2 + 1
        if skips
        else _count(weights, f"{stack}layers."),
        heads=unstated.heads,
        hidden=hidden,
        dropout=unstated.dropout,
        activation=unstated.activation,
        norm=unstated.norm,
        skips=skips,
        final_norm=f"{stack}norm.weight" in weights,
    )


def _count(weights: Weights, prefix: str) -> int:
    matches = (re.match(re.escape(prefix) + r"(\d+)\.", name) for name in weights)
    return len({match.group(1) for match in matches if match})


def _position(weights: Weights, name: str) -> PositionKind:
    return "learned" if _shape(weights, name)[0] <= LEARNED_LENGTH else "sine"


def _shape(weights: Weights, name: str) -> tuple[int, ...]:
    if name not in weights:
        raise ModelError(f"the weights {name!r} are missing; is it a checkpoint of MLD?")
    return tuple(weights[name].shape)
