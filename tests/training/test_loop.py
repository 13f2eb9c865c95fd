from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from latentmotion.errors import LatentMotionError, ModelError
from latentmotion.motion import Motion
from latentmotion.training.distributed import Ranks, StepRandomness
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.loop import (
    ExponentialMovingAverage,
    Progress,
    Stage,
    read_progress,
    train,
)
from latentmotion.training.run_folder import Journal, read_journal, readable_time
from tests.support.small_training import CONTEXT

SETTINGS = TrainingSettings(
    steps=12,
    batch_size=8,
    warm_up=2,
    report_every=3,
    validate_every=6,
    snapshot_every=4,
    sample_every=0,
)


class Line(Stage):
    """Fits y = 2 x with a dropout, whose masks must be the same after a resumption."""

    def __init__(self, stop_before: int | None = None, scale: float = 1.0) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.network = nn.Sequential(nn.Linear(1, 8), nn.Dropout(0.1), nn.Linear(8, 1))
        self.stop_before, self.scale = stop_before, scale

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        if step == self.stop_before:
            raise KeyboardInterrupt
        x = StepRandomness(3, step, SETTINGS.batch_size, Ranks()).normal(1)
        error = (self.network(x) - 2 * x) * self.scale
        return {"total": error.square().mean(), "absolute": error.abs().mean()}

    def validate(self, network: nn.Module) -> dict[str, float]:
        with torch.no_grad():
            return {"error": float((network(torch.ones(1, 1)) - 2).abs())}

    def sample(self, network: nn.Module) -> list[Motion]:
        return []


def weights(network: nn.Module) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in network.parameters()])


def test_an_interrupted_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir(), parts.mkdir()
    expected, _ = train(Line(), SETTINGS, whole, CONTEXT)
    for stop in (7, 9):
        with pytest.raises(KeyboardInterrupt):
            train(Line(stop_before=stop), SETTINGS, parts, CONTEXT)
    found, _ = train(Line(), SETTINGS, parts, CONTEXT)
    assert torch.equal(weights(expected), weights(found))
    assert read_journal(whole) == read_journal(parts)
    assert [line["step"] for line in read_journal(whole)] == [3, 6, 6, 9, 12, 12]


def test_a_finished_run_trains_no_more(tmp_path: Path) -> None:
    first, seconds = train(Line(), SETTINGS, tmp_path, CONTEXT)
    again, _ = train(Line(stop_before=0), SETTINGS, tmp_path, CONTEXT)
    assert torch.equal(weights(first), weights(again))
    progress = read_progress(tmp_path)
    assert progress.step == SETTINGS.steps and 0 < progress.seconds <= seconds
    assert progress.processor_seconds > 0 and read_progress(tmp_path / "none") == Progress()


def test_an_infinite_loss_ends_the_run(tmp_path: Path) -> None:
    with pytest.raises(LatentMotionError, match="finite"):
        train(Line(scale=float("inf")), SETTINGS, tmp_path, CONTEXT)


def test_a_damaged_snapshot_is_named(tmp_path: Path) -> None:
    (tmp_path / "snapshot.pt").write_bytes(b"no zip file")
    with pytest.raises(ModelError, match=r"snapshot.pt is damaged"):
        train(Line(), SETTINGS, tmp_path, CONTEXT)


def test_bfloat16_trains_too(tmp_path: Path) -> None:
    from dataclasses import replace

    train(Line(), replace(SETTINGS, precision="bfloat16"), tmp_path, CONTEXT)
    assert all(np.isfinite(line.get("total", 0.0)) for line in read_journal(tmp_path))


def test_learning_rate_rises_and_falls() -> None:
    settings = TrainingSettings(steps=100, warm_up=10, learning_rate=1.0)
    rates = [settings.rate(step) for step in range(101)]
    assert rates[0] == pytest.approx(0.1)
    assert rates[10] == pytest.approx(1.0)
    assert rates[55] == pytest.approx(0.5)
    assert rates[100] == pytest.approx(0.0)


def test_average_follows_the_network() -> None:
    network = nn.Linear(2, 2)
    average = ExponentialMovingAverage(network, 0.5)
    with torch.no_grad():
        network.weight.fill_(1.0)
        average.network.weight.fill_(0.0)
    for step in range(100, 103):
        average.update(network, step)
    assert torch.allclose(average.network.weight, torch.tensor(1 - 0.5**3))


def test_no_decay_is_the_network_itself() -> None:
    network = nn.Linear(2, 2)
    average = ExponentialMovingAverage(network, 0.0)
    with torch.no_grad():
        network.weight.fill_(1.0)
    average.update(network, 0)
    assert torch.equal(average.network.weight, network.weight)


def test_ranks_share_the_numbers_of_one() -> None:
    one = StepRandomness(5, 7, 6, Ranks())
    normal, uniform = one.normal(3), one.uniform()
    for rank in range(2):
        part = StepRandomness(5, 7, 6, Ranks(rank, 2))
        assert torch.equal(part.normal(3), normal[rank::2])
        assert torch.equal(part.uniform(), uniform[rank::2])


def test_steps_draw_different_numbers() -> None:
    draws = [StepRandomness(0, step, 4, Ranks()).normal(2) for step in range(3)]
    assert not torch.equal(draws[0], draws[1]) and not torch.equal(draws[1], draws[2])


def test_journal_drops_lines_that_a_kill_undid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = Journal(tmp_path, 10)
    for step in (2, 4, 6):
        journal.write(step, "train", {"total": 3 / step}, 60.0)
    journal.close()
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write('{"step": 8, "ki')
    Journal(tmp_path, 10, done=4).close()
    assert [line["step"] for line in read_journal(tmp_path)] == [2, 4]
    assert "6/10 train  total 0.5  (60.000 s a step, 4 min 00 s left)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("seconds", "text"), [(12.0, "12 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 05 min")]
)
def test_readable_time(seconds: float, text: str) -> None:
    assert readable_time(seconds) == text
