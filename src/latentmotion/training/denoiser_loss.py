"""Loss of the denoiser (paper, eq. 4): ‖target − denoiser(z_t, t, condition)‖².

z_t = α z_0 + σ ε; the target is the noise, the latents or the velocity, as its parametrization
says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import (
    Denoiser,
    Epsilon,
    Parametrization,
    Sample,
    Velocity,
    add_noise,
)
from latentmotion.diffusion.schedule import AnySchedule, ScaledLinear, Schedule, StepCondition
from latentmotion.errors import InputError
from latentmotion.networks.vae.interface import Latents, mean_of_real


@dataclass(frozen=True)
class DenoiserObjective:
    """Objective of the denoiser; the defaults are the paper's."""

    schedule: AnySchedule = field(default_factory=ScaledLinear)  # Noise schedule.
    # Prediction of the network.
    parametrization: Epsilon | Sample | Velocity = field(default_factory=Epsilon)
    # Distribution of times; logit-normal (Esser et al. 2024) prefers the middle.
    times: Literal["uniform", "logit_normal"] = "uniform"
    dropped: float = 0.1  # Share of motions that are shown without their condition.
    # Min-SNR weights (Hang et al. 2023): the squared error of z_0 weighs min(SNR, gamma), whatever
    # is predicted; null for the plain squared error of the prediction, as in the paper.
    snr_gamma: float | None = None

    def __post_init__(self) -> None:
        if self.snr_gamma is not None and not 0 < self.snr_gamma < math.inf:
            raise InputError(f"snr_gamma {self.snr_gamma}: expected a number above 0, or null")

    def time(self, normal: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Turns standard normal numbers into times of the schedule."""
        uniform = torch.special.ndtr(normal) if self.times == "uniform" else torch.sigmoid(normal)
        # A far tail rounds to 1, which is no time of a discrete schedule.
        return self.schedule.time_at(uniform.clamp(max=1 - 2**-24))

    def weight(self, t: Float[Tensor, " batch"]) -> Float[Tensor, " batch"]:
        """Returns the weight of the squared error of the prediction at each time."""
        if self.snr_gamma is None:
            return torch.ones_like(t)
        ratio = self.schedule.alpha(t) / self.schedule.sigma(t).clamp(min=1e-4)  # sqrt of the SNR
        ratio = ratio.clamp(min=1e-4)
        # At a given z_t an error of 1 in z_0 is one of -ratio in epsilon, so the target, which is
        # linear in both, says how large it is in the prediction.
        columns = (torch.ones_like(ratio)[:, None, None], -ratio[:, None, None])
        rate = self.parametrization.target(*columns, t, self.schedule).flatten()
        return ratio.square().clamp(max=self.snr_gamma) / rate.square()


def denoiser_loss(
    denoiser: Denoiser,
    z0: Latents,
    epsilon: Latents,
    t: Float[Tensor, " batch"],
    condition: Conditioning,
    mask: Bool[Tensor, "batch tokens"],
    objective: DenoiserObjective,
) -> Float[Tensor, ""]:
    """Adds noise to latents and compares the network's answer with its target."""
    z = add_noise(z0, epsilon, t, objective.schedule)
    output = denoiser(z, t, condition, mask).float()
    target = objective.parametrization.target(z0, epsilon, t, objective.schedule)
    errors = F.mse_loss(output, target, reduction="none")
    return mean_of_real(errors * objective.weight(t)[:, None, None], mask)


@dataclass(frozen=True)
class StepBatch:
    """Steps that a student learns."""

    start: Latents  # Latents at the start.
    end: Latents  # Target: latents at the end.
    times: tuple[Float[Tensor, " batch"], Float[Tensor, " batch"]]  # Times of start and end.
    condition: Conditioning  # Condition of the motions.
    mask: Bool[Tensor, "batch tokens"]  # True on real tokens.
    step_condition: StepCondition  # Guidance scale and step size.


def step_loss(
    student: Callable[..., Tensor],
    batch: StepBatch,
    schedule: Schedule,
    parametrization: Parametrization,
    huber_delta: float,
) -> Float[Tensor, ""]:
    """Compares a student's steps with their targets, as mean velocities.

    Args:
        student: The denoiser that learns, whose last argument is a `StepCondition`.
        batch: The steps.
        schedule: The teacher's.
        parametrization: Meaning of the student's output.
        huber_delta: Error at which the loss changes from quadratic to linear.
    """
    start, t = batch.start, batch.times[0]
    output = student(start, t, batch.condition, batch.mask, batch.step_condition).float()
    velocity = partial(Velocity().target, t=t, schedule=schedule)
    predicted = velocity(*parametrization.to_x0_eps(output, start, t, schedule))
    target = velocity(*between(start, batch.end, *batch.times, schedule))
    return mean_of_real(
        F.huber_loss(predicted, target, reduction="none", delta=huber_delta), batch.mask
    )


def between(
    start: Latents,
    end: Latents,
    t: Float[Tensor, " batch"],
    s: Float[Tensor, " batch"],
    schedule: Schedule,
) -> tuple[Latents, Latents]:
    """Returns the (z_0, epsilon) with which one step of DDIM leads from `start` to `end`.

    They solve α_t z_0 + σ_t ε = start and α_s z_0 + σ_s ε = end.
    """
    (at, st), (as_, ss) = (
        (schedule.alpha(time)[:, None, None], schedule.sigma(time)[:, None, None])
        for time in (t, s)
    )
    determinant = at * ss - as_ * st
    return (ss * start - st * end) / determinant, (at * end - as_ * start) / determinant
