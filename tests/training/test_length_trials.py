"""Lengths at which a model obeys: what is drawn, what is kept, and runs that are resumed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from latentmotion.errors import DataError, InputError
from latentmotion.pipeline import MotionPipeline
from latentmotion.training import lengths
from latentmotion.training.drawn_instructions import drawn_instructions
from latentmotion.training.lengths import LengthTrials, judged_lengths

TRIALS = LengthTrials(prompts=12, takes=4, seed=5)


class Model(MotionPipeline):
    """Generates motions that obey if they last from 2 to 4 s, and records its calls."""

    card = SimpleNamespace(name="model")  # type: ignore[assignment]
    representation = SimpleNamespace(fps=20.0)  # type: ignore[assignment]

    def __init__(self, stops_after: int = 10**6) -> None:
        calls: list[Any] = []
        vars(self).update(calls=calls, stops_after=stops_after)

    def batch(self, prompts: Any, seconds: Any, seeds: Any, *_: Any) -> Any:  # type: ignore[override]
        calls = vars(self)["calls"]
        if len(calls) == vars(self)["stops_after"]:
            raise KeyboardInterrupt
        calls.append((prompts, seconds, seeds))
        return [SimpleNamespace(joints=length) for length in seconds]


@pytest.fixture(autouse=True)
def judged_by_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lengths, "describe", lambda joints: joints)
    monkeypatch.setattr(lengths, "fulfills", lambda scene, check: 2 <= scene <= 4)


def found(model: Model, journal: Path, trials: LengthTrials = TRIALS) -> Any:
    return judged_lengths(model, trials, journal)


def test_lengths_are_spread_over_the_range_in_whole_frames() -> None:
    each = np.array([TRIALS.lengths(number, 20.0) for number in range(50)])
    assert each.shape == (50, 4)
    assert np.allclose(each * 20, np.round(each * 20))
    edges = TRIALS.shortest * (TRIALS.longest / TRIALS.shortest) ** (np.arange(5) / 4)
    assert (each >= edges[:-1] - 0.026).all() and (each <= edges[1:] + 0.026).all()
    assert TRIALS.lengths(3, 20.0) == TRIALS.lengths(3, 20.0) != TRIALS.lengths(4, 20.0)


def test_a_killed_run_is_resumed_with_the_same_result(tmp_path: Path) -> None:
    whole = found(Model(), tmp_path / "whole.jsonl")
    with pytest.raises(KeyboardInterrupt):
        found(Model(stops_after=5), tmp_path / "parts.jsonl")
    with (tmp_path / "parts.jsonl").open("a") as file:
        file.write('["half a li')
    rest = Model()
    again = found(rest, tmp_path / "parts.jsonl")
    assert len(vars(rest)["calls"]) == len(drawn_instructions(12, 5)) - 5
    assert again.prompts == whole.prompts
    assert (again.seconds == whole.seconds).all() and (again.obeyed == whole.obeyed).all()
    assert (whole.obeyed == ((whole.seconds >= 2) & (whole.seconds <= 4))).all()
    finished = Model()
    found(finished, tmp_path / "parts.jsonl")
    assert not vars(finished)["calls"]


def test_a_journal_of_other_trials_or_damaged_is_refused(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    found(Model(), journal)
    before = journal.read_bytes()
    with pytest.raises(InputError, match="is of other trials than"):
        found(Model(), journal, LengthTrials(prompts=12, takes=3, seed=5))
    assert journal.read_bytes() == before
    journal.write_text("{]\n")
    with pytest.raises(DataError, match=r"journal\.jsonl is damaged"):
        found(Model(), journal)
