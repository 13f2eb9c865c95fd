from __future__ import annotations

from functools import partial

import pytest
import torch
import torch.nn.functional as F

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import Epsilon, Sample, Velocity
from latentmotion.diffusion.schedule import LinearPath, ScaledLinear
from latentmotion.errors import InputError
from latentmotion.model.config import ConvolutionalVAEConfig
from latentmotion.networks.checkpoint import build
from latentmotion.networks.vae.interface import (
    MotionVAE,
    Posterior,
    VAEObjective,
    feature_losses,
    mean_of_real,
    vae_losses,
)
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.denoiser_loss import DenoiserObjective, denoiser_loss


def test_padding_weighs_nothing_in_a_mean() -> None:
    values = torch.tensor([[1.0, 3.0, 99.0], [4.0, 99.0, 99.0]])
    mask = torch.tensor([[True, True, False], [True, False, False]])
    assert mean_of_real(values[..., None].expand(2, 3, 5), mask) == 3.0


def losses(frames: int) -> dict[str, torch.Tensor]:
    """Losses of two motions of 24 real frames in a batch of `frames`."""
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(2, 24, 263, generator=generator) / 10
    features = F.pad(features, (0, 0, 0, frames - 24))
    mask = torch.arange(frames)[None].expand(2, -1) < 24
    torch.manual_seed(1)
    vae = build(ConvolutionalVAEConfig(width=8, channels=2, dilations=(1,)))

    def noise(tokens: int, width: int) -> torch.Tensor:
        drawn = torch.randn(2, 6, width, generator=generator)
        return F.pad(drawn, (0, 0, 0, tokens - 6))

    objective = VAEObjective(velocity=0.5)
    decode = HUMANML3D_FEATURES.decode
    return vae_losses(vae, features, mask, noise, decode, 20.0, objective)


def test_padding_changes_no_loss_of_the_vae() -> None:
    plain, padded = losses(24), losses(32)
    for name, value in plain.items():
        assert float(padded[name].detach()) == pytest.approx(float(value.detach()), rel=1e-4)


def test_the_total_is_the_weighted_sum() -> None:
    parts = losses(24)
    weights = {"features": 1.0, "joints": 1.0, "velocity": 0.5, "kl": 1e-4}
    total = sum(weight * parts[name] for name, weight in weights.items())
    assert torch.allclose(parts["total"], torch.as_tensor(total))


def test_the_papers_squared_error_is_an_option() -> None:
    output, true = torch.zeros(1, 2, 3), torch.tensor([[[3.0, 0, 0], [0, 0, 0]]])
    mask = torch.ones(1, 2, dtype=torch.bool)
    joints_of = lambda x: x[:, :, None]  # noqa: E731
    found = [
        feature_losses(output, true, mask, joints_of, 20.0, VAEObjective(squared=squared))[
            "features"
        ]
        for squared in (True, False)
    ]
    assert found == [pytest.approx(9 / 6), pytest.approx(2.5 / 6)]


def test_only_feet_that_stand_and_bones_that_change_cost() -> None:
    """A body that is moved as a whole slides with its feet, and keeps the lengths of its bones."""
    skeleton = HUMANML3D_FEATURES.skeleton
    rest = torch.from_numpy(skeleton.rest_joints()).float().expand(1, 8, -1, -1)
    slide = rest + torch.linspace(0, 0.7, 8)[None, :, None, None] * torch.tensor([1.0, 0, 0])
    mask, features = torch.ones(1, 8, dtype=torch.bool), torch.zeros(1, 8, 1)

    def compare(found: torch.Tensor, true: torch.Tensor) -> dict[str, torch.Tensor]:
        bodies = iter((found, true))
        objective = VAEObjective(contacts=1.0, bones=1.0)
        joints_of = lambda _: next(bodies)  # noqa: E731
        return feature_losses(features, features, mask, joints_of, 20.0, objective, skeleton)

    stood, went = compare(slide, rest), compare(rest, slide)
    assert float(stood["contacts"]) > 0.1 and float(stood["bones"]) < 1e-6
    assert float(went["contacts"]) == 0.0, "a foot that truly moves is no contact"
    assert float(compare(1.1 * rest, rest)["bones"]) > 1e-4


def test_a_posterior_stays_finite_however_far_off_a_motion_is() -> None:
    torch.manual_seed(0)
    vae = build(ConvolutionalVAEConfig(width=8, channels=2, dilations=(1,)))
    far = 1e6 * torch.randn(1, 16, 263)
    posterior = vae.encode(far, torch.ones(1, 16, dtype=torch.bool))
    assert torch.isfinite(posterior.std).all() and torch.isfinite(posterior.kl()).all()


def test_the_authors_means_run_over_padding() -> None:
    """Plain means of padded batches; the joints of padding are those of features of zero."""
    generator = torch.Generator().manual_seed(0)
    mask = torch.arange(24)[None] < torch.tensor([24, 10])[:, None]
    features = torch.randn(2, 24, 263, generator=generator) / 10 * mask[..., None]
    torch.manual_seed(1)
    vae = build(ConvolutionalVAEConfig(width=8, channels=2, dilations=(1,)))
    losses_of = partial(
        vae_losses,
        *(vae, features, mask, lambda *shape: torch.zeros(2, *shape)),
        *(HUMANML3D_FEATURES.decode, 20.0),
    )
    found = losses_of(VAEObjective(padded_means=True))
    posterior = vae.encode(features, mask)
    rebuilt = vae.decode(posterior.mean, mask)
    joints = [HUMANML3D_FEATURES.decode(part) for part in (rebuilt, features)]
    theirs = {
        "features": F.smooth_l1_loss(rebuilt, features),
        "joints": F.smooth_l1_loss(*joints),
        "kl": posterior.kl().mean(),
    }
    for name, value in theirs.items():
        assert float(found[name].detach()) == pytest.approx(float(value.detach()), rel=1e-5)
    total = theirs["features"] + theirs["joints"] + 1e-4 * theirs["kl"]
    assert float(found["total"].detach()) == pytest.approx(float(total.detach()), rel=1e-5)
    clean = losses_of(VAEObjective())
    assert float((clean["features"] / found["features"]).detach()) > 1.1


