from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file
from torch import nn

from latentmotion.networks.checkpoint import WEIGHTS_FILE
from latentmotion.training import distributed
from latentmotion.training.distributed import DistributedContext, Ranks, is_sharded
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.loop import NAME
from latentmotion.training.run_folder import read_journal

TWO = DistributedContext(torch.device("cpu"), Ranks(0, 2))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("runs")
    words = [sys.executable, "-m", "tests.support.two_ranks", str(folder)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    yield folder


@pytest.mark.parametrize(
    ("name", "like"),
    [
        ("sharded-alone", "one"),
        ("alone-sharded", "one"),
        ("denoiser-sharded", "denoiser-one"),
    ],
)
def test_sharded_runs_are_those_of_one_process(runs: Path, name: str, like: str) -> None:
    found, expected = read_journal(runs / name), read_journal(runs / like)
    assert [line["step"] for line in found] == [line["step"] for line in expected]
    for one, other in zip(found, expected, strict=True):
        kind = one.pop("kind")
        assert kind == other.pop("kind") and one.keys() == other.keys()
        numbers = [list(line.values()) for line in (one, other)]
        # What prompts save is a difference of losses of 1 and more, whose rounding it keeps.
        np.testing.assert_allclose(*numbers, rtol=1e-5, atol=1e-6)
    tensors = (load_file(runs / run / "model" / WEIGHTS_FILE) for run in (name, like))
    for (key, one), (other_key, other) in zip(*(part.items() for part in tensors), strict=True):
        assert key == other_key
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)  # two_ranks.EPSILON has why


def test_a_sharded_snapshot_is_whole(runs: Path) -> None:
    one, other = (
        torch.load(runs / run / NAME, weights_only=True) for run in ("alone-sharded", "one")
    )
    assert one["step"] == other["step"] == 4
    for part in ("network", "average"):
        assert {key: value.shape for key, value in one[part].items()} == {
            key: value.shape for key, value in other[part].items()
        }
    for number, moments in other["optimizer"]["state"].items():
        for key, value in moments.items():
            torch.testing.assert_close(
                one["optimizer"]["state"][number][key], value, rtol=1e-3, atol=1e-6
            )


def test_each_rank_holds_half_of_the_weights(runs: Path) -> None:
    found = [json.loads((runs / f"parts-{rank}.json").read_text()) for rank in range(2)]
    assert found[0][0] + found[1][0] == found[0][1]
    assert all(0.4 < own / every < 0.6 for own, every in found)


@pytest.mark.parametrize(
    ("parallel", "memory", "world", "expected"),
    [
        ("auto", 2 * 20 * 110, 2, False),
        ("auto", 2 * 20 * 110 - 1, 2, True),
        ("auto", 1, 1, False),
        ("replicated", 1, 2, False),
        ("sharded", 10**12, 2, True),
        ("sharded", 10**12, 1, False),
    ],
)
def test_networks_are_sharded_by_size(
    monkeypatch: pytest.MonkeyPatch, parallel: str, memory: float, world: int, expected: bool
) -> None:
    monkeypatch.setattr(distributed, "device_memory", lambda device: memory)
    context = DistributedContext(torch.device("cpu"), Ranks(0, world))
    settings = TrainingSettings(parallel=parallel)  # type: ignore[arg-type]
    assert is_sharded(nn.Linear(10, 10), settings, context) is expected


def test_processors_share_nothing_of_themselves() -> None:
    assert not is_sharded(nn.Linear(10, 10), TrainingSettings(), TWO)
