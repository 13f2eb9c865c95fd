"""Motions from a VAE alone: latents drawn from its prior N(0, 1), decoded.

This is the paper's VAE as an unconditional model. A full model works as well; its denoiser is not
used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.engine.backend import FeatureDecoder, representation_of
from latentmotion.engine.request import batches, check_frames, check_seeds, frames_of, unpadded
from latentmotion.engine.session import Session
from latentmotion.errors import ModelError
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import ClipFeatures, Representation
from latentmotion.representation.smpl import SmplRepresentation


@dataclass(frozen=True)
class MotionPrior:
    """A VAE's decoder, ready to generate from noise.

    Raises:
        ModelError: The model has no VAE.
    """

    card: ModelCard  # What the model is.
    decoder: Session  # Network: latents → normalized features.
    max_batch_size: int = 32  # Maximum number of motions that go through the network at once.
    # Body whose joints motions have, in place of the skeleton that ships.
    body: SmplRepresentation | None = None

    def __post_init__(self) -> None:
        if not self.card.vae.has_weights:
            raise ModelError(f"model {self.card.name!r} has no VAE, so there is no prior to sample")

    def batch(self, seconds: float | Sequence[float] | None, seeds: Sequence[int]) -> list[Motion]:
        """Returns a motion for each seed, by default of 4 seconds or the nearest possible length.

        Raises:
            InputError: A number is out of range.
        """
        features, card = self.representation, self.card
        frames = frames_of(card, seconds, len(seeds), features.fps)
        metadata = {"model": card.name, **card.terms()}
        return [
            Motion(
                features.decode(values),
                features.fps,
                features.skeleton,
                metadata={**metadata, "seed": seed},
            )
            for values, seed in zip(self.features(frames, seeds), seeds, strict=True)
        ]

    def features(self, frames: Sequence[int], seeds: Sequence[int]) -> list[ClipFeatures]:
        """Returns features in their own units, (frames, features), for each length and seed.

        Raises:
            InputError: A number is out of range.
        """
        check_frames(self.card, frames, self.representation.fps)
        check_seeds(frames, seeds)
        space, decoder = self.card.latents, FeatureDecoder.of(self.card, self.decoder)
        rows, outputs = batches(frames, self.max_batch_size), []
        for batch in rows:
            lengths = [frames[row] for row in batch]
            tokens = [space.tokens_of(length) for length in lengths]
            noise = SeededNoise([seeds[row] for row in batch], tokens)
            latents = noise((len(batch), max(tokens), space.width))
            outputs.append(decoder.decode(latents, prefix_mask(lengths)))
        return unpadded(outputs, rows, frames)

    @cached_property
    def representation(self) -> Representation:
        """The motion features that the model makes."""
        return representation_of(self.card, self.body)
