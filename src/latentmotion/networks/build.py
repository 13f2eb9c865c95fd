"""From configurations to networks with fresh weights: VAEs, denoisers and the stacks inside.

The order in which parts are built is the order in which a seed's numbers are drawn for their
weights, so it is part of what a training run yields.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, overload

import torch
from torch import nn

from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    IdentityVAEConfig,
    MirroredDecoder,
    PositionKind,
    QuarterRateDecoder,
    TransformerConfig,
    TransformerVAEConfig,
    VAEConfig,
    VPoserTConfig,
)
from latentmotion.networks.denoiser import (
    AcrossContext,
    AttendToPadding,
    ContextFirst,
    Denoiser,
    InContext,
    LatentsFirst,
    NoStepEmbedding,
    NumbersThenWords,
    SeparatePositions,
    StepEmbedding,
    TimeAndLengthTokens,
    TimeToken,
    WordsAddedToTime,
)
from latentmotion.networks.transformer import (
    CrossAttention,
    DecoderLayer,
    EncoderLayer,
    FeedForward,
    LearnedPosition,
    NumberEmbedding,
    PostNorm,
    PreNorm,
    SelfAttention,
    SinePosition,
    SkipStack,
    Stack,
    initialize,
)
from latentmotion.networks.vae.baselines import IdentityVAE, VPoserT
from latentmotion.networks.vae.convolutional import (
    Chain,
    ConvolutionalVAE,
    Double,
    Halve,
    MaskedConvolution,
    ResidualBlock,
    Unfold,
)
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.networks.vae.transformer import (
    STRIDE,
    CrossDecoder,
    JointDecoder,
    LinearDistribution,
    TokenDistribution,
    TransformerVAE,
    TwoRateDecoder,
)


@overload
def build(config: DenoiserConfig) -> Denoiser: ...
@overload
def build(config: TransformerVAEConfig) -> TransformerVAE: ...
@overload
def build(config: ConvolutionalVAEConfig) -> ConvolutionalVAE: ...
@overload
def build(config: VPoserTConfig) -> VPoserT: ...
@overload
def build(config: IdentityVAEConfig) -> IdentityVAE: ...
@overload
def build(config: VAEConfig) -> MotionVAE: ...
def build(config: DenoiserConfig | VAEConfig) -> Denoiser | MotionVAE:
    """Builds the network of a configuration with fresh weights.

    Raises:
        InputError: A stack with long skips has an even number of layers.
    """
    match config:
        case DenoiserConfig():
            return _denoiser(config)
        case TransformerVAEConfig():
            return _transformer_vae(config)
        case ConvolutionalVAEConfig():
            encoder, decoder = _convolutional_encoder(config), _convolutional_decoder(config)
            return ConvolutionalVAE(encoder, decoder, config.channels)
        case VPoserTConfig():
            return VPoserT(config)
        case IdentityVAEConfig():
            return IdentityVAE(config.features)


def encoder_stack(config: TransformerConfig) -> nn.Module:
    """Builds a stack called with (x, mask)."""
    return _stack(config, [_encoder_layer(config) for _ in range(config.layers)])


def decoder_stack(config: TransformerConfig) -> nn.Module:
    """Builds a stack called with (x, mask, memory, memory_mask)."""
    return _stack(config, [_decoder_layer(config) for _ in range(config.layers)])


def position(kind: PositionKind, width: int, dropout: float) -> nn.Module:
    """Builds the positions of one sequence."""
    return LearnedPosition(width) if kind == "learned" else SinePosition(width, dropout)


def _stack(config: TransformerConfig, layers: list[nn.Module]) -> nn.Module:
    norm = nn.LayerNorm(config.width) if config.final_norm else nn.Identity()
    stack = SkipStack(layers, norm, config.width) if config.skips else Stack(layers, norm)
    stack.apply(initialize)
    return stack


def _encoder_layer(config: TransformerConfig) -> nn.Module:
    attention = SelfAttention(config.width, config.heads, config.attention_dropout)
    return EncoderLayer(attention, _feed_forward(config), partial(_residual, config))


def _decoder_layer(config: TransformerConfig) -> nn.Module:
    sizes = config.width, config.heads, config.attention_dropout
    attention, across = SelfAttention(*sizes), CrossAttention(*sizes)
    return DecoderLayer(attention, across, _feed_forward(config), partial(_residual, config))


def _feed_forward(config: TransformerConfig) -> nn.Module:
    activation = {"gelu": nn.GELU, "relu": nn.ReLU}[config.activation]()
    return FeedForward(config.width, config.hidden, config.dropout, activation)


def _residual(config: TransformerConfig) -> nn.Module:
    return {"post": PostNorm, "pre": PreNorm}[config.norm](config.width, config.dropout)


def _transformer_vae(config: TransformerVAEConfig) -> TransformerVAE:
    width, latent = config.transformer.width, config.latent_width or config.transformer.width
    adapted = config.latent_width is not None
    own_tokens = config.distribution == "tokens"
    return TransformerVAE(
        frames_in=nn.Linear(config.features, width),
        frames_out=nn.Linear(width, config.features),
        summary=torch.randn(config.tokens * (2 if own_tokens else 1), width),
        position=position(config.position, width, config.transformer.dropout),
        encoder=encoder_stack(config.transformer),
        distribution=TokenDistribution() if own_tokens else LinearDistribution(latent),
        decoder=_frame_decoder(config),
        narrow=nn.Linear(width, latent) if adapted else nn.Identity(),
        widen=nn.Linear(latent, width) if adapted else nn.Identity(),
        latents=config.latent_space(),
    )


def _frame_decoder(config: TransformerVAEConfig) -> nn.Module:
    whole, fine = config.transformer, config.fine_layers
    queries = position(config.position, whole.width, whole.dropout)
    if config.decoding == "joint":
        return JointDecoder(queries, encoder_stack(whole))
    if config.decoding == "cross":
        return CrossDecoder(queries, decoder_stack(whole))
    return TwoRateDecoder(
        position=queries,
        coarse=decoder_stack(replace(whole, layers=whole.layers - fine)),
        unfold=nn.Linear(whole.width, STRIDE * whole.width),
        fine=decoder_stack(replace(whole, layers=fine, skips=False)),
    )


def _convolutional_encoder(config: ConvolutionalVAEConfig) -> Chain:
    return Chain(
        [
            MaskedConvolution(config.features, config.width, 3),
            Halve(config.width),
            *(ResidualBlock(config.width, d) for d in config.dilations),
            Halve(config.width),
            *(ResidualBlock(config.width, d) for d in config.dilations),
            MaskedConvolution(config.width, 2 * config.channels, 3, activation=nn.SiLU()),
        ]
    )


def _convolutional_decoder(config: ConvolutionalVAEConfig) -> Chain:
    match config.decoder:
        case MirroredDecoder():
            return _mirrored_decoder(config)
        case QuarterRateDecoder(dilations):
            return Chain(
                [
                    MaskedConvolution(config.channels, config.width, 3),
                    *(ResidualBlock(config.width, d) for d in dilations),
                    Unfold(config.width, config.features),
                ]
            )


def _mirrored_decoder(config: ConvolutionalVAEConfig) -> Chain:
    width, dilations = config.width, config.dilations[::-1]
    return Chain(
        [
            MaskedConvolution(config.channels, width, 3),
            *(ResidualBlock(width, d) for d in dilations),
            Double(width),
            *(ResidualBlock(width, d) for d in dilations),
            Double(width),
            MaskedConvolution(width, width, 3, activation=nn.SiLU()),
            MaskedConvolution(width, config.features, 3, activation=nn.SiLU()),
        ]
    )


def _denoiser(config: DenoiserConfig) -> Denoiser:
    width = config.transformer.width
    inner, outer = (config.latent_width, width), (width, config.latent_width)
    return Denoiser(
        latents_in=nn.Linear(*inner) if config.project_latents else nn.Identity(),
        latents_out=nn.Linear(*outer) if config.project_latents else nn.Identity(),
        condition_in=_condition_projection(config),
        numbers=_numbers(config),
        joining=WordsAddedToTime() if config.words == "added_to_time" else NumbersThenWords(),
        positions=_positions(config),
        body=_body(config),
        padding=AttendToPadding() if config.attends_to_padding else nn.Identity(),
        step_embedding=StepEmbedding(config.sine_width, width)
        if config.few_step
        else NoStepEmbedding(),
    )


def _condition_projection(config: DenoiserConfig) -> nn.Module:
    labels = config.condition_projection == "table"
    linear = nn.Linear(config.condition_width, config.transformer.width, bias=not labels)
    choices: dict[str, nn.Module] = {
        "linear": linear,
        "relu_linear": nn.Sequential(nn.ReLU(), linear),
        "table": linear,
        "none": nn.Identity(),
    }
    return choices[config.condition_projection]


def _numbers(config: DenoiserConfig) -> nn.Module:
    width = config.transformer.width
    time = NumberEmbedding(config.sine_width, width, config.time_scale)
    if not config.length_token:
        return TimeToken(time)
    return TimeAndLengthTokens(time, NumberEmbedding(config.sine_width, width))


def _positions(config: DenoiserConfig) -> nn.Module:
    width, dropout = config.transformer.width, config.transformer.dropout
    tables: list[Any] = [position(config.position, width, dropout) for _ in range(2)]
    if config.positions == "separate":
        return SeparatePositions(*tables)
    return {"latents_first": LatentsFirst, "context_first": ContextFirst}[config.positions](
        tables[0]
    )


def _body(config: DenoiserConfig) -> nn.Module:
    if config.attention == "cross":
        return AcrossContext(decoder_stack(config.transformer))
    return InContext(encoder_stack(config.transformer))
