"""Networks with fresh weights from configurations, or with weights of a narrower network.

The order in which a network's parts are built is the order in which a seed's numbers are drawn for
their weights, so it is part of what a training run yields.

A network that starts from one with fewer latent channels answers as that one until training uses
the new ones. What reads latents gives them no weight. What makes them begins at zero, except for
the VAE's means: the encoder shows something in them, so that there is something to read.
"""

from __future__ import annotations

from typing import overload

from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    IdentityVAEConfig,
    PluginVAEConfig,
    TransformerVAEConfig,
    VAEConfig,
    VPoserTConfig,
)
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.baselines import IdentityVAE, VPoserT
from latentmotion.networks.vae.convolutional import ConvolutionalVAE
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.networks.vae.transformer import TransformerVAE
from latentmotion.storage.configuration import part_named


@overload
def build(config: DenoiserConfig) -> DenoiserNetwork: ...
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
def build(config: DenoiserConfig | VAEConfig) -> DenoiserNetwork | MotionVAE:
    """Builds the network of a configuration with fresh weights.

    Raises:
        InputError: A stack with long skips has an even number of layers.
    """
    match config:
        case DenoiserConfig():
            if config.plugin:
                return part_named("latentmotion.denoisers", config.plugin)(config)
            return DenoiserNetwork.of(config)
        case PluginVAEConfig():
            vae = part_named("latentmotion.vaes", config.plugin)
            return vae(features=config.features, **config.settings)
        case TransformerVAEConfig():
            return TransformerVAE.of(config)
        case ConvolutionalVAEConfig():
            return ConvolutionalVAE.of(config)
        case VPoserTConfig():
            return VPoserT(config)
        case IdentityVAEConfig():
            return IdentityVAE(config.features)


def start_from(network: nn.Module, trained: nn.Module, channels: int, before: int) -> None:
    """Gives a network the weights of a trained one, in place.

    Args:
        network: VAE or denoiser with fresh weights.
        trained: One with the same layers, but for the number of latent channels.
        channels: Latent channels of `network`.
        before: Latent channels of `trained`.

    Raises:
        InputError: They differ in more than the latent channels, or there were more of them.
    """
    fresh, start = network.state_dict(), trained.state_dict()
    if fresh.keys() != start.keys() or channels < before:
        raise InputError(
            "the model to start from has other layers, or more latent channels; use the preset and "
            "settings that it was trained with"
        )
    network.load_state_dict(
        {name: _widened(name, fresh[name], start[name], channels, before) for name in fresh}
    )


def _widened(name: str, fresh: Tensor, trained: Tensor, channels: int, before: int) -> Tensor:
    """Returns the trained weights, followed by fresh ones for new channels."""
    if fresh.shape == trained.shape:
        return trained
    result, shapes = fresh.clone(), (tuple(fresh.shape), tuple(trained.shape))
    match shapes:
        case ((to, *_), (of, *_)) if (to, of) == (2 * channels, 2 * before):
            # The encoder's last layer: all means, then all log variances.
            result[channels:] = 0
            result[:before], result[channels : channels + before] = trained.chunk(2)
        case ((to, *_), (of, *_)) if (to, of) == (channels, before):
            result[before:] = 0
            result[:before] = trained
        case ((_, to, *_), (_, of, *_)) if (to, of) == (channels, before):
            result[:, before:] = 0
            result[:, :before] = trained
        case _:
            raise InputError(
                f"the model to start from has {name} of shape {shapes[1]}, expected {shapes[0]}; "
                "use the preset and settings that it was trained with"
            )
    return result
