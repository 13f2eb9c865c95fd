"""The command line finds its verbs, and a mistake ends in one line and exit code 2."""

from __future__ import annotations

import pytest

from latentmotion.cli.main import VERBS, main


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
    ],
)
def test_mistakes_are_named(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refused(words, capsys)


def test_a_misspelled_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--secnds" in refused(["generate", "a person walks", "--secnds", "4"], capsys)


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
