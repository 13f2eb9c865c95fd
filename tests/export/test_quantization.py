"""Graphs with matrix products in 8 bits: nearly the same, on both engines, in any batch."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from latentmotion.engine.session import Runtime, Session, open_session
from latentmotion.export.onnx import quantize, trace


class Small(nn.Module):
    """Two matrix products and a convolution."""

    def __init__(self) -> None:
        super().__init__()
        self.up, self.down = nn.Linear(48, 128), nn.Linear(128, 32)
        self.convolution = nn.Conv1d(32, 8, 3, padding=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.convolution(self.down(torch.tanh(self.up(x))).transpose(1, 2))


@pytest.fixture(scope="module")
def graphs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A graph in float32 and in 8 bits."""
    torch.manual_seed(0)
    folder, network, x = tmp_path_factory.mktemp("graphs"), Small(), torch.randn(2, 5, 48)
    for name in ("whole", "small"):
        trace(network, {"x": x}, folder / f"{name}.onnx", card={"name": "Small"})
    quantize(folder / "small.onnx")
    return folder / "whole.onnx", folder / "small.onnx"


@pytest.fixture(params=["onnxruntime", "openvino"])
def sessions(request: pytest.FixtureRequest, graphs: tuple[Path, Path]) -> tuple[Session, Session]:
    runtime: Runtime = request.param
    pytest.importorskip(runtime)
    whole, small = (open_session(graph, runtime, 1) for graph in graphs)
    return whole, small


def test_the_answer_is_nearly_the_same(sessions: tuple[Session, Session]) -> None:
    x = np.random.default_rng(0).standard_normal((4, 9, 48), dtype=np.float32)
    expected, found = (session(x=x) for session in sessions)
    error = np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean())
    assert 1e-5 < error < 0.02


def test_a_motion_does_not_depend_on_its_batch(sessions: tuple[Session, Session]) -> None:
    x = np.random.default_rng(0).standard_normal((4, 9, 48), dtype=np.float32)
    x[1:] *= 100
    together, alone = sessions[1](x=x), sessions[1](x=x[:1])
    np.testing.assert_allclose(together[:1], alone, atol=1e-5)


def test_matrices_are_small_and_the_card_stays(graphs: tuple[Path, Path]) -> None:
    whole, small = map(onnx.load, graphs)
    kinds = Counter(node.op_type for node in small.graph.node)
    assert kinds["MatMulNBits"] == 2 and kinds["Conv"] == 1 and not kinds["MatMul"]
    assert [(entry.key, entry.value) for entry in small.metadata_props] == [("name", "Small")]
    assert small.ByteSize() < 0.6 * whole.ByteSize()
