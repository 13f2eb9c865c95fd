"""Whom a report is about: a generator, a VAE that repeats motions, or its prior.

A subject answers a trial with one motion per question, as features in their own units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.evaluation.settings import Protocol as Settings
from latentmotion.evaluation.trials import Question, Trial
from latentmotion.feature_decoder import FeatureDecoder, normalizer_of
from latentmotion.model.card import ModelCard
from latentmotion.model.config import Sampling
from latentmotion.prior import MotionPrior
from latentmotion.request import GenerationRequest, batches
from latentmotion.vae.interface import MotionVAE

Motions = list[Float[np.ndarray, "_ features"]]

MAX_BATCH_SIZE = 32
"""Motions that a VAE repeats together."""


@runtime_checkable
class Subject(Protocol):
    """What is measured."""

    @property
    def card(self) -> ModelCard:
        """What the model is."""
        ...

    @property
    def row(self) -> str:
        """Its row in the report."""
        ...

    @property
    def weights(self) -> str:
        """Hash of its files; empty where it does not come from a folder."""
        ...

    @property
    def repeats(self) -> bool:
        """Whether it sees the motion that it shall answer with."""
        ...

    @property
    def prompted(self) -> bool:
        """Whether its answers have to do with the question, so that they can match it."""
        ...

    def __call__(self, trial: Trial, settings: Settings) -> Motions:
        """Answers a trial."""
        ...


@runtime_checkable
class Generator(Protocol):
    """What is asked of a `MotionPipeline`."""

    @property
    def card(self) -> ModelCard:
        """What the model is."""
        ...

    def generate(self, request: GenerationRequest) -> Motions:
        """Returns motions in their own units, (frames, features)."""
        ...


@dataclass(frozen=True)
class Generated:
    """Motions that a generator makes of the questions' sentences, labels, or lengths alone."""

    generator: Generator
    """The model, a `MotionPipeline`."""
    sampling: Sampling | None = None
    """Steps, guidance scale and sampler; by default the model's own."""
    weights: str = ""
    """Hash of its files."""
    row: str = "generated"
    """Its row in the report."""
    repeats = False

    @property
    def card(self) -> ModelCard:
        """What the model is."""
        return self.generator.card

    @property
    def prompted(self) -> bool:
        """Whether it is asked anything."""
        return self.card.condition.prompted

    def __call__(self, trial: Trial, settings: Settings) -> Motions:
        """Answers a trial."""
        seeds = settings.seeds("motions", trial.replication, len(trial.questions))
        return self.answer(trial.questions, seeds)

    def answer(self, questions: Sequence[Question], seeds: Sequence[int]) -> Motions:
        """Answers questions with seeds of one's own."""
        prompts = tuple(question.prompt(self.card.condition) for question in questions)
        frames = tuple(question.frames for question in questions)
        sampling = self.sampling or self.card.sampling
        return self.generator.generate(GenerationRequest(prompts, frames, tuple(seeds), sampling))


@dataclass(frozen=True)
class Reconstructed:
    """The real motions, encoded and decoded by a VAE."""

    vae: MotionVAE
    """The VAE."""
    card: ModelCard
    """What the model is; its normalizer is used."""
    sampled: bool | None = None
    """Whether latents are drawn, or the posterior's mean; by default as the protocol has it."""
    weights: str = ""
    """Hash of its files."""
    row: str = "reconstruction"
    """Its row in the report."""
    repeats = True
    prompted = True

    def __call__(self, trial: Trial, settings: Settings) -> Motions:
        """Answers a trial."""
        sampled = settings.quirks.sampled_latents if self.sampled is None else self.sampled
        seeds = settings.seeds("motions", trial.replication, len(trial.questions))
        found: dict[int, np.ndarray] = {}
        for rows in batches(trial.frames, MAX_BATCH_SIZE):
            motions = [trial.features[row] for row in rows]
            drawn = [seeds[row] for row in rows] if sampled else None
            found |= dict(zip(rows, self._repeat(motions, drawn), strict=True))
        return [found[row] for row in range(len(trial.questions))]

    @torch.no_grad()
    def _repeat(self, motions: Motions, seeds: list[int] | None) -> Motions:
        frames = [len(motion) for motion in motions]
        normalizer = normalizer_of(self.card)
        decoder = FeatureDecoder.of(self.card, self.vae.decode, torch.tensor)
        padded = np.zeros((len(motions), max(frames), motions[0].shape[1]), np.float32)
        for row, motion in zip(padded, motions, strict=True):
            row[: len(motion)] = normalizer.normalize(motion)
        mask = prefix_mask(torch.tensor(frames))
        posterior = self.vae.encode(torch.from_numpy(padded), mask)
        latents = posterior.mean
        if seeds is not None:
            tokens = self.vae.latent_mask(mask).sum(1).tolist()
            noise = SeededNoise(seeds, tokens)(tuple(latents.shape))
            latents = latents + posterior.std * torch.from_numpy(noise)
        features = decoder.decode(latents, mask).numpy()
        return [each[:length] for each, length in zip(features, frames, strict=True)]


@dataclass(frozen=True)
class Prior:
    """Motions decoded from a VAE's prior, of the questions' lengths."""

    prior: MotionPrior
    """The model."""
    weights: str = ""
    """Hash of its files."""
    row: str = "prior"
    """Its row in the report."""
    repeats = False
    prompted = False

    @property
    def card(self) -> ModelCard:
        """What the model is."""
        return self.prior.card

    def __call__(self, trial: Trial, settings: Settings) -> Motions:
        """Answers a trial."""
        seeds = settings.seeds("motions", trial.replication, len(trial.questions))
        return self.prior.features(trial.frames, seeds)
