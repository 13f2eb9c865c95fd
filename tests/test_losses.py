"""Losses of both stages in closed form; padding weighs nothing."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.loss import DenoiserObjective, denoiser_loss
from latentmotion.diffusion.prediction import Epsilon, Sample, Velocity
from latentmotion.diffusion.schedule import LinearPath, ScaledLinear
from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.loss import VAEObjective, vae_losses
from latentmotion.vae.posterior import Posterior

MASK = torch.arange(6) < torch.tensor([[6], [3]])


class Shifting(MotionVAE):
    """Its latents are the features; what it decodes is off by `shift` a frame."""

    def __init__(self, shift: float) -> None:
        super().__init__()
        self.shift = shift

    def encode(self, features: Tensor, mask: Tensor) -> Posterior:
        return Posterior(features, torch.full_like(features, -2.0))

    def decode(self, latents: Tensor, mask: Tensor) -> Tensor:
        steps = torch.arange(latents.shape[1], dtype=torch.float32)
        return (latents + self.shift * steps[:, None]) * mask[..., None]

    def latent_mask(self, mask: Tensor) -> Tensor:
        return mask


def as_joints(features: Tensor) -> Tensor:
    return features.unflatten(-1, (-1, 3))


def silent(*shape: int) -> Tensor:
    return torch.zeros(2, *shape)


def test_vae_losses_in_closed_form() -> None:
    features = torch.randn(2, 6, 3, generator=torch.Generator().manual_seed(0))
    objective = VAEObjective(features=2.0, joints=3.0, steps=0.5, divergence=0.1)
    losses = vae_losses(Shifting(0.1), features, MASK, silent, as_joints, 10.0, objective)
    # Half of the squared shift 0, 0.1, ... 0.5 of the one motion and 0, 0.1, 0.2 of the other.
    distance = 0.5 * 0.01 * (sum(i * i for i in range(6)) / 6 + (0 + 1 + 4) / 3) / 2
    assert losses["features"].item() == pytest.approx(distance, rel=1e-4)
    assert losses["joints"].item() == pytest.approx(distance, rel=1e-4)
    # A step of 0.1 a frame is 1 a second; the knee of 1 m is 10 m/s: 0.5 · 1² / 10.
    assert losses["steps"].item() == pytest.approx(0.05, rel=1e-4)
    squares = [features[0].square().mean(), features[1, :3].square().mean()]
    divergence = 0.5 * (sum(squares) / 2 + torch.exp(torch.tensor(-2.0)) - 1 + 2)
    assert losses["divergence"].item() == pytest.approx(float(divergence), rel=1e-4)
    parts = [(2.0, "features"), (3.0, "joints"), (0.5, "steps"), (0.1, "divergence")]
    total = sum(weight * losses[name].item() for weight, name in parts)
    assert losses["total"].item() == pytest.approx(total, rel=1e-5)


def test_padding_weighs_nothing() -> None:
    features = torch.randn(2, 6, 3, generator=torch.Generator().manual_seed(0))
    arguments: Any = (silent, as_joints, 10.0, VAEObjective())
    found = vae_losses(Shifting(0.1), features, MASK, *arguments)
    other = torch.where(MASK[..., None], features, 50.0)
    assert vae_losses(Shifting(0.1), other, MASK, *arguments)["total"] == found["total"]


@pytest.mark.parametrize("prediction", [Epsilon(), Sample(), Velocity()])
@pytest.mark.parametrize("schedule", [ScaledLinear(), LinearPath()])
def test_denoiser_loss_in_closed_form(schedule: Any, prediction: Any) -> None:
    generator = torch.Generator().manual_seed(0)
    z0, epsilon = torch.randn(2, 2, 6, 3, generator=generator).unbind(0)
    t = schedule.at(torch.tensor([0.2, 0.7]))
    objective = DenoiserObjective(schedule, prediction)
    nothing = Conditioning(torch.zeros(2, 1, 1), torch.ones(2, 1, dtype=torch.bool))
    target = prediction.target(z0, epsilon, t, schedule)

    def loss(off: Tensor) -> float:
        def network(z: Tensor, t: Tensor, condition: Conditioning, mask: Tensor) -> Tensor:
            return target + off

        return float(denoiser_loss(network, z0, epsilon, t, nothing, MASK, objective))

    assert loss(torch.tensor(0.0)) == 0
    assert loss(torch.tensor(0.3)) == pytest.approx(0.09, rel=1e-4)
    assert loss(10.0 * ~MASK[..., None]) == 0


def test_times_cover_the_schedule() -> None:
    normal = torch.randn(20_000, generator=torch.Generator().manual_seed(0))
    uniform = DenoiserObjective().time(normal)
    assert uniform.min() < 5
    assert uniform.max() == 999
    assert uniform.mean().item() == pytest.approx(499.5, abs=5)
    middle = DenoiserObjective(LinearPath(), Velocity(), "logit_normal").time(normal)
    assert ((middle > 0) & (middle < 1)).all()
    assert middle.std() < 0.25
