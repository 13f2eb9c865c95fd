"""Schedules, predictions and samplers against diffusers and against closed forms."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.guidance import ClassifierFreeGuidance, drop, guided
from latentmotion.diffusion.parametrization import (
    Epsilon,
    Parametrization,
    ParametrizedDenoiser,
    Sample,
    Velocity,
    add_noise,
)
from latentmotion.diffusion.samplers import (
    DDIM,
    DDPM,
    DPMSolver,
    Heun,
    Sampler,
    sample,
    sampler_named,
)
from latentmotion.diffusion.schedule import Cosine, LinearPath, ScaledLinear, Schedule
from latentmotion.errors import InputError

SCHEDULES = [ScaledLinear(), ScaledLinear(offset=0, ends_clean=True), Cosine(), LinearPath()]
PREDICTIONS = [Epsilon(), Sample(), Velocity()]
FOREIGN_NAMES = {"epsilon": Epsilon(), "sample": Sample(), "v_prediction": Velocity()}
SHAPE = (3, 5, 4)
MASK = np.ones(SHAPE[:2], bool)
NOBODY = Conditioning(np.zeros((3, 1, 2), np.float32), np.ones((3, 1), bool))


def normal(seed: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)


def unused(shape: tuple[int, ...]) -> np.ndarray:
    raise AssertionError("this sampler draws nothing")


class KnownPoint:
    """The perfect denoiser of data that is one point, whatever it is asked to predict."""

    def __init__(self, point: Any, schedule: Schedule, parametrization: Parametrization) -> None:
        self.point = point
        self.schedule = schedule
        self.parametrization = parametrization

    def __call__(self, z: Any, t: Any, condition: Any, mask: Any) -> Any:
        time = float(t[0])
        epsilon = (z - self.schedule.alpha(time) * self.point) / self.schedule.sigma(time)
        return self.parametrization.target(self.point, epsilon, t, self.schedule)


class KnownGaussian(KnownPoint):
    """The perfect denoiser of data N(point, spread²): it answers the mean of z_0 given z_t."""

    spread = 0.5

    def __call__(self, z: Any, t: Any, condition: Any, mask: Any) -> Any:
        time = float(t[0])
        alpha, sigma = self.schedule.alpha(time), self.schedule.sigma(time)
        gain = alpha * self.spread**2 / (alpha**2 * self.spread**2 + sigma**2)
        z0 = self.point + gain * (z - alpha * self.point)
        return self.parametrization.target(z0, (z - alpha * z0) / sigma, t, self.schedule)


def parametrized(
    kind: type[KnownPoint], point: Any, schedule: Schedule, parametrization: Parametrization
) -> ParametrizedDenoiser:
    return ParametrizedDenoiser(kind(point, schedule, parametrization), parametrization, schedule)


# Schedules


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_times_descend_to_the_end(schedule: Schedule) -> None:
    for steps in (1, 7, 50, 1000):
        times = schedule.timesteps(steps)
        assert len(times) == steps + 1
        # With 1,000 steps the authors' discrete times end at 0 twice.
        assert (np.diff(times) < 0).sum() >= min(steps, 999)
    for steps in (0, -1, 100_000):
        with pytest.raises(InputError, match=str(steps)):
            schedule.timesteps(steps)


def test_times_of_the_paper() -> None:
    assert ScaledLinear().timesteps(50).tolist() == [*range(981, 0, -20), 0]
    assert LinearPath().timesteps(4).tolist() == [1, 0.75, 0.5, 0.25, 0]


def test_signal_of_the_paper() -> None:
    signal = [ScaledLinear().alpha(t) ** 2 for t in (0, 500, 981, 999)]
    assert np.allclose(signal, [0.99915, 0.2763, 0.0058, 0.0047], atol=5e-5)
    assert ScaledLinear().alpha(-1) == 1


def foreign_betas(length: int) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diffusers = pytest.importorskip("diffusers")
    name = "squaredcos_cap_v2"
    return diffusers.DDPMScheduler(num_train_timesteps=length, beta_schedule=name).betas.numpy()


@pytest.mark.parametrize("length", [1000, 50])
def test_mdms_signal_is_a_squared_cosine(length: int) -> None:
    schedule = Cosine(length)
    signal = np.array([schedule.alpha(t) ** 2 for t in [-1, *range(length)]])
    assert signal[0] == 1
    betas = 1 - signal[1:] / signal[:-1]
    assert np.allclose(betas, foreign_betas(length), rtol=1e-4, atol=1e-7)
    fractions = np.arange(length) / length
    cosine = np.cos(np.pi / 2 * (fractions + 0.008) / 1.008) ** 2
    assert np.allclose(signal[:-1], cosine / cosine[0], rtol=1e-6)
    assert schedule.alpha(length - 1) < 0.05
    assert schedule.timesteps(length).tolist() == [*range(length - 1, -1, -1), -1]
    with pytest.raises(InputError, match=str(length + 1)):
        schedule.timesteps(length + 1)


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_a_scalar_time_is_a_vector_of_equal_times(schedule: Schedule) -> None:
    times = schedule.timesteps(10)[1:-1]
    for weight in (schedule.alpha, schedule.sigma):
        scalars = [weight(t) for t in times.tolist()]
        assert np.allclose(weight(times), scalars, atol=1e-6)
        assert np.allclose(weight(torch.from_numpy(times)), scalars, atol=1e-6)


def test_fractions_become_times() -> None:
    u = torch.tensor([0.0, 0.4999, 0.99999])
    assert ScaledLinear().time_at(u).tolist() == [0, 499, 999]
    assert LinearPath().time_at(u) is u


# Predictions


@pytest.mark.parametrize("parametrization", PREDICTIONS)
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_to_x0_eps_undoes_target(schedule: Schedule, parametrization: Parametrization) -> None:
    z0, epsilon = normal(0), normal(1)
    t = schedule.time_at(np.array([0.1, 0.5, 0.9], np.float32))
    for array in (np.asarray, torch.from_numpy):
        clean, noise, time = array(z0), array(epsilon), array(t)
        z = add_noise(clean, noise, time, schedule)
        output = parametrization.target(clean, noise, time, schedule)
        found = parametrization.to_x0_eps(output, z, time, schedule)
        assert np.allclose(found[0], z0, atol=1e-4)
        assert np.allclose(found[1], epsilon, atol=1e-4)


def test_velocity_is_the_slope_of_the_line() -> None:
    z0, epsilon, t = normal(0), normal(1), np.full(3, 0.3, np.float32)
    later = add_noise(z0, epsilon, t + 0.5, LinearPath())
    velocity_coefficients = (later - add_noise(z0, epsilon, t, LinearPath())) / 0.5
    assert np.allclose(
        Velocity().target(z0, epsilon, t, LinearPath()), velocity_coefficients, atol=1e-5
    )


# Samplers


@pytest.mark.parametrize(("length", "steps"), [(1000, 1000), (1000, 50), (50, 50)])
def test_mdms_ancestral_sampling_against_diffusers(length: int, steps: int) -> None:
    """The model_output is a clean sample; the last step returns it as it is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diffusers = pytest.importorskip("diffusers")
    foreign = diffusers.DDPMScheduler(
        num_train_timesteps=length,
        beta_schedule="squaredcos_cap_v2",
        prediction_type="sample",
        clip_sample=False,
    )
    foreign.set_timesteps(steps)
    ours = sampler_named("ddpm", Cosine(length))
    theirs, z = torch.from_numpy(normal(0)), normal(0)
    seed, same_seed = torch.Generator().manual_seed(5), torch.Generator().manual_seed(5)
    for t, s in pairwise(ours.schedule.timesteps(steps).tolist()):
        theirs = foreign.step(toy_network(theirs, t), int(t), theirs, generator=seed).prev_sample
        draw = lambda shape: torch.randn(shape, generator=same_seed).numpy()  # noqa: E731
        output = toy_network(z, t)
        z = ours.step(Sample().to_x0_eps(output, z, t, ours.schedule), z, t, s, draw)
    assert np.abs(z - theirs.numpy()).max() < 2e-3 * np.abs(z).max()
    assert np.allclose(z, output, atol=1e-5)


