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

from latentmotion.condition.task import ActionTask, TextConditioning, TextTask, UnconditionalTask
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.errors import ModelError
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    IdentityVAEConfig,
    LatentSpace,
    TransformerConfig,
)
from latentmotion.networks.build import build
from latentmotion.networks.checkpoint import (
    FirstStageModel,
    LatentModel,
    load_model,
    load_stages,
    save_model,
)
from tests.support.version_1 import write_version_1_card

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


OLD_CARDS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "no vae": (
        {
            "vae": {},
            "normalizer_mean": [0.0] * 3,
            "normalizer_std": [1.0] * 3,
            "latents": {"width": 3, "frames_per_token": 1},
        },
        {"vae": IdentityVAEConfig(3)},
    ),
    "vae alone": ({"denoiser": {}, "condition": {}}, {"denoiser": None}),
    "sentences": (
        {"condition": {"encoder": "clip", "width": 6}},
        {"condition": TextTask("clip", 6, TextConditioning())},
    ),
    "labels": (
        {"task": "action", "condition": {"kind": "action", "labels": ["a", "b"]}},
        {"condition": ActionTask(("a", "b"))},
    ),
    "numbers": (
        {"task": "action", "condition": {"classes": 2}, "denoiser": {"condition_width": 2}},
        {"condition": ActionTask(("0", "1")), "denoiser": DenoiserConfig(condition_width=2)},
    ),
    "nothing": (
        {"task": "unconditional", "condition": {"kind": "unconditional"}},
        {"condition": UnconditionalTask()},
    ),
}
"""Content of cards that earlier versions wrote, and what it means."""


@pytest.mark.parametrize("name", OLD_CARDS)
def test_cards_of_earlier_versions_are_read(name: str, tmp_path: Path) -> None:
    written, meant = OLD_CARDS[name]
    small_model().card.write(tmp_path)
    write_version_1_card(tmp_path)
    edit_card(lambda card: card.update(written))(tmp_path)
    card = read_card(tmp_path)
    for key, value in meant.items():
        assert getattr(card, key) == value
    card.write(tmp_path)
    assert read_card(tmp_path) == card
    kept = json.loads((tmp_path / "model.json").read_text())
    assert kept["format"] == 2 and kept["condition"]["kind"] == type(card.condition).__name__


def edit_card(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        path = folder / "model.json"
        card = json.loads(path.read_text())
        change(card)
        path.write_text(json.dumps(card))

    return edit


def edit_version_1(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        write_version_1_card(folder)
        edit_card(change)(folder)

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
    "other task": (edit_version_1(lambda card: card.update(task="texts")), "one of text, act"),
    "no task": (edit_version_1(lambda card: card.pop("task")), "missing key 'task'"),
    "other kind": (edit_card(lambda card: card["vae"].update(kind="Vae3")), "Vae3"),
    "future": (edit_card(lambda card: card.update(format=99)), "format 99"),
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
