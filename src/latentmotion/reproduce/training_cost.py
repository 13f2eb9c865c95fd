"""Cost of training: floating-point operations and crops of both stages of a row.

FLOPs are those of one step, forward and backward, times the steps. Every crop counts as the longest
one; the loss, the optimizer and the latents that stage 2 reads are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import torch

from latentmotion.condition import Conditioning
from latentmotion.evaluation.cost import flops
from latentmotion.evaluation.report import Figure
from latentmotion.networks.checkpoint import build
from latentmotion.training.experiment import Experiment
from latentmotion.training.loop import read_progress
from latentmotion.training.run_folder import Run, read_run

Quantity = Literal["FLOPs", "crops"]
"""What training is counted in."""

Step = Callable[[Experiment], tuple[int, int, Callable[[], object]]]
"""An experiment to the crops of a stage's step, its planned steps, and a step's forward and
backward."""


def training_cost(vae: Path | None, denoiser: Path) -> dict[str, Figure]:
    """Returns the FLOPs of training, 10¹², and the crops that were seen, 10³.

    Args:
        vae: Run folder of the first stage; None for diffusion on raw frames.
        denoiser: Run folder of the second stage.

    Raises:
        InputError: A folder holds no run.
    """
    stages = [_run_cost(denoiser, denoiser_step)] + ([_run_cost(vae, vae_step)] if vae else [])
    total = {quantity: sum(cost[quantity] for cost in stages) for quantity in stages[0]}
    return {"Training": Figure(total["FLOPs"] / 1e12), "Crops": Figure(total["crops"] / 1e3)}


def equal_steps(quantity: Quantity, vae: Path, planned: Experiment, other: Experiment) -> int:
    """Returns the steps in which a denoiser has as much training as both stages of a model.

    Args:
        quantity: What is to be equal.
        vae: Run folder of the model's first stage.
        planned: Second stage of the model.
        other: The denoiser to train.

    Raises:
        InputError: The folder holds no run.
    """
    total = _run_cost(vae, vae_step)[quantity] + _cost(planned, denoiser_step)[quantity]
    return round(total / _cost(other, denoiser_step, steps=1)[quantity])


def _run_cost(folder: Path, step: Step) -> dict[Quantity, int]:
    return _cost(read_run(Run, folder).experiment, step, read_progress(folder).step)


def _cost(experiment: Experiment, step: Step, steps: int = 0) -> dict[Quantity, int]:
    """Returns the cost of so many steps, by default of those that are planned."""
    size, planned, action = step(experiment)
    return {"FLOPs": (steps or planned) * flops(action), "crops": (steps or planned) * size}


def vae_step(experiment: Experiment) -> tuple[int, int, Callable[[], object]]:
    """Returns the crops of a step of stage 1, its steps, and a step's forward and backward."""
    vae, training = build(experiment.vae), experiment.vae_training
    size, steps = training.batch_size, training.steps
    features = torch.zeros(size, experiment.vae_cropping.max_frames, experiment.vae.features)
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    return size, steps, lambda: vae.decode(vae.encode(features, mask).mean, mask).sum().backward()


def denoiser_step(experiment: Experiment) -> tuple[int, int, Callable[[], object]]:
    """Returns the crops of a step of stage 2, its steps, and a step's forward and backward."""
    denoiser, training = build(experiment.denoiser), experiment.denoiser_training
    size, steps = training.batch_size, training.steps
    frames = torch.ones(size, experiment.latents.cropping.max_frames, dtype=torch.bool)
    mask = build(experiment.vae).latent_mask(frames)
    latents = torch.zeros(*mask.shape, experiment.denoiser.latent_width)
    tokens = max(1, experiment.conditioning.pooled + experiment.conditioning.words)
    words = torch.zeros(size, tokens, experiment.denoiser.condition_width)
    condition = Conditioning(words, torch.ones(words.shape[:2], dtype=torch.bool))
    return (
        size,
        steps,
        lambda: denoiser(latents, torch.ones(size), condition, mask).sum().backward(),
    )
