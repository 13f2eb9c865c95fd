from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from latentmotion import Motion, formats
from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.ranking import search
from latentmotion.ranking.scorer import CLIPS_FILE, shipped_scorer
from latentmotion.ranking.search import (
    KnownClip,
    MotionIndex,
    TrainingVectors,
    read_training_vectors,
    training_vectors,
    windows_of,
)
from tests.support.walker import walker


@pytest.fixture
def mocap(tmp_path: Path) -> Path:
    folder = tmp_path / "mocap"
    (folder / "deep").mkdir(parents=True)
    Motion(walker(130).joints()).save(folder / "long.npz")
    Motion(walker(30).joints()).save(folder / "deep" / "short.bvh")
    (folder / "broken.glb").write_bytes(b"glTF?")
    (folder / "notes.txt").write_text("not a motion")
    return folder


def test_windows_cover_a_motion() -> None:
    assert windows_of(70) == [(0, 70)]
    assert windows_of(130) == [(0, 80), (20, 100), (40, 120), (50, 130)]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that are read, in order."""
    paths: list[Path] = []

    def load(path: Path) -> list[Motion]:
        paths.append(path)
        return formats.load(path)

    stand_in = SimpleNamespace(load=load, readable=formats.readable)
    monkeypatch.setattr(search, "formats", stand_in)
    return paths


def test_a_folder_is_searched_and_kept(mocap: Path, tmp_path: Path, read: list[Path]) -> None:
    cache = tmp_path / "index.safetensors"
    index = MotionIndex.of(mocap, shipped_scorer(), cache)
    assert len(read) == 3 and set(index.problems) == {mocap / "broken.glb"}
    hits = index.search("a person walks in a circle", 9)
    assert {hit.window.path.name for hit in hits} == {"long.npz", "short.bvh"}
    assert [hit.score for hit in hits] == sorted((hit.score for hit in hits), reverse=True)
    assert hits == MotionIndex.of(mocap, shipped_scorer(), cache).search(
        "a person walks in a circle", 9
    )
    assert len(read) == 3


def test_a_changed_file_is_read_again(mocap: Path, tmp_path: Path, read: list[Path]) -> None:
    cache = tmp_path / "index.safetensors"
    MotionIndex.of(mocap, shipped_scorer(), cache)
    read.clear()
    Motion(walker(40).joints()).save(mocap / "long.npz")
    cache.write_bytes(cache.read_bytes())
    index = MotionIndex.of(mocap, shipped_scorer(), cache)
    assert read == [mocap / "long.npz"]
    assert len(index.files[mocap / "long.npz"].spans) == 1


def test_a_damaged_index_is_made_anew(mocap: Path, tmp_path: Path, read: list[Path]) -> None:
    cache = tmp_path / "index.safetensors"
    cache.write_bytes(b"\xff" * 99)
    MotionIndex.of(mocap, shipped_scorer(), cache)
    assert len(read) == 3 and cache.stat().st_size > 99


def test_hidden_folders_are_left_out(mocap: Path, read: list[Path]) -> None:
    shutil.copytree(mocap / "deep", mocap / ".trash")
    assert len(MotionIndex.of(mocap, shipped_scorer()).files) == len(read) == 3


def test_an_empty_sentence_is_told_before_files_are_read(mocap: Path, read: list[Path]) -> None:
    with pytest.raises(SystemExit):
        main(["search", str(mocap), " "])
    assert read == []


@pytest.mark.parametrize(
    ("folder", "words", "message"),
    [
        ("nowhere", "a kick", "is no folder"),
        ("empty", "a kick", "has no motion file"),
        ("mocap", " ", "sentence is empty"),
        ("mocap", "a kick -n 0", "0 results"),
    ],
)
def test_mistakes_are_named(
    mocap: Path, folder: str, words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (mocap.parent / "empty").mkdir()
    sentence, _, count = words.partition(" -n ")
    more = ["-n", count] if count else []
    with pytest.raises(SystemExit):
        main(["search", str(mocap.parent / folder), sentence, *more])
    assert message in capsys.readouterr().err


def test_the_command_line_prints_files_and_spans(
    mocap: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["search", str(mocap), "a person walks", "--json", "-n", "1"])
    captured = capsys.readouterr()
    (found,) = json.loads(captured.out)["found"]
    assert found["end"] - found["start"] <= 4 and Path(found["file"]).is_file()
    assert "left out" in captured.err


def test_a_training_clip_is_nearest_to_itself(figures: Path, tmp_path: Path) -> None:
    data, scorer = Dataset.load(figures), shipped_scorer()
    training = training_vectors(data, scorer)
    (clip, other, *_) = data.clips("train")
    (vector,) = scorer.embed([data.features(clip)])
    assert training.nearest(vector, 1)[0][0].id == clip.id != other.id
    shutil.copytree(scorer.folder, tmp_path / "scorer")
    training.write(tmp_path / "scorer" / CLIPS_FILE)
    read = read_training_vectors(replace(scorer, folder=tmp_path / "scorer"))
    assert read.clips == training.clips
    assert np.abs(read.vectors - training.vectors).max() < 0.01


def test_the_shipped_list_names_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Motion(walker(50).joints()).save(tmp_path / "walk.npz")
    main(["nearest", str(tmp_path / "walk.npz"), "-n", "2", "--json"])
    rows = json.loads(capsys.readouterr().out)["nearest"]
    assert len(rows) == 2 and rows[0]["similarity"] >= rows[1]["similarity"]
    assert rows[0]["source"] in {"cmu", "snu", "hdm05"} and rows[0]["origin"]
    main(["nearest", str(tmp_path / "walk.npz")])
    assert "of the training clips have a clip of another recording" in capsys.readouterr().out


def test_missing_and_damaged_lists_are_refused(tmp_path: Path) -> None:
    scorer = replace(shipped_scorer(), folder=tmp_path)
    with pytest.raises(InputError, match="--data"):
        read_training_vectors(scorer)
    TrainingVectors((KnownClip("a", "b", "c"),), np.ones((1, 3), np.float32)).write(
        tmp_path / CLIPS_FILE
    )
    with pytest.raises(ModelError, match="damaged"):
        read_training_vectors(scorer)
