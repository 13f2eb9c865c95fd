"""What is asked of a model, checked, and in which batches it goes through the networks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from latentmotion.diffusion.sampler import SamplerName
from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard


@dataclass(frozen=True)
class Order:
    """Prompts, lengths and seeds of several motions, and how they are sampled.

    Raises:
        InputError: The numbers of prompts, lengths and seeds differ, or one is out of range.
    """

    prompts: tuple[str, ...]
    """A sentence, a label or "" per motion, as the model's task is."""
    frames: tuple[int, ...]
    """Length of each motion."""
    seeds: tuple[int, ...]
    """One seed per motion."""
    steps: int
    """Sampling steps."""
    guidance: float
    """Guidance scale."""
    sampler: SamplerName
    """Rule of a sampling step."""

    def __post_init__(self) -> None:
        if len(self.prompts) != len(self.frames):
            raise InputError(f"{len(self.prompts)} prompts for {len(self.frames)} lengths")
        check_seeds(self.frames, self.seeds)
        if not 0 <= self.guidance <= 100:
            raise InputError(f"guidance {self.guidance}: expected 0 to 100, usual are 1 to 10")

    def take(self, rows: Sequence[int]) -> Order:
        """Returns the same for some of the motions."""
        prompts, frames, seeds = (
            tuple(values[row] for row in rows) for values in (self.prompts, self.frames, self.seeds)
        )
        return replace(self, prompts=prompts, frames=frames, seeds=seeds)


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
