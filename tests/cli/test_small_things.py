"""What users tripped over: quotes left out, missing folders, full disks, wrong lines."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cleanup import CleanUpWarning, clean
from latentmotion.cli.main import main
from latentmotion.engine.encoder import LongSentenceWarning
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_folder, check_replaceable
from tests.support.walker import walker


@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
@pytest.mark.parametrize(
    ("words", "warned"),
    [(["a", "person", "walks"], True), (["a person walks", "walks"], False), (["walks"], False)],
)
def test_words_without_quotes_are_warned_of(
    words: list[str], warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["generate", *words, "--seconds=1", "--no-clean", "-o", str(tmp_path / "a.npz")])
    assert ('put the sentence in quotes: "a person walks"' in capsys.readouterr().err) == warned


def test_in_place_keeps_the_body_where_it_began(tmp_path: Path) -> None:
    words = ["generate", "a person walks forward", "--seconds=3", "-o", str(tmp_path / "a.npz")]
    main([*words, "--in-place"])
    pelvis = Motion.load(tmp_path / "a.npz").joints[:, 0, [0, 2]]
    assert np.ptp(pelvis, axis=0).max() < 0.25
    with pytest.raises(SystemExit):
        main([*words, "--in-place", "--no-clean"])


def test_folders_are_made_in_folders_that_are_not_there_yet(tmp_path: Path) -> None:
    target = tmp_path / "data" / "sets" / "cmu"
    check_replaceable(target, "manifest.json")
    with atomic_folder(target, "manifest.json") as folder:
        (folder / "manifest.json").write_text("{}")
    assert (target / "manifest.json").is_file()


def test_wrong_lines_of_a_file_are_told_and_the_others_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, output = tmp_path / "prompts.txt", tmp_path / "a.npz"
    file.write_bytes("\ufeffa person walks\n\nkickLeft1Reps\na person jumps\n".encode())
    with pytest.raises(SystemExit):
        main(["generate", "-f", str(file), "--seconds=1", "--json", "-o", str(output)])
    told = capsys.readouterr()
    assert "prompts.txt:3: 'kickLeft1Reps' looks like a label" in told.err
    assert "1 of 3 prompts" in told.err
    captions = [motion["caption"] for motion in json.loads(told.out)["motions"]]
    assert captions == ["a person walks", "a person jumps"]  # without the byte order mark


def test_files_of_wrong_lines_alone_are_refused(
    tmp_path: Path, student: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "labels.txt").write_text("7\n")
    with pytest.raises(SystemExit):
        main(["generate", "-f", str(tmp_path / "labels.txt"), "--model", str(student)])
    assert "labels.txt:1: " in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_the_output_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "latentmotion", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ended.returncode == 2
    assert ended.stderr == "error: cannot write the output: No space left on device\n"


def test_warnings_of_clean_up_name_the_take() -> None:
    joints = walker(20).joints().astype("f4")
    joints[10, 21] += 3
    motion = Motion(joints, caption="a person waves", metadata={"seed": 7})
    with pytest.warns(CleanUpWarning, match=r"^'a person waves', seed 7: bones were drawn"):
        clean(motion)


def test_a_single_string_is_a_batch_of_one() -> None:
    generate = MotionPipeline.from_pretrained(threads=1)
    (motion,) = generate.batch("a person walks", 1)
    assert motion.caption == "a person walks"
    assert repr(generate) == "MotionPipeline('fast', text, 4 steps)"


def test_sentences_that_are_cut_are_warned_of() -> None:
    generate = MotionPipeline.from_pretrained(threads=1)
    with pytest.warns(LongSentenceWarning, match=r"longer than the 128 word pieces"):
        generate("a person walks and then " * 40 + "stops", seconds=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        generate("a person walks and then stops", seconds=1)
