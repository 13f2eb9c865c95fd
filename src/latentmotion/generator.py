"""The chain: sentence → condition → (noise → latents) → features → joints → motion.

MLD section 3, in order, without PyTorch: `batch` is the chain, all else serves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Conditioning
from latentmotion.condition.sentence import SentenceCondition, SentenceReading
from latentmotion.condition.text.student import StudentTextEncoder
from latentmotion.configuration import from_json
from latentmotion.diffusion.guidance import ClassifierFreeGuidance
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.sampler import DDIM, sample
from latentmotion.errors import InputError
from latentmotion.model_card import ModelCard, read_card
from latentmotion.models import find_model
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation
from latentmotion.representation.known import representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.runtime.session import Runtime, Session, open_session

MOST_AT_ONCE = 32
"""Motions that go through the networks together; more are done in turns, to bound memory."""


@dataclass(frozen=True)
class Order:
    """What is asked of the model.

    Raises:
        InputError: A caption is empty or a number is out of range.
    """

    captions: tuple[str, ...]
    """One sentence per motion."""
    seeds: tuple[int, ...]
    """One seed per motion."""
    frames: int
    """Length of each motion."""
    steps: int
    """Sampling steps."""
    guidance: float
    """Guidance scale."""

    def __post_init__(self) -> None:
        if not self.captions or not all(caption.strip() for caption in self.captions):
            raise InputError("the sentence is empty; say what the person does")
        if len(self.seeds) != len(self.captions):
            raise InputError(f"{len(self.seeds)} seeds for {len(self.captions)} sentences")
        if any(seed < 0 for seed in self.seeds):
            raise InputError(f"seed {min(self.seeds)}: expected a number from 0 up")
        if not 0 <= self.guidance <= 100:
            raise InputError(f"guidance {self.guidance}: expected 0 to 100, usual are 1 to 10")

    def parts(self) -> list[Order]:
        """Returns the same in portions that go through the networks together."""
        starts = range(0, len(self.captions), MOST_AT_ONCE)
        return [self._part(slice(start, start + MOST_AT_ONCE)) for start in starts]

    def _part(self, rows: slice) -> Order:
        return replace(self, captions=self.captions[rows], seeds=self.seeds[rows])


@dataclass(frozen=True)
class MotionGenerator:
    """A trained model, ready to generate. Immutable, so that one serves many threads."""

    card: ModelCard
    """What the model is."""
    sentences: SentenceCondition
    """Sentences to tokens."""
    denoiser: Session
    """Graph: noisy latents, time, condition → prediction."""
    decoder: Session
    """Graph: latents → normalized features."""

    @classmethod
    def load(
        cls, model: str | Path = "starter", runtime: Runtime = "auto", threads: int | None = None
    ) -> MotionGenerator:
        """Loads a model by name (`starter` ships with the package) or from its folder.

        Args:
            model: Name or folder.
            runtime: Engine of the networks; `auto` takes OpenVINO where it is installed.
            threads: Most threads the engine may use; by default all cores.

        Raises:
            ModelError: There is no such model, or its folder is damaged.
        """
        folder = find_model(model)
        card = read_card(folder)
        return cls(
            card,
            SentenceCondition(StudentTextEncoder.load(folder), _reading(card)),
            open_session(folder / "denoiser.onnx", runtime, threads),
            open_session(folder / "decoder.onnx", runtime, threads),
        )

    def __call__(
        self,
        caption: str,
        seconds: float = 4.0,
        seed: int = 0,
        steps: int | None = None,
        guidance: float | None = None,
    ) -> Motion:
        """Turns a sentence into a motion.

        Args:
            caption: What the person does, e.g. `a person walks forward and kicks`.
            seconds: Length of the motion.
            seed: Another number, another motion; the same number, the same motion.
            steps: Sampling steps; more is slower and finer. By default the model's own.
            guidance: How strongly the sentence steers (paper eq. 6). By default the model's own.

        Raises:
            InputError: The caption is empty or a number is out of range.
        """
        return self.batch([caption], seconds, [seed], steps, guidance)[0]

    def batch(
        self,
        captions: Sequence[str],
        seconds: float = 4.0,
        seeds: Sequence[int] | None = None,
        steps: int | None = None,
        guidance: float | None = None,
    ) -> list[Motion]:
        """Turns several sentences into motions; each is what it would be alone.

        Args:
            captions: One sentence per motion.
            seconds: Length of the motions.
            seeds: One seed per motion; by default 0, 1, 2, ….
            steps: As for one motion.
            guidance: As for one motion.

        Raises:
            InputError: A caption is empty or a number is out of range.
        """
        seeds = range(len(captions)) if seeds is None else seeds
        order = Order(
            tuple(captions),
            tuple(seeds),
            self._frames(seconds),
            self.card.steps if steps is None else steps,
            self.card.guidance if guidance is None else guidance,
        )
        return [motion for part in order.parts() for motion in self._motions(part)]

    def _motions(self, order: Order) -> list[Motion]:
        condition = self.sentences(order.captions)  #         (batch, words, width)
        latents = self.latents(condition, order)  #           (batch, tokens, width)
        features = self.decode(latents, order.frames)  #      (batch, frames, features)
        joints = self.representation.decode(features)  #      (batch, frames, joints, 3)
        return [
            Motion(
                joints=np.asarray(positions, dtype=np.float32),
                fps=self.representation.fps,
                skeleton=self.representation.skeleton,
                caption=caption,
                metadata=self._metadata(order, seed),
            )
            for positions, caption, seed in zip(joints, order.captions, order.seeds, strict=True)
        ]

    def latents(
        self, condition: Conditioning, order: Order
    ) -> Float[np.ndarray, "batch tokens width"]:
        """Walks from noise to latents, guided (paper eq. 6), in the scale of the VAE."""
        space = self.card.latents
        shape = (space.tokens_of(order.frames), space.width)
        noise = SeededNoise(order.seeds)
        z = noise((len(order.seeds), *shape))
        mask = np.ones(z.shape[:2], dtype=bool)
        guided = ClassifierFreeGuidance(self._denoise, self.sentences.null(1), order.guidance)
        sampler = DDIM(self.card.schedule, self.card.prediction)
        z = sample(guided, sampler, z, condition, mask, order.steps, noise)
        return z * _float32(space.std) + _float32(space.mean)

    def _denoise(
        self,
        z: Float[np.ndarray, "batch tokens width"],
        t: Float[np.ndarray, " batch"],
        condition: Conditioning,
        mask: Bool[np.ndarray, "batch tokens"],
    ) -> Float[np.ndarray, "batch tokens width"]:
        return self.denoiser(z=z, t=t, words=condition.tokens, words_mask=condition.mask, mask=mask)

    def decode(
        self, latents: Float[np.ndarray, "batch tokens width"], frames: int
    ) -> Float[np.ndarray, "batch frames features"]:
        """Returns features in their own units."""
        mask = np.ones((len(latents), frames), dtype=bool)
        normalizer = Normalizer(
            _float32(self.card.normalizer_mean), _float32(self.card.normalizer_std)
        )
        return normalizer.denormalize(self.decoder(latents=latents, mask=mask))

    @property
    def representation(self) -> Representation:
        """What the features mean."""
        return representation_named(self.card.representation)

    def _frames(self, seconds: float) -> int:
        shortest, longest = self.card.frames
        fps = self.representation.fps
        frames = round(seconds * fps) if np.isfinite(seconds) else -1
        if not shortest <= frames <= longest:
            raise InputError(
                f"{seconds} seconds: model {self.card.name!r} makes motions of "
                f"{shortest / fps:g} to {longest / fps:g} seconds"
            )
        return frames

    def _metadata(self, order: Order, seed: int) -> dict[str, str | int | float]:
        return {
            "model": self.card.name,
            "seed": seed,
            "steps": order.steps,
            "guidance": order.guidance,
            "license": self.card.provenance.license,
        }


def _reading(card: ModelCard) -> SentenceReading:
    return from_json(SentenceReading, card.condition.get("reading", {}))


def _float32(values: Sequence[float]) -> Float[np.ndarray, " channels"]:
    return np.asarray(values, dtype=np.float32)
