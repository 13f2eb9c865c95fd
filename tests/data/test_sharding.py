"""Preparation in shards: the bytes of one process, whoever read which files, and after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from latentmotion.cli.main import main
from latentmotion.data import packing
from tests.support.mocap_folders import (
    CMU_FILES,
    swaying,
    write_annotations,
    write_cmu_trials,
    write_own,
)

Words = list[str]


def own(folder: Path) -> Words:
    write_own(folder / "raw", ["a/walk", "b", "c"])
    (folder / "raw" / "broken.bvh").write_text("no motion")
    table = "file,caption,from,to\na/walk,he walks,0,0\nb,late,90,99\nnone,she is not there,0,0\n"
    (folder / "captions.csv").write_text(table)
    return ["own", str(folder / "raw"), "--captions", str(folder / "captions.csv"), "--test=0"]


def labelled(folder: Path) -> Words:
    write_own(folder / "raw", ["walk/one", "walk/two", "test/jump/one"])
    (folder / "raw" / "walk" / "one.txt").write_text("he walks")
    return ["labelled", str(folder / "raw"), "--representation=humanml3d", "--val=0"]


def cmu(folder: Path) -> Words:
    trials = {name: swaying(400, seed=n) for n, name in enumerate(("05_18", "06_01", "07_01"))}
    raw = write_cmu_trials(folder / "raw", trials)
    annotations = write_annotations(folder / "h3d", *CMU_FILES)
    return ["cmu", f"--trials={raw}", f"--humanml3d={annotations}", "--uncaptioned"]


@pytest.fixture(autouse=True)
def one_file_a_shard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "FILES", 1)


def prepare(words: Words, output: Path, *more: str) -> Path:
    output.parent.mkdir(exist_ok=True)
    main(["data", "prepare", *words, "-o", str(output), *more])
    return output


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("write", [own, labelled, cmu])
def test_shards_make_the_same_bytes(
    write: Callable[[Path], Words], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = write(tmp_path)
    whole = content(prepare(words, tmp_path / "one" / "data"))
    told = capsys.readouterr().out.replace("/one/", "/many/")
    output = prepare(words, tmp_path / "many" / "data", "--shard=2/2")
    assert not output.exists()
    assert capsys.readouterr().out == "shard 2/2 is finished, others are not\n"
    prepare(words, output, "--shard=1/2")
    assert capsys.readouterr().out == told
    assert content(output) == whole
    assert {"manifest.json", "report.json", "motions-000.safetensors"} <= set(whole)


KILLED = """
import os, signal, sys
from pathlib import Path

from latentmotion.cli.main import main
from latentmotion.data import packing

packing.FILES, write, files = 1, Path.write_bytes, []

def dying(path, content):
    files.append(path)
    if len(files) == 4:  # the run, a shard and its record were written
        write(path, content[:99])
        os.kill(os.getpid(), signal.SIGKILL)
    return write(path, content)

Path.write_bytes = dying
main(sys.argv[1:])
"""


def test_a_killed_process_is_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = own(tmp_path)
    whole = content(prepare(words, tmp_path / "one" / "data"))
    output = tmp_path / "many" / "data"
    output.parent.mkdir()
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, "data", "prepare", *words, "-o", str(output), "--shard=1/1"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    capsys.readouterr()
    prepare(words, output, "--shard=1/1")
    made = capsys.readouterr().err
    assert "recordings-00000" not in made and "recordings-00001.safetensors: 1 files" in made
    assert content(output) == whole
    assert not list((tmp_path / "many" / "data.recordings").glob(".*")), "nothing is left"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--shard=3/2"], "expected a number of a total"),
        (["--shard=1/1", "--unit=meters"], "unit is None there, 'meters' here"),
        (["--shard=1/1", "--val=0.5"], "val is 0.05 there, 0.5 here"),
    ],
)
def test_another_run_is_refused(
    words: Words, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = own(tmp_path)
    prepare(asked, tmp_path / "out" / "data", "--shard=1/2")
    with pytest.raises(SystemExit) as error:
        prepare(asked, tmp_path / "out" / "data", *words)
    assert error.value.code == 2
    assert told in capsys.readouterr().err


def test_a_damaged_shard_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = own(tmp_path)
    output = prepare(words, tmp_path / "out" / "data", "--shard=1/1")
    shard = tmp_path / "out" / "data.recordings" / "recordings-00001.safetensors"
    shard.write_bytes(shard.read_bytes()[:-1] + b"x")
    with pytest.raises(SystemExit):
        prepare(words, output, "--shard=1/1")
    assert "recordings-00001.safetensors has another content" in capsys.readouterr().err
