"""The length at which a prompt is obeyed is found from motions of other prompts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from latentmotion.diffusion.condition import TextEmbedding
from latentmotion.engine.lengths import LengthModel
from latentmotion.training.drawn_instructions import drawn_instructions
from latentmotion.training.lengths import (
    LengthVerdicts,
    ObedienceRecipe,
    best_lengths,
    kept_lengths,
)

RECIPE = ObedienceRecipe(hidden=32, passes=40, dropout=0.1, prompts=200, copies=1)


class Turning:
    """An encoder whose embeddings hold one fact: whether the sentence is of a turn."""

    name, width = "turning", 3

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        turning = np.array(["turn" in sentence for sentence in sentences], np.float32)
        pooled = np.stack([turning, 1 - turning, np.ones_like(turning)], axis=1)
        return TextEmbedding(pooled, pooled[:, None], np.ones((len(sentences), 1), bool))


@pytest.fixture(scope="module")
def verdicts() -> LengthVerdicts:
    """Turns are obeyed from 1.5 to 2.5 s, everything else from 5 to 7 s."""
    generator = np.random.default_rng(0)
    prompts = [one.prompt for one in drawn_instructions(300, 3) for _ in range(8)]
    seconds = np.exp(generator.uniform(np.log(1.2), np.log(8.6), len(prompts)))
    turns = np.array(["turn" in prompt for prompt in prompts])
    obeyed = np.where(turns, (seconds > 1.5) & (seconds < 2.5), (seconds > 5) & (seconds < 7))
    return LengthVerdicts(tuple(prompts), seconds.astype(np.float32), obeyed)


def usual(seconds: float) -> LengthModel:
    """A model of lengths that knows one, give or take a third."""
    bias = (seconds * np.array([0.6, 0.8, 1, 1.25, 1.7])).astype(np.float32)
    hidden, out = np.zeros((2, 3), np.float32), np.zeros((5, 2), np.float32)
    return LengthModel("turning", (hidden, out), (np.zeros(2, np.float32), bias))


def test_each_kind_of_prompt_gets_the_length_at_which_it_is_obeyed(
    verdicts: LengthVerdicts,
) -> None:
    best = best_lengths(verdicts, usual(3.5), Turning(), RECIPE)
    assert list(best.sentences) == [one.prompt for one in drawn_instructions(200, 0)]
    turns = np.array(["turn" in sentence for sentence in best.sentences])
    assert 20 < turns.sum() < 180
    assert (abs(best.seconds[turns] - 2) < 0.5).all()
    assert (abs(best.seconds[~turns] - 6) < 1).all()
    again = best_lengths(verdicts, usual(3.5), Turning(), RECIPE)
    assert (again.seconds == best.seconds).all()


def test_an_earlier_model_hands_its_lengths_on() -> None:
    kept = kept_lengths(usual(4.0), Turning(), replace(RECIPE, copies=2))
    prompts = [one.prompt for one in drawn_instructions(200, 0)]
    assert list(kept.sentences) == prompts * 2
    assert kept.seconds.tolist() == [4.0] * len(prompts) * 2


@pytest.mark.parametrize("seconds", [2.0, 4.0, 7.0])
def test_of_lengths_as_good_the_usual_one_is_taken(
    verdicts: LengthVerdicts, seconds: float
) -> None:
    always = replace(verdicts, obeyed=np.ones_like(verdicts.obeyed))
    best = best_lengths(always, usual(seconds), Turning(), replace(RECIPE, prior=1.0))
    assert (abs(np.log(best.seconds / seconds)) < 0.1).all()
