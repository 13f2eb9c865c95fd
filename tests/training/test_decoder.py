"""Another decoder for the latents of a trained model, and its exchange between models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.generation import decoders
from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.engine.session import open_session
from latentmotion.errors import InputError, ModelError
from latentmotion.export.onnx import export_decoder
from latentmotion.export.package import with_decoder
from latentmotion.model.config import IdentityVAEConfig, QuarterRateDecoder
from latentmotion.networks.checkpoint import build, load_model, save_model
from latentmotion.training.decoder import (
    DenoisedStage,
    check_data,
    light_decoder_config,
    train_decoder,
    vae_with_latents_of,
)
from latentmotion.training.distributed import Ranks, StepRandomness
from latentmotion.training.experiment import Experiment
from tests.support.small_training import CONTEXT, killed_at, small


@pytest.fixture(scope="module")
def model(unconditional_run: Path) -> Path:
    return unconditional_run / "model"


def settings(model: Path) -> Experiment:
    return replace(
        small(), vae=replace(light_decoder_config(model), decoder=QuarterRateDecoder((1,)))
    )


@pytest.fixture(scope="module")
def decoded(figures: Path, model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("decoder") / "run"
    return train_decoder(settings(model), figures, model, run, CONTEXT)


def test_only_the_decoder_is_another(model: Path, decoded: Path) -> None:
    before, after = load_model(model), load_model(decoded)
    for one, other in ((before.vae.encoder, after.vae.encoder), (before.denoiser, after.denoiser)):
        weights = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
        assert all(torch.equal(*pair) for pair in weights)
    changed = {"vae", "figures", "provenance"}
    for name, value in vars(before.card).items():
        assert (getattr(after.card, name) == value) == (name not in changed), name
    assert after.card.figures["denoiser_loss"] == before.card.figures["denoiser_loss"]
    assert after.card.figures["vae_val_mm"] != before.card.figures["vae_val_mm"]
    assert len(after.card.provenance.commands) == 3


def test_it_goes_on_bit_for_bit(figures: Path, model: Path, tmp_path: Path) -> None:
    experiment = settings(model)
    whole = train_decoder(experiment, figures, model, tmp_path / "whole", CONTEXT, 0.5)
    with killed_at(5):
        train_decoder(experiment, figures, model, tmp_path / "run", CONTEXT, 0.5)
    found = train_decoder(experiment, figures, model, tmp_path / "run", CONTEXT, 0.5)
    one, other = (folder / "weights.safetensors" for folder in (whole, found))
    assert one.read_bytes() == other.read_bytes()
    with pytest.raises(InputError, match=r"parents.model"):
        train_decoder(experiment, figures, whole, tmp_path / "run", CONTEXT, 0.5)
    with pytest.raises(InputError, match=r"parents.denoised"):
        train_decoder(experiment, figures, model, tmp_path / "run", CONTEXT)
    with pytest.raises(InputError, match="below 1"):
        train_decoder(experiment, figures, model, tmp_path / "run", CONTEXT, 1.0)


def test_it_learns_from_latents_that_the_denoiser_cleaned(figures: Path, model: Path) -> None:
    trained = load_model(model)
    vae = vae_with_latents_of(trained, settings(model).vae)
    dataset, experiment = Dataset.load(figures), settings(model)
    stage = DenoisedStage(vae, dataset, experiment, CONTEXT, trained, None, 0.9)
    drawn, mask = torch.randn(5, 6, 4), torch.ones(5, 6, dtype=torch.bool)
    draws = [StepRandomness(0, 0, 5, Ranks()) for _ in range(2)]
    cleaned = stage._latents_to_decode(draws[0], drawn, mask)
    times = 0.9 * draws[1].uniform()
    moved = (cleaned - drawn).norm(dim=(1, 2))
    assert bool((moved[times.argsort()][[0, -1]].diff() > 0).all())  # later is farther off
    assert all(name.startswith("network.") for name in stage.state_dict())
    losses = stage(0)
    assert all(bool(loss.isfinite()) for loss in losses.values())


def test_a_student_gets_it_by_exchange(model: Path, decoded: Path, tmp_path: Path) -> None:
    """Any model of the same latents; here one with another denoiser."""
    student = load_model(model)
    for parameter in student.denoiser.parameters():
        torch.nn.init.ones_(parameter)
    save_model(tmp_path / "student", student)
    main(
        [
            "swap-decoder",
            str(tmp_path / "student"),
            "--decoder",
            str(decoded),
            "-o",
            str(tmp_path / "both"),
        ]
    )
    both, other = load_model(tmp_path / "both"), load_model(decoded)
    mask, z = torch.ones(1, 10, dtype=torch.bool), torch.randn(1, 3, 4)
    assert torch.equal(both.vae.decode(z, mask), other.vae.decode(z, mask))
    assert all(bool((p == 1).all()) for p in both.denoiser.parameters())
    assert both.card.figures == other.card.figures and both.card.vae == other.card.vae
    assert both.card.provenance.hours >= student.card.provenance.hours


def test_what_does_not_fit_is_refused(
    figures: Path, model: Path, decoded: Path, tmp_path: Path
) -> None:
    trained, other = load_model(model), load_model(decoded)
    wider = replace(settings(model), vae=replace(light_decoder_config(model), width=24))
    with pytest.raises(InputError, match=r"another encoder.*encoder.0.convolution.weight"):
        train_decoder(wider, figures, model, tmp_path / "run", CONTEXT)
    dilated = replace(settings(model), vae=replace(light_decoder_config(model), dilations=(3,)))
    with pytest.raises(InputError, match=r"another encoder \(of weights of the same shapes"):
        train_decoder(dilated, figures, model, tmp_path / "run", CONTEXT)
    frames = IdentityVAEConfig(263)
    raw = replace(trained, card=replace(trained.card, vae=frames), vae=build(frames))
    with pytest.raises(ModelError, match="no VAE"):
        with_decoder(trained, raw)
    torch.nn.init.zeros_(other.vae.encoder[0].convolution.bias)
    with pytest.raises(InputError, match="different encoders"):
        with_decoder(trained, other)
    card = replace(trained.card, normalizer_std=(2.0,) * 263)
    with pytest.raises(InputError, match="another normalizer"):
        check_data(card, Dataset.load(figures))
    with pytest.raises(InputError, match="different normalizers"):
        with_decoder(trained, replace(trained, card=card))
    space = frames.latent_space()
    save_model(tmp_path / "raw", replace(raw, card=replace(raw.card, latents=space)))
    with pytest.raises(ModelError, match="no cheaper decoder"):
        light_decoder_config(tmp_path / "raw")


def test_its_graph_says_the_same_at_any_length(decoded: Path, tmp_path: Path) -> None:
    vae = load_model(decoded).vae
    assert vae
    export_decoder(vae, 4, tmp_path / "decoder.onnx")
    session = open_session(tmp_path / "decoder.onnx", "onnxruntime", threads=1)
    for batch, frames in ((1, 13), (3, 40)):
        z, mask = (
            torch.randn(batch, -(-frames // 4), 4),
            torch.ones(batch, frames, dtype=torch.bool),
        )
        with torch.no_grad():
            expected = vae.decode(z, mask).numpy()
        found = session(latents=z.numpy(), mask=mask.numpy())
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_the_benchmark_has_a_row_for_each_decoder(
    decoded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    decoders.main(
        ["--models", f"tiny={decoded}", "--frames", "8", "--batches", "1", "--turns", "1"]
    )
    name, size, count, *times = capsys.readouterr().out.splitlines()[-1].strip("| ").split(" | ")
    assert name == "tiny" and len(times) == 2
    vae = load_model(decoded).vae
    assert vae and float(size) == round(sum(p.numel() for p in vae.decoder.parameters()) / 1e6, 2)
    assert float(count) > 0
