"""How long a training step takes: in the authors' shapes and in ours, the paper's and others.

    python -m benchmarks.training.speed                     # 64 motions of 196 frames; needs 20 GB
    python -m benchmarks.training.speed --first 16          # stage 1 with fewer; 5 GB

The contenders of a stage take turns. Ours are the steps of `latentmotion train`, where stage 2
finds latents and sentences in memory. Numbers are synthetic, which changes no time; the authors'
shapes are a reference for time only. Where a recipe's windows are shorter, a step has more of them:
"times as fast" is by frames.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import torch

from benchmarks.harness.contest import Contender, figure, table, take_turns, whole
from benchmarks.training import authors
from benchmarks.training.distillation import DistillationStage
from benchmarks.training.steps import FEATURES, FirstStage, SecondStage, step_of
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.distillation.data import Distillation
from latentmotion.training.experiment import preset_named

COLUMNS = (
    *("", "motions a step", "frames", "s a step", "processor, s"),
    *("motions/s", "frames/s", "times as fast"),
)

Entry = tuple[Contender, int, int]  # A step, how many motions it shows, and of how many frames.


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table for each stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=64, help="motions of a step of stage 1")
    parser.add_argument("--second", type=int, default=64, help="motions of a step of stage 2")
    parser.add_argument("--frames", type=int, default=196)
    parser.add_argument("--presets", nargs="*", default=["mld_humanml3d", "starter"])
    parser.add_argument("--teacher", default="starter", help="shipped model to distill")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--turns", type=int, default=5)
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    for name, stage in (("Stage 1", _first), ("Stage 2", _second), ("Distillation", _distilled)):
        print(f"\n{name}: {_report(stage(options), options.turns)}", flush=True)


def _report(entries: dict[str, Entry], turns: int) -> str:
    times = take_turns({name: step for name, (step, _, _) in entries.items()}, turns)
    work = {name: motions * frames for name, (_, motions, frames) in entries.items()}
    rows = []
    for name, (_, motions, frames) in entries.items():
        seconds, processor = times.whole(name) / 1e3, times.processor(name) / 1e3
        ratio = times.ratio(name) * work[name] / next(iter(work.values()))
        pace = motions / seconds, work[name] / seconds
        cells = map(figure, (seconds, processor, *pace, ratio))
        rows.append([name, str(motions), str(frames), *cells])
    return f"{times}\n\n{table(COLUMNS, rows)}"


def _first(options: argparse.Namespace) -> dict[str, Entry]:
    batch, frames = options.first, options.frames
    features = torch.randn(batch, frames, FEATURES) / 10
    step = whole(authors.first_stage(features, HUMANML3D_FEATURES.decode))
    found = {"authors' shapes": (step, batch, frames)}
    for name in options.presets:
        experiment = preset_named(name)
        settings = experiment.vae_training
        window = min(frames, experiment.vae_cropping.max_frames)
        motions = batch * frames // window
        stage = FirstStage(experiment, motions, window)
        found[f"ours, `{name}`"] = whole(step_of(stage, settings)), motions, window
    return found


def _second(options: argparse.Namespace) -> dict[str, Entry]:
    batch, frames = options.second, options.frames
    features = torch.randn(batch, frames, FEATURES) / 10
    found = {"authors' shapes": (whole(authors.second_stage(features)), batch, frames)}
    for name in options.presets:
        experiment = preset_named(name)
        stage = SecondStage(experiment, batch, frames)
        step = whole(step_of(stage, experiment.denoiser_training))
        found[f"ours, `{name}`"] = step, batch, frames
    return found


def _distilled(options: argparse.Namespace) -> dict[str, Entry]:
    batch, frames, settings = options.second, options.frames, Distillation()
    stage = DistillationStage(options.teacher, settings, batch, frames)
    step = whole(step_of(stage, settings.training))
    return {f"of `{options.teacher}`, trajectories": (step, batch, frames)}


if __name__ == "__main__":
    main()
