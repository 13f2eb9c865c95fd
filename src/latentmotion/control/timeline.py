"""Timelines: several prompts in one motion, each of which begins where the one before ends.

The tokens of a span are sampled with the last second of what is there already as known tokens, so
that the transition is part of what the denoiser generates. All are decoded as one motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.control.generator import (
    Generator,
    SampleKnown,
    decoders_of,
    known_latents_of,
    margin_of,
    metadata_of,
)
from latentmotion.control.stream import KNOWN, decode_in_windows
from latentmotion.engine.request import USUAL_SECONDS, GenerationRequest
from latentmotion.errors import InputError
from latentmotion.model.config import STRIDE, Sampling
from latentmotion.motion import Motion

LONGEST = 600.0
"""Most seconds of a timeline; a stream has no end."""


@dataclass(frozen=True)
class Span:
    """A prompt and how long it is followed.

    Raises:
        InputError: The length is no positive number.
    """

    prompt: str
    """What the person does."""
    seconds: float | None = None
    """Length of the span; by default as predicted from the prompt."""

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < np.inf:
            raise InputError(
                f"{self.prompt!r}: {self.seconds:g} seconds; expected more than 0 s for each span"
            )


def generate_timeline(
    generator: Generator,
    spans: Sequence[str | tuple[str, float] | Span],
    seed: int,
    sampling: Sampling,
) -> Motion:
    """Generates one motion for several prompts, as `MotionPipeline.timeline` does.

    Args:
        generator: The model.
        spans: Prompts, `(prompt, seconds)` or `Span`s.
        seed: Seed of the noise.
        sampling: Steps, guidance and sampler; 2 steps or more.

    Raises:
        InputError: A prompt is not of the model's kind or a number is out of range.
        ModelError: The model has no pullback.
    """
    card, space, motion = generator.card, generator.representation, decoders_of(generator)
    every = spans_of(spans)
    prompts = [span.prompt for span in every]
    usual = generator.usual_seconds(prompts) or [USUAL_SECONDS] * len(every)
    tokens, (shortest, longest) = tokens_of(every, usual, space.fps), card.frames
    frames = [min(max(STRIDE * count, shortest), longest) for count in tokens]
    request = GenerationRequest(tuple(prompts), tuple(frames), (seed,) * len(every), sampling)
    request.check(card, space.fps)
    z = sampled_spans(
        tokens,
        lambda number: known_latents_of(generator, request.take([number])),
        longest // STRIDE,
        card.latents.width,
        seed,
    )
    features = decode_in_windows(z, motion, margin_of(generator))
    joints = np.asarray(space.decode(features), np.float32)
    ends = (np.cumsum(tokens) * STRIDE / space.fps).tolist()
    found = [
        {"prompt": prompt, "start": start, "end": end}
        for prompt, start, end in zip(prompts, [0.0, *ends], ends, strict=False)
    ]
    about = {**metadata_of(generator, seed, sampling), "spans": found}
    return Motion(joints, space.fps, space.skeleton, ", then ".join(prompts), about)


def spans_of(timeline: Sequence[str | tuple[str, float] | Span]) -> tuple[Span, ...]:
    """Returns the spans of a timeline, given as prompts, prompts with seconds, or spans.

    Raises:
        InputError: There are none, or a length is no positive number.
    """
    if not timeline:
        raise InputError("the timeline is empty; expected one prompt or more")
    return tuple(
        Span(one) if isinstance(one, str) else one if isinstance(one, Span) else Span(*one)
        for one in timeline
    )


def parse_span(text: str) -> Span:
    """Reads `a person walks @3`, as the command line has it, or a prompt without a length.

    Raises:
        InputError: What stands behind the last @ is no number of seconds.
    """
    prompt, at, seconds = text.rpartition("@")
    try:
        return Span(prompt.strip(), float(seconds)) if at else Span(text.strip())
    except ValueError as error:
        raise InputError(
            f"--timeline {text!r}: expected PROMPT or PROMPT@SECONDS, such as 'a person walks@3'"
        ) from error


def sampled_spans(
    tokens: Sequence[int],
    sample_of: Callable[[int], SampleKnown],
    longest: int,
    width: int,
    seed: int,
) -> Float[np.ndarray, "tokens width"]:
    """Returns the latents of all spans, one after the other.

    Args:
        tokens: Number of tokens of each span.
        sample_of: Returns what samples tokens with known ones, by the number of the span.
        longest: Most tokens that the model generates at once; a longer span is made in parts.
        width: Numbers per token.
        seed: Of the whole timeline.
    """
    z = np.zeros((0, width))
    for number, count in enumerate(tokens):
        parts = -(-count // (longest - KNOWN))
        for part in range(parts):
            fresh = count * (part + 1) // parts - count * part // parts
            kept = min(KNOWN, len(z))
            window = np.zeros((kept + fresh, width))
            window[:kept] = z[len(z) - kept :]
            drawn = np.random.SeedSequence([seed, number, part]).generate_state(1)
            known = np.arange(kept + fresh) < kept
            found = sample_of(number)(window, known, int(drawn[0]))
            z = np.concatenate([z, found[kept:]])
    return z


def tokens_of(spans: Sequence[Span], seconds: Sequence[float], fps: float) -> list[int]:
    """Returns the number of tokens of each span, so that none begins more than 0.1 s off.

    Args:
        spans: The spans.
        seconds: Length of each where it is left out.
        fps: Frames per second.

    Raises:
        InputError: The timeline is too long.
    """
    given = [
        usual if span.seconds is None else span.seconds
        for span, usual in zip(spans, seconds, strict=True)
    ]
    if sum(given) > LONGEST:
        raise InputError(
            f"a timeline of {sum(given):g} seconds; expected at most {LONGEST:g}, or a stream"
        )
    ends = np.round(np.cumsum(given) * fps / STRIDE).astype(int)
    return np.maximum(np.diff(ends, prepend=0), 1).tolist()
