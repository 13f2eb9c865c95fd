"""Steps of both training stages on a device, on noise: how many motions a second they show.

As in a run, random numbers are drawn on the CPU, latents and sentences lie on the device.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from statistics import median

import torch
from torch import Tensor, nn

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.loss import denoiser_loss
from latentmotion.experiment import Experiment
from latentmotion.presets import preset_named
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.devices import Place
from latentmotion.training.loop import optimize
from latentmotion.training.randomness import Ranks, StepRandomness
from latentmotion.vae.loss import vae_losses

PRESETS = "mld_humanml3d", "starter"
BATCHES = 64, 256, 1024
FRAMES = 196


class FirstStage(nn.Module):
    """The VAE on features of one length."""

    def __init__(self, experiment: Experiment, batch: int, device: torch.device) -> None:
        super().__init__()
        frames = min(FRAMES, experiment.vae_cropping.max_frames)
        self.network = experiment.vae.build().to(device)
        self.objective = experiment.vae_objective
        self.features = torch.randn(batch, frames, experiment.vae.features, device=device) / 10
        self.mask = torch.ones(batch, frames, dtype=torch.bool, device=device)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        features, mask = self.features, self.mask
        noise = StepRandomness(0, step, len(mask), Ranks(), mask.device).normal
        decode, fps = HUMANML3D_FEATURES.decode, HUMANML3D_FEATURES.fps
        return vae_losses(self.network, features, mask, noise, decode, fps, self.objective)


class SecondStage(nn.Module):
    """The denoiser on latents of one length and sentences."""

    def __init__(self, experiment: Experiment, batch: int, device: torch.device) -> None:
        super().__init__()
        config, reading = experiment.denoiser, experiment.reading
        shown = experiment.vae.build().latent_mask(torch.ones(batch, FRAMES, dtype=torch.bool))
        self.network, self.objective = config.build().to(device), experiment.denoiser_objective
        self.mask, words = shown.to(device), reading.words + reading.pooled
        self.z0 = torch.randn(*shown.shape, config.latent_width, device=device)
        tokens = torch.randn(batch, words, config.condition_width, device=device)
        self.condition = Conditioning(tokens, torch.ones_like(tokens[..., 0], dtype=torch.bool))

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        draw = StepRandomness(0, step, len(self.z0), Ranks(), self.z0.device)
        epsilon, t = draw.normal(*self.z0.shape[1:]), self.objective.time(draw.normal())
        loss = denoiser_loss(
            self.network, self.z0, epsilon, t, self.condition, self.mask, self.objective
        )
        return {"total": loss}


STAGES = {"first": FirstStage, "second": SecondStage}


def training_rows(device: str, quick: bool) -> Iterator[tuple[str, dict[str, object]]]:
    """Yields a line for each preset, stage, precision and batch."""
    for preset in PRESETS[1:] if quick else PRESETS:
        for stage, build in STAGES.items():
            for precision in ("float32", "bfloat16"):
                for batch in (4,) if quick else BATCHES:
                    place = Place(torch.device(device), Ranks())
                    experiment = preset_named(preset)
                    step = _step(
                        build(experiment, batch, place.device), experiment, precision, place
                    )
                    seconds = _seconds(step, place.device, quick)
                    row = {"preset": preset, "precision": precision, "batch": batch}
                    row |= {"ms a step": 1e3 * seconds, "motions/s": batch / seconds}
                    yield f"Training, {stage} stage", row


def _step(
    stage: nn.Module, experiment: Experiment, precision: str, place: Place
) -> Callable[[], object]:
    settings = replace(experiment.vae_training, precision=precision)
    optimizer = torch.optim.AdamW(stage.parameters(), settings.learning_rate)
    numbers = iter(range(10**9))
    return lambda: optimize(stage, optimizer, settings, next(numbers), place)


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
