"""Protocols on synthetic figures with evaluators of closed form: rows, seeds, quirks, notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.protocol import (
    CLEAN,
    PAPER,
    Generated,
    Repeats,
    evaluate,
)
from latentmotion.model_card import ModelCard, read_card
from latentmotion.models import find_model
from moving_figures import write_moving_figures

SMALL = replace(CLEAN, replications=3, split="val", repeats=Repeats(4, 3, None, 2))
AS_AUTHORS = replace(PAPER, replications=3, split="val", repeats=Repeats(4, 6, 5, 3))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=4, val=9))


def card(**changes: Any) -> ModelCard:
    return replace(read_card(find_model("starter")), **changes)


@dataclass(frozen=True)
class Echo:
    """A text-motion evaluator: mean features; every caption is the same point."""

    width: int = 263
    fingerprint: str = "echo"

    def motions(self, features: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([motion.mean(axis=0) for motion in features])

    def texts(self, captions: Sequence[Caption]) -> np.ndarray:
        return np.stack([np.full(self.width, len(caption.text), float) for caption in captions])


@dataclass(frozen=True)
class Answers:
    """A generator that answers with noise of its seed, or with the motions it was given."""

    card: ModelCard
    known: dict[tuple[str, int], np.ndarray]

    def features(
        self, prompts: Sequence[str], frames: Sequence[int], seeds: Sequence[int], *_: object
    ) -> list[np.ndarray]:
        return [
            self.known[prompt, length]
            if (prompt, length) in self.known
            else np.random.default_rng(seed).standard_normal((length, 263)).astype(np.float32)
            for prompt, length, seed in zip(prompts, frames, seeds, strict=True)
        ]


def noise_model() -> Generated:
    return Generated(Answers(card(), {}))  # type: ignore[arg-type]


def test_report(dataset: Dataset) -> None:
    report = evaluate(noise_model(), dataset, Echo(), SMALL)
    print(report.markdown())
    report = evaluate(noise_model(), dataset, Echo(), AS_AUTHORS)
    print(report.markdown())
