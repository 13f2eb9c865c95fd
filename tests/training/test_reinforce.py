"""Training a model on by its own motions, judged by what they were asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.engine.lengths import LengthModel
from latentmotion.errors import InputError
from latentmotion.networks.checkpoint import load_model
from latentmotion.training.experiment import with_changes
from latentmotion.training.reinforce import Reinforcement, reinforce
from latentmotion.training.stages import train_denoiser
from latentmotion.training.takes import Takes
from tests.support.small_training import CONTEXT, LetterCount, killed_at, small

TWO_SECONDS = LengthModel(
    "letter-count", (np.zeros((1, 6)), np.zeros((5, 1))), (np.zeros(1), np.full(5, 2.0))
)


def takes(obeys: list[bool], faults: list[float], prompt: list[int]) -> Takes:
    count = len(obeys)
    latents, mask = torch.zeros(count, 2, 4), torch.ones(count, 2, dtype=torch.bool)
    parts = torch.tensor(prompt), torch.tensor(obeys), torch.tensor(faults)
    return Takes(latents, mask, *parts)


def test_takes_are_weighed_against_the_other_takes_of_their_prompt() -> None:
    mixed = takes([True, False, True, True, False, False], [0.1] * 6, [0, 0, 1, 1, 2, 2])
    assert mixed.weights(feet=0.3).tolist() == [1.0, 0.0, 0.5, 0.5, 0.5, 0.5]
    steady = takes([True, True], [0.1, 0.5], [0, 0]).weights(feet=0.3)
    assert steady.tolist() == pytest.approx([0.8, 0.2], abs=1e-4)


def settings(**changes: object) -> Reinforcement:
    small_round = {
        "takes.prompts": 4, "takes.takes": 3, "takes.steps": 2, "training.steps": 6,
        "training.batch_size": 4, "training.precision": '"float32"', "training.snapshot_every": 2,
        "training.report_every": 1,
    }  # fmt: skip
    return with_changes(Reinforcement(), [f"{k}={v}" for k, v in (small_round | changes).items()])


def test_a_round_goes_on_bit_for_bit(figures: Path, vae_run: Path, tmp_path: Path) -> None:
    encoder = LetterCount()
    source = train_denoiser(small(), figures, vae_run, encoder, tmp_path / "denoiser", CONTEXT)

    def run(name: str, **changes: object) -> Path:
        parts = small(), figures, source, encoder, TWO_SECONDS, tmp_path / name, CONTEXT
        return reinforce(settings(**changes), *parts)

    whole = run("whole")
    with killed_at(3):
        run("parts")
    parts = run("parts")
    before, model, other = load_model(source), load_model(whole), load_model(parts)
    assert model.card.latents == before.card.latents
    assert 0 <= model.card.figures["denoiser_takes_obey"] <= 1
    pairs = list(zip(model.denoiser.parameters(), other.denoiser.parameters(), strict=True))
    assert all(torch.equal(one, two) for one, two in pairs)
    with pytest.raises(InputError, match=r"differing: settings\.weight"):
        run("whole", weight=3.0)
