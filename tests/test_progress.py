"""Progress bars: shown on terminals, after two seconds, with the time left; quiet elsewhere."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from threading import Event

import pytest

from latentmotion import formats, progress
from latentmotion.cli.main import main
from latentmotion.motion import Motion
from latentmotion.progress import counted, shown_progress
from tests.support.walker import walker


class Terminal(io.StringIO):
    """Standard error of somebody who watches."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    pytest.importorskip("tqdm")
    monkeypatch.setattr(progress, "DELAY", 0)
    return Terminal()


def test_terminals_see_how_many_are_done_and_the_time_left(terminal: Terminal) -> None:
    with redirect_stderr(terminal), shown_progress():
        assert list(counted("abcd", "reading")) == list("abcd")
    assert "reading" in terminal.getvalue()
    assert "0/4" in terminal.getvalue() and "<" in terminal.getvalue()


def test_a_silent_minute_ends_with_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SILENT", 0.05)
    error, out = io.StringIO(), io.StringIO()
    with redirect_stderr(error), redirect_stdout(out), shown_progress():
        for number in counted(range(3), "joints → features"):
            if number == 1:
                told = Event()
                while "features" not in error.getvalue():
                    told.wait(0.01)
        print("a line of its own")
        stream = sys.stdout
    assert "still running after 0 min, joints → features 2 of 3\n" in error.getvalue()
    assert out.getvalue() == "a line of its own\n"
    assert sys.stdout is not stream
    with redirect_stderr(error), shown_progress(quiet=True):
        assert list(counted(range(3), "reading")) == [0, 1, 2]
    assert "reading" not in error.getvalue()


def test_resumed_jobs_begin_where_they_were(terminal: Terminal) -> None:
    with redirect_stderr(terminal), shown_progress():
        assert list(counted(range(7, 9), "trials", done=7)) == [7, 8]
    assert "7/9" in terminal.getvalue()


@pytest.mark.parametrize("case", ["pipe", "json", "library", "one item", "no tqdm"])
def test_nothing_is_shown(terminal: Terminal, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if case == "pipe":
        monkeypatch.setattr(terminal, "isatty", lambda: False)
    if case == "no tqdm":
        monkeypatch.setitem(sys.modules, "tqdm", None)
    items = [1] if case == "one item" else [1, 2, 3]
    if case == "library":
        with redirect_stderr(terminal):
            assert list(counted(items, "reading")) == items
    else:
        with redirect_stderr(terminal), shown_progress(quiet=case == "json"):
            assert list(counted(items, "reading")) == items
    assert terminal.getvalue() == ""


def test_an_error_leaves_no_bar(terminal: Terminal) -> None:
    with pytest.raises(KeyboardInterrupt), redirect_stderr(terminal), shown_progress():
        for _ in counted(range(5), "reading"):
            raise KeyboardInterrupt
    assert terminal.getvalue().endswith("\r")


@pytest.mark.parametrize("json", [[], ["--json"]])
def test_verbs_show_it_unless_they_print_json(
    terminal: Terminal, tmp_path: Path, json: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.motion._TOGETHER", 1)
    verb = ["generate", "a person walks", "a person sits down", "--best-of", "1", "-o"]
    with redirect_stderr(terminal):
        main([*verb, str(tmp_path / "a.npz"), *json])
    assert ("cleaning up" in terminal.getvalue()) == (not json)


def test_clean_shows_it(terminal: Terminal, tmp_path: Path) -> None:
    motions = [Motion(walker(frames).joints().astype("f4")) for frames in (20, 30)]
    formats.save(tmp_path / "a.npz", motions)
    with redirect_stderr(terminal):
        main(["clean", str(tmp_path / "a.npz"), "-o", str(tmp_path / "b.npz")])
    assert "cleaning up:   0%" in terminal.getvalue()
