"""Experiments of directing: their rows on a small data set, their intervals, their pages."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.control.__main__ import goals_of
from benchmarks.control.__main__ import main as control
from benchmarks.control.cases import KINDS, file_content
from benchmarks.directing import bench, fits, goals, keep
from benchmarks.directing.__main__ import main
from benchmarks.directing.bench import Bench, beside, blended, write_results
from benchmarks.directing.fits import fit_rows
from benchmarks.directing.goals import goal_rows
from benchmarks.directing.sentences import length_rows, search_rows
from benchmarks.directing.sequences import loop_rows, stream_rows, timeline_rows
from benchmarks.directing.smoothers import kalman, spline
from latentmotion import Dataset, MotionPipeline
from latentmotion.control.goals import Pose, targets_of
from latentmotion.data.clip import Source
from latentmotion.data.store import StoredClip, StoredMotion, stored_normalizer, write_dataset
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.ranking.scorer import shipped_scorer
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.interface import Normalizer

# The clips are no motions of people, so goals and gaps of theirs may get limbs of wrong length.
UNUSUAL = pytest.mark.filterwarnings("ignore::latentmotion.cleanup.pipeline.CleanUpWarning")

PROMPTS = ("a person walks forward", "a person jumps", "a person waves", "a person sits down")


@pytest.fixture(scope="module")
def generate() -> MotionPipeline:
    return MotionPipeline.from_pretrained("fast", "onnxruntime", 1)


@pytest.fixture(scope="module")
def folder(generate: MotionPipeline, tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("data") / "people"
    motions = []
    for number, prompt in enumerate(PROMPTS * 2):
        features = HUMANML3D_FEATURES.encode(generate(prompt, 5.2, number, takes=1).joints)
        frames = len(features)
        clip = StoredClip(
            id=f"{number:03d}",
            source="made",
            origin=f"trial {number}[0:104]",
            split="test" if number < 4 else "train",
            frames=frames,
            shard=0,
            offset=0,
            captions=((prompt, 0, frames, ""), (f"{prompt} slowly", 0, frames, "")),
            mirrored_captions=((prompt, 0, frames, ""), (f"{prompt} slowly", 0, frames, "")),
            action=None,
            mirrored_action=None,
        )
        motions.append(StoredMotion(clip, features))
    fitted = Normalizer.fit([motion.features for motion in motions], HUMANML3D_FEATURES.blocks)
    stored, source = stored_normalizer(fitted, "these clips"), Source("made", "CC0-1.0", "nobody")
    write_dataset(found, motions, (source,), HUMANML3D_FEATURES, stored)
    return found


@pytest.fixture
def small(
    generate: MotionPipeline, folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Bench:
    monkeypatch.setattr(bench, "DRAWS", 20)
    monkeypatch.setattr(bench, "fid", lambda one, other: float(np.abs(one).mean()))
    return Bench(generate, Dataset.load(folder), shipped_scorer(), 2, seeds=1)


def figures(bench: Bench, measure: Any, folder: Path) -> dict[str, dict[str, list[float]]]:
    page = write_results("some", "a title", measure(bench), bench, folder)
    read = json.loads(page.with_suffix(".json").read_text())
    text = page.read_text()
    assert all(f"| {row} |" in text for row in read["figures"])
    assert read["made"]["model"] == "fast" and "by bootstrap over clips" in text
    return read["figures"]


@UNUSUAL
def test_goals_are_met_beside_motions_without(
    small: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    course = "path: 1 m/s"
    monkeypatch.setattr(goals, "courses", lambda of=goals.courses: {course: of()[course]})
    found = figures(small, goal_rows, tmp_path)
    free = {f"no path: {prompt}" for prompt in (goals.WALK, goals.BACK)}
    assert set(found) >= {"real motion, cleaned", "no goals", *goals.SETS, *free, course}
    for row in (*goals.SETS, course):
        assert found[row]["Off, mm, worst"][0] < 1
    assert found["no goals"]["Off before exact, cm"][0] > 5
    assert found["wrist, 2 goals"]["Off in the sample, cm"][0] < 1
    assert found["pelvis, 5 goals"]["FID / no goals"][0] > 0
    assert found[course]["Facing off, °"][0] < 20
    assert 0 < found[course]["Sliding by height, cm/s"][0] < found[course]["Sliding, cm/s"][0]


@UNUSUAL
def test_kept_frames_stay(small: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keep, "GAPS", {"middle half": keep.GAPS["middle half"]})
    found = figures(small, keep.keep_rows, tmp_path)
    assert len(found) == 4
    assert all(row["Kept frames off, mm, worst"][0] == 0 for row in list(found.values())[1:])
    ours, line = found["middle half: edit"], found["middle half: linear interpolation"]
    assert ours["Jitter, m/s³"][0] > line["Jitter, m/s³"][0]  # straight lines do not move


def test_timelines_are_smooth_beside_what_is_joined(small: Bench, tmp_path: Path) -> None:
    found = figures(small, timeline_rows, tmp_path)
    joined = found["alone, joined, half a second interpolated"]
    assert found["timeline"]["Peak jerk, m"][0] < joined["Peak jerk, m"][0]
    assert 0 <= found["timeline"]["R@3 / alone"][0] <= 3
    assert "R@3" not in found["real motion"] and "R@3" in found["each prompt alone"]


def test_streams_neither_grow_nor_drift(small: Bench, tmp_path: Path) -> None:
    found = figures(small, stream_rows, tmp_path)
    first, last = found["first 20 s"]["Jitter, m/s³"][0], found["last 20 s"]["Jitter, m/s³"][0]
    assert last < 2 * first
    assert found["all 0.5 min"]["State, kB"][0] < 20
    assert found["decoded in windows"]["Off, mm, worst"][0] < 0.01


def test_loops_close(small: Bench, tmp_path: Path) -> None:
    found = figures(small, loop_rows, tmp_path)
    assert found["loop"]["Seam jerk, m"][0] < 0.5 * found["motion, repeated"]["Seam jerk, m"][0]


def test_fits_are_nearer_than_what_was_recorded(
    small: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = {"noise": fits.Spoiled(0.05), "gap": fits.Spoiled(0.05, 1.0, ("left_ankle",))}
    monkeypatch.setattr(fits, "CASES", cases)
    found = figures(small, fit_rows, tmp_path)
    off = {row: columns["Off, cm"][0] for row, columns in found.items() if "Off, cm" in columns}
    for method in ("fit", "spline", "Kalman smoother"):
        assert off[f"noise: {method}"] < 0.7 * off["noise: recorded"]
        assert f"gap: {method}" in off


def test_smoothers_keep_what_is_smooth_and_bridge_gaps() -> None:
    time = np.arange(80) / 20
    path = np.stack([np.sin(2 * time), np.cos(1.5 * time), time], axis=1)[:, None]
    seen = np.ones((80, 1), bool)
    seen[35:45] = False
    noisy = path + np.random.default_rng(0).normal(0, 0.03, path.shape)
    unread = np.where(seen[..., None], noisy, 1e3)
    for smoother in (spline, lambda joints, seen, noise: kalman(joints, seen, noise, 20.0)):
        off = np.linalg.norm(smoother(unread, seen, 0.03) - path, axis=-1)
        assert off[seen].mean() < 0.6 * np.linalg.norm(noisy - path, axis=-1)[seen].mean()
        assert off[~seen].max() < 0.12
        np.testing.assert_allclose(smoother(path, seen, 1e-4), path, atol=0.01)


def test_lengths_and_searches_stand_beside_guesses(small: Bench, tmp_path: Path) -> None:
    lengths = figures(small, length_rows, tmp_path)
    assert {"predicted", "always 5.2 s"} == set(lengths)
    found = figures(small, search_rows, tmp_path)
    assert found["towers"]["R@5"][0] == 1  # four clips
    assert found["words, clips with several sentences"]["R@1"][0] > 0.5


def test_figures_have_intervals(small: Bench) -> None:
    draw = np.random.default_rng(0)
    mean, half = small.figure("Off, cm", draw.normal(3, 1, 400))
    assert mean is not None and half is not None
    assert abs(mean - 3) < 0.2 and 0.05 < half < 0.2
    assert small.figure("Off, mm, worst", np.array([1.0, 4.0, 2.0]))[0] == 4
    assert small.figure("Seam, median", np.array([1.0, 9.0, 2.0]))[0] == 2
    assert small.figure("Correlation", np.array([[1, 2], [2, 4], [3, 6.0]]))[0] == pytest.approx(1)
    assert small.figure("Off, cm", np.array([1.0])) == [None, None]
    clips = np.repeat(np.arange(20), 10)
    alike = np.repeat(draw.normal(3, 1, 20), 10)  # ten motions of a clip tell nothing new
    naive, once, repeated = (
        np.array(small.figure("Off, cm", values, own), float)
        for values, own in ((alike, None), (alike, clips), (np.repeat(alike, 2), clips))
    )
    assert naive[1] < 0.5 * once[1]
    np.testing.assert_allclose(repeated, once)
    row, other = {"Sliding, cm/s": np.array([2.0, 4])}, {"Sliding, cm/s": np.array([1.0, 3])}
    both = beside(row, other, "no goals", ["Sliding, cm/s"])
    assert small.figure("Sliding / no goals", both["Sliding / no goals"])[0] == 1.5


def test_fid_is_that_to_the_test_split(generate: MotionPipeline, folder: Path) -> None:
    judged = Bench(generate, Dataset.load(folder), shipped_scorer(), 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "FID_DRAWS", 2)
        same, off = (judged.figure("FID", values)[0] for values in (judged.real, judged.real + 1))
        pairs = np.stack([judged.real + 1, judged.real + 1], axis=1)
        ratio = judged.figure("FID / no goals", pairs)[0]
    assert same == pytest.approx(0, abs=1e-6) and off == pytest.approx(judged.real.shape[1])
    assert ratio == pytest.approx(1)


def test_interpolation_is_straight() -> None:
    joints = np.zeros((5, 1, 3))
    joints[3:] = 3.0
    assert blended(joints, 1, 3)[:, 0, 0].tolist() == [0, 1, 2, 3, 3]


def test_the_program_runs_one_and_tells_mistakes(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = ["length", "--data", str(folder), "-o", str(tmp_path)]
    main([*order, "--count", "2"])
    assert "### length: seconds predicted from the sentence" in capsys.readouterr().out
    assert (tmp_path / "length.md").is_file() and (tmp_path / "length.json").is_file()
    for more in (["--count", "1"], ["--seeds", "0"]):
        with pytest.raises(SystemExit):
            main([*order, *more])
        assert "expected --count of 2 or more and --seeds" in capsys.readouterr().err


def test_cases_of_control_are_the_same_on_every_machine() -> None:
    content = file_content()
    assert hashlib.sha256(content.encode()).hexdigest().startswith("00412b10b4b89c4e")
    every = json.loads(content)["cases"]
    assert [sum(case["kind"] == kind for case in every) for kind in KINDS] == [200] * 5
    for case in every[::7]:
        frames = round(case["seconds"] * 20)
        targets_of([g for g in goals_of(case) if not isinstance(g, Pose)], frames, 20.0, HUMANML3D)


def test_the_control_benchmark_measures_ours_and_other_motions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--kind", "end_effectors", "--count", "1", "-o", str(tmp_path)]
    control(["run", "--threads", "1", *words])
    control(["run", "--threads", "1", *words])  # the case is there already
    (row,) = map(json.loads, (tmp_path / "run.jsonl").read_text(encoding="utf-8").splitlines())
    assert row["error_cm"] < 0.1 and row["worst_cm"] < 0.2
    control(["score", str(tmp_path), *words])
    assert "| end_effectors | 1 | 1 |" in capsys.readouterr().out  # there is no such motion
