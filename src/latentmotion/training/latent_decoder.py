"""From the denoiser's latents to motions, to look at samples while it trains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.vae.interface import MotionVAE


class LatentDecoder:
    """A trained VAE's way back: latents in the denoiser's scale to motions of one length.

    Args:
        vae: The trained VAE.
        card: Its scales and representation.
        frames: Length of the motions.
    """

    def __init__(self, vae: MotionVAE, card: ModelCard, frames: int) -> None:
        self._vae, self._card, self._frames = vae, card, frames
        self._normalizer = normalizer_of(card)

    def mask(self, count: int) -> Bool[torch.Tensor, "batch tokens"]:
        """Returns the mask of the latents of `count` motions."""
        return self._vae.latent_mask(torch.ones(count, self._frames, dtype=torch.bool))

    def __call__(
        self, z: Float[torch.Tensor, "batch tokens width"], captions: Sequence[str]
    ) -> list[Motion]:
        """Returns a motion for each row."""
        space, part = self._card.latents, representation_named(self._card.representation)
        latents = z * z.new_tensor(space.std) + z.new_tensor(space.mean)
        mask = torch.ones(len(z), self._frames, dtype=torch.bool, device=z.device)
        # Distillation, and a resumed stage 2, need the VAE for nothing else.
        features = self._normalizer.denormalize(self._vae.to(z.device).decode(latents, mask))
        return [
            Motion(joints, part.fps, part.skeleton, caption)
            for joints, caption in zip(part.decode(features.cpu().numpy()), captions, strict=True)
        ]


def normalizer_of(card: ModelCard) -> Normalizer:
    """Returns the normalizer that a model was trained with."""
    mean, std = card.normalizer_mean, card.normalizer_std
    return Normalizer(np.asarray(mean, np.float32), np.asarray(std, np.float32))
