"""`latentmotion bulk`: prompts of two kinds, motions in shards, workers that are killed."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open

from latentmotion import formats
from latentmotion.bulk import BulkGeneration, PromptRow, read_rows, work_of
from latentmotion.cli.main import main
from latentmotion.errors import FileFormatError, InputError, LatentMotionError
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage import limits, shards
from latentmotion.storage.shards import folder_at

PROMPTS = [
    "a person walks",
    "a person jumps twice",
    "",
    "a man runs and then sits down",
    "kickLeft",
    "someone waves",
    "a person walks",
]


@pytest.fixture
def prompts(tmp_path: Path) -> Path:
    path = tmp_path / "prompts.txt"
    path.write_text("\n".join(PROMPTS) + "\n")
    return path


def bulk(prompts: Path, folder: Path, *words: str) -> None:
    main(["bulk", str(prompts), "-o", str(folder), "--rows=2", "--no-clean", *words])


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def whole(prompts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, bytes]:
    bulk(prompts, tmp_path / "whole")
    out, err = capsys.readouterr()
    assert "5 motions, 2 rows left out; files 4" in out
    assert f"{prompts}:3: the sentence is empty; say what the person does; left out" in err
    assert f"{prompts}:5: 'kickLeft' looks like a label" in err
    return content(tmp_path / "whole")


def test_bytes_do_not_depend_on_the_number_of_processes(
    prompts: Path, whole: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for share in ("3/3", "1/3", "2/3"):
        bulk(prompts, tmp_path / "parts", f"--shard={share}")
    assert content(tmp_path / "parts") == whole
    assert "shard 3/3 is finished, others are not" in capsys.readouterr().out
    main(["bulk", "-o", str(tmp_path / "parts"), "--check"])
    assert "5 motions, 2 rows left out; files 4" in capsys.readouterr().out


# Generates, but is killed before a shard.
KILLED = """
import os, signal, sys
from latentmotion import bulk
from latentmotion.cli.main import main

make, left = bulk.make_shard, [int(sys.argv[1])]

def killed_make(*arguments):
    left[0] -= 1
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return make(*arguments)

