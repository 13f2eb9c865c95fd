"""The plan for a GPU: steps end in their time, and a second call repeats those that failed."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import pytest

from benchmarks import gpu_plan
from benchmarks.gpu_plan import Step
from latentmotion.cli.main import main


def statuses(folder: Path) -> list[tuple[str, int | None]]:
    rows = map(json.loads, (folder / "plan.jsonl").read_text().splitlines())
    return [(row["step"], row["status"]) for row in rows]


def test_a_second_call_repeats_what_did_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = [
        Step("good", ("this",), 1.0),
        Step("bad", ("json.tool", "missing.json"), 1.0),
        Step("endless", ("http.server", "0", "--bind", "127.0.0.1"), 1e-3),
    ]
    monkeypatch.setattr(gpu_plan, "plan", lambda *settings: steps)
    words = [str(tmp_path), "--data", "none", "--device", "cpu"]
    gpu_plan.main(words)
    first = statuses(tmp_path)
    assert [name for name, _ in first] == ["good", "bad", "endless"]
    assert first[0][1] == 0 and first[1][1] not in (0, None) and first[2][1] is None
    assert "Beautiful is better" in (tmp_path / "good.log").read_text()
    gpu_plan.main([*words, "--only", "good", "bad"])
    assert [name for name, _ in statuses(tmp_path)[3:]] == ["bad"]


def test_a_pace_becomes_a_number_of_steps_and_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    printing = "print('20/40 train  total 1.0  (0.5 s a step, 9 s left)')"
    (tmp_path / "training.py").write_text(printing)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    step = Step("vae", ("training", "-o", "model"), 1.0, "vae_training")
    assert gpu_plan.run(step, tmp_path, 3600.0) == 0
    steps = json.loads((tmp_path / "steps.json").read_text())["vae"]
    assert 5000 < steps <= 6480
    assert gpu_plan.run(step, tmp_path, 60.0) == 0
    assert json.loads((tmp_path / "steps.json").read_text()) == {"vae": steps}


@pytest.mark.parametrize("quick", [False, True])
def test_the_commands_of_the_plan_are_understood(
    tmp_path: Path, quick: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each fails for its missing input alone, which is looked for after the options are read."""
    steps = gpu_plan.plan(tmp_path, tmp_path / "no_data", "cpu", quick)
    assert sum(step.share for step in steps) == pytest.approx(1.0)
    for step in steps:
        if step.words[0] == "latentmotion":
            with pytest.raises(SystemExit):
                main(step.words[1:])
            error = capsys.readouterr().err
            assert "no_data" in error or str(tmp_path) in error, step.name


def test_it_refuses_to_begin_without_a_gpu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(SystemExit):
        gpu_plan.main([str(tmp_path / "out"), "--data", "none"])
    assert "no NVIDIA GPU here; to try the plan on a CPU" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_results_that_come_back_are_reports_and_models_up_to_a_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu_plan, "MOST_BYTES", 20_000)
    sizes = {"run/report.json": 100, "run/model/weights.safetensors": 9_000, "run/snapshot.pt": 50}
    sizes["run/other/weights.safetensors"] = 30_000
    for name, size in sizes.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"0" * size)
    gpu_plan.keep_results(tmp_path)
    with tarfile.open(tmp_path / "results.tar") as archive:
        assert archive.getnames() == ["run/report.json", "run/model/weights.safetensors"]
