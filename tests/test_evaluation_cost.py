"""FLOPs, parameters and seconds against counts by hand."""

from __future__ import annotations

import time

import pytest
import torch
from torch import nn

from latentmotion.condition.interface import Conditioning
from latentmotion.evaluation.metrics.aits import aits
from latentmotion.evaluation.metrics.flops import flops, thop_macs
from latentmotion.evaluation.metrics.parameters import parameters
from latentmotion.nn.attention import SelfAttention
from latentmotion.presets.mld_humanml3d import mld_humanml3d


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
    """26.38 million (spec 1); the authors keep a table of places, `mem_pos`, that nothing uses."""
    experiment = mld_humanml3d()
    vae, denoiser = experiment.vae.build(), experiment.denoiser.build()
    assert parameters(vae) == 18_032_135
    assert 8_349_184 - parameters(denoiser) in (0, 500 * 256)


def test_thop_of_a_step_and_of_the_decoder_are_those_of_the_paper() -> None:
    """From table 5, spec 11.5: 33.11 - 29.86 G for 50 steps more, two to a multiply-add."""
    experiment = mld_humanml3d()
    vae, denoiser = experiment.vae.build().eval(), experiment.denoiser.build().eval()
    z, mask = torch.zeros(2, 1, 256), torch.ones(2, 1, dtype=torch.bool)
    words = Conditioning(torch.zeros(2, 1, 768), mask)
    step = thop_macs(denoiser, lambda: denoiser(z, torch.tensor(1.0), words, mask))
    assert 2 * 50 * step / 1e9 == pytest.approx(33.11 - 29.86, abs=0.01)
    frames = torch.ones(1, 40, dtype=torch.bool)
    decoded = thop_macs(vae, lambda: vae.decode(z[:1], frames))
    clip = 2 * (77 * 12 * 12 * 768**2 + 25 * 4 * 77 * 768 + 768**2)
    assert (50 * step + decoded + clip) / 1e9 == pytest.approx(14.931, rel=2e-3)


def test_seconds_are_of_the_warm_ones_on_average() -> None:
    calls: list[float] = []

    def action() -> None:
        time.sleep(0.2 if len(calls) < 2 else 0.01)
        calls.append(0)

    assert 0.01 <= aits([action] * 4, warm_up=2) < 0.1
    assert len(calls) == 6
