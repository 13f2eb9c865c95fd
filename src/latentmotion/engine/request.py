"""Generation requests: checked against a model's card, split into padded batches."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from numbers import Integral, Real
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.diffusion.schedule import Schedule
from latentmotion.engine.backend import Backend, Batch
from latentmotion.errors import InputError, hint
from latentmotion.model.card import ModelCard
from latentmotion.model.config import LatentSpace, Sampling
from latentmotion.storage.reading import packaged_toml


@dataclass(frozen=True, eq=False)
class Start:
    """Latents that sampling starts from instead of pure noise, as in SDEdit (Meng et al. 2022).

    z_t = alpha(t) z_0 + sigma(t) epsilon, where t begins the last `remaining` steps.
    """

    latents: Float[np.ndarray, "tokens width"]  # z_0, in the denoiser's scale.
    share: float  # Share of the sampling steps that remain: 0 keeps the latents, 1 is pure noise.
    # Share of z_0 in the result, by default none, with which the sampled latents are mixed: few
    # steps have no time between the last and the end at which less would change.
    result_share: Float[np.ndarray, " tokens"] | None = None

    def remaining(self, steps: int) -> int:
        """Returns how many of so many steps remain: at least one."""
        return min(max(round(self.share * steps), 1), steps)


@dataclass(frozen=True)
class GenerationRequest:
    """Prompts, lengths, seeds and sampling settings of several motions.

    Raises:
        InputError: The numbers of prompts, lengths and seeds differ, or one is out of range.
    """

    prompts: tuple[str, ...]  # A sentence, a label or "" per motion, depending on the model's task.
    frames: tuple[int, ...]  # Length of each motion.
    seeds: tuple[int, ...]  # One seed per motion.
    sampling: Sampling  # Steps, guidance scale and sampler of all motions.
    # What each motion starts from, None for pure noise; empty if all do.
    starts: tuple[Start | None, ...] = ()

    def __post_init__(self) -> None:
        if len(self.prompts) != len(self.frames):
            raise InputError(f"{len(self.prompts)} prompts for {len(self.frames)} lengths")
        if self.starts and len(self.starts) != len(self.frames):
            raise InputError(f"{len(self.starts)} starts for {len(self.frames)} lengths")
        check_seeds(self.frames, self.seeds)
        guidance = self.sampling.guidance
        if not 0 <= guidance <= 100:
            raise InputError(f"guidance {guidance}: expected 0 to 100, usual are 1 to 10")

    def check(self, card: ModelCard, fps: float) -> None:
        """Checks that a model was trained for the request.

        Raises:
            InputError: A prompt is not of the model's kind, a length is out of its range, or a
                distilled model does not support the sampling settings.
        """
        check_prompts(card, self.prompts)
        check_frames(card, self.frames, fps)
        if card.few_step:
            sampling = self.sampling
            card.few_step.check(sampling.steps, sampling.guidance, sampling.sampler)

    def take(self, rows: Sequence[int]) -> GenerationRequest:
        """Returns the request for some of its motions."""
        return replace(
            self,
            prompts=tuple(self.prompts[row] for row in rows),
            frames=tuple(self.frames[row] for row in rows),
            seeds=tuple(self.seeds[row] for row in rows),
            starts=tuple(self.starts[row] for row in rows) if self.starts else (),
        )

    @property
    def remaining(self) -> tuple[int | None, ...]:
        """Sampling steps that remain for each motion, None if it starts from pure noise."""
        starts = self.starts or (None,) * len(self.frames)
        return tuple(start and start.remaining(self.sampling.steps) for start in starts)

    def batches(self, most: int, mixed: bool) -> list[list[int]]:
        """Splits motions into batches of similar length that have the same steps to do.

        Args:
            most: Maximum number of motions in a batch.
            mixed: Whether a batch may hold different lengths.
        """
        remaining = self.remaining
        return [
            [rows[n] for n in batch]
            for steps in dict.fromkeys(remaining)
            for rows in [[row for row, row_steps in enumerate(remaining) if row_steps == steps]]
            for batch in batches([self.frames[row] for row in rows], most, mixed)
        ]


def padded_batch(
    request: GenerationRequest, condition: Conditioning, latents: LatentSpace, backend: Backend
) -> tuple[Batch, SeededNoise]:
    """Returns a request as a padded batch, and the noise of its sampling after the first draw.

    Noise is drawn on the CPU, so that a seed means the same motion on every device.

    Args:
        request: Motions that go through the networks together.
        condition: Condition of its prompts, NumPy.
        latents: Number of tokens of each length.
        backend: Padding of the batch, and device of its arrays.
    """
    padding, to_device = backend.padding, backend.to_device
    count, width = condition.mask.shape
    rows, words, longest = padding.sizes(len(request.seeds), width, max(request.frames))
    frames = _repeat_last(request.frames, rows)
    tokens = [latents.tokens_of(length) for length in frames]
    noise = SeededNoise(_repeat_last(request.seeds, rows), tokens)
    most = latents.tokens_of(longest)
    if (rows, words) != (count, width):
        repeated, missing = _repeat_last(range(count), rows), ((0, 0), (0, words - width))
        condition = Conditioning(
            np.pad(condition.tokens[repeated], (*missing, (0, 0))),
            np.pad(condition.mask[repeated], missing),
        )
    batch = Batch(
        noise=to_device(noise((rows, most, latents.width))),
        tokens=to_device(prefix_mask(tokens, most)),
        words=to_device(condition.tokens),
        words_mask=to_device(condition.mask),
        frames=to_device(prefix_mask(frames, longest)),
    )
    return batch, noise


def with_starts(
    batch: Batch, starts: Sequence[Start | None], schedule: Schedule, time: float, backend: Backend
) -> Batch:
    """Returns a batch that starts from latents of clips, which its noise is mixed with.

    Args:
        batch: Pure noise and masks.
        starts: Latents that each motion starts from; further rows are padding.
        schedule: Weights of latents and noise.
        time: Time at which sampling begins.
        backend: Device of the arrays.
    """
    latents = np.zeros(tuple(batch.noise.shape), np.float32)
    shares = np.zeros((*latents.shape[:2], 1), np.float32)
    for row, start in enumerate(starts):
        if start is not None:
            latents[row, : len(start.latents)] = start.latents
            if start.result_share is not None:
                shares[row, : len(start.latents), 0] = start.result_share
    z0 = backend.to_device(latents)
    noised = schedule.alpha(time) * z0 + schedule.sigma(time) * batch.noise
    return replace(batch, noise=noised, start=z0, start_share=backend.to_device(shares))


def batches(frames: Sequence[int], most: int, mixed: bool = True) -> list[list[int]]:
    """Splits motions into batches of similar length; returns the indices of each batch.

    Args:
        frames: Length of each motion.
        most: Maximum number of motions in a batch.
        mixed: Whether a batch may hold different lengths.
    """
    by_length = sorted(range(len(frames)), key=frames.__getitem__)
    equal = [list(group) for _, group in groupby(by_length, frames.__getitem__)]
    runs = [by_length] if mixed else equal
    return [run[start : start + most] for run in runs for start in range(0, len(run), most)]


def unpadded(
    outputs: Iterable[Float[np.ndarray, "_ _ *_"]],
    batches: Sequence[Sequence[int]],
    frames: Sequence[int],
) -> list[np.ndarray]:
    """Returns the frames of each motion from padded batches, in the order of the request.

    Args:
        outputs: An array per batch.
        batches: Indices of the motions in each batch.
        frames: Length of each motion.
    """
    motions: dict[int, np.ndarray] = {}
    for rows, output in zip(batches, outputs, strict=True):
        motions |= {row: output[n, : frames[row]] for n, row in enumerate(rows)}
    return [motions[row] for row in range(len(frames))]


USUAL_SECONDS = 4.0  # Length of a motion that is neither given nor predicted.


def each(seconds: float | Sequence[float | None] | None, count: int) -> list[float | None]:
    """Returns a length for each motion, where one may be given for all.

    Raises:
        InputError: A length is no number, or their number is not that of the motions.
    """
    if isinstance(seconds, Sequence | np.ndarray) and not isinstance(seconds, str):
        lengths: list[Any] = list(seconds)
    else:
        lengths = [seconds] * count
    if len(lengths) != count:
        motions = "one motion" if count == 1 else f"{count} motions"
        raise InputError(f"{len(lengths)} lengths for {motions}; expected one for each, or one")
    for length in lengths:
        if length is not None and not _is_number(length):
            raise InputError(f"seconds is {length!r}; expected a number, such as 4.0")
    return lengths


# Names that other libraries have for arguments.
OTHER_NAMES = packaged_toml(__file__, "arguments.toml")


def check_arguments(unknown: Mapping[str, Any], **numbers: Any) -> None:
    """Checks the arguments of a call.

    Args:
        unknown: Arguments that there are none of.
        **numbers: Numbers by name; of them `guidance` may be a fraction.

    Raises:
        InputError: There is an unknown one, or a number is of another kind.
    """
    for name in unknown:
        names = [*numbers, "prompt", "seconds", "sampler", "goals", "from_clips", "clean_up"]
        if name in OTHER_NAMES:
            raise InputError(f"unknown argument {name!r}; it is called {OTHER_NAMES[name]!r} here")
        raise InputError(f"unknown argument {name!r}; {hint(name, names)}")
    for name, number in numbers.items():
        if number is None or _is_number(number, whole=name != "guidance"):
            continue
        kind = "a number" if name == "guidance" else "a whole number"
        raise InputError(f"{name} is {number!r}; expected {kind}")


def _is_number(value: Any, whole: bool = False) -> bool:
    return isinstance(value, Integral if whole else Real) and not isinstance(value, bool)


def frames_of(
    card: ModelCard,
    seconds: float | Sequence[float | None] | None,
    count: int,
    fps: float,
    usual: Sequence[float] | None = None,
) -> list[int]:
    """Returns the lengths of `count` motions in frames.

    Args:
        card: The model.
        seconds: Length of all, or of each; None where it is the usual one.
        count: Number of motions.
        fps: Frames per second.
        usual: Lengths where none is given, clipped to the model's range; by default 4 s.

    Raises:
        InputError: A length is not a finite number, or their number is not that of the motions.
    """
    lengths = each(seconds, count)
    shortest, longest = card.frames
    predicted = [USUAL_SECONDS] * count if usual is None else usual
    frames = []
    for length, likely in zip(lengths, predicted, strict=True):
        exact = (likely if length is None else length) * fps
        if not np.isfinite(exact):
            raise InputError(f"{length} seconds: expected a number that frames can be counted in")
        frames.append(
            round(exact) if length is not None else min(max(round(exact), shortest), longest)
        )
    return frames


def check_prompts(card: ModelCard, prompts: Sequence[str]) -> None:
    """Checks that prompts are of the kind that a model takes; its condition checks labels.

    Raises:
        InputError: A prompt is of another kind.
    """
    for prompt in prompts:
        if not isinstance(prompt, str):
            raise InputError(f"a prompt is {prompt!r}; expected words")
        if re.search("[\ud800-\udfff]", prompt):  # bytes that Python could not decode
            raise InputError(
                f"the prompt {prompt!r:.200} holds bytes that are not UTF-8; set the terminal's "
                "encoding to UTF-8, or put the prompt in a file (--file)"
            )
        card.condition.check_prompt(prompt, card.name)


def check_seeds(frames: Sequence[int], seeds: Sequence[int]) -> None:
    """Raises InputError if a seed is negative or their number is not that of the motions."""
    if len(seeds) != len(frames):
        raise InputError(f"{len(seeds)} seeds for {len(frames)} motions")
    for seed in seeds:
        check_arguments({}, seed=seed)
    if any(seed < 0 for seed in seeds):
        raise InputError(f"seed {min(seeds)}: expected a number from 0 up")


def check_frames(card: ModelCard, frames: Sequence[int], fps: float) -> None:
    """Checks that a model was trained on motions of these lengths.

    Raises:
        InputError: A length is too short or too long.
    """
    shortest, longest = card.frames
    for length in frames:
        if not shortest <= length <= longest:
            raise InputError(
                f"{length / fps:g} seconds: model {card.name!r} makes motions of "
                f"{shortest / fps:g} to {longest / fps:g} seconds"
            )


def _repeat_last(values: Sequence[int], rows: int) -> list[int]:
    return [*values, *[values[-1]] * (rows - len(values))]
