"""Motions from a VAE alone: latents drawn from its prior N(0, 1), decoded.

The paper's VAE as an unconditional model; also for a full model, whose denoiser is not asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.diffusion.noise import SeededNoise
from latentmotion.errors import ModelError
from latentmotion.feature_decoder import FeatureDecoder
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.order import batches, check_frames, check_seeds, frames_of
from latentmotion.representation.smpl import SmplRepresentation
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
    at_once: int = 32
    """Motions that go through the network together."""
    body: SmplRepresentation | None = None
    """Whose joints motions have, in place of the skeleton's that ships."""

    def __post_init__(self) -> None:
        if not self.card.vae.has_weights:
            raise ModelError(f"model {self.card.name!r} has no VAE, so there is no prior to sample")

    def batch(self, seconds: float | Sequence[float] | None, seeds: Sequence[int]) -> list[Motion]:
        """Returns a motion for each seed; without `seconds` of 4, or the nearest it makes.

        Raises:
            InputError: A number is out of range.
        """
        fps = self._features.representation.fps
        frames = frames_of(self.card, seconds, len(seeds), fps)
        about = {"model": self.card.name, "license": self.card.provenance.license}
        return [
            self._features.motion(self._features.joints(features), "", {**about, "seed": seed})
            for features, seed in zip(self.features(frames, seeds), seeds, strict=True)
        ]

    def features(
        self, frames: Sequence[int], seeds: Sequence[int]
    ) -> list[Float[np.ndarray, "_ features"]]:
        """Returns features in their own units, (frames, features), for each length and seed.

        Raises:
            InputError: A number is out of range.
        """
        check_frames(self.card, frames, self._features.representation.fps)
        check_seeds(frames, seeds)
        found: dict[int, np.ndarray] = {}
        for rows in batches(frames, self.at_once):
            lengths, own = [frames[row] for row in rows], [seeds[row] for row in rows]
            features = self._together(lengths, own)
            found |= {row: features[n, : frames[row]] for n, row in enumerate(rows)}
        return [found[row] for row in range(len(frames))]

    def _together(
        self, frames: Sequence[int], seeds: Sequence[int]
    ) -> Float[np.ndarray, "batch longest features"]:
        space = self.card.latents
        tokens = [space.tokens_of(length) for length in frames]
        latents = SeededNoise(seeds, tokens)((len(seeds), max(tokens), space.width))
        return self._features(latents, frames)

    @cached_property
    def _features(self) -> FeatureDecoder:
        return FeatureDecoder(self.card, self.decoder, self.body)
