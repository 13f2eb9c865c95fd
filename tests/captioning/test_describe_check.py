"""`data describe --check` and `--names`: what the motion contradicts is left out, with a reason."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.formats import npz
from latentmotion.motion import Motion
from latentmotion.training.captioning.described import contradiction
from tests.support.simple_motions import figure

TURN = "a person walks forward and turns to the {}."


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A walk that turns left by 90°, with a true and a false sentence beside it."""
    folder = tmp_path / "motions"
    folder.mkdir()
    joints = figure(5, speed=1.0, turn=90).astype(np.float32)
    npz.write(folder / "turn_right_02.npz", [Motion(joints)])
    (folder / "turn_right_02.txt").write_text(f"{TURN.format('left')}\n{TURN.format('right')}\n")
    return folder


def captions(path: Path) -> list[str]:
    with path.open(encoding="utf-8") as file:
        return [row["caption"] for row in csv.DictReader(file)]


def run(*arguments: str | Path) -> int:
    """Returns the exit code."""
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_a_contradiction_is_told() -> None:
    joints = figure(5, speed=1.0, turn=90)
    assert contradiction(TURN.format("left"), joints) == ""
    assert contradiction(TURN.format("right"), joints).startswith("turn: +")
    assert contradiction("a person dances happily", joints) == ""


def test_sentences_beside_files_stay_unless_they_are_checked(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    assert run("data", "describe", folder, "-o", out) == 0
    assert captions(out)[:2] == [TURN.format("left"), TURN.format("right")]
    assert run("data", "describe", folder, "--check", "-o", out) == 0
    assert TURN.format("left") in captions(out)
    assert TURN.format("right") not in captions(out)


def test_a_file_name_is_told_unless_the_motion_contradicts_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    left = folder / "turn_left_01.npz"
    left.write_bytes((folder / "turn_right_02.npz").read_bytes())
    assert run("data", "describe", folder, "--names", "-o", out) == 0
    assert "a person turns left" in captions(out)
    assert "a person turns right" not in captions(out)
    assert "turn_right_02: name 'a person turns right', but turn: +" in capsys.readouterr().out


def test_train_captions_of_a_prepared_folder_are_checked_and_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain, out = tmp_path / "plain", tmp_path / "out"
    assert run("data", "prepare", "own", folder, "--val", "0", "--test", "0", "-o", plain) == 0
    options = ("--windows", "0", "--rewordings", "0")
    assert run("data", "describe", plain, "--check", *options, "-o", out) == 0
    (clip,) = Dataset.load(out).manifest.clips
    assert TURN.format("right") not in [row[0] for row in clip.captions]
    assert TURN.format("left") not in [row[0] for row in clip.mirrored_captions]
    assert TURN.format("left") in [row[0] for row in clip.captions]
    assert "turns to the right.', but turn: +" in capsys.readouterr().out


def test_a_pack_is_described_as_its_folder(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LATENTMOTION_CACHE", str(tmp_path / "cache"))
    plain, packed = tmp_path / "plain", tmp_path / "plain.pack"
    assert run("data", "prepare", "own", folder, "--val", "0", "--test", "0", "-o", plain) == 0
    assert run("data", "pack", plain, "-o", packed) == 0
    assert run("data", "describe", packed, "-o", tmp_path / "out") == 0
    assert len(Dataset.load(tmp_path / "out").manifest.clips[0].captions) > 2


def test_a_csv_of_a_prepared_folder_is_asked_for(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = tmp_path / "plain"
    assert run("data", "prepare", "own", folder, "-o", plain) == 0
    assert run("data", "describe", plain, "-o", tmp_path / "out.csv") == 2
    assert "add --edit" in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()
