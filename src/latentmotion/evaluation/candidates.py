"""Candidates of an evaluation: a generator, a VAE that reconstructs motions, or the VAE's prior.

A candidate answers a replication with one motion per test prompt, as features in their own units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.engine.backend import FeatureDecoder, normalizer_of
from latentmotion.engine.prior import MotionPrior
from latentmotion.engine.request import GenerationRequest, batches
from latentmotion.evaluation.protocol import Protocol, Replication, TestPrompt
from latentmotion.model.card import ModelCard
from latentmotion.model.config import Sampling
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import MotionPipeline

Motions = list[Float[np.ndarray, "_ features"]]

MAX_BATCH_SIZE = 32  # Motions that a VAE reconstructs in one batch.


@dataclass(frozen=True)
class Generated:
    """Motions that a generator makes from captions, labels, or lengths alone."""

    generator: MotionPipeline  # The model.
    # Steps, guidance scale and sampler; by default the model's own.
    sampling: Sampling | None = None
    weights: str = ""  # Hash of its files.
    row: str = "generated"  # Name of its row in the report.
    reconstructs = False  # Whether its input is the real motion.

    @property
    def card(self) -> ModelCard:
        """The model's card."""
        return self.generator.card

    @property
    def prompted(self) -> bool:
        """Whether the model takes prompts."""
        return self.card.condition.prompted

    def __call__(self, replication: Replication, protocol: Protocol) -> Motions:
        """Returns one motion per test prompt."""
        seeds = protocol.seeds("motions", replication.number, len(replication.prompts))
        return self.generate(replication.prompts, seeds)

    def generate(self, prompts: Sequence[TestPrompt], seeds: Sequence[int]) -> Motions:
        """Returns one motion per test prompt and seed."""
        texts = tuple(prompt.text(self.card.condition) for prompt in prompts)
        frames = tuple(prompt.frames for prompt in prompts)
        sampling = self.sampling or self.card.sampling
        return self.generator.generate(GenerationRequest(texts, frames, tuple(seeds), sampling))


@dataclass(frozen=True)
class Reconstructed:
    """The real motions, encoded and decoded by a VAE."""

    vae: MotionVAE  # The VAE.
    card: ModelCard  # The model's card, with the normalizer.
    # Whether latents are drawn from the posterior or are its mean; by default the protocol's.
    sampled: bool | None = None
    weights: str = ""  # Hash of its files.
    row: str = "reconstruction"  # Name of its row in the report.
    reconstructs = True
    prompted = True

    def __call__(self, replication: Replication, protocol: Protocol) -> Motions:
        """Returns the reconstruction of every real motion."""
        sampled = protocol.quirks.sampled_latents if self.sampled is None else self.sampled
        seeds = protocol.seeds("motions", replication.number, len(replication.prompts))
        reconstructions: dict[int, np.ndarray] = {}
        for rows in batches(replication.frames, MAX_BATCH_SIZE):
            motions = [replication.features[row] for row in rows]
            batch = self.reconstruct(motions, [seeds[row] for row in rows] if sampled else None)
            reconstructions |= dict(zip(rows, batch, strict=True))
        return [reconstructions[row] for row in range(len(replication.prompts))]

    @torch.no_grad()
    def reconstruct(self, motions: Motions, seeds: Sequence[int] | None = None) -> Motions:
        """Returns the reconstructions of one batch.

        Args:
            motions: Features in their own units.
            seeds: Seeds of the posterior's noise, one per motion; None for the posterior's means.
        """
        frames = [len(motion) for motion in motions]
        normalizer = normalizer_of(self.card)
        decoder = FeatureDecoder.of(self.card, self.vae.decode, torch.tensor)
        rows = [torch.from_numpy(normalizer.normalize(motion)).float() for motion in motions]
        mask = prefix_mask(torch.tensor(frames))
        posterior = self.vae.encode(torch.nn.utils.rnn.pad_sequence(rows, batch_first=True), mask)
        latents = posterior.mean
        if seeds is not None:
            tokens = self.vae.latent_mask(mask).sum(1).tolist()
            noise = SeededNoise(seeds, tokens)(tuple(latents.shape))
            latents = latents + posterior.std * torch.from_numpy(noise)
        features = decoder.decode(latents, mask).numpy()
        return [motion[:length] for motion, length in zip(features, frames, strict=True)]


@dataclass(frozen=True)
class Prior:
    """Motions decoded from a VAE's prior, of the lengths of the test prompts."""

    prior: MotionPrior  # The model.
    weights: str = ""  # Hash of its files.
    row: str = "prior"  # Name of its row in the report.
    reconstructs = False
    prompted = False

    @property
    def card(self) -> ModelCard:
        """The model's card."""
        return self.prior.card

    def __call__(self, replication: Replication, protocol: Protocol) -> Motions:
        """Returns one motion per length."""
        seeds = protocol.seeds("motions", replication.number, len(replication.prompts))
        return self.prior.features(replication.frames, seeds)


Candidate = Generated | Reconstructed | Prior  # A model that is evaluated.
