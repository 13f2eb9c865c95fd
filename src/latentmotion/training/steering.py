"""What steers the diffusion in training, by task: sentences, action labels or nothing.

An item's captions are what it is steered by: its sentences, the label of its clip, or none. So a
crop's caption is its prompt, whatever the task is, and the empty one stands for no condition.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from latentmotion.condition.action import ActionCondition
from latentmotion.condition.interface import Condition, Conditioning, TextEncoder
from latentmotion.condition.sentence import SentenceCondition
from latentmotion.condition.unconditional import Unconditional
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Item, items_of
from latentmotion.errors import InputError
from latentmotion.experiment import Experiment
from latentmotion.storage.configuration import to_json

AT_ONCE = 512
"""Prompts that are encoded together."""


@dataclass(frozen=True)
class Steering:
    """How prompts become what the denoiser sees."""

    condition: Condition
    """Prompts to words."""
    width: int
    """Numbers per word."""
    items: Callable[[Iterable[Clip]], list[Item]]
    """Clips to items, whose captions are prompts."""
    described: dict[str, Any]
    """What the model card says of it."""
    parents: dict[str, str]
    """What it builds on, by name."""


def steering_of(experiment: Experiment, dataset: Dataset, encoder: TextEncoder | None) -> Steering:
    """Returns the steering of an experiment's task.

    Raises:
        InputError: The task is text and there is no encoder, or action and there are no labels.
    """
    return _TASKS[experiment.task](experiment, dataset, encoder)


def fitted(experiment: Experiment, steering: Steering) -> Experiment:
    """Returns the experiment with a denoiser as wide as its labels are many.

    The width of sentences is the experiment's own: a text encoder must fit it.
    """
    if experiment.task == "text":
        return experiment
    return replace(
        experiment, denoiser=replace(experiment.denoiser, condition_width=steering.width)
    )


def _by_sentences(
    experiment: Experiment, dataset: Dataset, encoder: TextEncoder | None
) -> Steering:
    if encoder is None:
        raise InputError("a model that reads sentences needs a text encoder: --text-encoder")
    described = {
        "encoder": encoder.name,
        "width": encoder.width,
        "reading": to_json(experiment.reading),
    }
    condition = SentenceCondition(encoder, experiment.reading)
    return Steering(condition, encoder.width, items_of, described, {"text": encoder.name})


def _by_actions(experiment: Experiment, dataset: Dataset, encoder: TextEncoder | None) -> Steering:
    clips = dataset.clips("train", mirrored=experiment.mirrored)
    labels = sorted({clip.action for clip in clips if clip.action})
    if not labels:
        raise InputError(
            f"no training clip of {dataset.folder} has an action label, which task=action needs; "
            "use data with labels, or task=text or task=unconditional"
        )
    described = {"kind": "action", "labels": labels}
    condition = ActionCondition(tuple(labels))

    def items(clips: Iterable[Clip]) -> list[Item]:
        """A label that only held-out clips have cannot be learned."""
        return [_whole(clip, clip.action) for clip in clips if clip.action in {None, *labels}]

    return Steering(condition, len(labels), items, described, {})


def _by_nothing(experiment: Experiment, dataset: Dataset, encoder: TextEncoder | None) -> Steering:
    def items(clips: Iterable[Clip]) -> list[Item]:
        return [_whole(clip, None) for clip in clips]

    return Steering(Unconditional(1), 1, items, {"kind": "unconditional"}, {})


def _whole(clip: Clip, prompt: str | None) -> Item:
    return Item(clip, 0, clip.frames, (prompt,) if prompt else ())


_TASKS: dict[str, Callable[[Experiment, Dataset, TextEncoder | None], Steering]] = {
    "text": _by_sentences,
    "action": _by_actions,
    "unconditional": _by_nothing,
}


class PromptTable:
    """What the denoiser sees of prompts; the empty one has the row of the null condition.

    Words of all prompts lie one after another without padding, so that 100,000 prompts of a dozen
    words fit in memory.

    Args:
        condition: Turns prompts into tokens.
        prompts: Those that will be asked for.
        device: Where the tokens are wanted.
    """

    def __init__(self, condition: Condition, prompts: Iterable[str], device: torch.device) -> None:
        known = sorted({*prompts} - {""})
        with warnings.catch_warnings():
            # Data sets are full of misspelled words, which nobody can help here.
            warnings.simplefilter("ignore", UserWarning)
            groups = [known[i : i + AT_ONCE] for i in range(0, len(known), AT_ONCE)]
            parts = [_real(condition.null(1)), *(_real(condition(group)) for group in groups)]
        self._rows = {prompt: row for row, prompt in enumerate(["", *known])}
        words, counts = (
            torch.from_numpy(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)
        )
        self._words, self._counts = words.to(device), counts.to(device)
        self._starts = self._counts.cumsum(0) - self._counts

    def __call__(self, prompts: Sequence[str]) -> Conditioning:
        """Returns the tokens of each prompt, with no more padding than these need."""
        rows = [self._rows[prompt] for prompt in prompts]
        starts, counts = self._starts[rows, None], self._counts[rows, None]
        place = torch.arange(int(counts.max()), device=counts.device)
        mask = place < counts
        tokens = self._words[torch.where(mask, starts + place, 0)]
        return Conditioning(tokens * mask[..., None], mask)


def _real(condition: Conditioning) -> tuple[np.ndarray, np.ndarray]:
    """Returns the words of a batch without padding, and how many each row has."""
    return condition.tokens[condition.mask], condition.mask.sum(axis=1)
