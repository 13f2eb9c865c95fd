"""Mistakes on the command line: one line that says so, exit code 2, and nothing half-written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from latentmotion.cli.main import main

Refused = Callable[..., str]
"""Words, the folder in which they are run, and whether warnings may stand above → the line."""


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refused:
    def run(words: str, place: Path, warned: bool = False) -> str:
        monkeypatch.chdir(place)
        before = sorted(place.rglob("*"))
        with pytest.raises(SystemExit) as end:
            main(words.split())
        lines = capsys.readouterr().err.strip().splitlines()
        problems = [line for line in lines if not (warned and line.startswith("warning:"))]
        assert end.value.code == 2 and len(problems) == 1, lines
        assert problems[0].startswith("error: ")
        assert sorted(place.rglob("*")) == before
        return problems[0]

    return run
