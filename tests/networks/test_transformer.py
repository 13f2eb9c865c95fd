"""Transformer blocks: PyTorch's own layers as the oracle, and the symmetries of attention."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.model.config import TransformerConfig
from latentmotion.networks.transformer import (
    CrossAttention,
    DecoderLayer,
    Dropout,
    EncoderLayer,
    LearnedPosition,
    SelfAttention,
    SinePosition,
    layer_stack,
    sine_rate,
    sines,
)

WIDTH, HEADS, TOKENS = 8, 2, 5
CONFIG = TransformerConfig(width=WIDTH, layers=3, heads=HEADS, hidden=12, dropout=0.0)
MASK = torch.arange(TOKENS) < torch.tensor([5, 3, 1])[:, None]
EVERYWHERE = torch.ones(3, TOKENS, dtype=torch.bool)


def tokens(count: int = TOKENS, seed: int = 0) -> Tensor:
    return torch.randn(3, count, WIDTH, generator=torch.Generator().manual_seed(seed))


def shaken(network: nn.Module) -> nn.Module:
    """Random weights everywhere, biases and norms too, so that none is nothing by accident."""
    torch.manual_seed(1)
    for weight in network.parameters():
        nn.init.normal_(weight, std=0.4)
    return network.eval()


def theirs(ours: SelfAttention) -> nn.MultiheadAttention:
    attention = nn.MultiheadAttention(WIDTH, HEADS, batch_first=True).eval()
    attention.in_proj_weight.data = ours.query_key_value.weight.data
    attention.in_proj_bias.data = ours.query_key_value.bias.data
    attention.out_proj.load_state_dict(ours.output.state_dict())
    return attention


@pytest.mark.parametrize("mask", [EVERYWHERE, MASK], ids=["whole", "padded"])
def test_self_attention_is_pytorchs(mask: Tensor) -> None:
    ours, x = shaken(SelfAttention(WIDTH, HEADS, 0.0)), tokens()
    assert isinstance(ours, SelfAttention)
    expected, _ = theirs(ours)(x, x, x, key_padding_mask=~mask)
    torch.testing.assert_close(ours(x, mask), expected, atol=1e-5, rtol=1e-5)


def test_gradients_in_bfloat16_are_those_in_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds: list[torch.dtype] = []
    attend = functional.scaled_dot_product_attention

    def watched(q: Tensor, *others: Tensor, **settings: Any) -> Tensor:
        kinds.append(q.dtype)
        return attend(q, *others, **settings)

    monkeypatch.setattr(functional, "scaled_dot_product_attention", watched)
    attention = shaken(SelfAttention(WIDTH, HEADS, 0.0))
    gradients: list[Tensor] = []
    for halved in (False, True):
        x = tokens().requires_grad_()
        with torch.autocast("cpu", torch.bfloat16, enabled=halved):
            found = attention(x, MASK)
        assert found.dtype == (torch.bfloat16 if halved else torch.float32)
        found.float().square().sum().backward()
        assert x.grad is not None
        gradients.append(x.grad)
    assert kinds == [torch.float32] * 2  # the slow kernel is not met
    whole, half = gradients
    assert (whole - half).norm() < 0.03 * whole.norm()
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        attention(tokens(), MASK)
    assert kinds[-1] == torch.bfloat16


@pytest.mark.parametrize("words", [1, 4])
def test_cross_attention_is_pytorchs(words: int) -> None:
    """With one word too, where no softmax is taken."""
    ours = shaken(CrossAttention(WIDTH, HEADS, 0.0))
    assert isinstance(ours, CrossAttention)
    attention = nn.MultiheadAttention(WIDTH, HEADS, batch_first=True).eval()
    attention.in_proj_weight.data = torch.cat([ours.query.weight, ours.key_value.weight]).data
    attention.in_proj_bias.data = torch.cat([ours.query.bias, ours.key_value.bias]).data
    attention.out_proj.load_state_dict(ours.output.state_dict())
    x, memory = tokens(), tokens(words, seed=2)
    mask = torch.arange(words) < torch.tensor([words, 1, max(words - 1, 1)])[:, None]
    expected, _ = attention(x, memory, memory, key_padding_mask=~mask)
    torch.testing.assert_close(ours(x, memory, mask), expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("norm", ["post", "pre"])
@pytest.mark.parametrize("activation", ["gelu", "relu"])
def test_a_layer_is_pytorchs(norm: str, activation: str) -> None:
    config = replace(CONFIG, norm=norm, activation=activation)
    ours = shaken(layer_stack(replace(config, layers=1, skips=False), EncoderLayer)).layers[0]  # type: ignore[index]
    layer = nn.TransformerEncoderLayer(
        WIDTH, HEADS, config.hidden, 0.0, activation, batch_first=True, norm_first=norm == "pre"
    ).eval()
    assert isinstance(ours, EncoderLayer)
    layer.self_attn = theirs(ours.attention)
    layer.linear1.load_state_dict(ours.feed_forward[0].state_dict())
    layer.linear2.load_state_dict(ours.feed_forward[3].state_dict())
    layer.norm1.load_state_dict(ours.around_attention.norm.state_dict())
    layer.norm2.load_state_dict(ours.around_feed_forward.norm.state_dict())
    x = tokens()
    expected = layer(x, src_key_padding_mask=~MASK)
    torch.testing.assert_close(ours(x, MASK)[MASK], expected[MASK], atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("skips", [True, False])
def test_tokens_in_another_order_give_the_same_in_that_order(skips: bool) -> None:
    stack = shaken(layer_stack(replace(CONFIG, skips=skips), EncoderLayer))
    order, x = torch.tensor([3, 0, 4, 1, 2]), tokens()
    torch.testing.assert_close(
        stack(x, EVERYWHERE)[:, order], stack(x[:, order], EVERYWHERE), atol=1e-5, rtol=1e-5
    )


@pytest.mark.parametrize("skips", [True, False])
def test_the_memory_has_no_order_and_its_padding_no_weight(skips: bool) -> None:
    stack, memory = (
        shaken(layer_stack(replace(CONFIG, skips=skips), DecoderLayer)),
        tokens(4, seed=2),
    )
    mask = torch.tensor([True, True, True, False]).expand(3, 4)
    order, x = torch.tensor([2, 0, 1, 3]), tokens()
    expected = stack(x, EVERYWHERE, memory, mask)
    found = stack(x, EVERYWHERE, memory[:, order], mask)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)
    changed = memory.clone()
    changed[:, 3] = 100.0
    assert torch.equal(stack(x, EVERYWHERE, changed, mask), expected)


def test_without_joins_a_stack_of_skips_is_a_plain_one() -> None:
    """A join that passes its first half on leaves the layers one after the other."""
    skipping, plain = (
        shaken(layer_stack(CONFIG, EncoderLayer)),
        shaken(layer_stack(replace(CONFIG, skips=False), EncoderLayer)),
    )
    for join in skipping.joins:  # type: ignore[union-attr]
        join.weight.data = torch.eye(WIDTH, 2 * WIDTH)
        join.bias.data.zero_()
    layers = [*skipping.first, skipping.middle, *skipping.last]  # type: ignore[misc]
    for ours, other in zip(layers, plain.layers, strict=True):  # type: ignore[arg-type]
        other.load_state_dict(ours.state_dict())
    plain.norm.load_state_dict(skipping.norm.state_dict())
    x = tokens()
    torch.testing.assert_close(skipping(x, MASK), plain(x, MASK))


@pytest.mark.parametrize("layers", [2, 4])
def test_an_even_number_of_layers_has_no_middle(layers: int) -> None:
    with pytest.raises(InputError, match="odd number"):
        layer_stack(replace(CONFIG, layers=layers), EncoderLayer)


@pytest.mark.parametrize("position", [LearnedPosition(WIDTH), SinePosition(WIDTH, 0.0)])
def test_positions_that_start_later_are_those_of_later_tokens(position: nn.Module) -> None:
    x = tokens()
    later = position(x[:, 2:], start=2)
    torch.testing.assert_close(later, position(x)[:, 2:])


def test_a_shift_turns_every_pair_of_sines_by_the_same_angle() -> None:
    rate = sine_rate(WIDTH)
    start = sines(torch.arange(6), rate).unflatten(1, (-1, 2))
    later = sines(torch.arange(6) + 3, rate).unflatten(1, (-1, 2))
    sine, cosine = torch.sin(3 * rate), torch.cos(3 * rate)
    expected = torch.stack(
        [
            start[..., 0] * cosine + start[..., 1] * sine,
            start[..., 1] * cosine - start[..., 0] * sine,
        ],
        dim=-1,
    )
    torch.testing.assert_close(later, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_dropout_drops_its_share_and_only_in_training(share: float) -> None:
    torch.manual_seed(0)
    dropout, x = Dropout(share), torch.ones(301, 333)
    dropped = dropout.train()(x)
    assert float((dropped == 0).float().mean()) == pytest.approx(share, abs=0.01)
    kept = dropped[dropped != 0]
    torch.testing.assert_close(kept, torch.full_like(kept, 1 / (1 - share)))
    assert dropout.eval()(x) is x
