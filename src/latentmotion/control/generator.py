"""Generator: what control asks of a pipeline; its latents sampled with corrections, and decoded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.control.reach import CorrectedDenoiser, Correction, DecodedMotion, Sample
from latentmotion.diffusion.condition import Condition
from latentmotion.diffusion.parametrization import ParametrizedDenoiser
from latentmotion.diffusion.samplers import Sampler, remaining_times, sample
from latentmotion.engine.backend import Backend, FeatureDecoder
from latentmotion.engine.request import GenerationRequest, padded_batch, with_starts
from latentmotion.engine.session import PULLBACK_FILE
from latentmotion.errors import ModelError
from latentmotion.model.card import ModelCard
from latentmotion.model.config import STRIDE, Sampling
from latentmotion.representation.interface import Representation

# Samples latents with some known ones: the latents, which are known, and a seed.
SampleKnown = Callable[
    [Float[np.ndarray, "tokens width"], Bool[np.ndarray, " tokens"], int],
    Float[np.ndarray, "tokens width"],
]


@runtime_checkable
class Generator(Protocol):
    """A trained model that generates motions; `MotionPipeline` is one."""

    @property
    def card(self) -> ModelCard:
        """Description of the model."""
        ...

    @property
    def condition(self) -> Condition:
        """Turns prompts into words."""
        ...

    @property
    def backend(self) -> Backend:
        """Runs the networks."""
        ...

    @cached_property
    def representation(self) -> Representation:
        """The motion features that the model makes."""
        ...

    @cached_property
    def decoder(self) -> FeatureDecoder:
        """The VAE's decoder with the scales of latents and features."""
        ...

    def guided(self, sampling: Sampling) -> ParametrizedDenoiser:
        """Returns the denoiser with its guidance."""
        ...

    def sampler(self, sampling: Sampling) -> Sampler:
        """Returns the rule of a sampling step."""
        ...

    def usual_seconds(self, prompts: Sequence[str]) -> list[float] | None:
        """Returns the length that the model predicts for each prompt, or None."""
        ...


def decoders_of(generator: Generator) -> Callable[[int], DecodedMotion]:
    """Returns what makes a motion of so many frames a function of its latents.

    Raises:
        InputError: The model's features are of another kind.
        ModelError: The model has no pullback.
    """
    backend, scales = generator.backend, generator.decoder
    pullback = backend.pullback
    if pullback is None:
        raise ModelError(
            f"model {generator.card.name!r} has no {PULLBACK_FILE}, so its motions cannot be "
            "directed; export it again with this version (latentmotion export), or, if it runs "
            "on PyTorch, choose --runtime onnxruntime. Only VAEs of convolutions have one."
        )
    whole = DecodedMotion(
        backend.decoder, pullback, scales.latents, scales.features, generator.representation, 1
    )
    return lambda frames: replace(whole, frames=frames)


def margin_of(generator: Generator) -> int:
    """Returns how many tokens to either side a frame depends on, for a model with a pullback."""
    margin = generator.card.vae.decoder_margin()
    assert margin is not None  # as it has a pullback
    return margin


def latents_of(generator: Generator, request: GenerationRequest) -> Sample:
    """Returns what samples latents of a request's one motion, with corrections."""
    sampling, condition = request.sampling, generator.condition(request.prompts)

    def sample_latents(
        frames: int, correct: Callable[[np.ndarray], np.ndarray]
    ) -> Float[np.ndarray, "tokens width"]:
        sized = replace(request, frames=(frames,))
        backend = generator.backend
        batch, noise = padded_batch(sized, condition, generator.card.latents, backend)
        corrected = CorrectedDenoiser(generator.guided(sampling), correct)
        sampler, steps, (left,) = generator.sampler(sampling), sampling.steps, sized.remaining
        if left is not None:  # it starts from a clip
            first = remaining_times(sampler.schedule, steps, left)[0]
            batch = with_starts(batch, sized.starts, sampler.schedule, first, backend)
        chain = corrected, sampler, batch.noise, batch.condition, batch.tokens, steps, noise
        return sample(*chain, left)[0]

    return sample_latents


def known_latents_of(generator: Generator, request: GenerationRequest) -> SampleKnown:
    """Returns what samples latents of a request's one motion, some of which are known."""
    motion = decoders_of(generator)

    def sample_known(
        z: Float[np.ndarray, "tokens width"], known: Bool[np.ndarray, " tokens"], seed: int
    ) -> Float[np.ndarray, "tokens width"]:
        seeded, frames = replace(request, seeds=(seed,)), len(z) * STRIDE
        keep = Correction(motion(frames), fixed=z, is_known=known)
        return keep(latents_of(generator, seeded)(frames, keep)[None])[0]

    return sample_known


def metadata_of(generator: Generator, seed: int, sampling: Sampling) -> dict[str, Any]:
    """Returns what a motion's file says about how it was made."""
    settings = {"seed": seed, "steps": sampling.steps, "guidance": sampling.guidance}
    card = generator.card
    return {"model": card.name, **settings, **card.terms()}
