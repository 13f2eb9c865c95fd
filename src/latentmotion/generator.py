"""The chain: prompt → condition → (noise → latents) → features → joints → motion.

MLD section 3, in order, without PyTorch: `together` is the chain up to features, which `batch`
turns into motions; all else serves them. A prompt is a sentence, an action label or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import prefix_mask
from latentmotion.condition.interface import Condition, Conditioning
from latentmotion.condition.sentence import SentenceCondition
from latentmotion.condition.text.lengths import LengthFile
from latentmotion.diffusion.guidance import ClassifierFreeGuidance, GuidanceAsInput
from latentmotion.diffusion.interface import Denoiser
from latentmotion.diffusion.leaps import Leap, LeapTimes
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.sampler import Sampler, SamplerName, sample, sampler_named
from latentmotion.feature_decoder import FeatureDecoder
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.folder import DEFAULT, find_model
from latentmotion.motion import Motion
from latentmotion.order import Order, batches, check_frames, check_prompts, frames_of
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.runtime.conditions import condition_of, find_lengths
from latentmotion.runtime.session import OpenedWhenCalled, Runtime, Session, open_decoder
from latentmotion.runtime.walks import Walks, open_walks

MOST_AT_ONCE = 32
"""Motions that go through the networks together; more are done in turns, to bound memory."""


@dataclass(frozen=True)
class MotionGenerator:
    """A trained model, ready to generate. Immutable, so that one serves many threads."""

    card: ModelCard
    """What the model is."""
    condition: Condition
    """Prompts to words."""
    denoiser: Session
    """Network: noisy latents, time, words → prediction."""
    decoder: Session
    """Network: latents → normalized features."""
    at_once: int = MOST_AT_ONCE
    """Motions that go through the networks together."""
    body: SmplRepresentation | None = None
    """Whose joints motions have, in place of the skeleton's that ships."""
    walks: Walks = field(default_factory=dict)
    """Graphs from noise to features, by number of steps."""
    lengths: LengthFile | None = None
    """Sentences to usual lengths, for motions whose length is not given."""

    @classmethod
    def load(
        cls,
        model: str | Path = DEFAULT,
        runtime: Runtime = "auto",
        threads: int | None = None,
        cache: Path | None = None,
    ) -> MotionGenerator:
        """Finds a model by name (`fast` and `starter` ship with the package) or by its folder.

        Networks are loaded when they are first needed.

        Args:
            model: Name or folder.
            runtime: Engine of the networks; `auto` takes ONNX Runtime.
            threads: Most threads the engine may use; by default all cores.
            cache: Folder in which embeddings of prompts are kept, for example `cache_folder()`.

        Raises:
            ModelError: There is no such model, or a file of it is missing: it was not exported.
        """
        folder = find_model(model)
        card = read_card(folder)
        return cls(
            card,
            condition_of(card, folder, cache),
            OpenedWhenCalled(folder / "denoiser.onnx", runtime, threads),
            open_decoder(card, folder, runtime, threads),
            walks=open_walks(card, folder, runtime, threads),
            lengths=find_lengths(card, folder),
        )

    def __call__(
        self,
        prompt: str = "",
        seconds: float | None = None,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> Motion:
        """Turns a prompt into a motion.

        Args:
            prompt: What the person does, e.g. `a person walks forward and kicks`; for a model of
                actions one of its labels; for an unconditional model nothing.
            seconds: Length of the motion; by default what is usual for the sentence, or 4 s where
                the model has no `lengths.safetensors`, within what the model makes.
            seed: Another number, another motion; the same number, the same motion.
            steps: Sampling steps; more is slower and finer. By default the model's own.
            guidance: How strongly the prompt steers (paper eq. 6). By default the model's own.
            sampler: `ddim` (the same as `euler`), `heun`, `dpm++`, or `ddpm` for fresh noise at
                every step. By default the model's own.

        Raises:
            InputError: The prompt is not of the model's kind or a number is out of range.
        """
        return self.batch([prompt], seconds, [seed], steps, guidance, sampler)[0]

    def batch(
        self,
        prompts: Sequence[str],
        seconds: float | Sequence[float] | None = None,
        seeds: Sequence[int] | None = None,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> list[Motion]:
        """Turns several prompts into motions; each is what it would be alone.

        Args:
            prompts: One per motion.
            seconds: Length of all motions, or of each; by default as for one motion.
            seeds: One seed per motion; by default 0, 1, 2, ….
            steps: As for one motion.
            guidance: As for one motion.
            sampler: As for one motion.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        usual = self._usual_seconds(prompts) if seconds is None else None
        frames = frames_of(self.card, seconds, len(prompts), self.representation.fps, usual)
        seeds = range(len(prompts)) if seeds is None else seeds
        order = self._order(prompts, frames, seeds, steps, guidance, sampler)
        return [
            self._features.motion(joints, prompt, self._metadata(order, seed))
            for joints, prompt, seed in zip(self._joints(order), prompts, seeds, strict=True)
        ]

    def features(
        self,
        prompts: Sequence[str],
        frames: Sequence[int],
        seeds: Sequence[int],
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> list[Float[np.ndarray, "_ features"]]:
        """Returns what `batch` turns into joints: features in their own units, (frames, features).

        Args:
            prompts: One per motion.
            frames: Length of each motion.
            seeds: One seed per motion.
            steps: As for one motion.
            guidance: As for one motion.
            sampler: As for one motion.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        order = self._order(prompts, frames, seeds, steps, guidance, sampler)
        return self._each(order, self.together)

    def together(self, order: Order) -> Float[np.ndarray, "batch frames features"]:
        """Walks the chain for one batch; what lies beyond a motion's length means nothing.

        Where one graph holds all that follows the condition, that graph does it.
        """
        condition = self.condition(order.prompts)  #             (batch, words, width)
        if order.steps in self.walks:
            return self._walk(condition, order)
        latents = self.latents(condition, order)  #              (batch, tokens, width)
        return self._features(latents, order.frames)  #          (batch, frames, features)

    def latents(
        self, condition: Conditioning, order: Order
    ) -> Float[np.ndarray, "batch tokens width"]:
        """Walks from noise to latents, guided (paper eq. 6), in the scale of the VAE."""
        space, tokens = self.card.latents, self._tokens(order)
        noise, mask = SeededNoise(order.seeds, tokens), prefix_mask(tokens)
        z = noise((*mask.shape, space.width))
        guided, sampler = self._guided(order), self._sampler(order)
        z = sample(guided, sampler, z, condition, mask, order.steps, noise)
        return z * np.array(space.std, np.float32) + np.array(space.mean, np.float32)

    def _walk(
        self, condition: Conditioning, order: Order
    ) -> Float[np.ndarray, "batch frames features"]:
        tokens = self._tokens(order)
        noise, mask = SeededNoise(order.seeds, tokens), prefix_mask(tokens)
        return self.walks[order.steps](
            noise=noise((*mask.shape, self.card.latents.width)),
            words=condition.tokens,
            words_mask=condition.mask,
            mask=mask,
            frames=prefix_mask(order.frames),
            guidance=np.full(len(mask), order.guidance, np.float32),
        )

    @property
    def representation(self) -> Representation:
        """What the features mean."""
        return self._features.representation

    def _usual_seconds(self, prompts: Sequence[str]) -> list[float] | None:
        check_prompts(self.card, prompts)
        if self.lengths is None or not prompts or not isinstance(self.condition, SentenceCondition):
            return None
        return self.lengths.usual(self.condition.encoder(prompts).pooled)

    def _tokens(self, order: Order) -> list[int]:
        return [self.card.latents.tokens_of(length) for length in order.frames]

    def _guided(self, order: Order) -> Denoiser:
        if self.card.leaps:
            return GuidanceAsInput(self._denoise, order.guidance, order.steps)
        return ClassifierFreeGuidance(self._denoise, self._null, order.guidance)

    def _sampler(self, order: Order) -> Sampler:
        card, leaps = self.card, self.card.leaps
        schedule = LeapTimes(card.schedule, leaps) if leaps else card.schedule
        return sampler_named(order.sampler, schedule, card.prediction)

    def _denoise(
        self,
        z: Float[Any, "batch tokens width"],
        t: Float[Any, " batch"],
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
        leap: Leap | None = None,
    ) -> Float[Any, "batch tokens width"]:
        words, real = condition.tokens, condition.mask
        told = {"guidance": leap.guidance, "stride": leap.stride} if leap else {}
        return self.denoiser(z=z, t=t, words=words, words_mask=real, mask=mask, **told)

    @cached_property
    def _null(self) -> Conditioning:
        return self.condition.null(1)

    @cached_property
    def _features(self) -> FeatureDecoder:
        return FeatureDecoder(self.card, self.decoder, self.body)

    def _joints(self, order: Order) -> list[Float[np.ndarray, "_ joints 3"]]:
        return [self._features.joints(each) for each in self._each(order, self.together)]

    def _each(self, order: Order, together: Callable[[Order], np.ndarray]) -> list[np.ndarray]:
        """Walks in batches; each motion's own frames of what `together` returns."""
        found: dict[int, np.ndarray] = {}
        for rows in batches(order.frames, self.at_once, self.card.masks_padding):
            batch = together(order.take(rows))
            found |= {row: batch[n, : order.frames[row]] for n, row in enumerate(rows)}
        return [found[row] for row in range(len(order.frames))]

    def _order(
        self,
        prompts: Sequence[str],
        frames: Sequence[int],
        seeds: Sequence[int],
        steps: int | None,
        guidance: float | None,
        sampler: SamplerName | None,
    ) -> Order:
        card = self.card
        check_prompts(card, prompts)
        check_frames(card, frames, self.representation.fps)
        order = Order(
            tuple(prompts),
            tuple(frames),
            tuple(seeds),
            card.steps if steps is None else steps,
            card.guidance if guidance is None else guidance,
            card.sampler if sampler is None else sampler,
        )
        if card.leaps:
            card.leaps.check(order.steps, order.guidance, order.sampler)
        return order

    def _metadata(self, order: Order, seed: int) -> dict[str, str | int | float]:
        return {
            "model": self.card.name,
            "seed": seed,
            "steps": order.steps,
            "guidance": order.guidance,
            "license": self.card.provenance.license,
        }
