"""The baselines are trained by the same commands: VPoser-t in stage 1, raw frames in stage 2."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.engine.session import open_session
from latentmotion.errors import InputError
from latentmotion.export.onnx import export_decoder
from latentmotion.model.config import Sampling, VPoserTConfig
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import build, load_model, load_stages
from latentmotion.networks.vae.transformer import IdentityVAE
from latentmotion.training.experiment import Experiment, preset_named, with_changes
from latentmotion.training.loop import ExponentialMovingAverage
from latentmotion.training.stages import train_denoiser, train_vae
from tests.support.small_training import CONTEXT, LetterCount, killed_at


def quick(experiment: Experiment, **changes: object) -> Experiment:
    """Two stages of six steps on crops of at most 24 frames."""
    every: dict[str, object] = {
        f"{part}.{key}": value
        for part in ("vae_training", "denoiser_training")
        for key, value in {
            "steps": 6,
            "batch_size": 4,
            "warm_up": 0,
            "precision": "float32",
            "report_every": 1,
            "validate_every": 3,
            "snapshot_every": 2,
            "sample_every": 0,
        }.items()
    }
    for part in ("vae_cropping", "latents.cropping"):
        every |= {f"{part}.max_frames": 24, f"{part}.min_frames": 8}
    every |= changes
    return with_changes(experiment, [f"{key}={json.dumps(value)}" for key, value in every.items()])


TINY = {"width": 16, "layers": 3, "heads": 2, "hidden": 16}
RAW = {
    "latents.normalized": False,
    "denoiser.latent_width": 263,
    "denoiser.condition_width": 6,
    "denoiser.transformer": TINY,
    "conditioning.words": 0,
}


def vposer_t(**changes: object) -> Experiment:
    config = VPoserTConfig(frames=24, hidden=16, width=8)
    return quick(replace(preset_named("vposer_t"), vae=config), **changes)


def test_vposer_t_is_trained_and_goes_on_where_it_was_killed(figures: Path, tmp_path: Path) -> None:
    whole = train_vae(vposer_t(), figures, tmp_path / "whole", CONTEXT)
    with killed_at(3):
        train_vae(vposer_t(), figures, tmp_path / "parts", CONTEXT)
    parts = train_vae(vposer_t(), figures, tmp_path / "parts", CONTEXT)
    name = "weights.safetensors"
    assert (whole / name).read_bytes() == (parts / name).read_bytes()
    model = load_stages(whole)
    assert model.card.latents.tokens == 1 and model.card.latents.width == 8
    assert int(model.vae.state_dict()["encoder.0.num_batches_tracked"]) == 6


def test_one_motion_at_once_is_refused_before_training(figures: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a batch of one motion"):
        train_vae(vposer_t(**{"vae_training.batch_size": 1}), figures, tmp_path / "run", CONTEXT)
    assert not (tmp_path / "run").exists()


def test_crops_longer_than_vposer_t_knows_are_refused_before_training(
    figures: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"at most 24.*max_frames"):
        experiment = vposer_t(**{"latents.cropping.max_frames": 40})
        train_vae(experiment, figures, tmp_path / "run", CONTEXT)
    assert not (tmp_path / "run").exists()


def test_running_statistics_are_averaged_like_the_weights() -> None:
    network = build(VPoserTConfig(features=3, frames=2, hidden=4, width=2))
    average = ExponentialMovingAverage(network, 0.5)
    start = network.state_dict()["encoder.0.running_mean"].clone()
    network.encode(torch.randn(5, 2, 3) + 7, torch.ones(5, 2, dtype=torch.bool))
    moved = network.state_dict()["encoder.0.running_mean"]
    average.update(network, 1000)
    found = average.network.state_dict()
    assert torch.allclose(found["encoder.0.running_mean"], (start + moved) / 2)
    assert int(found["encoder.0.num_batches_tracked"]) == 1


def test_diffusion_on_raw_frames_needs_no_first_stage(figures: Path, tmp_path: Path) -> None:
    experiment = quick(preset_named("starter"), **RAW)
    folder = train_denoiser(experiment, figures, None, LetterCount(), tmp_path / "run", CONTEXT)
    model = load_model(folder)
    assert isinstance(model.vae, IdentityVAE)
    assert model.card.latents.width == 263 and model.card.latents.frames_per_token == 1
    assert model.card.latents.std == (1.0,)
    assert len(model.card.provenance.commands) == 1
    assert not (tmp_path / "run" / "latents.safetensors").exists()


@pytest.mark.parametrize("steps", [6, 1000])
def test_mdm_is_trained_and_generates_alone_as_in_a_batch(
    figures: Path, tmp_path: Path, steps: int
) -> None:
    changes = {
        "denoiser.condition_width": 6,
        "denoiser.transformer": {**TINY, "skips": False, "final_norm": False},
        "denoiser.sine_width": 16,
        "denoiser_training.sample_every": 6,
    }
    changes |= {"denoiser_objective.schedule": {"kind": "Cosine", "length": steps}}
    changes |= {"sampling.steps": steps}
    experiment = quick(preset_named("mdm"), **changes)
    folder = train_denoiser(experiment, figures, None, LetterCount(), tmp_path / "run", CONTEXT)
    generator = torch_pipeline(folder, LetterCount())
    assert generator.card.sampling == Sampling(steps, 2.5, "ddpm")
    prompts, frames, seeds = ["a person walks", "a person kicks"], [20, 12], [1, 2]
    found = generator.features(prompts, frames, seeds, steps=6)
    assert [part.shape for part in found] == [(20, 263), (12, 263)]
    for row, part in enumerate(found):
        part_of = slice(row, row + 1)
        alone = generator.features(prompts[part_of], frames[part_of], seeds[part_of], steps=6)
        np.testing.assert_allclose(alone[0], part, atol=1e-3)


def test_mld_without_vae_has_the_size_of_the_authors() -> None:
    network = build(preset_named("mld_no_vae").denoiser)
    assert sum(parameter.numel() for parameter in network.parameters()) == 30_223_111


def test_mdm_has_no_first_stage_to_train(figures: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--vae none"):
        train_vae(quick(preset_named("mdm")), figures, tmp_path / "run", CONTEXT)


def test_the_graph_of_raw_frames(tmp_path: Path) -> None:
    export_decoder(IdentityVAE(5), 1, tmp_path / "decoder.onnx")
    decoder = open_session(tmp_path / "decoder.onnx", "onnxruntime", 1)
    latents = np.random.default_rng(0).standard_normal((3, 11, 5), dtype=np.float32)
    mask = np.arange(11)[None].repeat(3, 0) < np.array([[11], [4], [1]])
    np.testing.assert_array_equal(decoder(latents=latents, mask=mask), latents * mask[..., None])


def test_raw_frames_are_not_normalized_twice(figures: Path, tmp_path: Path) -> None:
    experiment = quick(preset_named("starter"), **{**RAW, "latents.normalized": True})
    with pytest.raises(InputError, match=r"latents\.normalized=false"):
        train_denoiser(experiment, figures, None, LetterCount(), tmp_path / "run", CONTEXT)
