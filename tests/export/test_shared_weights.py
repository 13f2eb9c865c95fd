"""Graphs that read their weights from the model's weights file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from safetensors.torch import save_file

from latentmotion.diffusion.condition import Conditioning
from latentmotion.engine.session import Runtime, open_session
from latentmotion.errors import ModelError
from latentmotion.export.onnx import FEWEST, export_denoiser, share_weights
from latentmotion.model.config import DenoiserConfig, TransformerConfig
from latentmotion.networks.checkpoint import SCALE, build, load_weights, read_weights
from latentmotion.networks.text_encoder import pack

WEIGHTS = "weights.safetensors"
REAL = torch.ones(2, 5, dtype=torch.bool)
INPUTS = {
    "z": torch.randn(2, 5, 8),
    "t": torch.tensor([0.2, 0.7]),
    "words": torch.randn(2, 5, 12),
    "words_mask": REAL,
    "mask": REAL,
}


@pytest.fixture(scope="module", params=["float16", "int8"])
def exported(
    tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> tuple[Path, np.ndarray]:
    """The folder of a denoiser's graph and its weights file, and the network's answer."""
    folder = tmp_path_factory.mktemp("exported")
    torch.manual_seed(0)
    config = TransformerConfig(width=32, hidden=64, heads=2, layers=3)
    network = build(DenoiserConfig(latent_width=8, condition_width=12, transformer=config))
    stored = {name: value.half() for name, value in network.state_dict().items()}
    for name in [name for name in stored if request.param == "int8" and stored[name].ndim == 2]:
        stored[name], stored[name + SCALE] = pack(stored[name].float())
    save_file(stored, folder / WEIGHTS)
    load_weights(network, read_weights(folder / WEIGHTS), WEIGHTS)
    export_denoiser(network, 8, 12, folder / "small.onnx")
    z, t, words, real, mask = INPUTS.values()
    with torch.no_grad():
        expected = network(z, t, Conditioning(words, real), mask)
    return folder, expected.numpy()


@pytest.fixture
def small(exported: tuple[Path, np.ndarray], tmp_path: Path) -> tuple[Path, np.ndarray]:
    """A graph that may be changed, and the network's answer."""
    folder, expected = exported
    return shutil.copytree(folder, tmp_path / "model") / "small.onnx", expected


def _answer(graph: Path, runtime: Runtime = "onnxruntime") -> np.ndarray:
    return open_session(graph, runtime)(**{name: value.numpy() for name, value in INPUTS.items()})


@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_a_graph_says_the_same_from_shared_weights(
    small: tuple[Path, np.ndarray], runtime: Runtime
) -> None:
    graph, expected = small
    before = _answer(graph, runtime)
    share_weights(graph, graph.parent / WEIGHTS)
    np.testing.assert_allclose(_answer(graph, runtime), before, atol=1e-6)
    np.testing.assert_allclose(before, expected, atol=1e-5)


def test_only_few_numbers_stay_in_the_graph(small: tuple[Path, np.ndarray]) -> None:
    graph, _ = small
    share_weights(graph, graph.parent / WEIGHTS)
    share_weights(graph, graph.parent / WEIGHTS)  # once more changes nothing
    kept = onnx.load(graph, load_external_data=False).graph.initializer
    inside = [tensor for tensor in kept if tensor.data_location != onnx.TensorProto.EXTERNAL]
    assert len(kept) - len(inside) > 10
    assert all(np.prod(tensor.dims) < FEWEST for tensor in inside)


def test_numbers_that_the_file_lacks_stay(small: tuple[Path, np.ndarray]) -> None:
    graph, expected = small
    others = graph.parent / WEIGHTS
    save_file({"other": torch.randn(64, 32).half()}, others)
    share_weights(graph, others)
    others.unlink()
    np.testing.assert_allclose(_answer(graph), expected, atol=1e-5)


def test_missing_weights_are_told(small: tuple[Path, np.ndarray]) -> None:
    graph, _ = small
    share_weights(graph, graph.parent / WEIGHTS)
    (graph.parent / WEIGHTS).unlink()
    with pytest.raises(ModelError, match="copy the folder again"):
        _answer(graph)
