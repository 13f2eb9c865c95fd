"""What every denoiser is held to (architecture, section 4), and the dropout inside."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor

from latentmotion.diffusion.condition import Conditioning
from latentmotion.model.config import DenoiserConfig, TransformerConfig
from latentmotion.networks.checkpoint import build
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.transformer import Dropout, NumberEmbedding, sinusoid
from latentmotion.training.experiment import preset_named

SMALL = TransformerConfig(width=32, layers=3, heads=2, hidden=48)
OURS = DenoiserConfig(latent_width=6, condition_width=10, transformer=SMALL, sine_width=12)
PAPER = dataclasses.replace(
    OURS,
    latent_width=32,
    project_latents=False,
    condition_projection="relu_linear",
    positions="latents_first",
)
NO_SKIPS = dataclasses.replace(SMALL, skips=False)

EXACT_UNDER_PADDING = {
    "ours": OURS,
    "length token": dataclasses.replace(OURS, length_token=True, time_scale=1000.0),
    "cross": dataclasses.replace(OURS, attention="cross", transformer=NO_SKIPS),
    "sine": dataclasses.replace(OURS, position="sine"),
    "words added to time": dataclasses.replace(
        OURS, words="added_to_time", positions="context_first", transformer=NO_SKIPS
    ),
}
CONFIGS = {
    **EXACT_UNDER_PADDING,
    "paper": PAPER,
    "unit scale": dataclasses.replace(PAPER, condition_projection="standardized"),
    "labels": dataclasses.replace(PAPER, condition_projection="table"),
    "plain condition": dataclasses.replace(PAPER, condition_projection="none", condition_width=32),
    "raw frames": dataclasses.replace(OURS, positions="context_first", attends_to_padding=True),
}


def called(name: str) -> tuple[DenoiserNetwork, Tensor, Tensor, Conditioning, Tensor]:
    """Returns a network and what it is called with: z, t, condition, mask."""
    torch.manual_seed(0)
    config = CONFIGS[name]
    network = build(config).eval()
    z = torch.randn(3, 7, config.latent_width)
    t = torch.tensor([0.1, 0.5, 0.9]) * 1000 / config.time_scale
    words = torch.arange(4) < torch.tensor([2, 4, 1])[:, None]
    condition = Conditioning(torch.randn(3, 4, config.condition_width), words)
    return network, z, t, condition, torch.arange(7) < torch.tensor([7, 3, 5])[:, None]


@torch.no_grad()
@pytest.mark.parametrize("name", CONFIGS)
def test_a_scalar_time_is_a_vector_of_equal_times(name: str) -> None:
    network, z, t, condition, mask = called(name)
    scalar = network(z, t[1], condition, mask)
    assert torch.equal(scalar, network(z, t[1].expand(3), condition, mask))
    assert not torch.allclose(scalar, network(z, t, condition, mask))


@pytest.mark.parametrize("name", CONFIGS)
def test_gradient_reaches_every_parameter(name: str) -> None:
    network, z, t, condition, mask = called(name)
    network(z, t, condition, mask).square().sum().backward()
    assert all(parameter.grad is not None for parameter in network.parameters())


@torch.no_grad()
@pytest.mark.parametrize("name", EXACT_UNDER_PADDING)
def test_padding_changes_nothing(name: str) -> None:
    network, z, t, condition, mask = called(name)
    output = network(z, t, condition, mask)
    for i in range(3):
        row, real, words = slice(i, i + 1), int(mask[i].sum()), int(condition.mask[i].sum())
        short = Conditioning(condition.tokens[row, :words], condition.mask[row, :words])
        alone = network(z[row, :real], t[row], short, mask[row, :real])
        assert torch.allclose(alone, output[row, :real], atol=1e-5)
        assert output[i, real:].abs().sum() == 0


@torch.no_grad()
def test_the_length_token_tells_the_length() -> None:
    network, _, t, _, mask = called("length token")
    numbers = network.numbers(t, mask)
    assert numbers.shape[1] == 2
    assert not torch.allclose(numbers[0, 1], numbers[1, 1])


def test_the_paper_has_8_million_weights() -> None:
    paper = dataclasses.replace(
        PAPER,
        latent_width=256,
        condition_width=768,
        transformer=TransformerConfig(),
        sine_width=768,
    )
    count = sum(parameter.numel() for parameter in build(paper).parameters())
    unused = 500 * 256  # positions of a memory that only cross-attention has
    assert count == 8_349_184 - unused


def test_mdm_has_17_9_million_weights() -> None:
    network = build(preset_named("mdm").denoiser)
    assert sum(parameter.numel() for parameter in network.parameters()) == 17_880_327


@torch.no_grad()
def test_words_are_added_to_the_time_as_their_mean() -> None:
    network, z, t, condition, mask = called("words added to time")
    pairs = zip(condition.tokens, condition.mask, strict=True)
    means = torch.stack([row[real].mean(0) for row, real in pairs])
    one = Conditioning(means[:, None], torch.ones(3, 1, dtype=torch.bool))
    output = network(z, t, condition, mask)
    assert torch.allclose(output, network(z, t, one, mask), atol=1e-5)
    nothing = Conditioning(condition.tokens[:, :0], condition.mask[:, :0])
    silent = network(z, t, nothing, mask)
    assert silent.isfinite().all() and not torch.allclose(silent, output)


def test_a_number_becomes_cosines_then_sines() -> None:
    angles = torch.tensor([3.0, 3.0 * 10_000**-0.5])
    expected = torch.cat([angles.cos(), angles.sin()])
    assert torch.allclose(sinusoid(torch.tensor([3.0]), 4)[0], expected)
    fine, coarse = NumberEmbedding(4, 6, scale=10.0), NumberEmbedding(4, 6)
    coarse.load_state_dict(fine.state_dict())
    assert torch.equal(fine(torch.tensor([0.3])), coarse(torch.tensor([3.0])))


def test_dropout_keeps_the_mean() -> None:
    torch.manual_seed(0)
    dropout, ones = Dropout(0.3), torch.ones(501, 333)
    dropped = dropout(ones)
    assert (dropped == 0).float().mean().item() == pytest.approx(0.3, abs=0.005)
    assert dropped.mean().item() == pytest.approx(1, abs=0.01)
    assert dropped.max().item() == pytest.approx(1 / 0.7)
    assert torch.equal(dropout.eval()(ones), ones)


def test_sentences_are_brought_to_unit_scale_as_the_training_prompts_have_it() -> None:
    network = build(CONFIGS["unit scale"])
    words = 0.01 * torch.randn(50, 10, generator=torch.Generator().manual_seed(0)) + 3
    words[:, 4] = 7  # a number that never changes must not become infinite
    network.measure_words(words)
    loaded = build(CONFIGS["unit scale"])
    loaded.load_state_dict(network.state_dict())
    scaled = loaded.condition_in[0](words)
    deviation, mean = torch.std_mean(scaled, dim=0, unbiased=False)
    assert torch.allclose(mean, torch.zeros(10), atol=1e-3)
    assert torch.allclose(deviation, (torch.arange(10) != 4).float(), atol=1e-3)
