"""Everything worth a borrowed GPU, by priority, each step within its share of the time.

    PYTHONPATH=src python -m benchmarks.gpu_plan OUT --data data/starter.pack --minutes 30
    PYTHONPATH=src python -m benchmarks.gpu_plan /tmp/try --data SMALL --device cpu --quick

Steps are commands of their own, for an H100 or H200 alike: speed of generation and training with
rooflines; the long run of the starter's denoiser at two widths, with draws by rarity, its student
and the instruction benchmark; MLD at full size; rows of the paper's tables, those of noise against
clean latents first. Without an NVIDIA GPU it refuses to begin, unless a CPU is asked for.
A step ends with its share of the minutes; what it has written stays. OUT/plan.jsonl gets a line for
every step that ended, OUT/NAME.log what it printed. The same command again resumes: steps that
ended well are skipped, a training continues from its snapshot. How many steps a training takes is
decided once, from the pace of its first steps, and kept in OUT/steps.json.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tarfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from latentmotion.storage.files import atomic_file

# Bytes of the archive of results, which is what comes back from a borrowed machine.
MOST_BYTES = 60 << 20

GRACE = 20.0  # Seconds between the request to stop and the end of a command.


@dataclass(frozen=True)
class Step:
    """A command and its share of the time."""

    name: str  # What its results are called.
    words: tuple[str, ...]  # The module to run and its arguments.
    share: float  # Share of all minutes.
    # Prefix of the training settings, where the number of steps follows from the pace.
    training: str = ""
    trial: int = 40  # Steps from which the pace is measured, the fewest of the training.


def plan(folder: Path, data: Path, device: str, quick: bool) -> list[Step]:
    """Returns the steps by priority.

    Args:
        folder: Where results go.
        data: Prepared folder or data pack.
        device: Where PyTorch computes.
        quick: Whether networks are tiny and steps few, to try the plan on a CPU.
    """
    on = ("--device", device)
    generation = ("benchmarks.generation.gpu", *on, *(("--quick",) if quick else ()))

    def train(stage: str, name: str, batch: int, *words: str) -> tuple[str, ...]:
        prefix = f"{stage}_training"
        settings = [f"{prefix}.batch_size={4 if quick else batch}", f"{prefix}.snapshot_every=200"]
        if not quick:
            settings.append(f"{prefix}.precision=bfloat16")
        flags = [flag for setting in settings for flag in ("--set", setting)]
        output = ("-o", str(folder / name), "--data", str(data), *on)
        return ("latentmotion", "train", stage, *output, *flags, *words)

    def denoiser(name: str, vae: str, *words: str) -> tuple[str, ...]:
        return train("denoiser", name, 256, "--vae", vae, "--text-encoder", "starter", *words)

    def on_starter(width: int) -> tuple[str, ...]:
        sizes = {"width": width, "hidden": 3 * width}
        settings = [f"denoiser.transformer.{key}={value}" for key, value in sizes.items()]
        rare = ("--set", "draws.power=0.5")
        flags = [flag for setting in settings for flag in ("--set", setting)]
        return denoiser(f"starter_{width}", "starter", "--preset", "starter", *rare, *flags)

    mld = ("--preset", "mld_humanml3d")
    narrow, wide = (32, 48) if quick else (256, 512)
    teacher = folder / f"starter_{wide}" / "model"
    few = ("--set", "objective.trajectories=64") if quick else ()
    distill = ("latentmotion", "train", "distill", "--teacher", str(teacher))
    distill = (*distill, "--data", str(data), *few, *on)
    student = str(folder / "student")
    evaluated = ("--instructions", "--output", str(folder / "instructions"), *on)
    sizes = ["vae_training.steps=2", "vae_training.batch_size=4", "denoiser_training.steps=2"]
    tiny = [word for size in sizes for word in ("--set", size)] if quick else ()
    few_rows = ("--replications", "1") if quick else ()

    def table(name: str, *rows: str) -> tuple[str, ...]:
        command = ("latentmotion", "experiment", "run", name, "--data", str(data))
        words = ("--budget", "small", "--evaluator", "scorer", "-o", str(folder / "tables"), *on)
        chosen = ("--rows", *rows) if rows else ()
        return (*command, *words, *tiny, *few_rows, *chosen)

    epsilon = ("epsilon", "epsilon_standardized", "epsilon_min_snr", "velocity_standardized", "z0")
    steps = [
        Step("generation", (*generation, "starter", "fast", "-o", f"{folder}/generation"), 0.14),
        Step("training", (*generation, "--training", "-o", f"{folder}/training"), 0.04),
        Step(f"starter_{narrow}", on_starter(narrow), 0.16, "denoiser_training"),
        Step(f"starter_{wide}", on_starter(wide), 0.2, "denoiser_training"),
        Step("student", (*distill, "-o", student), 0.05, "training"),
        Step("instructions", ("latentmotion", "evaluate", f"{student}/model", *evaluated), 0.03),
        Step("mld_vae", train("vae", "mld_vae", 128, *mld), 0.14, "vae_training"),
        Step(
            "mld_denoiser",
            denoiser("mld_denoiser", str(folder / "mld_vae"), *mld),
            0.1,
            "denoiser_training",
        ),
        Step("epsilon", table("prediction", *epsilon), 0.06),
        Step("table_1", table("pack"), 0.04),
        Step("table_4", table("vae"), 0.02),
        Step("table_5", table("denoiser"), 0.02),
    ]
    return [replace(step, trial=4) for step in steps] if quick else steps


def run(step: Step, folder: Path, seconds: float) -> int | None:
    """Runs a step for at most some seconds; returns its exit status, None where time ran out."""
    words = list(step.words)
    if step.training:
        words += ["--set", f"{step.training}.steps={_steps(step, folder, seconds)}"]
    with (folder / f"{step.name}.log").open("a", encoding="utf-8") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,  # a signal reaches what the command started, too
        )
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        finally:
            _stop(process)


def _steps(step: Step, folder: Path, seconds: float) -> int:
    """Returns the steps that fit into some seconds, as decided when the training began."""
    file = folder / "steps.json"
    decided = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    if step.name not in decided:
        start = time.perf_counter()
        words = list(step.words)
        words[words.index("-o") + 1] = str(folder / "pace" / step.name)
        words += ["--set", f"{step.training}.steps={step.trial}"]
        words += ["--set", f"{step.training}.report_every={step.trial // 2}"]
        trial = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)
        paces = re.findall(r"\(([\d.]+) s a step", trial.stdout)
        left = 0.9 * (seconds - 2 * (time.perf_counter() - start))
        decided[step.name] = max(int(left / float(paces[-1])), step.trial) if paces else step.trial
        with atomic_file(file) as temporary:
            temporary.write_text(json.dumps(decided, indent=1), encoding="utf-8")
    return decided[step.name]


def _stop(process: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(GRACE)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def keep_results(folder: Path) -> None:
    """Writes FOLDER/results.tar: all that fits, reports and final models before anything else.

    Snapshots, latents and embeddings stay where they are: they can be made again.
    """
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    small = [path for path in files if path.suffix in (".json", ".jsonl", ".md", ".svg", ".log")]
    models = [path for path in files if path.name in ("weights.safetensors", "model.json")]
    left = MOST_BYTES
    with tarfile.open(folder / "results.tar", "w") as archive:
        for path in dict.fromkeys((*small, *models)):
            if path.stat().st_size < left:
                left -= path.stat().st_size + 1024
                archive.add(path, path.relative_to(folder))


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the steps that have not ended well yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where results go; resumed if it exists")
    parser.add_argument("--data", type=Path, required=True, help="prepared folder or data pack")
    parser.add_argument("--minutes", type=float, default=30.0, help="for all steps together")
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--quick", action="store_true", help="tiny, to try the plan")
    parser.add_argument("--only", nargs="*", help="names of some of the steps")
    options = parser.parse_args(arguments)
    if options.device.startswith("cuda") and not torch.cuda.is_available():
        parser.error("no NVIDIA GPU here; to try the plan on a CPU: --device cpu --quick")
    if options.device.startswith("cuda"):
        print(
            f"{torch.cuda.get_device_name()}, {MOST_BYTES >> 20} MiB of results at most", flush=True
        )
    steps = plan(options.folder, options.data, options.device, options.quick)
    names = [step.name for step in steps]
    if odd := set(options.only or ()) - set(names):
        parser.error(f"--only {min(odd)}: expected some of {', '.join(names)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    journal = options.folder / "plan.jsonl"
    rows = journal.read_text(encoding="utf-8").splitlines() if journal.is_file() else []
    done = {row["step"] for row in map(json.loads, rows) if row["status"] == 0}
    for step in steps:
        if step.name in done or (options.only and step.name not in options.only):
            continue
        start = time.perf_counter()
        status = run(step, options.folder, 60 * options.minutes * step.share)
        row = {"step": step.name, "status": status, "seconds": time.perf_counter() - start}
        with journal.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{step.name}: status {status}, {row['seconds']:.0f} s", flush=True)
    keep_results(options.folder)


if __name__ == "__main__":
    main()
