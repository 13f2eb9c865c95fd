"""The chain on PyTorch: the same motions as the exported graphs make, from any model folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.diffusion.condition import TextTask
from latentmotion.engine.prior import MotionPrior
from latentmotion.engine.session import open_decoder
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import find_model, read_card
from latentmotion.model.config import IdentityVAEConfig
from latentmotion.networks.backend import torch_pipeline, torch_prior
from latentmotion.networks.checkpoint import (
    FirstStageModel,
    LatentModel,
    build,
    load_model,
    save_model,
)

PROMPTS, FRAMES, SEEDS = ["a person walks forward", "a person jumps"], [41, 24], [3, 4]


def test_networks_and_graphs_make_the_same_features() -> None:
    graphs = MotionPipeline.from_pretrained("starter", "onnxruntime", 1)
    networks = torch_pipeline("starter")
    for options in ({"steps": 5}, {"steps": 5, "sampler": "ddpm", "guidance": 1.0}):
        expected = graphs.features(PROMPTS, FRAMES, SEEDS, **options)
        found = networks.features(PROMPTS, FRAMES, SEEDS, **options)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-4)


def test_networks_and_graphs_of_a_student_make_the_same_features(student: Path) -> None:
    graphs, networks = MotionPipeline.from_pretrained(student), torch_pipeline(student)
    for steps in (2, 8):
        arguments = ["1", "4"], FRAMES, SEEDS, steps, 2.0
        expected, found = graphs.features(*arguments), networks.features(*arguments)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-4)
    assert networks("1", seconds=1.0).metadata["steps"] == 8


def test_the_encoder_of_a_card_is_found_among_the_shipped(tmp_path: Path) -> None:
    model = load_model(find_model("starter"))
    save_model(tmp_path / "model", model)
    found = torch_pipeline(tmp_path / "model").features(PROMPTS, FRAMES, SEEDS, steps=1)
    expected = torch_pipeline("starter").features(PROMPTS, FRAMES, SEEDS, steps=1)
    np.testing.assert_array_equal(found[0], expected[0])
    foreign = replace(model.card, condition=TextTask("clip:/no/such/folder"))
    save_model(tmp_path / "foreign", LatentModel(foreign, model.vae, model.denoiser))
    with pytest.raises(ModelError, match=r"not at hand .*--text-encoder"):
        torch_pipeline(tmp_path / "foreign")


def test_a_prior_is_sampled_with_and_without_graphs(tmp_path: Path) -> None:
    folder = find_model("starter")
    card = read_card(folder)
    prior = MotionPrior(card, open_decoder(card, folder, "onnxruntime", 1))
    expected = prior.features(FRAMES, SEEDS)
    found = torch_prior("starter").features(FRAMES, SEEDS)
    alone = [
        prior.features([length], [seed])[0] for length, seed in zip(FRAMES, SEEDS, strict=True)
    ]
    for one, two, three in zip(found, expected, alone, strict=True):
        np.testing.assert_allclose(one, two, atol=1e-4)
        np.testing.assert_allclose(three, two, atol=1e-4)
    assert [len(motion) for motion in prior.batch((1, 2), SEEDS)] == [20, 40]
    with pytest.raises(InputError, match="1 seeds for 2 motions"):
        torch_prior("starter").features(FRAMES, [1])


def test_half_models_say_what_to_do(tmp_path: Path) -> None:
    model = load_model(find_model("starter"))
    card = replace(model.card, denoiser=None)
    save_model(tmp_path / "vae", FirstStageModel(card, model.vae))
    with pytest.raises(ModelError, match=r"train denoiser.*--prior"):
        torch_pipeline(tmp_path / "vae")
    assert torch_prior(tmp_path / "vae").features([20], [0])[0].shape == (20, 263)
    width = model.card.latents.width
    card = replace(
        model.card,
        vae=IdentityVAEConfig(width),
        latents=replace(model.card.latents, frames_per_token=1),
        normalizer_mean=(0.0,) * width,
        normalizer_std=(1.0,) * width,
    )
    save_model(tmp_path / "raw", LatentModel(card, build(card.vae), model.denoiser))
    with pytest.raises(ModelError, match="has no VAE"):
        torch_prior(tmp_path / "raw").features([20], [0])
