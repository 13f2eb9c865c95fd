"""One step of either stage, against the paper's formulas written out plainly in float64.

At full size and under the authors' weight names: losses, gradients, and AdamW's update. Nothing of
the package but its converter of names is used to reach the expected numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from latentmotion.convert import reading
from latentmotion.convert.mld import Origin, load_denoiser, load_vae
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import Epsilon, Sample
from latentmotion.networks.vae.interface import vae_losses
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.denoiser_loss import DenoiserObjective, denoiser_loss
from latentmotion.training.experiment import TrainingSettings, preset_named
from latentmotion.training.loop import optimize
from tests.support.golden import formula, golden_input, prefix_mask
from tests.support.small_training import CONTEXT

WIDTH, HIDDEN, BLOCKS, HEADS, FEATURES, TEXT = 256, 1024, 4, 4, 263, 768
LENGTHS = [40, 64]
CLOSE = 1e-4
Weights = dict[str, Tensor]


def linear_shapes(name: str, outputs: int, inputs: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


def stack_shapes(stack: str, attentions: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
    """Nine layers with long skips, and a closing normalization."""
    shapes: dict[str, tuple[int, ...]] = {}
    sides = [f"{side}_blocks.{i}" for side in ("input", "output") for i in range(BLOCKS)]
    for block in (*sides, "middle_block"):
        layer = f"{stack}.{block}"
        for attention in attentions:
            shapes[f"{layer}.{attention}.in_proj_weight"] = (3 * WIDTH, WIDTH)
            shapes[f"{layer}.{attention}.in_proj_bias"] = (3 * WIDTH,)
            shapes |= linear_shapes(f"{layer}.{attention}.out_proj", WIDTH, WIDTH)
        shapes |= linear_shapes(f"{layer}.linear1", HIDDEN, WIDTH)
        shapes |= linear_shapes(f"{layer}.linear2", WIDTH, HIDDEN)
        for number in range(len(attentions) + 1):
            norm = f"{layer}.norm{number + 1}"
            shapes |= {f"{norm}.weight": (WIDTH,), f"{norm}.bias": (WIDTH,)}
    for i in range(BLOCKS):
        shapes |= linear_shapes(f"{stack}.linear_blocks.{i}", WIDTH, 2 * WIDTH)
    return shapes | {f"{stack}.norm.weight": (WIDTH,), f"{stack}.norm.bias": (WIDTH,)}


VAE_SHAPES = {
    "global_motion_token": (2, WIDTH),
    "query_pos_encoder.pe": (500, 1, WIDTH),
    "query_pos_decoder.pe": (500, 1, WIDTH),
    **linear_shapes("skel_embedding", WIDTH, FEATURES),
    **linear_shapes("final_layer", FEATURES, WIDTH),
    **stack_shapes("encoder", ("self_attn",)),
    **stack_shapes("decoder", ("self_attn", "multihead_attn")),
}
DENOISER_SHAPES = {
    "query_pos.pe": (500, 1, WIDTH),
    **linear_shapes("time_embedding.linear_1", WIDTH, TEXT),
    **linear_shapes("time_embedding.linear_2", WIDTH, WIDTH),
    **linear_shapes("emb_proj.1", WIDTH, TEXT),
    **stack_shapes("encoder", ("self_attn",)),
}


def drawn(part: str, shapes: dict[str, tuple[int, ...]]) -> Weights:
    return {name: torch.from_numpy(formula(part + name, shape)) for name, shape in shapes.items()}


@dataclass
class Plain:
    """The authors' networks by their formulas, batch first."""

    w: Weights

    def linear(self, x: Tensor, name: str) -> Tensor:
        return x @ self.w[f"{name}.weight"].T + self.w[f"{name}.bias"]

    def norm(self, x: Tensor, name: str) -> Tensor:
        centered = x - x.mean(-1, keepdim=True)
        scaled = centered / (centered.square().mean(-1, keepdim=True) + 1e-5).sqrt()
        return scaled * self.w[f"{name}.weight"] + self.w[f"{name}.bias"]

    def attention(self, queries: Tensor, keys: Tensor, mask: Tensor, name: str) -> Tensor:
        matrix, bias = self.w[f"{name}.in_proj_weight"], self.w[f"{name}.in_proj_bias"]
        projected = [
            (x @ part.T + b).unflatten(-1, (HEADS, -1)).transpose(1, 2)
            for x, part, b in zip(
                (queries, keys, keys), matrix.chunk(3), bias.chunk(3), strict=True
            )
        ]
        q, k, v = projected
        scores = q @ k.transpose(-1, -2) / math.sqrt(WIDTH / HEADS)
        scores = scores.masked_fill(~mask[:, None, None, :], -math.inf)
        mixed = scores.softmax(-1) @ v
        return self.linear(mixed.transpose(1, 2).flatten(2), f"{name}.out_proj")

    def layer(self, x: Tensor, mask: Tensor, memory: Tensor | None, name: str) -> Tensor:
        x = self.norm(x + self.attention(x, x, mask, f"{name}.self_attn"), f"{name}.norm1")
        last = "norm2"
        if memory is not None:
            every = torch.ones(memory.shape[:2], dtype=torch.bool)
            crossed = self.attention(x, memory, every, f"{name}.multihead_attn")
            x, last = self.norm(x + crossed, f"{name}.norm2"), "norm3"
        hidden = self.linear(x, f"{name}.linear1")
        hidden = hidden * 0.5 * (1 + torch.erf(hidden / math.sqrt(2)))
        return self.norm(x + self.linear(hidden, f"{name}.linear2"), f"{name}.{last}")

    def stack(self, x: Tensor, mask: Tensor, memory: Tensor | None, name: str) -> Tensor:
        kept = []
        for i in range(BLOCKS):
            x = self.layer(x, mask, memory, f"{name}.input_blocks.{i}")
            kept.append(x)
        x = self.layer(x, mask, memory, f"{name}.middle_block")
        for i in range(BLOCKS):
            x = self.linear(torch.cat([x, kept.pop()], -1), f"{name}.linear_blocks.{i}")
            x = self.layer(x, mask, memory, f"{name}.output_blocks.{i}")
        return self.norm(x, f"{name}.norm")

    def position(self, x: Tensor, name: str) -> Tensor:
        return x + self.w[f"{name}.pe"][: x.shape[1], 0]

    def vae(self, features: Tensor, mask: Tensor, noise: Tensor) -> tuple[Tensor, ...]:
        """Mean, logarithm of the variance, and rebuilt features."""
        count = len(features)
        tokens = self.w["global_motion_token"].expand(count, -1, -1)
        x = torch.cat([tokens, self.linear(features, "skel_embedding")], 1)
        seen = torch.cat([torch.ones(count, 2, dtype=torch.bool), mask], 1)
        x = self.stack(self.position(x, "query_pos_encoder"), seen, None, "encoder")
        mean, log_variance = x[:, :1], x[:, 1:2]
        z = mean + (log_variance / 2).exp() * noise
        queries = torch.zeros(count, features.shape[1], WIDTH, dtype=torch.float64)
        x = self.stack(self.position(queries, "query_pos_decoder"), mask, z, "decoder")
        return mean, log_variance, self.linear(x, "final_layer") * mask[..., None]

    def denoiser(self, z: Tensor, t: Tensor, text: Tensor) -> Tensor:
        rates = torch.exp(-math.log(10_000) * torch.arange(TEXT // 2) / (TEXT // 2)).double()
        angles = t[:, None] * rates
        time = self.linear(torch.cat([angles.cos(), angles.sin()], -1), "time_embedding.linear_1")
        time = self.linear(time / (1 + (-time).exp()), "time_embedding.linear_2")
        condition = self.linear(text.clamp(min=0), "emb_proj.1")
        x = self.position(torch.cat([z, time[:, None], condition], 1), "query_pos")
        every = torch.ones(x.shape[:2], dtype=torch.bool)
        return self.stack(x, every, None, "encoder")[:, :1]


def plain_joints(features: Tensor) -> Tensor:
    """HumanML3D's recovery of joints, from features that are not normalized."""

    def turned(vectors: Tensor, yaw: Tensor) -> Tensor:
        c, s = yaw.cos(), yaw.sin()
        x, y, z = vectors.unbind(-1)
        return torch.stack([c * x - s * z, y, s * x + c * z], -1)

    before = nn.functional.pad(features[:, :-1], (0, 0, 1, 0))
    yaw = 2 * before[..., 0].cumsum(1)
    step = torch.stack([before[..., 1], torch.zeros_like(yaw), before[..., 2]], -1)
    root = turned(step, yaw).cumsum(1)
    local = features[..., 4:67].unflatten(-1, (21, 3))
    around = turned(local, yaw[..., None]) + root[:, :, None]
    pelvis = torch.stack([root[..., 0], features[..., 3], root[..., 2]], -1)
    return torch.cat([pelvis[:, :, None], around], 2)


def smooth_l1(found: Tensor, true: Tensor) -> Tensor:
    error = (found - true).abs()
    return torch.where(error < 1, error.square() / 2, error - 0.5).mean()


def relative(found: Tensor, expected: Tensor) -> float:
    return float((found.double() - expected).norm() / expected.norm())


class OneLoss(nn.Module):
    """What the training loop optimizes: a network with a loss of its own."""

    def __init__(self, network: nn.Module, losses: Callable[[], dict[str, Tensor]]) -> None:
        super().__init__()
        self.network, self._losses = network, losses

    def forward(self, step: int) -> dict[str, Tensor]:
        return self._losses()


def step_taken(
    network: nn.Module, losses: Callable[[], dict[str, Tensor]], settings: TrainingSettings
) -> tuple[dict[str, Tensor], dict[str, Tensor], Weights]:
    """Losses and gradients of the loop's first step, and weights before it."""
    before = {name: value.detach().clone() for name, value in network.named_parameters()}
    optimizer = torch.optim.AdamW(
        network.parameters(), settings.learning_rate, weight_decay=settings.weight_decay
    )
    found = optimize(OneLoss(network, losses), optimizer, settings, 0, CONTEXT)
    gradients = {n: p.grad for n, p in network.named_parameters() if p.grad is not None}
    return found, gradients, before


def check_gradients(found: Weights, expected: Weights) -> None:
    """Each weight's gradient; that of a bias of keys is zero but for rounding, as softmax is."""
    assert set(found) == set(expected)
    largest = max(float(gradient.norm()) for gradient in expected.values())
    for name, gradient in expected.items():
        error = float((found[name].double() - gradient).norm())
        assert error < CLOSE * max(float(gradient.norm()), 1e-3 * largest), name


def check_update(network: nn.Module, before: Weights, gradients: Weights) -> None:
    """AdamW's first step: its averages are the gradient and its square."""
    moved = 0.0
    for name, weight in network.named_parameters():
        gradient = gradients[name].double()
        decayed = before[name].double() * (1 - 1e-4 * 0.01)
        expected = decayed - 1e-4 * gradient / (gradient.abs() + 1e-8)
        assert float((weight.detach().double() - expected).abs().max()) < 2e-7, name
        moved += float((weight.detach() - before[name]).square().sum())
    assert moved > 0


def as_double(weights: Weights) -> Weights:
    return {name: value.double().requires_grad_() for name, value in weights.items()}


def gradients_of(weights: Weights, loss: Tensor, rules: reading.Rules) -> Weights:
    found = torch.autograd.grad(loss, list(weights.values()))
    return reading.rename(dict(zip(weights, found, strict=True)), rules)


def test_a_step_of_stage_1() -> None:
    weights, mask = drawn("vae.", VAE_SHAPES), prefix_mask(LENGTHS, max(LENGTHS))
    features = golden_input("step_motion", (2, max(LENGTHS), FEATURES)) * mask[..., None]
    noise = golden_input("step_noise", (2, 1, WIDTH))
    mean, std = (0.1 * golden_input(f"step_{name}", (FEATURES,)) for name in ("mean", "std"))
    std = std.abs() + 0.01

    author = as_double(weights)
    mu, log_variance, rebuilt = Plain(author).vae(features.double(), mask, noise.double())
    both = [plain_joints(x * std.double() + mean.double()) for x in (rebuilt, features.double())]
    divergence = (log_variance.exp() + mu.square() - 1 - log_variance).mean() / 2
    losses = {
        "features": smooth_l1(rebuilt, features.double()),
        "joints": smooth_l1(*both),
        "kl": divergence,
    }
    total = losses["features"] + losses["joints"] + 1e-4 * losses["kl"]

    network, _ = load_vae(weights, Origin(dropout=0.0), "drawn")
    experiment = preset_named("mld_humanml3d")
    objective = replace(experiment.vae_objective, padded_means=True)
    found, gradients, before = step_taken(
        network,
        lambda: vae_losses(
            network,
            features,
            mask,
            lambda *shape: noise,
            lambda x: HUMANML3D_FEATURES.decode(x * std + mean),
            HUMANML3D_FEATURES.fps,
            objective,
        ),
        experiment.vae_training,
    )
    assert float(found["total"]) == pytest.approx(total.item(), rel=CLOSE)
    for name, loss in losses.items():
        assert float(found[name]) == pytest.approx(loss.item(), rel=CLOSE), name
    check_gradients(gradients, gradients_of(author, total, reading.rules_of("vae", "vae_cross")))
    check_update(network, before, gradients)


@pytest.mark.parametrize("predicts", ["epsilon", "sample"])
def test_a_step_of_stage_2(predicts: str) -> None:
    weights = drawn("denoiser.", DENOISER_SHAPES)
    shape = (4, 1, WIDTH)
    latents, epsilon = (golden_input(f"step_{name}", shape) for name in ("z0", "epsilon"))
    text, t = golden_input("step_text", (4, 1, TEXT)), torch.tensor([0.0, 250.0, 700.0, 999.0])

    author = as_double(weights)
    beta = np.linspace(math.sqrt(0.00085), math.sqrt(0.012), 1000) ** 2
    kept = torch.from_numpy(np.cumprod(1 - beta))[t.long()][:, None, None]
    noisy = kept.sqrt() * latents.double() + (1 - kept).sqrt() * epsilon.double()
    target = epsilon if predicts == "epsilon" else latents
    total = (Plain(author).denoiser(noisy, t.double(), text.double()) - target).square().mean()

    network, _ = load_denoiser(weights, Origin(dropout=0.0), "drawn")
    objective = DenoiserObjective(parametrization=Epsilon() if predicts == "epsilon" else Sample())
    always = torch.ones(4, 1, dtype=torch.bool)
    condition = Conditioning(text, always)
    found, gradients, before = step_taken(
        network,
        lambda: {
            "total": denoiser_loss(network, latents, epsilon, t, condition, always, objective)
        },
        preset_named("mld_humanml3d").denoiser_training,
    )
    assert float(found["total"]) == pytest.approx(total.item(), rel=CLOSE)
    check_gradients(
        gradients, gradients_of(author, total, reading.rules_of("denoiser", "denoiser_in_context"))
    )
    check_update(network, before, gradients)
