"""Graphs of the whole way: the generator takes them by itself, and they say what the chain says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from latentmotion import MotionPipeline
from latentmotion.cli.options import Runtime
from latentmotion.condition.task import ActionTask
from latentmotion.diffusion.few_step import FewStepConfig
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.export.package import package_model
from latentmotion.model.card import ModelCard
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import ConvolutionalVAEConfig, LatentSpace
from latentmotion.networks.build import build
from latentmotion.networks.checkpoint import LatentModel, save_model

FEW_STEP = FewStepConfig(guidance=(1.0, 4.0), steps=(2, 8), solver_steps=8)


@pytest.fixture(scope="module")
def student(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    vae = ConvolutionalVAEConfig(width=16, channels=4)
    denoiser = DenoiserConfig(
        latent_width=4,
        condition_width=6,
        transformer=TransformerConfig(width=16, layers=3, heads=2, hidden=24),
        sine_width=16,
        length_token=True,
        few_step=FEW_STEP,
    )
    card = ModelCard(
        name="untrained",
        representation="humanml3d",
        normalizer_mean=(0.5,) * 263,
        normalizer_std=(2.0,) * 263,
        latents=LatentSpace(4, frames_per_token=4, mean=(0.1, 0.2, 0.3, 0.4), std=(1.5,) * 4),
        schedule=LinearPath(),
        parametrization=Velocity(),
        vae=vae,
        denoiser=denoiser,
        condition=ActionTask(tuple("012345")),
        sampling=Sampling(steps=2, guidance=1.0),
    )
    network = build(denoiser)
    for weight in network.step_embedding.parameters():  # which is nothing at first
        torch.nn.init.normal_(weight, std=0.3)
    folder = tmp_path_factory.mktemp("student")
    save_model(folder / "run", LatentModel(card, build(vae), network))
    package_model(folder / "run", card, None, folder / "model")
    return folder / "model"


@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_a_walk_says_what_the_steps_say(student: Path, runtime: Runtime) -> None:
    pytest.importorskip(runtime)
    whole = MotionPipeline.from_pretrained(student, runtime, 1)
    assert set(whole.backend.fused) == {2}
    stepwise = replace(whole, backend=replace(whole.backend, fused={}))
    order = ["1", "3", "5"], [41, 24, 37], [3, 4, 5], 2
    for guidance in (1.0, 3.5):
        expected = stepwise.features(*order, guidance)
        for one, other in zip(whole.features(*order, guidance), expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-4)
    alone = whole.features(["3"], [24], [4], 2, 3.5)[0]
    np.testing.assert_allclose(alone, expected[1], atol=1e-4)
    assert np.abs(expected[1] - stepwise.features(["3"], [24], [4], 2, 1.0)[0]).max() > 1e-3


def test_other_numbers_of_steps_go_step_by_step(student: Path) -> None:
    generate = MotionPipeline.from_pretrained(student, "onnxruntime", 1)
    called: list[str] = []
    fused = {2: lambda **_: called.append("fused") or np.zeros((1, 20, 263))}
    watched = replace(generate, backend=replace(generate.backend, fused=fused))
    watched("1", 1.0, steps=8)
    assert not called
    watched("1", 1.0)
    assert called == ["fused"]


def test_graphs_share_their_weights_and_name_no_place(student: Path) -> None:
    for path in student.glob("*.onnx"):
        graph = onnx.load(path, load_external_data=False).graph
        assert any(tensor.external_data for tensor in graph.initializer)
        assert not any(node.metadata_props or node.doc_string for node in graph.node)
        assert b".py" not in path.read_bytes()
