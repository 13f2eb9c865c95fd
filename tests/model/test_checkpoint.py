"""Model folders: written whole or not at all, read strictly."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from latentmotion.diffusion.condition import TextTask
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.errors import ModelError
from latentmotion.model.card import ModelCard
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    LatentSpace,
    TransformerConfig,
)
from latentmotion.networks.checkpoint import (
    FirstStageModel,
    LatentModel,
    build,
    load_model,
    load_stages,
    save_model,
)

VAE = ConvolutionalVAEConfig(features=5, width=8, channels=3, dilations=(1, 2))
DENOISER = DenoiserConfig(
    latent_width=3,
    condition_width=4,
    transformer=TransformerConfig(width=8, layers=3, heads=2, hidden=8),
    sine_width=4,
    length_token=True,
)


def small_model() -> LatentModel:
    card = ModelCard(
        name="small",
        representation="tiny",
        normalizer_mean=(0.0,) * 5,
        normalizer_std=(1.0,) * 5,
        latents=LatentSpace(width=3, frames_per_token=4),
        schedule=LinearPath(),
        parametrization=Velocity(),
        vae=VAE,
        denoiser=DENOISER,
        condition=TextTask(),
    )
    return LatentModel(card, build(VAE), build(DENOISER))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_model(tmp_path / "model", small_model())
    return tmp_path / "model"


def test_a_model_comes_back_as_it_was(tmp_path: Path) -> None:
    model = small_model()
    save_model(tmp_path / "model", model)
    save_model(tmp_path / "model", model)  # over an older one
    found = load_model(tmp_path / "model")
    assert found.card == model.card
    for mine, theirs in ((model.vae, found.vae), (model.denoiser, found.denoiser)):
        assert not theirs.training
        same = zip(mine.state_dict().values(), theirs.state_dict().values(), strict=True)
        assert all(torch.equal(a, b) for a, b in same)
    assert [path.name for path in tmp_path.iterdir()] == ["model"]


def test_a_first_stage_alone(tmp_path: Path) -> None:
    model = small_model()
    only = dataclasses.replace(model.card, denoiser=None)
    save_model(tmp_path / "model", FirstStageModel(only, model.vae))
    assert list(load_stages(tmp_path / "model").networks) == ["vae"]
    with pytest.raises(ModelError, match="no denoiser; train both stages first"):
        load_model(tmp_path / "model")


def edit_card(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        path = folder / "model.json"
        card = json.loads(path.read_text())
        change(card)
        path.write_text(json.dumps(card))

    return edit


def edit_weights(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        weights = load_file(folder / "weights.safetensors")
        change(weights)
        save_file(weights, folder / "weights.safetensors")

    return edit


def cut(folder: Path) -> None:
    path = folder / "weights.safetensors"
    path.write_bytes(path.read_bytes()[:-100])


DAMAGES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no card": (lambda folder: (folder / "model.json").unlink(), "not a model folder"),
    "no json": (lambda folder: (folder / "model.json").write_text("{"), "not JSON"),
    "misspelt": (edit_card(lambda card: card["sampling"].update(gidance=3)), "mean 'guidance'"),
    "misspelt size": (edit_card(lambda card: card["vae"].update(widht=3)), "mean 'width'"),
    "misspelt label": (edit_card(lambda card: card["condition"].update(encodr="x")), "'encoder'"),
    "other task": (
        edit_card(lambda card: card["condition"].update(kind="TextsTask")),
        "one of TextTask, ActionTask",
    ),
    "no condition": (edit_card(lambda card: card.pop("condition")), "missing key 'condition'"),
    "other kind": (edit_card(lambda card: card["vae"].update(kind="Vae3")), "Vae3"),
    "future": (edit_card(lambda card: card.update(format=99)), "format 99"),
    "no format": (edit_card(lambda card: card.pop("format")), "format None, expected 2"),
    "missing": (edit_card(lambda card: card.pop("schedule")), "missing key 'schedule'"),
    "other size": (edit_card(lambda card: card["vae"].update(width=9)), "has shape"),
    "no weights": (lambda folder: (folder / "weights.safetensors").unlink(), "missing or dam"),
    "cut weights": (cut, "missing or damaged"),
    "weight missing": (
        edit_weights(lambda weights: weights.pop("denoiser.positions.latents.table")),
        "1 weights missing, first 'denoiser.positions.latents.table'",
    ),
    "weight unknown": (
        edit_weights(
            lambda weights: weights.update(
                {"vae.encodr.0.convolution.bias": weights.pop("vae.encoder.0.convolution.bias")}
            )
        ),
        "did you mean 'vae.encoder.0.convolution.bias'",
    ),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGES.values(), ids=DAMAGES)
def test_damage_is_named(folder: Path, damage: Callable[[Path], Any], message: str) -> None:
    damage(folder)
    with pytest.raises(ModelError, match=message):
        load_model(folder)
