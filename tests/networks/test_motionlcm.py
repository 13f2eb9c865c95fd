"""MotionLCM's layout of MLD's networks, against a small reading of its description with PyTorch's
own layers: narrow latents between linear maps, no activation before the text's projection.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from latentmotion.convert import convert_checkpoint
from latentmotion.convert.mld import Origin
from latentmotion.diffusion.condition import Conditioning, TextTask
from latentmotion.errors import ModelError
from latentmotion.model.config import Sampling
from latentmotion.networks.checkpoint import LatentModel, load_model

FEATURES, TOKENS, NARROW, WIDTH, HEADS, HIDDEN, TEXT, SINE = 7, 3, 6, 16, 2, 24, 10, 12


class Skips(nn.Module):
    """Three layers, the first joined to the last."""

    def __init__(self, kind: type[nn.Module]) -> None:
        super().__init__()
        layers = [
            kind(WIDTH, HEADS, HIDDEN, 0.0, activation="gelu", batch_first=True) for _ in range(3)
        ]
        self.input_blocks, self.middle_block = nn.ModuleList(layers[:1]), layers[1]
        self.output_blocks = nn.ModuleList(layers[2:])
        self.linear_blocks = nn.ModuleList([nn.Linear(2 * WIDTH, WIDTH)])
        self.norm = nn.LayerNorm(WIDTH)

    def forward(self, x: Tensor, *memory: Tensor, **masks: Tensor) -> Tensor:
        first = self.input_blocks[0](x, *memory, **masks)
        middle = self.middle_block(first, *memory, **masks)
        joined = self.linear_blocks[0](torch.cat([middle, first], dim=-1))
        return self.norm(self.output_blocks[0](joined, *memory, **masks))


class Table(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.pe = nn.Parameter(torch.rand(500, 1, WIDTH))

    def forward(self, x: Tensor) -> Tensor:
        return x + self.pe[: x.shape[1], 0]


class TheirVAE(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.global_motion_token = nn.Parameter(torch.randn(2 * TOKENS, WIDTH))
        self.skel_embedding, self.final_layer = nn.Linear(FEATURES, WIDTH), nn.Linear(WIDTH, 7)
        self.latent_pre, self.latent_post = nn.Linear(WIDTH, NARROW), nn.Linear(NARROW, WIDTH)
        self.query_pos_encoder, self.query_pos_decoder = Table(), Table()
        self.encoder = Skips(nn.TransformerEncoderLayer)
        self.decoder = Skips(nn.TransformerDecoderLayer)

    def encode(self, features: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        tokens = self.global_motion_token.expand(len(features), -1, -1)
        x = self.query_pos_encoder(torch.cat([tokens, self.skel_embedding(features)], dim=1))
        real = torch.cat([torch.ones_like(tokens[..., 0], dtype=torch.bool), mask], dim=1)
        summary = self.encoder(x, src_key_padding_mask=~real)[:, : 2 * TOKENS]
        mean, logvar = self.latent_pre(summary).chunk(2, dim=1)
        return mean, logvar

    def decode(self, latents: Tensor, mask: Tensor) -> Tensor:
        queries = self.query_pos_decoder(torch.zeros(*mask.shape, WIDTH))
        x = self.decoder(queries, self.latent_post(latents), tgt_key_padding_mask=~mask)
        return self.final_layer(x) * mask[..., None]


class TheirTime(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.linear_1, self.linear_2 = nn.Linear(SINE, WIDTH), nn.Linear(WIDTH, WIDTH)

    def forward(self, t: Tensor) -> Tensor:
        rates = torch.exp(-math.log(10_000) * torch.arange(SINE // 2) / (SINE // 2))
        angles = t[:, None] * rates
        both = torch.cat([angles.cos(), angles.sin()], dim=-1)
        return self.linear_2(nn.functional.silu(self.linear_1(both)))


class TheirDenoiser(nn.Module):
    """Latents, time and text in this order in one sequence."""

    def __init__(self) -> None:
        super().__init__()
        self.latent_pre, self.latent_post = nn.Linear(NARROW, WIDTH), nn.Linear(WIDTH, NARROW)
        self.time_embedding, self.query_pos = TheirTime(), Table()
        self.emb_proj = nn.Sequential(nn.Identity(), nn.Linear(TEXT, WIDTH))
        self.encoder = Skips(nn.TransformerEncoderLayer)

    def forward(self, z: Tensor, t: Tensor, text: Tensor) -> Tensor:
        context = [self.time_embedding(t)[:, None], self.emb_proj(text)]
        x = self.query_pos(torch.cat([self.latent_pre(z), *context], dim=1))
        return self.latent_post(self.encoder(x)[:, : z.shape[1]])


class Theirs(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.vae, self.denoiser = TheirVAE(), TheirDenoiser()


@pytest.fixture(scope="module")
def theirs() -> Theirs:
    torch.manual_seed(0)
    return Theirs().eval()


def convert(state: dict[str, Tensor], folder: Path, **unstated: str) -> LatentModel:
    torch.save({"state_dict": state}, folder / "mld_humanml.ckpt")
    plain = np.zeros(FEATURES, np.float32), np.ones(FEATURES, np.float32)
    origin = Origin(plain, heads=HEADS, **unstated)  # type: ignore[arg-type]
    convert_checkpoint(folder / "mld_humanml.ckpt", folder / "model", origin)
    return load_model(folder / "model")


@torch.no_grad()
def test_networks(theirs: Theirs, tmp_path: Path) -> None:
    model = convert(theirs.state_dict(), tmp_path)
    mask = torch.arange(11) < torch.tensor([11, 4, 8])[:, None]
    motion = torch.randn(3, 11, FEATURES)
    posterior, (mean, logvar) = model.vae.encode(motion, mask), theirs.vae.encode(motion, mask)
    torch.testing.assert_close(posterior.mean, mean, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(posterior.logvar, logvar, rtol=1e-5, atol=1e-5)
    expected = theirs.vae.decode(mean, mask)
    torch.testing.assert_close(model.vae.decode(mean, mask), expected, rtol=1e-5, atol=1e-5)
    z, t, text = (
        torch.randn(3, TOKENS, NARROW),
        torch.tensor([981.0, 1, 500]),
        torch.randn(3, 1, 10),
    )
    always = torch.ones(3, TOKENS, dtype=torch.bool)
    found = model.denoiser(z, t, Conditioning(text, always[:, :1]), always)
    torch.testing.assert_close(found, theirs.denoiser(z, t, text), rtol=1e-5, atol=1e-5)


def test_the_card_tells_the_layout(theirs: Theirs, tmp_path: Path) -> None:
    card = convert(theirs.state_dict(), tmp_path).card
    assert (card.latents.width, card.latents.tokens) == (NARROW, TOKENS)
    assert card.condition == TextTask("sentence-transformers/sentence-t5-large", TEXT)
    assert card.sampling == Sampling(50, 7.5, "ddim")
    assert card.trained_denoiser.condition_projection == "linear"


def test_a_relu_before_the_text_can_be_asked_for(theirs: Theirs, tmp_path: Path) -> None:
    card = convert(theirs.state_dict(), tmp_path, text_activation="relu").card
    assert card.trained_denoiser.condition_projection == "relu_linear"


def test_a_distilled_model_is_refused_with_the_reason(theirs: Theirs, tmp_path: Path) -> None:
    state = theirs.state_dict() | {
        "denoiser.time_embedding.cond_proj.weight": torch.zeros(SINE, 256)
    }
    with pytest.raises(ModelError, match="guidance scale as an input"):
        convert(state, tmp_path)
    assert not (tmp_path / "model").exists()
