"""The model as the queue runs it: prompts with equal settings in one batch, all else one by one."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from latentmotion.condition import SentenceCondition
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.engine.request import GenerationRequest, frames_of
from latentmotion.errors import LatentMotionError
from latentmotion.pipeline import MotionPipeline, RawMotion
from latentmotion.text.cache import MemoryCachedTextEncoder

RECENT_PROMPTS = 1000
"""Prompts whose embeddings stay in memory, some 20 kB each."""


@dataclass(frozen=True)
class BatchSettings:
    """Settings that prompts share if they are generated in one batch."""

    steps: int | None
    """Sampling steps; None for the model's own."""
    guidance: float | None
    """Guidance scale; None for the model's own."""
    sampler: SamplerName | None
    """Sampler; None for the model's own."""
    predicted: bool
    """The model predicts the length."""


@dataclass(frozen=True)
class Prompt:
    """A motion to generate."""

    text: str
    """What the person does."""
    seconds: float | None
    """Length; None for the predicted one."""
    seed: int
    """Seed of the noise."""


def with_recent_prompts(pipeline: MotionPipeline) -> MotionPipeline:
    """Returns a pipeline that keeps the embeddings of the last prompts in memory."""
    condition = pipeline.condition
    if not isinstance(condition, SentenceCondition):
        return pipeline
    return replace(
        pipeline,
        condition=replace(
            condition, encoder=MemoryCachedTextEncoder(condition.encoder, RECENT_PROMPTS)
        ),
    )


def first_prompt(pipeline: MotionPipeline) -> Prompt:
    """Returns a prompt for the first batch, which loads the networks before users wait for them."""
    condition = pipeline.card.condition
    prompt = (getattr(condition, "labels", None) or ["a person walks"])[0]
    return Prompt(prompt if condition.prompted else "", None, 0)


def check(pipeline: MotionPipeline, settings: BatchSettings, prompts: Sequence[Prompt]) -> None:
    """Checks prompts without running a network.

    Raises:
        InputError: One is not of the model's kind, or a number is out of range.
    """
    card, fps = pipeline.card, pipeline.representation.fps
    sampling = card.sampling.but(settings.steps, settings.guidance, settings.sampler)
    for prompt in prompts:
        frames = frames_of(card, prompt.seconds, 1, fps)
        GenerationRequest((prompt.text,), tuple(frames), (prompt.seed,), sampling).check(card, fps)


def run(
    pipeline: MotionPipeline, key: Hashable, payloads: Sequence[Any]
) -> list[Any | LatentMotionError]:
    """Returns the results of a batch.

    Args:
        pipeline: The model.
        key: `BatchSettings` for prompts; anything else for functions.
        payloads: Prompts, or functions without arguments.

    Returns:
        Raw motions, or what the functions return; or the error of each that could not be made.
    """
    if not isinstance(key, BatchSettings):
        return [_result_or_error(payload) for payload in payloads]
    settings = key
    try:
        return _motions(pipeline, settings, payloads)
    except LatentMotionError:
        # One of them is at fault, and the others do not pay for it.
        return [
            _result_or_error(lambda prompt=payload: _motions(pipeline, settings, [prompt])[0])
            for payload in payloads
        ]


def _motions(
    pipeline: MotionPipeline, settings: BatchSettings, prompts: Sequence[Prompt]
) -> list[RawMotion]:
    seconds = None if settings.predicted else [prompt.seconds or 0.0 for prompt in prompts]
    texts, seeds = [prompt.text for prompt in prompts], [prompt.seed for prompt in prompts]
    sampling = settings.steps, settings.guidance, settings.sampler
    return pipeline.raw_motions(texts, seconds, seeds, *sampling)


def _result_or_error(function: Callable[[], Any]) -> Any | LatentMotionError:
    try:
        return function()
    except LatentMotionError as error:
        return error
