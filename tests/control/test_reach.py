"""Reach: derivatives against finite differences and autograd, goals met through a real decoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.control.goals import Heading, Reach, TargetResidual, targets_of
from latentmotion.control.reach import (
    CorrectedDenoiser,
    Correction,
    DecodedMotion,
    ReachSettings,
    joint_features,
    joints_pullback,
    least_step,
    reach,
)
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import (
    Epsilon,
    ParametrizedDenoiser,
    Sample,
    Velocity,
    add_noise,
)
from latentmotion.diffusion.samplers import DDIM, DPMSolver, Heun, sample
from latentmotion.diffusion.schedule import LinearPath, ScaledLinear
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    MirroredDecoder,
    QuarterRateDecoder,
)
from latentmotion.networks.checkpoint import build
from latentmotion.networks.vae.convolutional import Pullback
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Scale
from tests.support.walker import walker


def vae(decoder: MirroredDecoder | QuarterRateDecoder, seed: int = 0) -> torch.nn.Module:
    torch.manual_seed(seed)
    network = build(ConvolutionalVAEConfig(width=24, channels=6, decoder=decoder)).eval()
    for weights in network.parameters():  # some layers are nothing at first
        torch.nn.init.normal_(weights, std=0.08)
    return network


@pytest.mark.parametrize("decoder", [MirroredDecoder(), QuarterRateDecoder()])
@pytest.mark.parametrize("width", [263, 67])
def test_the_pullback_is_autograds(
    decoder: MirroredDecoder | QuarterRateDecoder, width: int
) -> None:
    network = vae(decoder)
    mask = torch.arange(26)[None] < 23
    latents, gradient = torch.randn(1, 7, 6), torch.randn(3, 26, width)
    z = latents.expand(3, -1, -1).clone().requires_grad_(True)
    features = network.decode(z, mask.expand(3, -1))[..., :width]
    (expected,) = torch.autograd.grad(features, z, gradient)
    with torch.no_grad():
        found = Pullback(network)(latents, mask, gradient)
    assert (found - expected).abs().max() < 1e-5 * expected.abs().max()


@pytest.mark.parametrize("representation", [HUMANML3D_FEATURES, KIT_FEATURES])
def test_joints_pull_on_features_as_differences_say(representation: object) -> None:
    generator = np.random.default_rng(0)
    features = 0.2 * generator.standard_normal((9, representation.width))
    gradient = generator.standard_normal((2, 9, len(representation.skeleton), 3))
    joints = representation.decode(features)
    found = joints_pullback(representation, features, joints, gradient)
    direction = generator.standard_normal(features.shape)
    ahead, behind = (representation.decode(features + e * direction) for e in (1e-6, -1e-6))
    expected = np.einsum("rtjc,tjc->r", gradient, (ahead - behind) / 2e-6)
    used = joint_features(representation)
    assert np.allclose(np.einsum("rtf,tf->r", found, direction[:, :used]), expected, rtol=1e-5)


def test_headings_and_places_change_as_their_gradient_says() -> None:
    joints = np.array(walker(30).joints())
    goals = [Reach("right_wrist", 0.5, (0.2, None, 0.9)), Heading(1.0, 40)]
    residual = TargetResidual(targets_of(goals, 30, 20.0, HUMANML3D), HUMANML3D)
    direction = np.random.default_rng(0).standard_normal(joints.shape)
    change = (residual(joints + 1e-6 * direction) - residual(joints - 1e-6 * direction)) / 2e-6
    found = np.einsum("rtjc,tjc->r", residual.gradient(joints), direction)
    assert np.allclose(found, -change, atol=1e-6)


def decoded(frames: int = 40) -> DecodedMotion:
    network = vae(QuarterRateDecoder())
    pullback = Pullback(network)

    def decode(latents: np.ndarray, mask: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network.decode(torch.tensor(latents), torch.tensor(mask)).numpy()

    def pull(latents: np.ndarray, mask: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return pullback(*map(torch.tensor, (latents, mask, gradient))).numpy()

    one = Scale(np.zeros(6), np.ones(6))
    features = Scale(np.zeros(263), np.full(263, 0.3))
    return DecodedMotion(decode, pull, one, features, HUMANML3D_FEATURES, frames)


def test_goals_are_met_and_only_free_tokens_move() -> None:
    motion, generator = decoded(), np.random.default_rng(0)
    z = generator.standard_normal((10, 6)).astype(np.float32)
    start = motion.joints(z)[[20, 30], [21, 0]]
    goals = [
        Reach("right_wrist", 1.0, tuple((start[0] + 0.05).tolist())),
        Reach("pelvis", 1.5, (start[1, 0] + 0.05, None, start[1, 2] - 0.05)),
    ]
    residual = TargetResidual(targets_of(goals, 40, 20.0, HUMANML3D), HUMANML3D)
    free = np.arange(10) > 2
    found = reach(z, motion, residual, free, ReachSettings(updates=12))
    assert np.abs(residual(motion.joints(found))).max() < 1e-3
    assert (found[:3] == z[:3]).all()
    assert (found[3:] != z[3:]).any()


def test_nothing_changes_without_goals() -> None:
    motion, z = decoded(), np.ones((10, 6), np.float32)
    residual = TargetResidual(targets_of([], 40, 20.0, HUMANML3D), HUMANML3D)
    assert (reach(z, motion, residual) == z).all()


def test_a_step_is_the_shortest_that_closes_a_linear_gap() -> None:
    generator = np.random.default_rng(0)
    jacobian, missing = generator.standard_normal((3, 20)), generator.standard_normal(3)
    step = least_step(jacobian, missing, 0.0)
    assert np.allclose(step, np.linalg.pinv(jacobian) @ missing)


@pytest.mark.parametrize("parametrization", [Epsilon(), Sample(), Velocity()])
@pytest.mark.parametrize("schedule", [LinearPath(), ScaledLinear()])
def test_known_latents_are_kept_with_the_noise_sampling_began_with(
    parametrization: Epsilon | Sample | Velocity, schedule: LinearPath | ScaledLinear
) -> None:
    if isinstance(parametrization, Epsilon) and isinstance(schedule, LinearPath):
        pytest.skip("the noise says nothing of latents where there is no signal")
    generator = np.random.default_rng(0)
    noise = generator.standard_normal((1, 10, 6))
    known, is_known = generator.standard_normal((10, 6)), np.arange(10) < 4
    states = []
    nothing = Conditioning(np.zeros((1, 0, 4), np.float32), np.zeros((1, 0), bool))

    def network(z: np.ndarray, t: np.ndarray, condition: object, mask: object) -> np.ndarray:
        states.append((z, t))
        return np.tanh(z)

    keep = Correction(decoded(), fixed=known, is_known=is_known)
    denoiser = CorrectedDenoiser(ParametrizedDenoiser(network, parametrization, schedule), keep)
    for sampler in (DDIM, Heun, DPMSolver):
        states.clear()
        rule = sampler(schedule)
        z = sample(denoiser, rule, noise, nothing, np.ones((1, 10), bool), 5, lambda _: noise)
        level = schedule.sigma(
            schedule.timesteps(5)[-1].item()
        )  # the paper's keeps a hair of noise
        assert np.allclose(z[0, :4], known[:4], atol=1e-5 + 4 * level)
        if sampler is DDIM:
            first_z, first_t = states[0]
            first = (first_z - schedule.alpha(first_t)[:, None, None] * known) / schedule.sigma(
                first_t
            )[:, None, None]
            for state, t in states[1:]:
                expected = add_noise(known[None], first, t, schedule)
                assert np.allclose(state[0, :4], expected[0, :4], atol=1e-4)


def test_the_graph_of_the_pullback_is_the_network(tmp_path: Path) -> None:
    from latentmotion.engine.session import open_session
    from latentmotion.export.onnx import export_pullback

    network = vae(QuarterRateDecoder(dilations=(3, 1)))
    export_pullback(network, tmp_path / "pullback.onnx")
    session = open_session(tmp_path / "pullback.onnx", threads=1)
    for frames, rows, width in ((26, 3, 67), (12, 1, 263), (80, 7, 67)):
        latents = torch.randn(1, -(-frames // 4), 6)
        mask, gradient = torch.ones(1, frames, dtype=torch.bool), torch.randn(rows, frames, width)
        z = latents.expand(rows, -1, -1).clone().requires_grad_(True)
        features = network.decode(z, mask.expand(rows, -1))[..., :width]
        (expected,) = torch.autograd.grad(features, z, gradient)
        inputs = {"latents": latents, "mask": mask, "gradient": gradient}
        found = session(**{name: value.numpy() for name, value in inputs.items()})
        assert np.abs(found - expected.numpy()).max() < 1e-5 * float(expected.abs().max())
