"""FLOPs, parameters and seconds against counts by hand."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from benchmarks.generation.roofline import Traffic, traffic
from latentmotion.diffusion.condition import Conditioning
from latentmotion.evaluation.cost import aits, flops, parameters
from latentmotion.networks.checkpoint import build
from latentmotion.networks.transformer import (
    CrossAttention,
    EncoderLayer,
    SelfAttention,
    layer_stack,
)
from latentmotion.training.experiment import preset_named

THOP_NORM = 4  # Operations that THOP counts for a number that a norm with weights returns.

# Modules in place of the authors' `nn.MultiheadAttention`, which THOP does not know.
_UNKNOWN_TO_THOP = (SelfAttention, CrossAttention)


def thop_macs(network: nn.Module, action: Callable[[], object]) -> int:
    """Returns the multiply-adds that THOP would count of a network while an action runs."""
    total = 0

    def count(module: nn.Module, _: object, output: Tensor) -> None:
        nonlocal total
        if isinstance(module, nn.Linear):
            total += output.numel() * module.in_features
        elif isinstance(module, nn.Conv1d):
            inputs = module.in_channels // module.groups
            total += output.numel() * inputs * module.kernel_size[0]
        else:
            total += output.numel() * THOP_NORM

    with ExitStack() as stack:
        for module in _counted(network):
            stack.callback(module.register_forward_hook(count).remove)
        with torch.no_grad():
            action()
    return total


def _counted(network: nn.Module) -> Iterator[nn.Module]:
    """Yields the modules that THOP counts."""
    if isinstance(network, (nn.Linear, nn.LayerNorm, nn.Conv1d)):
        yield network
    for child in network.children():
        if not isinstance(child, _UNKNOWN_TO_THOP):
            yield from _counted(child)


def test_flops_of_a_linear_layer_and_of_attention() -> None:
    linear, attention = nn.Linear(8, 16), SelfAttention(8, 2, 0.0).eval()
    x, mask = torch.ones(3, 5, 8), torch.ones(3, 5, dtype=torch.bool)
    assert flops(lambda: linear(x)) == 2 * 3 * 5 * 8 * 16
    products = 3 * 5 * 8 * (24 + 8) + 2 * 3 * 5 * 5 * 8
    assert flops(lambda: attention(x, mask)) == 2 * products


def test_thop_sees_nothing_inside_attention() -> None:
    network = nn.ModuleList([SelfAttention(8, 2, 0.0), nn.Linear(8, 16), nn.LayerNorm(8)])
    x, mask = torch.ones(3, 5, 8), torch.ones(3, 5, dtype=torch.bool)

    def run() -> None:
        network[1](network[2](network[0](x, mask)))

    assert thop_macs(network, run) == 3 * 5 * 8 * 16 + 4 * 3 * 5 * 8


def test_parameters_are_those_of_the_paper() -> None:
    """26.38 million (mld.md §1); the authors keep positions, `mem_pos`, that nothing uses."""
    experiment = preset_named("mld_humanml3d")
    vae, denoiser = build(experiment.vae), build(experiment.denoiser)
    assert parameters(vae) == 18_032_135
    assert 8_349_184 - parameters(denoiser) in (0, 500 * 256)


def test_thop_of_a_step_and_of_the_decoder_are_those_of_the_paper() -> None:
    """From table 5 (mld.md §11): 33.11 - 29.86 G for 50 steps more, two to a multiply-add."""
    experiment = preset_named("mld_humanml3d")
    vae, denoiser = build(experiment.vae).eval(), build(experiment.denoiser).eval()
    z, mask = torch.zeros(2, 1, 256), torch.ones(2, 1, dtype=torch.bool)
    words = Conditioning(torch.zeros(2, 1, 768), mask)
    step = thop_macs(denoiser, lambda: denoiser(z, torch.tensor(1.0), words, mask))
    assert 2 * 50 * step / 1e9 == pytest.approx(33.11 - 29.86, abs=0.01)
    frames = torch.ones(1, 40, dtype=torch.bool)
    decoded = thop_macs(vae, lambda: vae.decode(z[:1], frames))
    clip = 2 * (77 * 12 * 12 * 768**2 + 25 * 4 * 77 * 768 + 768**2)
    assert (50 * step + decoded + clip) / 1e9 == pytest.approx(14.931, rel=2e-3)


def test_seconds_are_of_the_warm_ones_on_average(monkeypatch: pytest.MonkeyPatch) -> None:
    durations = iter([100.0, 200.0, 1.0, 2.0, 3.0, 6.0])
    now = 0.0

    def action() -> None:
        nonlocal now
        now += next(durations)

    monkeypatch.setattr(time, "perf_counter", lambda: now)
    assert aits([action] * 4, warm_up=2) == 3.0
    assert next(durations, None) is None
    durations = iter([5.0, 7.0])
    assert aits([action] * 2, warm_up=0, clock=lambda: 2 * now) == 12.0


def test_bytes_of_a_linear_layer_of_attention_and_of_a_convolution() -> None:
    linear, attention = nn.Linear(8, 16), SelfAttention(8, 2, 0.0).eval()
    x, mask = torch.randn(3, 5, 8), torch.ones(3, 5, dtype=torch.bool)
    found = traffic(linear, lambda: linear(x))
    assert found == Traffic(weights=4 * (8 * 16 + 16), activations=4 * 3 * 5 * (8 + 16))
    found = traffic(attention, lambda: attention(x, mask))
    assert found.weights == 4 * (8 * 24 + 24 + 8 * 8 + 8)
    # Into the projections and out of them, queries, keys and values in and their mean out.
    numbers = 3 * 5 * ((8 + 24) + 4 * 8 + (8 + 8))
    # The kernel takes the mask as numbers.
    assert found.activations == 4 * (numbers + 3 * 5)
    convolution = nn.Conv1d(8, 16, 3, padding=1)
    found = traffic(convolution, lambda: convolution(x.transpose(1, 2)))
    assert found == Traffic(weights=4 * (8 * 16 * 3 + 16), activations=4 * 3 * 5 * (8 + 16))
    assert found.total == 4 * (8 * 16 * 3 + 16 + 3 * 5 * (8 + 16))


def test_flops_of_a_layer_of_the_starters_denoiser_by_hand() -> None:
    config, rows, tokens = preset_named("starter").denoiser.transformer, 2, 37
    stack = layer_stack(
        replace(config, layers=1, skips=False, final_norm=False), EncoderLayer
    ).eval()
    x = torch.ones(rows, tokens, config.width)
    # Queries, keys, values and output; both maps of the feed-forward part; scores and means.
    weights = 4 * config.width**2 + 2 * config.width * config.hidden
    products = tokens * weights + 2 * tokens**2 * config.width
    assert flops(lambda: stack(x, torch.ones(rows, tokens, dtype=torch.bool))) == (
        2 * rows * products
    )
