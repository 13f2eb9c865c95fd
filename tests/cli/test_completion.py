"""The script that `latentmotion completion` prints, in the shell itself."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from latentmotion.cli import completion
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
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_options_and_choices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["completion", "bash"])
    assert not end.value.code
    script = tmp_path / "completion"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    done = subprocess.run(
        ["bash", "-c", ASK.format(script=script)], capture_output=True, text=True, check=True
    )
    found = [line.split() for line in done.stdout.splitlines()]
    assert found == [["generate"], ["hdm05"], ["--model"], ["openvino"]], done.stderr


@pytest.mark.parametrize("error", [ModuleNotFoundError("x"), MissingExtraError("a", "b", "c")])
def test_commands_of_missing_extras_are_completed_by_their_names(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(name: str) -> None:
        raise error

    monkeypatch.setattr(completion, "import_module", refuse)
    with pytest.raises(SystemExit):
        main(["completion", "zsh"])
    assert "text-encoder" in capsys.readouterr().out