def foreign_scheduler(kind: str, parametrization: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diffusers = pytest.importorskip("diffusers")
    betas = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"}
    common = {**betas, "clip_sample": False, "prediction_type": parametrization}
    if kind == "ddim":
        return diffusers.DDIMScheduler(**common, set_alpha_to_one=False, steps_offset=1)
    return diffusers.DDPMScheduler(**common, variance_type="fixed_small")


def toy_network(z: Any, t: Any) -> Any:
    return 0.3 * z + 0.1 * t / 1000 - 0.05


@pytest.mark.parametrize("name", FOREIGN_NAMES)
def test_ddim_against_diffusers(name: str) -> None:
    foreign, ours = foreign_scheduler("ddim", name), DDIM(ScaledLinear())
    foreign.set_timesteps(50)
    theirs, z = torch.from_numpy(normal(0)), normal(0)
    for t, s in pairwise(ours.schedule.timesteps(50).tolist()):
        theirs = foreign.step(toy_network(theirs, t), int(t), theirs).prev_sample
        estimates = FOREIGN_NAMES[name].to_x0_eps(toy_network(z, t), z, t, ours.schedule)
        z = ours.step(estimates, z, t, s, np.zeros)
    assert np.abs(z - theirs.numpy()).max() < 1e-4 * np.abs(z).max()


@pytest.mark.parametrize(
    ("name", "steps"), [*((name, 50) for name in FOREIGN_NAMES), ("epsilon", 1000)]
)
def test_ddpm_against_diffusers(name: str, steps: int) -> None:
    foreign = foreign_scheduler("ddpm", name)
    ours = DDPM(ScaledLinear(offset=0, ends_clean=True))
    foreign.set_timesteps(steps)
    theirs, z = torch.from_numpy(normal(0)), normal(0)
    seed, same_seed = torch.Generator().manual_seed(5), torch.Generator().manual_seed(5)
    for t, s in pairwise(ours.schedule.timesteps(steps).tolist()):
        theirs = foreign.step(toy_network(theirs, t), int(t), theirs, generator=seed).prev_sample
        draw = lambda shape: torch.randn(shape, generator=same_seed).numpy()  # noqa: E731
        estimates = FOREIGN_NAMES[name].to_x0_eps(toy_network(z, t), z, t, ours.schedule)
        z = ours.step(estimates, z, t, s, draw)
    assert np.abs(z - theirs.numpy()).max() < 2e-3 * np.abs(z).max()


def every_sampler() -> list[tuple[Sampler, Parametrization]]:
    return [
        (make(schedule), parametrization)
        for make in (DDIM, DDPM, Heun, DPMSolver)
        for schedule in SCHEDULES
        for parametrization in PREDICTIONS
        # The straight line starts without any signal, where noise alone tells nothing of z_0.
        if not (isinstance(schedule, LinearPath) and isinstance(parametrization, Epsilon))
    ]


@pytest.mark.parametrize(("sampler", "parametrization"), every_sampler(), ids=str)
def test_a_known_point_is_hit_exactly(sampler: Any, parametrization: Parametrization) -> None:
    point, noise = normal(3), normal(4)
    before = noise.copy()
    denoiser = parametrized(KnownPoint, point, sampler.schedule, parametrization)
    draws = np.random.default_rng(0)
    found = sample(denoiser, sampler, noise, NOBODY, MASK, 20, draws.standard_normal)
    left = sampler.schedule.sigma(float(sampler.schedule.timesteps(20)[-1]))
    assert np.abs(found - point).max() < 5 * left + 1e-3
    assert np.array_equal(noise, before)


@pytest.mark.parametrize(("sampler", "parametrization"), every_sampler()[:6], ids=str)
def test_torch_and_numpy_agree_and_a_seed_repeats(
    sampler: Any, parametrization: Parametrization
) -> None:
    results = []
    for array in (np.asarray, np.asarray, torch.from_numpy):
        denoiser = parametrized(KnownGaussian, array(normal(3)), sampler.schedule, parametrization)
        draw = np.random.default_rng(1).standard_normal
        results.append(sample(denoiser, sampler, array(normal(4)), NOBODY, MASK, 20, draw))
    assert np.array_equal(results[0], results[1])
    assert isinstance(results[2], torch.Tensor)
    assert np.allclose(results[0], results[2], atol=1e-4)


class Smooth(Cosine):
    """A squared cosine at any time: discrete times are too few to see an order."""

    def alpha(self, t: Any) -> Any:
        return np.cos(np.pi / 2 * t)

    def sigma(self, t: Any) -> Any:
        return np.sin(np.pi / 2 * t)

    def timesteps(self, steps: int) -> np.ndarray:
        """Equal steps of log(alpha / sigma), for which multistep solvers are made."""
        return np.arctan(np.exp(-np.linspace(-4, 4, steps + 1))) * 2 / np.pi


def error_of(sampler: Sampler, parametrization: Parametrization, steps: int) -> float:
    """(z_t - alpha m) / sqrt(alpha² s² + sigma²) is constant along the flow of a Gaussian."""
    schedule = sampler.schedule
    point, noise = normal(3).astype(float), normal(4).astype(float)
    denoiser = parametrized(KnownGaussian, point, schedule, parametrization)

    def scale(t: float) -> float:
        return (schedule.alpha(t) ** 2 * KnownGaussian.spread**2 + schedule.sigma(t) ** 2) ** 0.5

    first, *_, last = schedule.timesteps(steps).tolist()
    found = sample(denoiser, sampler, noise, NOBODY, MASK, steps, unused)
    along = (noise - schedule.alpha(first) * point) / scale(first)
    exact = schedule.alpha(last) * point + scale(last) * along
    return float(np.abs(found - exact).max())


@pytest.mark.parametrize(("make", "order"), [(DDIM, 1), (Heun, 2), (DPMSolver, 2)])
@pytest.mark.parametrize("parametrization", PREDICTIONS)
@pytest.mark.parametrize("schedule", [Smooth(), LinearPath()])
def test_errors_fall_by_the_order(
    make: Any, order: int, parametrization: Parametrization, schedule: Schedule
) -> None:
    if isinstance(schedule, LinearPath) and isinstance(parametrization, Epsilon):
        pytest.skip("the straight line starts without any signal")
    errors = [error_of(make(schedule), parametrization, steps) for steps in (40, 80, 160)]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    # Equal steps of the line are unequal ones of log(alpha / sigma): there a multistep solver
    # comes to its order late.
    least = 1.4 if (make, schedule) == (DPMSolver, LinearPath()) else order - 0.25
    assert errors[0] < 0.15
    assert ((slopes > least) & (slopes < order + 0.35)).all(), slopes


@pytest.mark.parametrize("parametrization", PREDICTIONS)
@pytest.mark.parametrize("schedule", [ScaledLinear(), Cosine()])
def test_heun_is_nearer_with_half_the_steps(
    schedule: Schedule, parametrization: Parametrization
) -> None:
    assert (
        error_of(Heun(schedule), parametrization, 10)
        < error_of(DDIM(schedule), parametrization, 20) / 3
    )


def test_ddpm_draws_from_a_gaussian() -> None:
    sampler = DDPM(ScaledLinear(offset=0, ends_clean=True))
    denoiser = parametrized(KnownGaussian, np.float32(1.0), sampler.schedule, Sample())
    shape = (20_000, 1, 1)
    condition = Conditioning(np.zeros(shape, np.float32), np.ones(shape[:2], bool))
    draw = np.random.default_rng(0).standard_normal
    found = sample(denoiser, sampler, normal(0, shape), condition, condition.mask, 500, draw)
    assert abs(found.mean() - 1) < 0.015
    assert abs(found.std() - KnownGaussian.spread) < 0.015


def test_ddim_on_the_line_is_eulers_method() -> None:
    sampler = DDIM(LinearPath())
    z, velocity = normal(0), normal(1)
    euler = z + (0.6 - 0.7) * velocity
    estimates = Velocity().to_x0_eps(velocity, z, 0.7, LinearPath())
    assert np.allclose(sampler.step(estimates, z, 0.7, 0.6, unused), euler, atol=1e-6)
    assert sampler_named("euler", LinearPath()) == sampler


@pytest.mark.parametrize("parametrization", PREDICTIONS)
def test_the_first_multistep_is_ddims(parametrization: Parametrization) -> None:
    for schedule in (ScaledLinear(), Cosine()):
        one, other = (
            sample(
                ParametrizedDenoiser(lambda z, *_: toy_network(z, 0), parametrization, schedule),
                make(schedule),
                normal(0),
                NOBODY,
                MASK,
                1,
                unused,
            )
            for make in (DDIM, DPMSolver)
        )
        assert np.allclose(one, other, atol=1e-4)


# Guidance


def echo(z: Any, t: Any, condition: Conditioning, mask: Any) -> Any:
    """A denoiser whose model_output is the sum of the real words."""
    words = (condition.tokens * condition.mask[..., None]).sum(1)
    return z * 0 + words[:, None, :1]


def words(*rows: list[float]) -> Conditioning:
    tokens = np.array(rows, np.float32)[..., None]
    return Conditioning(tokens, np.ones(tokens.shape[:2], bool))


@pytest.mark.parametrize("array", [np.asarray, torch.from_numpy])
def test_guidance_goes_past_the_condition(array: Any) -> None:
    def on(condition: Conditioning) -> Conditioning:
        return Conditioning(array(condition.tokens), array(condition.mask))

    z, t, mask = array(normal(0, (2, 3, 1))), array(np.ones(2, np.float32)), array(MASK[:2, :3])
    guided = ClassifierFreeGuidance(echo, on(words([2.0])), 3.0)
    output = guided(z, t, on(words([5.0, 6.0], [1.0, 1.0])), mask)
    assert np.allclose(output[:, 0, 0], [2 + 3 * (11 - 2), 2 + 3 * (2 - 2)])
    plain = ClassifierFreeGuidance(echo, on(words([2.0])), 1.0)
    assert np.allclose(plain(z, t, on(words([5.0], [1.0])), mask)[:, 0, 0], [5, 1])


def test_dropped_conditions_become_the_null() -> None:
    null, condition = words([7.0, 8.0, 9.0]), words([1.0], [2.0])
    dropped = drop(condition, null, np.array([False, True]))
    assert dropped.tokens[..., 0].tolist() == [[1, 0, 0], [7, 8, 9]]
    assert dropped.mask.tolist() == [[True, False, False], [True, True, True]]


@pytest.mark.parametrize("array", [np.asarray, torch.from_numpy])
def test_projected_guidance_moves_across_the_latents_and_at_middle_times_alone(array: Any) -> None:
    mask = np.ones((3, 4), bool)
    mask[:, 3] = False
    z, times = normal(1, (3, 4, 2)), np.array([0.5, 0.99, 0.6], np.float32)
    answers = normal(2, (2, 3, 4, 2)) * mask[..., None]  # without and with the condition

    def denoiser(*_: Any) -> Any:
        return array(answers.reshape(6, 4, 2))

    null, condition = (
        Conditioning(array(np.zeros((rows, 1, 1), np.float32)), array(np.ones((rows, 1), bool)))
        for rows in (1, 3)
    )
    inputs = array(z), array(times), condition, array(mask)
    settings = ParametrizedDenoiser(denoiser, Velocity(), LinearPath()), null, 3.0
    moved = np.asarray(guided("projected", *settings).denoiser(*inputs)) - answers[1]
    clean = (z - times[:, None, None] * answers[1]) * mask[..., None]
    difference = answers[1] - answers[0]
    along = (difference * clean).sum(axis=(1, 2)) / (clean**2).sum(axis=(1, 2))
    expected = 2 * (difference - along[:, None, None] * clean)
    assert np.allclose(moved[[0, 2]], expected[[0, 2]], atol=1e-5)
    assert np.abs((moved * clean).sum(axis=(1, 2))).max() < 1e-4
    assert np.allclose(moved[1], 0)  # so near to the noise it does not act
    plain = np.asarray(guided("classifier_free", *settings).denoiser(*inputs))
    assert np.allclose(plain, answers[0] + 3 * difference, atol=1e-5)
