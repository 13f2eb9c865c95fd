"""A request for motions, checked against a model's card, and the padded batches made of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.errors import InputError
from latentmotion.model.card import LatentSpace, ModelCard
from latentmotion.model.config import Sampling
from latentmotion.runtime.backend import Backend, Batch


@dataclass(frozen=True)
class GenerationRequest:
    """Prompts, lengths and seeds of several motions, and how they are sampled.

    Raises:
        InputError: The numbers of prompts, lengths and seeds differ, or one is out of range.
    """

    prompts: tuple[str, ...]
    """A sentence, a label or "" per motion, depending on the model's task."""
    frames: tuple[int, ...]
    """Length of each motion."""
    seeds: tuple[int, ...]
    """One seed per motion."""
    sampling: Sampling
    """Steps, guidance scale and sampler of all motions."""

    def __post_init__(self) -> None:
        if len(self.prompts) != len(self.frames):
            raise InputError(f"{len(self.prompts)} prompts for {len(self.frames)} lengths")
        check_seeds(self.frames, self.seeds)
        guidance = self.sampling.guidance
        if not 0 <= guidance <= 100:
            raise InputError(f"guidance {guidance}: expected 0 to 100, usual are 1 to 10")

    def check(self, card: ModelCard, fps: float) -> None:
        """Compares the request with what a model was trained for.

        Raises:
            InputError: A prompt is not of the model's kind, a length is out of its range, or a
                distilled model does not know the sampling.
        """
        check_prompts(card, self.prompts)
        check_frames(card, self.frames, fps)
        if card.leaps:
            sampling = self.sampling
            card.leaps.check(sampling.steps, sampling.guidance, sampling.sampler)

    def take(self, rows: Sequence[int]) -> GenerationRequest:
        """Returns the same for some of the motions."""
        prompts, frames, seeds = (
            tuple(values[row] for row in rows) for values in (self.prompts, self.frames, self.seeds)
        )
        return replace(self, prompts=prompts, frames=frames, seeds=seeds)


def padded_batch(
    request: GenerationRequest, condition: Conditioning, latents: LatentSpace, backend: Backend
) -> tuple[Batch, SeededNoise]:
    """Returns a request as a batch, and the noise of its sampling after the first draw.

    Noise is drawn on the CPU, so that a seed means the same motion on every device.

    Args:
        request: Motions that go through the networks together.
        condition: That of its prompts, NumPy.
        latents: Says how many tokens a length has.
        backend: To which sizes batches are filled, and where arrays are placed.
    """
    padding, place = backend.padding, backend.place
    longest, rows = padding.frames(max(request.frames)), padding.rows(len(request.seeds))
    frames = _filled(request.frames, rows)
    tokens = [latents.tokens_of(length) for length in frames]
    noise = SeededNoise(_filled(request.seeds, rows), tokens)
    most = latents.tokens_of(longest)
    words = _padded(condition, rows, padding.words(condition.mask.shape[1]))
    batch = Batch(
        noise=place(noise((rows, most, latents.width))),
        tokens=place(prefix_mask(tokens, most)),
        words=place(words.tokens),
        words_mask=place(words.mask),
        frames=place(prefix_mask(frames, longest)),
    )
    return batch, noise


def batches(frames: Sequence[int], most: int, mixed: bool = True) -> list[list[int]]:
    """Returns which motions go through the networks together, those of similar length.

    Args:
        frames: Length of each motion.
        most: Motions of a batch.
        mixed: Whether a batch may hold different lengths.
    """
    by_length = sorted(range(len(frames)), key=frames.__getitem__)
    equal = [list(group) for _, group in groupby(by_length, frames.__getitem__)]
    runs = [by_length] if mixed else equal
    return [run[start : start + most] for run in runs for start in range(0, len(run), most)]


def unpadded(
    outputs: Iterable[Float[np.ndarray, "rows longest *_"]],
    batches: Sequence[Sequence[int]],
    frames: Sequence[int],
) -> list[np.ndarray]:
    """Returns each motion's own frames of padded batches, in the order of the request.

    Args:
        outputs: What was made of each batch.
        batches: Which motions went together.
        frames: Length of each motion.
    """
    found: dict[int, np.ndarray] = {}
    for rows, output in zip(batches, outputs, strict=True):
        found |= {row: output[n, : frames[row]] for n, row in enumerate(rows)}
    return [found[row] for row in range(len(frames))]


USUAL_SECONDS = 4.0
"""Length of a motion, where nothing is said, predicted or known of its like."""


def frames_of(
    card: ModelCard,
    seconds: float | Sequence[float] | None,
    count: int,
    fps: float,
    usual: Sequence[float] | None = None,
) -> list[int]:
    """Returns the lengths of `count` motions in frames.

    Args:
        card: The model.
        seconds: Length of all, or of each.
        count: Number of motions.
        fps: Frames per second.
        usual: Lengths where `seconds` is None, moved to what the model makes; by default 4 s.

    Raises:
        InputError: One is no finite number, or there are not as many as motions.
    """
    if seconds is None:
        shortest, longest = card.frames
        each = [USUAL_SECONDS] * count if usual is None else usual
        return [min(max(round(length * fps), shortest), longest) for length in each]
    each = [seconds] * count if isinstance(seconds, int | float) else list(seconds)
    if not np.isfinite(each).all():
        raise InputError(f"{seconds} seconds: expected a number")
    if len(each) != count:
        raise InputError(f"{len(each)} lengths for {count} motions")
    return [round(length * fps) for length in each]


def check_prompts(card: ModelCard, prompts: Sequence[str]) -> None:
    """Compares prompts with a model's task; whether a label is known, its condition tells.

    Raises:
        InputError: One is of another kind.
    """
    for prompt in prompts:
        card.condition.check_prompt(prompt, card.name)


def check_seeds(frames: Sequence[int], seeds: Sequence[int]) -> None:
    """Raises InputError where a seed is negative or there are not as many as motions."""
    if len(seeds) != len(frames):
        raise InputError(f"{len(seeds)} seeds for {len(frames)} motions")
    if any(seed < 0 for seed in seeds):
        raise InputError(f"seed {min(seeds)}: expected a number from 0 up")


def check_frames(card: ModelCard, frames: Sequence[int], fps: float) -> None:
    """Compares lengths with those that a model was trained on.

    Raises:
        InputError: One is too short or too long.
    """
    shortest, longest = card.frames
    for length in frames:
        if not shortest <= length <= longest:
            raise InputError(
                f"{length / fps:g} seconds: model {card.name!r} makes motions of "
                f"{shortest / fps:g} to {longest / fps:g} seconds"
            )


def _filled(values: Sequence[int], rows: int) -> list[int]:
    """The values, the last of them repeated up to `rows`."""
    return [*values, *[values[-1]] * (rows - len(values))]


def _padded(condition: Conditioning, rows: int, words: int) -> Conditioning:
    """The condition with its last row repeated, and words of zero that nobody sees."""
    count, seen = condition.mask.shape
    if (rows, words) == (count, seen):
        return condition
    repeated = _filled(range(count), rows)
    missing = (0, 0), (0, words - seen)
    return Conditioning(
        np.pad(condition.tokens[repeated], (*missing, (0, 0))),
        np.pad(condition.mask[repeated], missing),
    )
