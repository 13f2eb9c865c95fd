"""Conditions of the diffusion in training, by task: sentences, action labels or nothing.

An item's captions are what it is steered by: its sentences, the label of its clip, or none. So a
crop's caption is its prompt, whatever the task is, and the empty one stands for no condition.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset, Item, items_of
from latentmotion.diffusion import condition as tasks
from latentmotion.diffusion.condition import Condition, Conditioning, TextEncoder
from latentmotion.errors import InputError
from latentmotion.training.experiment import Experiment

AT_ONCE = 512  # Prompts that are encoded together.


@dataclass(frozen=True)
class TaskConditioning:
    """Conversion of prompts to the denoiser's condition."""

    # Its entry in the model card.
    task: tasks.TextTask | tasks.ActionTask | tasks.UnconditionalTask
    condition: Condition  # Prompts to words.

    @property
    def width(self) -> int:
        """Numbers per word."""
        return self.task.condition_width


def task_conditioning(
    experiment: Experiment, dataset: Dataset, encoder: TextEncoder | None
) -> TaskConditioning:
    """Returns the conditioning of an experiment's task.

    Raises:
        InputError: The task is text and there is no encoder, or action and there are no labels.
    """
    clips = dataset.clips("train", mirrored=experiment.mirrored)
    labels = tuple(sorted({clip.action for clip in clips if clip.action}))
    loaded = partial(required_encoder, encoder)
    training = tasks.TrainingCondition(str(dataset.folder), labels, loaded, experiment.conditioning)
    task = tasks.TASKS[experiment.task].of_training(training)
    return TaskConditioning(task, task.condition(task.condition_width, loaded))


def with_condition_width(experiment: Experiment, conditioning: TaskConditioning) -> Experiment:
    """Returns the experiment with the width of its labels, or of its text encoder."""
    return replace(
        experiment, denoiser=replace(experiment.denoiser, condition_width=conditioning.width)
    )


def items_to_learn(task: tasks.Task, clips: Iterable[Clip]) -> list[Item]:
    """Returns what a model of a task can learn of clips; the captions of an item are prompts."""
    whole = (Item(clip, 0, clip.frames, ()) for clip in clips)
    items = list(whole) if task.whole_clips else items_of(clips)
    prompted = ((item, task.prompts(item.captions, item.clip.action)) for item in items)
    return [replace(item, captions=prompts) for item, prompts in prompted if prompts is not None]


def required_encoder(encoder: TextEncoder | None) -> TextEncoder:
    """Returns the text encoder.

    Raises:
        InputError: There is none.
    """
    if encoder is None:
        raise InputError("a model that reads sentences needs a text encoder: --text-encoder")
    return encoder


class ConditionTable:
    """Conditions of all prompts of a data set; the empty prompt has the row of the null condition.

    Words of all prompts lie one after another without padding, in 16 bits: 9 kB for a prompt of a
    dozen words.

    Args:
        condition: Turns prompts into tokens.
        prompts: Prompts to embed.
        device: Device of the tokens.
    """

    def __init__(self, condition: Condition, prompts: Iterable[str], device: torch.device) -> None:
        sentences = sorted({*prompts} - {""})
        with warnings.catch_warnings():
            # Data sets are full of misspelled words, which nobody can help here.
            warnings.simplefilter("ignore", UserWarning)
            groups = [sentences[i : i + AT_ONCE] for i in range(0, len(sentences), AT_ONCE)]
            parts = [_real(condition.null(1)), *(_real(condition(group)) for group in groups)]
        self._rows = {prompt: row for row, prompt in enumerate(["", *sentences])}
        words, counts = (
            torch.from_numpy(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)
        )
        self._words, self._counts = words.to(device), counts.to(device)
        self._starts = self._counts.cumsum(0) - self._counts

    @property
    def words(self) -> torch.Tensor:
        """Words of all prompts but the empty one, (words, width)."""
        return self._words[int(self._counts[0]) :].float()

    def __call__(self, prompts: Sequence[str]) -> Conditioning:
        """Returns the tokens of each prompt, padded to the longest of them."""
        rows = [self._rows[prompt] for prompt in prompts]
        starts, counts = self._starts[rows, None], self._counts[rows, None]
        positions = torch.arange(int(counts.max()), device=counts.device)
        mask = positions < counts
        tokens = self._words[torch.where(mask, starts + positions, 0)]
        return Conditioning(tokens.float() * mask[..., None], mask)


def _real(condition: Conditioning) -> tuple[np.ndarray, np.ndarray]:
    """Returns the words of a batch without padding, and how many each row has."""
    words = np.asarray(condition.tokens, np.float16)[condition.mask]
    return words, condition.mask.sum(axis=1)
