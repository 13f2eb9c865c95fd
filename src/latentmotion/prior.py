"""Motions from a VAE alone: latents drawn from its prior N(0, 1), decoded.

The paper's VAE as an unconditional model; also for a full model, whose denoiser is not asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.errors import ModelError
from latentmotion.feature_decoder import FeatureDecoder, representation_of
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.request import batches, check_frames, check_seeds, frames_of, unpadded
from latentmotion.runtime.session import Session


@dataclass(frozen=True)
class MotionPrior:
    """A VAE's decoder, ready to generate from noise.

    Raises:
        ModelError: The model has no VAE.
    """

    card: ModelCard
    """What the model is."""
    decoder: Session
    """Network: latents → normalized features."""
    max_batch_size: int = 32
    """Motions that go through the network together."""
    body: SmplRepresentation | None = None
    """Body whose joints motions have, in place of the skeleton that ships."""

    def __post_init__(self) -> None:
        if not self.card.vae.has_weights:
            raise ModelError(f"model {self.card.name!r} has no VAE, so there is no prior to sample")

    def batch(self, seconds: float | Sequence[float] | None, seeds: Sequence[int]) -> list[Motion]:
        """Returns a motion for each seed; without `seconds` of 4, or the nearest it makes.

        Raises:
            InputError: A number is out of range.
        """
        part, card = self.representation, self.card
        frames = frames_of(card, seconds, len(seeds), part.fps)
        about = {"model": card.name, "license": card.provenance.license}
        return [
            Motion(part.decode(each), part.fps, part.skeleton, "", {**about, "seed": seed})
            for each, seed in zip(self.features(frames, seeds), seeds, strict=True)
        ]

    def features(
        self, frames: Sequence[int], seeds: Sequence[int]
    ) -> list[Float[np.ndarray, "_ features"]]:
        """Returns features in their own units, (frames, features), for each length and seed.

        Raises:
            InputError: A number is out of range.
        """
        check_frames(self.card, frames, self.representation.fps)
        check_seeds(frames, seeds)
        rows = batches(frames, self.max_batch_size)
        parts = (([frames[row] for row in each], [seeds[row] for row in each]) for each in rows)
        return unpadded((self._decoded(*part) for part in parts), rows, frames)

    def _decoded(
        self, frames: Sequence[int], seeds: Sequence[int]
    ) -> Float[np.ndarray, "batch longest features"]:
        space = self.card.latents
        tokens = [space.tokens_of(length) for length in frames]
        latents = SeededNoise(seeds, tokens)((len(seeds), max(tokens), space.width))
        return FeatureDecoder.of(self.card, self.decoder).decode(latents, prefix_mask(frames))

    @cached_property
    def representation(self) -> Representation:
        """What the features mean."""
        return representation_of(self.card, self.body)
