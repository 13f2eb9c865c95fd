"""A trained model becomes a folder that generates without PyTorch, or nothing is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.diffusion.condition import TextTask
from latentmotion.diffusion.parametrization import Epsilon, Velocity
from latentmotion.diffusion.schedule import LinearPath, ScaledLinear
from latentmotion.errors import ModelError
from latentmotion.export.package import copied, matrices_to_pack, package_model
from latentmotion.model.card import ModelCard, find_model, read_card
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    LatentSpace,
    Sampling,
    TransformerConfig,
    TransformerVAEConfig,
)
from latentmotion.networks.checkpoint import (
    SCALE,
    WEIGHTS_FILE,
    FirstStageModel,
    LatentModel,
    build,
    load_model,
    save_model,
)

SMALL = TransformerConfig(width=16, layers=3, heads=2, hidden=24)
VAES = {
    "over time": (
        ConvolutionalVAEConfig(width=8, channels=4, dilations=(1,)),
        LatentSpace(4, frames_per_token=4),
    ),
    "global": (
        TransformerVAEConfig(tokens=2, transformer=replace(SMALL, layers=1)),
        LatentSpace(16, tokens=2),
    ),
}


def untrained(kind: str) -> LatentModel:
    torch.manual_seed(0)
    vae, latents = VAES[kind]
    denoiser = DenoiserConfig(latent_width=latents.width, transformer=SMALL, sine_width=16)
    flow = kind == "over time"
    card = ModelCard(
        name="untrained",
        representation="humanml3d",
        normalizer_mean=(0.0,) * 263,
        normalizer_std=(1.0,) * 263,
        latents=latents,
        schedule=LinearPath() if flow else ScaledLinear(),
        parametrization=Velocity() if flow else Epsilon(),
        vae=vae,
        denoiser=denoiser,
        condition=TextTask(),
        sampling=Sampling(guidance=2.0),
    )
    return LatentModel(card, build(vae), build(denoiser))


@pytest.mark.usefixtures("without_pullback")
@pytest.mark.parametrize("kind", VAES)
def test_a_packaged_model_generates(kind: str, tmp_path: Path) -> None:
    save_model(tmp_path / "run", untrained(kind))
    starter, output = find_model("starter"), tmp_path / "model"
    precision = {"over time": "float32", "global": "int8"}[kind]
    options = ["--text-encoder", str(starter), "-o", str(output), "--license", "CC0"]
    options += {"over time": ["--weights", "int8"], "global": []}[kind]
    main(["export", str(tmp_path / "run"), *options, "--precision", precision])
    card = read_card(output)
    assert (card.provenance.license, card.precision) == ("CC0", precision)
    page = (output / "README.md").read_text(encoding="utf-8")
    assert page.startswith("---\nlicense: ") and "# model\n" in page
    pipeline = MotionPipeline.from_pretrained(output, "onnxruntime", 1)
    (motion,) = pipeline.batch("a person walks", 1, steps=3)
    assert motion.joints.shape == (20, 22, 3)
    assert motion.metadata["model"] == "model"


def test_weights_are_kept_in_half_the_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("latentmotion.export.package._write_graphs", lambda *_, **__: None)
    model = untrained("over time")
    save_model(tmp_path / "run", model)
    package_model(tmp_path / "run", model.card, copied(find_model("starter")), tmp_path / "model")
    again = load_model(tmp_path / "model")
    for old, new in zip(model.vae.parameters(), again.vae.parameters(), strict=True):
        np.testing.assert_array_equal(old.detach().half().float(), new.detach())


def test_denoiser_and_decoder_but_its_last_layer_are_kept_in_8_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.export.package._write_graphs", lambda *_, **__: None)
    model, encoder = untrained("over time"), copied(find_model("starter"))
    save_model(tmp_path / "run", model)
    package_model(tmp_path / "run", model.card, encoder, tmp_path / "model", weights="int8")
    again = load_model(tmp_path / "model")
    pairs = {
        f"{part}.{name}": (old.detach(), new.detach())
        for part in ("vae", "denoiser")
        for (name, old), new in zip(
            getattr(model, part).named_parameters(), getattr(again, part).parameters(), strict=True
        )
    }
    kernels = [key for key, (old, _) in pairs.items() if "vae.decoder." in key and old.ndim == 3]
    matrices = [key for key, (old, _) in pairs.items() if "denoiser." in key and old.ndim == 2]
    assert len(kernels) > 5 and len(matrices) > 10
    for key, (old, new) in pairs.items():
        if key in (*kernels[:-1], *matrices):
            step = old.abs().amax(dim=tuple(range(1, old.ndim)), keepdim=True) / 127
            assert ((old - new).abs() <= 0.51 * step + 1e-3 * old.abs()).all(), key
        else:
            np.testing.assert_array_equal(old.half().float(), new, key)
    weights = load_file(tmp_path / "model" / WEIGHTS_FILE)
    scale = next(key for key in weights if key.endswith(SCALE))
    assert weights[scale.removesuffix(SCALE)].dtype == torch.int8
    save_file(weights | {scale: weights[scale][1:]}, tmp_path / "model" / WEIGHTS_FILE)
    with pytest.raises(ModelError, match=rf"{scale} has shape \(\d+, 1\), expected"):
        load_model(tmp_path / "model")


def test_a_decoder_whose_layers_have_names_stays_in_16_bits() -> None:
    names = ("vae.decoder.10.weight", "vae.decoder.2.weight", "vae.decoder.out.weight")
    assert matrices_to_pack({name: torch.zeros(4, 4, 3) for name in names}) == [names[1]]
    assert matrices_to_pack({names[2]: torch.zeros(4, 4, 3)}) == []


def test_nothing_is_written_of_half_a_model(tmp_path: Path) -> None:
    model = untrained("over time")
    save_model(tmp_path / "run", model)
    with pytest.raises(ModelError, match=r"lacks text_encoder\.onnx"):
        package_model(tmp_path / "run", model.card, copied(tmp_path), tmp_path / "model")
    first = FirstStageModel(replace(model.card, denoiser=None), model.vae)
    save_model(tmp_path / "vae", first)
    with pytest.raises(ModelError, match="train both stages"):
        package_model(
            tmp_path / "vae", first.card, copied(find_model("starter")), tmp_path / "model"
        )
    assert not (tmp_path / "model").exists()
