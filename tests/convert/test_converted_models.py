"""Models of the authors' kinds, small and untrained: with CLIP, on raw frames, of SMPL actions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from transformers import PreTrainedTokenizerFast

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.diffusion.condition import ActionTask
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.export.package import export_pretrained
from latentmotion.model.config import (
    DenoiserConfig,
    IdentityVAEConfig,
    LatentSpace,
    Sampling,
    TransformerVAEConfig,
)
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import save_model
from latentmotion.networks.pretrained_text import PretrainedTextEncoder
from tests.support.tiny_text import CAPTIONS, clip, teacher_tokenizer, write_dense, write_t5
from tests.support.untrained import SMALL, card, untrained

FRAMES, SEEDS = [24, 41], [3, 4]


@pytest.fixture(scope="module")
def clip_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    torch.manual_seed(0)
    clip().save_pretrained(folder)
    PreTrainedTokenizerFast(
        tokenizer_object=teacher_tokenizer(), pad_token="[PAD]", eos_token="[SEP]"
    ).save_pretrained(folder)
    return folder


def write_text_model(folder: Path) -> None:
    denoiser = DenoiserConfig(
        16, 16, SMALL, project_latents=False, condition_projection="relu_linear",
        positions="latents_first", sine_width=16,
    )  # fmt: skip
    vae = TransformerVAEConfig(features=251, transformer=replace(SMALL, layers=1))
    about = card(251, "kit", LatentSpace(16, tokens=1))
    save_model(folder, untrained(about, vae, denoiser))


def write_raw_model(folder: Path) -> None:
    denoiser = DenoiserConfig(
        263, 3, replace(SMALL, layers=1), condition_projection="table",
        positions="context_first", sine_width=16, position="sine", attends_to_padding=True,
    )  # fmt: skip
    about = card(263, "humanml3d", LatentSpace(263, frames_per_token=1))
    about = replace(
        about, condition=ActionTask(("a", "b", "c")), sampling=Sampling(1000, 7.5, "ddpm")
    )
    save_model(folder, untrained(about, IdentityVAEConfig(263), denoiser))


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.LongSentenceWarning")
@pytest.mark.parametrize("kind", ["clip", "clip_hidden", "sentence_t5"])
def test_encoders_read_the_same_as_graphs(kind: str, clip_folder: Path, tmp_path: Path) -> None:
    source = clip_folder if kind != "sentence_t5" else tmp_path / "t5"
    if kind == "sentence_t5":
        source.mkdir()
        write_t5(source)
        write_dense(source)
    encoder = PretrainedTextEncoder.load(kind, str(source))
    export_pretrained(encoder, tmp_path)
    graph = load_text_encoder(tmp_path)
    assert (graph.name, graph.width) == (encoder.name, encoder.width)
    sentences = [*CAPTIONS, "", " ".join(["walks"] * 100)]
    found, expected = graph(sentences), encoder(sentences)
    np.testing.assert_array_equal(found.mask, expected.mask)
    np.testing.assert_allclose(found.pooled, expected.pooled, atol=1e-5)
    np.testing.assert_allclose(found.words, expected.words, atol=1e-5)


@pytest.mark.usefixtures("without_pullback")
def test_a_model_with_clip_generates_with_and_without_pytorch(
    clip_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_text_model(tmp_path / "run")
    motion, encoder = tmp_path / "a.npz", ["--text-encoder", f"clip:{clip_folder}"]
    options = ["--model", str(tmp_path / "run"), "--steps", "2", "-o", str(motion)]
    with pytest.raises(SystemExit):
        main(["generate", "a person walks", *options])
    assert "not at hand" in capsys.readouterr().err
    main(["generate", "a person walks", *options, *encoder, "--no-clean"])
    main(["export", str(tmp_path / "run"), *encoder, "-o", str(tmp_path / "model")])
    clip_encoder = PretrainedTextEncoder.load("clip", str(clip_folder))
    prompts = ["a person walks", "person walks and kicks"]
    eager = torch_pipeline(tmp_path / "model", clip_encoder)
    expected = eager.features(prompts, FRAMES, SEEDS, steps=3)
    graphs = MotionPipeline.from_pretrained(tmp_path / "model", "onnxruntime", 1)
    for one, other in zip(graphs.features(prompts, FRAMES, SEEDS, steps=3), expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)
    kit = graphs("a person kicks", seconds=2, steps=1, clean_up=None)
    assert (kit.fps, len(kit), kit.joints.shape[1]) == (12.5, 25, 21)


def test_frames_are_those_of_a_motion_alone_where_padding_is_seen(tmp_path: Path) -> None:
    write_raw_model(tmp_path / "run")
    generate = torch_pipeline(tmp_path / "run")
    assert not generate.card.masks_padding
    prompts, frames, seeds = ["a", "b", "c"], [24, 20, 24], [1, 2, 3]
    together = generate.features(prompts, frames, seeds, steps=3)
    for row, features in enumerate(together):
        alone = generate.features(prompts[row : row + 1], frames[row : row + 1], [seeds[row]], 3)
        np.testing.assert_allclose(features, alone[0], atol=1e-3)


@pytest.mark.parametrize("sampler", ["ddpm", "ddim"])
def test_a_thousand_steps(sampler: str, tmp_path: Path) -> None:
    write_raw_model(tmp_path / "run")
    generate = torch_pipeline(tmp_path / "run")
    features = generate.features(["a"], [16], [0], guidance=1.0, sampler=sampler)
    assert np.isfinite(features[0]).all()


def test_raw_frames_run_as_a_graph(tmp_path: Path) -> None:
    write_raw_model(tmp_path / "run")
    main(["export", str(tmp_path / "run"), "-o", str(tmp_path / "model")])
    assert not (tmp_path / "model" / "decoder.onnx").exists()
    # ACTOR's table of places has 5,000 rows; no part of the graph is nearly as large.
    graph = onnx.load(tmp_path / "model" / "denoiser.onnx").graph
    assert max(np.prod(part.dims) for part in graph.initializer) < 5000
    graphs = MotionPipeline.from_pretrained(tmp_path / "model", "onnxruntime", 1)
    expected = torch_pipeline(tmp_path / "model").features(["a", "b"], FRAMES, SEEDS, steps=3)
    for one, other in zip(
        graphs.features(["a", "b"], FRAMES, SEEDS, steps=3), expected, strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


def test_actions_of_smpl_generate(tmp_path: Path) -> None:
    denoiser = DenoiserConfig(
        16, 12, SMALL, False, "table", positions="latents_first", sine_width=16
    )
    about = card(150, "smpl", LatentSpace(16, tokens=1))
    about = replace(about, condition=ActionTask(tuple(map(str, range(12)))))
    vae = TransformerVAEConfig(features=150, transformer=SMALL, position="sine")
    save_model(tmp_path / "run", untrained(about, vae, denoiser))
    motion = torch_pipeline(tmp_path / "run")("11", seconds=2, steps=2)
    assert np.isfinite(motion.joints).all() and motion.caption == "11"
