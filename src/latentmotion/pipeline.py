"""The pipeline: prompt → condition → (noise → latents) → features → joints → motion.

MLD section 3 without PyTorch. Read it from top to bottom: `MotionPipeline.__call__`, `batch`,
`generate_batch`, and `features_from_noise`, which training previews and exported graphs run too.
A prompt is a sentence, an action label or nothing.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Condition, Conditioning
from latentmotion.condition.sentence import SentenceCondition
from latentmotion.condition.text.lengths import LengthFile
from latentmotion.diffusion.guidance import ClassifierFreeGuidance, GuidanceAsInput
from latentmotion.diffusion.interface import Denoiser, Noise
from latentmotion.diffusion.leaps import Leap, LeapTimes
from latentmotion.diffusion.sampler import Sampler, SamplerName, sample, sampler_named
from latentmotion.feature_decoder import FeatureDecoder, representation_of
from latentmotion.hub import download, is_hub_id
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.config import Sampling
from latentmotion.model.folder import DEFAULT, find_model
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.request import (
    Batch,
    GenerationRequest,
    batches,
    check_prompts,
    frames_of,
    padded_batch,
    unpadded,
)
from latentmotion.runtime.backend import Backend, directly
from latentmotion.runtime.conditions import condition_of, find_lengths
from latentmotion.runtime.session import (
    OpenedWhenCalled,
    Runtime,
    open_decoder,
    open_fused_samplers,
)

MAX_BATCH_SIZE = 32
"""Motions that go through the networks together; more are done in turns, to bound memory."""


@dataclass(frozen=True)
class MotionPipeline:
    """A trained model, ready to generate. Immutable, so that one serves many threads."""

    card: ModelCard
    """What the model is."""
    condition: Condition
    """Prompts to words."""
    backend: Backend
    """Runs the networks."""
    max_batch_size: int = MAX_BATCH_SIZE
    """Motions that go through the networks together."""
    body: SmplRepresentation | None = None
    """Body whose joints motions have, in place of the skeleton that ships."""
    lengths: LengthFile | None = None
    """Sentences to usual lengths, for motions whose length is not given."""

    @classmethod
    def from_pretrained(
        cls,
        model: str | Path = DEFAULT,
        runtime: Runtime = "auto",
        threads: int | None = None,
        cache: Path | None = None,
    ) -> MotionPipeline:
        """Opens a model by name (`fast` and `starter` ship with the package), folder or hub id.

        Networks are loaded when they are first needed. Nothing is downloaded unless `model` is an
        id, `owner/name` or `owner/name@revision`, and no folder here has that name.

        Args:
            model: Name, folder, or id on the Hugging Face Hub.
            runtime: Engine of the networks; `auto` takes ONNX Runtime.
            threads: Most threads the engine may use; by default all cores.
            cache: Folder in which embeddings of prompts are kept, for example `cache_folder()`.

        Raises:
            ModelError: There is no such model, or a file of it is missing: it was not exported.
            MissingExtraError: The model is on the hub and `huggingface_hub` is not installed.
        """
        folder = download(str(model)) if is_hub_id(model) else find_model(model)
        card = read_card(folder)
        backend = Backend(
            OpenedWhenCalled(folder / "denoiser.onnx", runtime, threads),
            open_decoder(card, folder, runtime, threads),
            open_fused_samplers(card, folder, runtime, threads),
        )
        condition, lengths = condition_of(card, folder, cache), find_lengths(card, folder)
        return cls(card, condition, backend, lengths=lengths)

    @classmethod
    def load(cls, *arguments: Any, **named: Any) -> MotionPipeline:
        """Old name of `from_pretrained`, which takes the same arguments."""
        message = (
            "MotionPipeline.load is now from_pretrained; the old name goes with the next release"
        )
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return cls.from_pretrained(*arguments, **named)

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
            prompt: What the person does, e.g. `a person walks and sits down`; for a model of
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
        sampling = self.card.sampling.but(steps, guidance, sampler)
        request = GenerationRequest(tuple(prompts), tuple(frames), tuple(seeds), sampling)
        rows, fetch = self._batches(request), self.backend.fetch
        features = (self.generate_batch(request.take(each)) for each in rows)
        joints = unpadded((fetch(self.joints_of(each)) for each in features), rows, frames)
        return [self._motion(request, row, each) for row, each in enumerate(joints)]

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
        sampling = self.card.sampling.but(steps, guidance, sampler)
        return self.generate(
            GenerationRequest(tuple(prompts), tuple(frames), tuple(seeds), sampling)
        )

    def generate(self, request: GenerationRequest) -> list[Float[np.ndarray, "_ features"]]:
        """Returns features in their own units, (frames, features), for each motion of a request.

        Raises:
            InputError: A prompt is not of the model's kind or a number is out of range.
        """
        rows = self._batches(request)
        features = (self.generate_batch(request.take(each)) for each in rows)
        return unpadded(map(self.backend.fetch, features), rows, request.frames)

    def generate_batch(
        self, request: GenerationRequest, condition: Conditioning | None = None
    ) -> Float[Any, "rows longest features"]:
        """Returns features of motions that go through the networks together.

        Args:
            request: The motions; more rows and frames than it has mean nothing.
            condition: That of the prompts; by default they are read.

        Returns:
            Features in their own units, an array of the backend's.
        """
        sampling, backend = request.sampling, self.backend
        if condition is None:
            condition = self.condition(request.prompts)
        batch, noise = padded_batch(request, condition, self.card.latents, backend)
        if sampling.steps in backend.fused:
            return backend.run_fused(batch, sampling)
        denoiser, sampler = self.guided(sampling), self.sampler(sampling)

        def chain(*arrays: Any) -> Float[Any, "rows longest features"]:
            batch, steps = Batch(*arrays), sampling.steps
            return features_from_noise(batch, denoiser, sampler, steps, noise, self._decoder)

        # Fresh noise at every step comes from the host, which no recording asks.
        launch = directly if sampling.sampler == "ddpm" else backend.launch
        return launch(sampling, chain, *vars(batch).values())

    def joints_of(
        self, features: Float[Any, "rows longest features"]
    ) -> Float[Any, "rows longest joints 3"]:
        """Places the joints, where the backend's arrays are."""
        # SMPL's representation asks the host for constants, which no recording does.
        asks = isinstance(self.representation, SmplRepresentation)
        launch = directly if asks else self.backend.launch
        return launch("joints", self.representation.decode, features)

    def guided(self, sampling: Sampling) -> Denoiser:
        """Returns the denoiser with guidance around it, or inside it for a distilled model."""
        if self.card.leaps:
            return GuidanceAsInput(self._denoise, sampling.guidance, sampling.steps)
        return ClassifierFreeGuidance(self._denoise, self._null, sampling.guidance)

    def sampler(self, sampling: Sampling) -> Sampler:
        """Returns the rule of a sampling step; override it to use a sampler of your own."""
        return sampler_of(self.card, sampling)

    @cached_property
    def representation(self) -> Representation:
        """What the features mean."""
        return representation_of(self.card, self.body)

    def _batches(self, request: GenerationRequest) -> list[list[int]]:
        """Checks a request; returns which motions go through the networks together."""
        request.check(self.card, self.representation.fps)
        return batches(request.frames, self.max_batch_size, self.card.masks_padding)

    def _usual_seconds(self, prompts: Sequence[str]) -> list[float] | None:
        check_prompts(self.card, prompts)
        if self.lengths is None or not prompts or not isinstance(self.condition, SentenceCondition):
            return None
        return self.lengths.usual(self.condition.encoder(prompts).pooled)

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
        return self.backend.denoiser(z=z, t=t, words=words, words_mask=real, mask=mask, **told)

    @cached_property
    def _null(self) -> Conditioning:
        null, place = self.condition.null(1), self.backend.place
        return Conditioning(place(null.tokens), place(null.mask))

    @cached_property
    def _decoder(self) -> FeatureDecoder:
        return FeatureDecoder.of(self.card, self.backend.decoder, self.backend.place)

    def _motion(
        self, request: GenerationRequest, row: int, joints: Float[np.ndarray, "_ joints 3"]
    ) -> Motion:
        about = {"model": self.card.name, "seed": request.seeds[row]}
        about |= {"steps": request.sampling.steps, "guidance": request.sampling.guidance}
        about |= {"license": self.card.provenance.license}
        part, joints = self.representation, np.asarray(joints, np.float32)
        return Motion(joints, part.fps, part.skeleton, request.prompts[row], about)


def features_from_noise(
    batch: Batch,
    denoiser: Denoiser,
    sampler: Sampler,
    steps: int,
    noise: Noise,
    decoder: FeatureDecoder,
) -> Float[Any, "batch frames features"]:
    """Generates features: noise → latents, by the sampler → features in their own units.

    Args:
        batch: Noise, condition and masks, arrays of NumPy or PyTorch.
        denoiser: The network with its guidance.
        sampler: The rule of a step.
        steps: Number of steps.
        noise: Draws further noise, where the sampler wants any.
        decoder: The VAE's decoder with the scales of latents and features.
    """
    z = sample(denoiser, sampler, batch.noise, batch.condition, batch.tokens, steps, noise)
    return decoder(z, batch.frames)


def sampler_of(card: ModelCard, sampling: Sampling) -> Sampler:
    """Returns the sampler for a model's schedule; a distilled one stops at its own few times."""
    schedule = LeapTimes(card.schedule, card.leaps) if card.leaps else card.schedule
    return sampler_named(sampling.sampler, schedule, card.prediction)
