"""ACTOR's VAE (Petrovich et al. 2021), as the paper compares with it and uses it for actions."""

from __future__ import annotations

from latentmotion.model.config import TransformerConfig
from latentmotion.model.vae_config import TransformerVAEConfig


def actor_vae(features: int) -> TransformerVAEConfig:
    """Six layers without skips or final normalization, sine positions, one latent token."""
    return TransformerVAEConfig(
        features=features,
        tokens=1,
        transformer=TransformerConfig(layers=6, skips=False, final_norm=False),
        position="sine",
    )