bulk.make_shard = killed_make
main(sys.argv[2:])
"""


def test_killed_and_restarted_processes_make_the_same_motions(
    prompts: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    folder = tmp_path / "parts"
    words = ["bulk", str(prompts), "-o", str(folder), "--rows=2", "--no-clean"]
    workers = [
        subprocess.Popen([sys.executable, "-c", KILLED, at, *words, f"--shard={share}"])
        for at, share in (("1", "1/2"), ("2", "2/2"))
    ]
    assert [worker.wait() for worker in workers] == [-signal.SIGKILL] * 2
    assert "motions-00001.safetensors.json" in content(folder)
    bulk(prompts, folder, "--shard=2/2")
    bulk(prompts, folder, "--shard=1/2")
    assert content(folder) == whole


def test_a_shard_holds_what_the_pipeline_makes_of_its_rows(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    generate = MotionPipeline.from_pretrained(threads=1)
    first, second = generate.batch(PROMPTS[:2], seeds=[0, 1])
    (last,) = generate.batch(PROMPTS[6:], seeds=[6])
    with safe_open(tmp_path / "whole" / "motions-00000.safetensors", "numpy") as file:
        about = json.loads(file.metadata()["latentmotion"])
        frames, joints = file.get_tensor("frames"), file.get_tensor("joints")
        assert file.get_tensor("line").tolist() == [1, 2]
    assert about["prompts"] == PROMPTS[:2] and about["fps"] == 20 and len(about["joints"]) == 22
    assert frames.tolist() == [len(first), len(second)]
    assert np.array_equal(joints, np.concatenate([first.joints, second.joints]))
    with safe_open(tmp_path / "whole" / "motions-00003.safetensors", "numpy") as file:
        assert file.get_tensor("seed").tolist() == [6]
        assert np.array_equal(file.get_tensor("joints"), last.joints)


@pytest.mark.parametrize("form", ["glb", "bvh"])
def test_a_file_for_each_motion(prompts: Path, tmp_path: Path, form: str) -> None:
    words = [f"--format={form}", "--preset=unity", "--fps=30"]
    bulk(prompts, tmp_path / "clips", *words)
    files = content(tmp_path / "clips")
    assert f"0000001_a_person_walks.{form}" in files
    table = list(csv.DictReader(files["motions-00000.csv"].decode().splitlines()))
    assert [row["prompt"] for row in table] == PROMPTS[:2]
    (motion,) = formats.load(tmp_path / "clips" / table[1]["file"])
    assert motion.fps == pytest.approx(30, abs=1e-3)
    main(["bulk", "-o", str(tmp_path / "clips"), "--check"])
    broken = tmp_path / "clips" / table[1]["file"]
    broken.write_bytes(broken.read_bytes()[:-1])
    with pytest.raises(SystemExit):
        main(["bulk", "-o", str(tmp_path / "clips"), "--check"])
    with pytest.raises(InputError, match="--preset and --fps are those of files"):
        work_of(BulkGeneration(preset="unity"), MotionPipeline.from_pretrained(), prompts)


def test_rows_of_tables_have_lengths_and_seeds_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "prompts.csv"
    lines = ["prompt,seed,seconds", "a,7,2.5", "b,,", "c,-1,", "d,,soon", "e,1.5,nan"]
    path.write_text("\n".join(lines) + "\n")
    rows = read_rows(path, 100)
    assert [(row.line, row.seed, row.seconds) for row in rows[:2]] == [(2, 7, 2.5), (3, 101, None)]
    assert [row.problem.partition(":")[0] for row in rows[2:]] == [
        "seed '-1'",
        "'soon' seconds",
        "seed '1.5'",
    ]


def test_lengths_out_of_range_are_wrong_rows(tmp_path: Path) -> None:
    path = tmp_path / "prompts.csv"
    path.write_text("prompt,seconds\na person walks,2\na person walks,99\na person walks,0\n")
    work = work_of(BulkGeneration(clean=False), MotionPipeline.from_pretrained(), path)
    manifest = shards.make(work, at(tmp_path / "out"))
    assert manifest is not None
    assert [wrong.line for wrong in manifest.shards[0].wrong] == [3, 4]
    assert manifest.shards[0].wrong[0].problem.startswith("99 seconds: model 'fast' makes")


@pytest.mark.filterwarnings("ignore::latentmotion.cleanup.pipeline.CleanUpWarning")
def test_counts_and_turns_are_exact_where_they_may_be() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", threads=1)
    prompts = ["a person bows twice", "turn around to the left", "a person bows twice"]
    rows = [PromptRow(n, text, 1, 3.0 if n == 3 else None) for n, text in enumerate(prompts, 1)]
    exact = BulkGeneration().motions(pipeline, rows)
    alone = [pipeline(row.prompt, row.seconds, row.seed, takes=1) for row in rows]
    assert [len(motion) for motion in exact] == [len(motion) for motion in alone]
    assert all("made" in exact[n].metadata[name] for n, name in ((0, "count"), (1, "turn")))
    assert "count" not in exact[2].metadata
    plain = BulkGeneration(exact_count=False, exact_turn=False).motions(pipeline, rows)
    assert [len(motion) for motion in plain] != [len(motion) for motion in exact]
    assert "made" not in plain[0].metadata["count"] and "made" not in plain[1].metadata["turn"]


def at(folder: Path) -> Path:
    return folder_at(folder, create=True)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("p.txt", b"", "holds no prompt"),
        ("p.txt", b"\xff\xfe", "is not UTF-8"),
        ("p.csv", b"text\nwalks\n", "lacks the column prompt; found text"),
        ("none.txt", None, "No such file"),
    ],
)
def test_a_wrong_file_is_refused(
    name: str, content: bytes | None, told: str, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(LatentMotionError, match=told):
        read_rows(tmp_path / name)


def test_too_many_rows_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MOST_PROMPTS", 2)
    (tmp_path / "p.txt").write_text("a\n" * 3)
    (tmp_path / "p.csv").write_text("prompt\n" + "a\n" * 3)
    for name in ("p.txt", "p.csv"):
        with pytest.raises(FileFormatError, match="3 rows, at most 2 are read"):
            read_rows(tmp_path / name)


def test_a_prompt_that_is_a_book_is_a_wrong_row(tmp_path: Path) -> None:
    (tmp_path / "p.txt").write_text("a person walks\n" + "walks " * 1000 + "\n")
    first, second = read_rows(tmp_path / "p.txt")
    assert not first.problem and second.problem == "5,999 characters, expected at most 2,000"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--seconds=99"], "99 seconds: model 'fast' makes motions of"),
        (["--steps=7"], "takes 1, 2, 4"),
        (["--rows=0"], "0 rows of a shard"),
        (["--seed=-1"], "seed -1: expected"),
        (["--shard=3/2"], "expected a number of a total"),
        (["--model=fest"], "did you mean 'fast'"),
    ],
)
def test_wrong_options_leave_no_folder(
    words: list[str], told: str, prompts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        bulk(prompts, tmp_path / "out", *words)
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_model_of_the_same_name_is_refused(
    prompts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = MotionPipeline.from_pretrained()
    shards.start(work_of(BulkGeneration(), pipeline, prompts).run, at(tmp_path / "out"))
    monkeypatch.setattr("latentmotion.bulk._MODEL_FILES", ("*.json",))
    with pytest.raises(InputError, match="another run: weights is"):
        shards.start(work_of(BulkGeneration(), pipeline, prompts).run, at(tmp_path / "out"))
