"""The script that `latentmotion completion` prints, in the shell itself."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from latentmotion.cli import usage
from latentmotion.cli.main import main
from latentmotion.errors import MissingExtraError

ASK = """
source {script}
complete_words() {{
  COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
  _tyro_latentmotion
  echo "${{COMPREPLY[*]}}"
}}
complete_words latentmotion gen
complete_words latentmotion data prepare hd
complete_words latentmotion generate --mod
complete_words latentmotion generate walk --runtime open
complete_words latentmotion generate --pre
complete_words latentmotion bulk --c
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_options_and_choices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["completion", "bash"])
    script = tmp_path / "completion"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    done = subprocess.run(
        ["bash", "-c", ASK.format(script=script)], capture_output=True, text=True, check=True
    )
    found = [line.split() for line in done.stdout.splitlines()]
    words = [["generate"], ["hdm05"], ["--model"], ["openvino"]]
    words += [["--preset", "--precision"], ["--check", "--clean"]]  # whose help has several lines
    assert found == words, done.stderr


@pytest.mark.parametrize("error", [ModuleNotFoundError("x"), MissingExtraError("a", "b", "c")])
def test_commands_of_missing_extras_are_completed_by_their_names(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(name: str) -> None:
        raise error

    monkeypatch.setattr(usage, "import_module", refuse)
    main(["completion", "zsh"])
    assert "text-encoder" in capsys.readouterr().out
