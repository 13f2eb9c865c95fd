"""How long a training step takes, beside one with the shapes of the authors' code.

    python benchmarks/training.py                              # 64 x 196 frames, needs 20 GB
    python benchmarks/training.py --batch 4 --frames 40        # a quick look

Both take turns in one run; medians are reported. Ours are the steps of `latentmotion train`:
stage 2 finds its latents and sentences in memory, as there. Synthetic numbers, paper's networks.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable

import torch
from torch import nn

import authors_shaped
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.guidance import drop
from latentmotion.diffusion.loss import denoiser_loss
from latentmotion.experiment import Experiment
from latentmotion.presets import preset_named
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.devices import Place
from latentmotion.training.loop import optimize
from latentmotion.training.provenance import describe_machine
from latentmotion.training.randomness import Ranks, StepRandomness
from latentmotion.vae.loss import vae_losses

PLACE = Place(torch.device("cpu"), Ranks())


class FirstStage(nn.Module):
    """Stage 1 on synthetic features."""

    def __init__(self, experiment: Experiment, features: torch.Tensor) -> None:
        super().__init__()
        self.network, self.features = experiment.vae.build(), features
        self.objective = experiment.vae_objective

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of a step."""
        noise = StepRandomness(0, step, len(self.features), Ranks()).normal
        mask = torch.ones(self.features.shape[:2], dtype=torch.bool)
        decode, fps = HUMANML3D_FEATURES.decode, HUMANML3D_FEATURES.fps
        return vae_losses(self.network, self.features, mask, noise, decode, fps, self.objective)


class SecondStage(nn.Module):
    """Stage 2 on remembered synthetic latents and sentences."""

    def __init__(self, experiment: Experiment, batch: int) -> None:
        super().__init__()
        self.network, self.objective = experiment.denoiser.build(), experiment.denoiser_objective
        width, words = experiment.denoiser.latent_width, experiment.denoiser.condition_width
        self.mask = torch.ones(batch, 1, dtype=torch.bool)
        self.mean, self.std = torch.randn(2, 1000, 1, width)
        self.sentences = torch.randn(1000, 1, words)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of a step."""
        randomness = StepRandomness(0, step, len(self.mask), Ranks())
        rows = (randomness.uniform() * 1000).long()
        shape = self.mean.shape[1:]
        z0 = self.mean[rows] + self.std[rows] * randomness.normal(*shape)
        condition = Conditioning(self.sentences[rows], self.mask)
        null = Conditioning(self.sentences[:1], self.mask[:1])
        condition = drop(condition, null, randomness.chance(self.objective.dropped))
        epsilon, t = randomness.normal(*shape), self.objective.time(randomness.normal())
        loss = denoiser_loss(self.network, z0, epsilon, t, condition, self.mask, self.objective)
        return {"total": loss}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--frames", type=int, default=196)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    experiment = preset_named("mld_humanml3d")
    features = torch.randn(options.batch, options.frames, experiment.vae.features) / 10
    pairs = {
        f"stage 1, {options.batch} x {options.frames} frames": (
            authors_shaped.first_stage(features, HUMANML3D_FEATURES.decode),
            _ours(FirstStage(experiment, features), experiment),
        ),
        f"stage 2, batch {options.batch}": (
            authors_shaped.second_stage(features),
            _ours(SecondStage(experiment, options.batch), experiment),
        ),
    }
    print(f"{describe_machine()}, load {os.getloadavg()[0]:.1f}, ", end="")
    print(f"float32, median of {options.repeats}, seconds a step\n")
    print("| | authors-shaped | ours | ratio |\n|---|---|---|---|")
    for name, (theirs, ours) in pairs.items():
        seconds = _medians(options.repeats, theirs, ours)
        ratio = f"{seconds[0] / seconds[1]:.1f}"
        print(f"| {name} | {seconds[0]:.3g} | {seconds[1]:.3g} | {ratio} |", flush=True)


def _ours(stage: nn.Module, experiment: Experiment) -> Callable[[], object]:
    settings = experiment.vae_training
    optimizer = torch.optim.AdamW(stage.parameters(), settings.learning_rate)
    numbers = iter(range(10**9))
    return lambda: optimize(stage, optimizer, settings, next(numbers), PLACE)


def _medians(repeats: int, *steps: Callable[[], object]) -> list[float]:
    """Median seconds of each, taking turns after one unmeasured turn."""
    times: list[list[float]] = [[] for _ in steps]
    for turn in range(repeats + 1):
        for step, row in zip(steps, times, strict=True):
            start = time.perf_counter()
            step()
            if turn:
                row.append(time.perf_counter() - start)
    return [statistics.median(row) for row in times]


if __name__ == "__main__":
    main()
