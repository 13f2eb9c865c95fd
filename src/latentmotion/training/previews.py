"""Samples during training: motions of a fixed length, as picture strips if Pillow is installed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch
from jaxtyping import Float

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Estimator
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.samplers import Sampler
from latentmotion.engine.backend import Batch
from latentmotion.engine.feature_decoder import FeatureDecoder
from latentmotion.errors import MissingExtraError
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import features_from_noise
from latentmotion.representation.interface import representation_named


def write_strip(path: Path, motions: Sequence[Motion]) -> None:
    """Writes `motions` as a picture, a row each; does nothing without Pillow or motions."""
    try:
        from latentmotion.render.strip import write
    except MissingExtraError:
        return
    if motions:
        write(path, motions)


class Previews:
    """The pipeline from noise to motions, for the networks in training.

    Args:
        vae: The trained VAE.
        card: Its scales and representation.
        frames: Length of the motions.
    """

    def __init__(self, vae: MotionVAE, card: ModelCard, frames: int) -> None:
        self._vae, self._card, self._frames = vae, card, frames

    def sample(
        self,
        guided: Estimator,
        sampler: Sampler,
        steps: int,
        condition: Conditioning,
        captions: Sequence[str],
    ) -> list[Motion]:
        """Returns a motion for each caption, with the seeds 0, 1, 2, ….

        Args:
            guided: The denoiser with its guidance, and the meaning of its output.
            sampler: The rule of a step.
            steps: Number of steps.
            condition: That of the captions; says on which device all is computed.
            captions: What the motions are called.
        """
        device, noise = condition.tokens.device, SeededNoise(range(len(captions)))
        frames = torch.ones(len(captions), self._frames, dtype=torch.bool)
        tokens = self._vae.latent_mask(frames).to(device)
        z = torch.from_numpy(noise((*tokens.shape, self._card.latents.width))).to(device)
        batch = Batch(z, tokens, condition.tokens, condition.mask, frames.to(device))
        decoder = self._decoder(device)
        features = features_from_noise(batch, guided, sampler, steps, noise, decoder)
        return self._motions(features, captions)

    def decode(
        self, z: Float[torch.Tensor, "batch tokens width"], captions: Sequence[str]
    ) -> list[Motion]:
        """Returns a motion for each row of latents in the denoiser's scale."""
        frames = torch.ones(len(z), self._frames, dtype=torch.bool, device=z.device)
        return self._motions(self._decoder(z.device)(z, frames), captions)

    def _decoder(self, device: torch.device) -> FeatureDecoder:
        # Distillation, and a resumed stage 2, need the VAE for nothing else.
        decode = self._vae.to(device).decode
        return FeatureDecoder.of(self._card, decode, partial(torch.tensor, device=device))

    def _motions(
        self, features: Float[torch.Tensor, "batch frames features"], captions: Sequence[str]
    ) -> list[Motion]:
        part = representation_named(self._card.representation)
        joints = part.decode(features.cpu().numpy())
        return [
            Motion(each, part.fps, part.skeleton, caption)
            for each, caption in zip(joints, captions, strict=True)
        ]
