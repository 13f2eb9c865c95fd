"""The command line finds its verbs, and a mistake ends in one line and exit code 2."""

from __future__ import annotations

import io
import os
import subprocess
import sys

import pytest

from latentmotion.cli import VERBS
from latentmotion.cli.main import main


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    return capsys.readouterr().err


def test_overview_names_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    main([])
    overview = capsys.readouterr().out
    assert all(name in overview for name in VERBS)


def test_a_group_lists_its_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    main(["train"])
    assert "train text-encoder" in capsys.readouterr().out
    main(["data", "prepare"])
    assert len(capsys.readouterr().out.splitlines()) == 2 + 10


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["generat"], "did you mean 'generate'"),
        (["train", "vea"], "did you mean 'train vae'"),
        (["xyz"], "known are generate"),
        (["generate"], "no sentence given"),
        (["generate", "a person walks", "-o", "out.bhv"], ".bvh"),
        (["generate", "a person walks", "-o", "no/such/folder/out.bvh"], "does not exist"),
        (["generate", "a person walks", "--count", "0"], "--count 0"),
        (["generate", "--file", "no_such_file.txt"], "no_such_file.txt"),
        (["generate", "a person walks", "--model", "startr", "-o", "a.bvh"], "startr"),
        (["generate", "-o", "out.bvh", "a person walks"], "no sentence given; name it before -o"),
        (
            ["generate", "walk", "--runtime", "onnxruntime", "--text-encoder", "starter"],
            "the runtime onnxruntime takes no --text-encoder",
        ),
    ],
)
def test_mistakes_are_named(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refused(words, capsys)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("data prepare cm", "unknown command 'data prepare cm'; did you mean 'data prepare cmu'?"),
        ("data prepar cmu", "unknown command 'data prepar'; did you mean 'data prepare'?"),
        ("describe walk.bvh", "unknown command 'describe'; did you mean 'data describe'?"),
        ("data own x", "unknown command 'data own'; did you mean 'data prepare own'?"),
        ("generate --prompts x.txt", "unknown option '--prompts'; leave it out"),
        ("generate walk -o folder", "folder has no ending: it cannot be written: known are .npz"),
        ("generate walk --secnds 4", "unknown option '--secnds'; did you mean '--seconds'?"),
        ("generate walk --secnds=4", "unknown option '--secnds'; did you mean '--seconds'?"),
        ("generate walk --no-claen", "unknown option '--no-claen'; did you mean '--no-clean'?"),
        ("generate walk -x", "unknown option '-x'; see latentmotion generate --help"),
        ("generate walk --clean no", "'no' belongs to no option; see"),
        ("generate walk --seconds", "--seconds needs a value; see"),
        ("generate walk -o", "--output needs a value"),
        ("generate walk -o a.bvh --output=b.bvh", "--output is given 2 times; name all its values"),
        ("generate walk --seconds four", "--seconds 'four': expected a number; see"),
        ("generate walk --count 1.5", "--count '1.5': expected a whole number; see"),
        ("generate walk --sampler dim", "--sampler 'dim': did you mean 'ddim'?"),
        ("study make a b --prompts p --seeds x", "--seeds: Could not find valid parse"),
        ("study make a --prompts p", "B is missing; see latentmotion study make --help"),
        ("clean", "FILE and --output are missing; see"),
        ("retarget --ouput x", "unknown option '--ouput'; did you mean '--output'?"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_what_tyro_refuses_takes_one_line(
    words: str,
    message: str,
    encoding: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    told = refused(words.split(), capsys)
    assert told.startswith(f"error: {message}") and told.count("\n") == 1, told


def test_help_is_printed_and_no_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["data", "prepare", "cmu", "--help"])
    assert not stop.value.code and "--humanml3d" in capsys.readouterr().out


def test_sentences_and_file_exclude_each_other(
    tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    prompts = tmp_path / "prompts.txt"
    prompts.write_text("a person walks\n")
    assert "not both" in refused(["generate", "a person runs", "-f", str(prompts)], capsys)
    prompts.write_text("\n\n")
    assert "holds no prompt" in refused(["generate", "-f", str(prompts)], capsys)


def test_a_verb_without_its_packages_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def import_nothing(module: str) -> None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    monkeypatch.setattr("latentmotion.cli.main.import_module", import_nothing)
    assert 'pip install "latentmotion[train]"' in refused(["train", "vae"], capsys)


def test_a_reader_that_goes_away_is_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "latentmotion", "--help"]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


def test_a_closed_standard_output_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    main(["--version"])