@pytest.mark.parametrize("parametrization", [Epsilon(), Sample(), Velocity()])
@pytest.mark.parametrize("schedule", [ScaledLinear(), LinearPath()])
def test_a_denoiser_that_knows_the_answer_has_no_loss(
    parametrization: Epsilon | Sample | Velocity, schedule: ScaledLinear | LinearPath
) -> None:
    z0, epsilon = torch.randn(2, 3, 4, 5, generator=torch.Generator().manual_seed(0))
    objective = DenoiserObjective(schedule, parametrization)
    t = objective.time(torch.tensor([-1.0, 0.0, 2.0]))
    condition = Conditioning(torch.zeros(3, 1, 2), torch.ones(3, 1, dtype=torch.bool))
    mask = torch.tensor([[True] * 4, [True] * 4, [True, False, False, False]])

    def knowing(z: torch.Tensor, t: torch.Tensor, *_: object) -> torch.Tensor:
        answer = parametrization.target(z0, epsilon, t, schedule)
        return torch.where(mask[..., None], answer, 7.0)

    loss = denoiser_loss(knowing, z0, epsilon, t, condition, mask, objective)
    assert float(loss) == pytest.approx(0.0, abs=1e-10)


def test_times_are_uniform_or_prefer_the_middle() -> None:
    normal = torch.randn(20_000, generator=torch.Generator().manual_seed(0))
    uniform = DenoiserObjective().time(normal)
    assert uniform.min() >= 0 and uniform.max() <= 999
    assert float(uniform.mean()) == pytest.approx(499.5, abs=8)
    assert float((uniform < 100).float().mean()) == pytest.approx(0.1, abs=0.01)
    middle = DenoiserObjective(LinearPath(), Velocity(), "logit_normal").time(normal)
    assert float(((middle > 0.25) & (middle < 0.75)).float().mean()) > 0.7
    assert DenoiserObjective().time(torch.tensor([40.0])) == 999


def test_vertices_are_compared_where_there_is_a_body() -> None:
    features = torch.randn(2, 8, 5, generator=torch.Generator().manual_seed(0))
    mask = torch.arange(8)[None] < torch.tensor([[8], [5]])

    class Halves(MotionVAE):
        """Rebuilds half of each feature."""

        def encode(self, features: torch.Tensor, mask: torch.Tensor) -> Posterior:
            self.half = 0.5 * features
            return Posterior(torch.zeros(2, 1, 3), torch.zeros(2, 1, 3))

        def decode(self, latents: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            return self.half * mask[..., None]

        def latent_mask(self, mask: torch.Tensor) -> torch.Tensor:
            return mask.new_ones(2, 1)

    def points(features: torch.Tensor) -> torch.Tensor:
        return features[..., :4, None].expand(-1, -1, -1, 3)

    objective = VAEObjective(joints=0.0, vertices=2.0)
    noise = torch.zeros(2, 1, 3)
    arguments = (Halves(), features, mask, lambda *_: noise, points, 20.0, objective)
    plain, found = vae_losses(*arguments), vae_losses(*arguments, vertices_of=points)
    expected = mean_of_real(
        F.smooth_l1_loss(0.5 * features[..., :4], features[..., :4], reduction="none"), mask
    )
    assert "vertices" not in plain
    assert torch.allclose(found["vertices"], expected)
    assert torch.allclose(found["total"], plain["total"] + 2 * expected)


@pytest.mark.parametrize("schedule", [ScaledLinear(), LinearPath()])
def test_min_snr_weighs_the_error_of_clean_latents_whatever_is_predicted(
    schedule: ScaledLinear | LinearPath,
) -> None:
    t = schedule.time_at(torch.tensor([0.3, 0.9]))
    z0, epsilon = (torch.randn(2, 1, 3, generator=torch.Generator().manual_seed(n)) for n in (0, 1))
    alpha, sigma = schedule.alpha(t)[:, None, None], schedule.sigma(t)[:, None, None]
    z, wrong = alpha * z0 + sigma * epsilon, z0 + 0.1
    errors = []
    for kind in (Epsilon(), Sample(), Velocity()):
        objective = DenoiserObjective(schedule, kind, snr_gamma=0.5)
        output = kind.target(wrong, (z - alpha * wrong) / sigma, t, schedule)
        error = (output - kind.target(z0, epsilon, t, schedule)).square().mean(dim=(1, 2))
        errors.append(objective.weight(t) * error)
    snr = (alpha / sigma).square().flatten().clamp(max=0.5)
    for error in errors:
        assert torch.allclose(error, 0.01 * snr, rtol=1e-3)
    with pytest.raises(InputError, match="snr_gamma"):
        DenoiserObjective(snr_gamma=0)
