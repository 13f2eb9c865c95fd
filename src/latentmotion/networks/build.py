"""From configurations to networks with fresh weights.

The order in which a network's parts are built is the order in which a seed's numbers are drawn for
their weights, so it is part of what a training run yields.
"""

from __future__ import annotations

from typing import overload

from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    IdentityVAEConfig,
    TransformerVAEConfig,
    VAEConfig,
    VPoserTConfig,
)
from latentmotion.networks.denoiser import Denoiser
from latentmotion.networks.vae.baselines import IdentityVAE, VPoserT
from latentmotion.networks.vae.convolutional import ConvolutionalVAE
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.networks.vae.transformer import TransformerVAE


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
            return Denoiser.of(config)
        case TransformerVAEConfig():
            return TransformerVAE.of(config)
        case ConvolutionalVAEConfig():
            return ConvolutionalVAE.of(config)
        case VPoserTConfig():
            return VPoserT(config)
        case IdentityVAEConfig():
            return IdentityVAE(config.features)
