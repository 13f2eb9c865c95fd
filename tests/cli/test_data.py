"""From folders as they are downloaded to a training set, by the commands that users type."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from tests.support.mocap_folders import (
    CMU_FILES,
    swaying,
    write_annotations,
    write_cmu_trials,
    write_official,
    write_own,
)


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    write_cmu_trials(tmp_path / "trials", {"05_18": swaying(1200), "06_01": swaying(1200, seed=1)})
    write_annotations(tmp_path / "h3d", *CMU_FILES)
    write_own(tmp_path / "mine", ["walk", "turn"])
    return tmp_path


def run(words: str, folder: Path) -> None:
    main([str(folder / word[1:]) if word.startswith("@") else word for word in words.split()])


CMU = "data prepare cmu --trials @trials --humanml3d @h3d -o @cmu"


def test_prepare_merge_check(raw: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(f"{CMU} --uncaptioned", raw)
    printed = capsys.readouterr().out
    assert "dropped: nothing" in printed
    assert "off by 0.0" in printed
    assert "2 more CMU clips" in printed
    run("data prepare own @mine --val 0 --test 0 --license CC0-1.0 -o @own", raw)
    run("data merge @cmu @own -o @all", raw)
    dataset = Dataset.load(raw / "all")
    assert len(dataset.clips("train")) == 2 + 1 + 2
    assert len(dataset.clips("test")) == 1
    assert [source.name for source in dataset.sources] == ["cmu", "own"]
    report = json.loads((raw / "all" / "report.json").read_text())
    assert report["round_trip_mm"] < 5
    capsys.readouterr()
    run("data check @all", raw)
    printed = capsys.readouterr().out
    assert "every hash right" in printed
    assert "NSF EIA-0196217" in printed


def test_check_tells_what_raw_folders_lack(raw: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_official(raw / "official", HUMANML3D_FEATURES)
    (raw / "official" / "Std.npy").unlink()
    for words, expected in {
        "data check @trials": "missing: HumanML3D's captions",
        "data check @h3d": "captions: 2 ids",
        "data check @": "3 of them can be cut from these",
        "data check @mine": "missing: captions (NAME.txt beside NAME.bvh",
        "data check @official": "missing Std.npy",
    }.items():
        run(words, raw)
        assert expected in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("data check @nothing", "expected a prepared folder"),
        ("data check @empty", "found nothing known"),
        ("data prepare hdm05 @trials -o @out", "found none"),
        ("data prepare cmu --trials @nothing --humanml3d @h3d -o @out", "no folder"),
        ("data prepare cmu --trials @trials --humanml3d @mine -o @out", "lacks index.csv"),
        (CMU.replace("@cmu", "@mine"), "has no manifest.json"),
        ("data prepare own @mine --fps 2 -o @out", "too few"),
        ("data prepare own @mine --unit meters -o @out", "--unit meters makes its legs"),
        ("data merge -o @out", "nothing to merge"),
    ],
)
def test_mistakes(raw: Path, words: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    (raw / "empty").mkdir()
    with pytest.raises(SystemExit) as stop:
        run(words, raw)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
    assert not (raw / "out").exists()
