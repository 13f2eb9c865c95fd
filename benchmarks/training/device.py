"""Steps of both training stages on a device: how many motions a second they show."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from statistics import median

import torch

from benchmarks.training.steps import FirstStage, SecondStage, step_of
from latentmotion.training.distributed import DistributedContext, Ranks
from latentmotion.training.experiment import preset_named

PRESETS = "mld_humanml3d", "starter"
STAGES = "first", "second"
PRECISIONS = "float32", "bfloat16"
BATCHES = 64, 256, 1024
FRAMES = 196


def training_rows(device: str, quick: bool) -> Iterator[tuple[str, dict[str, object]]]:
    """Yields a line for each preset, stage, precision and batch."""
    context = DistributedContext(torch.device(device), Ranks())
    presets, batches = (PRESETS[1:], (4,)) if quick else (PRESETS, BATCHES)
    for preset, stage, precision, batch in itertools.product(presets, STAGES, PRECISIONS, batches):
        step = _step(preset, stage, precision, batch, context)
        seconds = _seconds(step, context.device, quick)
        row = {"preset": preset, "precision": precision, "batch": batch}
        row |= {"ms a step": 1e3 * seconds, "motions/s": batch / seconds}
        yield f"Training, {stage} stage", row


def _step(
    preset: str, stage: str, precision: str, batch: int, context: DistributedContext
) -> Callable[[], object]:
    experiment = preset_named(preset)
    settings = replace(experiment.vae_training, precision=precision)
    if stage == "first":
        frames = min(FRAMES, experiment.vae_cropping.max_frames)
        return step_of(FirstStage(experiment, batch, frames, context.device), settings, context)
    return step_of(SecondStage(experiment, batch, FRAMES, context.device), settings, context)


def _seconds(step: Callable[[], object], device: torch.device, quick: bool) -> float:
    """Median of steps, after some that warm up; the device is waited for."""
    wait = torch.cuda.synchronize if device.type == "cuda" else (lambda: None)
    times: list[float] = []
    for _ in range(3 if quick else 25):
        wait()
        start = time.perf_counter()
        step()
        wait()
        times.append(time.perf_counter() - start)
    return median(times[1 if quick else 5 :])
