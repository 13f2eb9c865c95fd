"""A training that is killed at random moments, again and again: do all runs end at the same bits?

    python -m benchmarks.training.kills data --kills 200
    python -m benchmarks.training.kills data --kills 60 --stage denoiser

Each start is a process that this one, with PyTorch loaded, forks. It is killed at any moment within
the processor time of a whole run, however busy the machine is: by the timer's signal, which ends a
process as SIGKILL does. The same run is started again until it ends. Its weights and its journal
are compared with those of a run that nobody killed. The network is as small as those of the tests:
it is not the figures that count. The denoiser's VAE is trained first, and not killed.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch

from latentmotion.cli.main import main as run
from latentmotion.networks.checkpoint import WEIGHTS_FILE
from latentmotion.networks.device import describe_machine
from latentmotion.training.run_folder import read_journal

KILL = signal.SIGPROF

CHANGES = {
    "vae.width": 16,
    "vae.channels": 4,
    "vae.dilations": [1],
    "vae_cropping.max_frames": 24,
    "denoiser.latent_width": 4,
    "denoiser.transformer": {"width": 16, "layers": 3, "heads": 2, "hidden": 16, "dropout": 0.1},
    "latents.per_item": 2,
}

TRAINING = {
    "steps": 12,
    "batch_size": 4,
    "warm_up": 2,
    "precision": "float32",
    "report_every": 1,
    "validate_every": 4,
    "snapshot_every": 2,
    "sample_every": 0,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints how many runs were killed how often, and how many of them differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, help="prepared folder, a small one")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stage", choices=("vae", "denoiser"), default="vae")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    draw, load = random.Random(options.seed), os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = ["train", "vae", "--data", str(options.data)]
        if options.stage == "denoiser":
            assert started(words, folder / "vae", 0.0)[0] == 0
            words = ["train", "denoiser", *words[2:], "--vae", str(folder / "vae")]
        started(words, folder / "warm", 0.0)
        code, whole = started(words, folder / "whole", 0.0)
        assert code == 0, (folder / "whole.log").read_text(encoding="utf-8")
        expected, codes, runs = result(folder / "whole"), [], []
        while codes.count(-KILL) < options.kills:
            place, starts = folder / f"killed-{len(runs)}", len(codes)
            while not codes[starts:] or codes[-1]:
                codes.append(started(words, place, draw.uniform(0.001, whole))[0])
                if codes[-1] not in (0, -KILL):
                    told = place.with_suffix(".log").read_text(encoding="utf-8")
                    raise SystemExit(f"a start ended with {codes[-1]}: {told[-2000:]}")
            runs.append(result(place) == expected)
    print(f"{describe_machine()}; load {load:.1f} to {os.getloadavg()[0]:.1f}; {whole:.1f} s a run")
    print(f"{codes.count(-KILL)} kills in {len(runs)} runs; {runs.count(False)} of them differ")


def started(words: Sequence[str], folder: Path, seconds: float) -> tuple[int, float]:
    """Starts a run in a process of its own; returns its exit code and its processor time.

    Args:
        words: The command.
        folder: The run's.
        seconds: Processor time after which it is killed; 0 for never.
    """
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        _train(words, folder)
    _, status, usage = os.wait4(child, 0)
    return os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime


def result(folder: Path) -> tuple[bytes, object]:
    """Returns the weights of a run, and its journal."""
    return (folder / "model" / WEIGHTS_FILE).read_bytes(), read_journal(folder)


def _train(words: Sequence[str], folder: Path) -> None:
    code = 1
    try:
        with folder.with_suffix(".log").open("w", encoding="utf-8") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        training = {f"{words[1]}_training.{key}": value for key, value in TRAINING.items()}
        changes = {**CHANGES, **training}
        settings = [f"--set={key}={json.dumps(value)}" for key, value in changes.items()]
        run([*words, "-o", str(folder), *settings])
        code = 0
    finally:
        os._exit(code)


if __name__ == "__main__":
    main()
