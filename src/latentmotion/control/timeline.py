"""Timelines: several prompts in one motion, each of which begins where the one before ends.

The tokens of a span are sampled with the last second of what is there already as known tokens, so
that the transition is part of what the denoiser generates. All are decoded as one motion.

On a second track prompts move one part of the body: each becomes a motion of its own, whose part is
put on the body that follows the first track, with position and velocity of both seams.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.control.edit import parts_named, with_parts
from latentmotion.control.exact import inertialized
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
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.model.config import STRIDE
from latentmotion.motion import Motion

LONGEST = 600.0  # Most seconds of a timeline; a stream has no end.

# Seconds in which a part of the body goes over to another motion.
_SEAM = 0.6


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


@dataclass(frozen=True)
class PartSpan:
    """A prompt that one part of the body follows for some time.

    Raises:
        InputError: The times are not ascending, or the first is before the motion.
    """

    part: str
    """Name of the part: an arm, arms, a leg, legs, head or upper_body."""
    prompt: str
    """What the person does, of which the part is taken."""
    start: float
    """Seconds."""
    end: float
    """Seconds."""

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.end < np.inf:
            raise InputError(
                f"{self.part}, {self.prompt!r}: from {self.start:g} to {self.end:g} s; expected "
                "two ascending times from 0 s on"
            )


def generate_timeline(
    generator: Generator,
    spans: Sequence[str | tuple[str, float] | Span],
    seed: int = 0,
    steps: int | None = None,
    guidance: float | None = None,
    parts: Sequence[tuple[str, str, float, float] | PartSpan] = (),
) -> Motion:
    """Generates one motion for several prompts, one after the other.

    Args:
        generator: The model.
        spans: Prompts, `(prompt, seconds)` or `Span`s; where the length is left out, it is
            predicted from the prompt.
        seed: Seed of the noise.
        steps: Sampling steps, 2 or more; by default the model's own.
        guidance: Guidance scale; by default the model's own.
        parts: What parts of the body do meanwhile: `(part, prompt, start, end)` or `PartSpan`s,
            such as `("right_arm", "a person waves the right hand", 1, 3)`; all other joints are
            those of the timeline without it.

    Raises:
        InputError: A prompt is not of the model's kind, a number is out of range, there is no such
            part, or two prompts move one joint at a time.
        ModelError: The model has no `pullback.onnx`.
    """
    card, space, motion = generator.card, generator.representation, decoders_of(generator)
    sampling = card.sampling.but(steps, guidance, None)
    every = spans_of(spans)
    prompts = [span.prompt for span in every]
    usual = generator.usual_seconds(prompts) or [USUAL_SECONDS] * len(every)
    tokens, (shortest, longest) = tokens_of(every, usual, space.fps), card.frames
    above = [span if isinstance(span, PartSpan) else PartSpan(*span) for span in parts]
    check_parts(above, sum(tokens) * STRIDE / space.fps, space.skeleton)
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
    sections: list[dict[str, object]] = [
        {"prompt": prompt, "start": start, "end": end}
        for prompt, start, end in zip(prompts, [0.0, *ends], ends, strict=False)
    ]
    for number, span in enumerate(above, len(every)):
        # A token more, so that rounding takes no frame away.
        alone = Span(span.prompt, span.end - span.start + STRIDE / space.fps)
        drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
        part_joints = generate_timeline(generator, [alone], drawn, steps, guidance).joints
        joints = _with_part(joints, part_joints, span, space.fps, space.skeleton)
        sections.append(vars(span))
    about = {**metadata_of(generator, seed, sampling), "spans": sections}
    words = [", then ".join(prompts), *(f"{span.part}: {span.prompt}" for span in above)]
    return Motion(joints, space.fps, space.skeleton, "; ".join(words), about)


def spans_of(timeline: Sequence[str | tuple[str, float] | Span]) -> tuple[Span, ...]:
    """Returns the spans of a timeline, given as prompts, prompts with seconds, or spans.

    Raises:
        InputError: There are none, or a length is no positive number.
    """
    if not timeline:
        raise InputError("the timeline is empty; expected one prompt or more")
    return tuple(
        Span(span) if isinstance(span, str) else span if isinstance(span, Span) else Span(*span)
        for span in timeline
    )


def check_parts(spans: Sequence[PartSpan], seconds: float, skeleton: Skeleton) -> None:
    """Checks the prompts and times of parts of the body.

    Args:
        spans: Parts with their prompts and times.
        seconds: Length of the timeline.
        skeleton: Of the model.

    Raises:
        InputError: There is no such part, it moves after the timeline's end, or two prompts move
            one joint at a time.
    """
    for number, span in enumerate(spans):
        parts_named([span.part], skeleton)
        # Spans begin and end up to 0.1 s off what was asked.
        if span.end > seconds + 0.1 + 1e-6:
            raise InputError(
                f"{span.part}, {span.prompt!r}, ends at {span.end:g} s, the timeline at "
                f"{seconds:g} s: make the timeline longer or end it earlier"
            )
        for other in spans[:number]:
            if max(span.start, other.start) >= min(span.end, other.end):
                continue
            try:
                parts_named([other.part, span.part], skeleton)
            except InputError as error:
                raise InputError(
                    f"{other.prompt!r} until {other.end:g} s and {span.prompt!r} from "
                    f"{span.start:g} s move one joint at a time: {error}"
                ) from error


def parse_part_span(text: str) -> PartSpan:
    """Reads `right_arm@1-3=a person waves`, as the command line has it.

    Raises:
        InputError: It is not of that form.
    """
    head, _, words = text.partition("=")
    part, _, times = head.partition("@")
    start, _, end = times.partition("-")
    prompt = words.strip()
    try:
        seconds = float(start), float(end if prompt else "")
    except ValueError as error:
        raise InputError(
            f"--timeline-part {text!r}: expected PART@START-END=PROMPT in seconds, such as "
            "'right_arm@1-3=a person waves the right hand'"
        ) from error
    return PartSpan(part.strip(), prompt, *seconds)


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
            overlap = min(KNOWN, len(z))
            window = np.zeros((overlap + fresh, width))
            window[:overlap] = z[len(z) - overlap :]
            drawn = np.random.SeedSequence([seed, number, part]).generate_state(1)
            is_known = np.arange(overlap + fresh) < overlap
            sampled = sample_of(number)(window, is_known, int(drawn[0]))
            z = np.concatenate([z, sampled[overlap:]])
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
    lengths = [
        usual if span.seconds is None else span.seconds
        for span, usual in zip(spans, seconds, strict=True)
    ]
    if sum(lengths) > LONGEST:
        raise InputError(
            f"a timeline of {sum(lengths):g} seconds; expected at most {LONGEST:g}, or a stream"
        )
    ends = np.round(np.cumsum(lengths) * fps / STRIDE).astype(int)
    return np.maximum(np.diff(ends, prepend=0), 1).tolist()


def _with_part(
    body: Joints,
    own: Float[np.ndarray, "some joints 3"],
    span: PartSpan,
    fps: float,
    skeleton: Skeleton,
) -> Joints:
    """Returns a motion whose part moves as in another; all other joints are the same numbers.

    Args:
        body: The motion.
        own: The other, from the span's start on.
        span: The part and its times.
        fps: Frames per second.
        skeleton: Of both.
    """
    moved, parts = body.copy(), parts_named([span.part], skeleton)
    start, end = round(span.start * fps), min(round(span.end * fps), len(body))
    if end <= start:
        return moved
    frames = slice(start, end)
    piece = with_parts(body[frames], own[: end - start], parts, skeleton)
    before, after = body[max(0, start - 3) : start], body[end : end + 3]
    if len(before) or len(after):
        # On the body again, as what is before and after has moved the chest and the hips too.
        seamless = inertialized(piece, before, after, skeleton, _SEAM * fps)
        piece = with_parts(body[frames], seamless, parts, skeleton)
    moved[frames] = piece
    return moved
