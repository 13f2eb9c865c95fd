"""Graphs of foreign folders: none repeats forever or takes all memory."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from latentmotion.engine.session import check_graph, open_session
from latentmotion.errors import ModelError
from latentmotion.model.card import find_model, shipped_models

onnx = pytest.importorskip("onnx")
helper, FLOAT, INT64 = onnx.helper, onnx.TensorProto.FLOAT, onnx.TensorProto.INT64


def value(name: str, shape: list[int] | None) -> object:
    return helper.make_tensor_value_info(name, FLOAT, shape)


def saved(path: Path, nodes: list[object], *constants: object) -> Path:
    graph = helper.make_graph(nodes, "g", [value("x", [1])], [value("y", None)], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def repeating(tmp_path: Path) -> Path:
    """A graph of 300 bytes that adds one 10¹² times."""
    total = [value("before", [1]), value("after", [1])]
    nothing = [helper.make_tensor_value_info(name, t, []) for name, t in (("i", INT64), ("c", 9))]
    step = helper.make_graph(
        [
            helper.make_node("Identity", ["c"], ["again"]),
            helper.make_node("Add", ["before", "before"], ["after"]),
        ],
        "step",
        [*nothing, total[0]],
        [helper.make_tensor_value_info("again", 9, []), total[1]],
    )
    node = helper.make_node("Loop", ["often", "", "x"], ["y"], body=step)
    often = helper.make_tensor("often", INT64, [], [10**12])
    return saved(tmp_path / "loop.onnx", [node], often)


def test_a_graph_with_a_loop_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"loop\.onnx has a node Loop, which may repeat others"):
        open_session(repeating(tmp_path), threads=1)
    content = (tmp_path / "loop.onnx").read_bytes()
    assert b"\x04Loop" in content
    for length in (b"\x84\x00", b"\x84\x80\x80\x00"):
        (tmp_path / "spelled.onnx").write_bytes(content.replace(b"\x04Loop", length + b"Loop"))
        with pytest.raises(ModelError, match="has a node Loop"):
            check_graph(tmp_path / "spelled.onnx")


def test_shipped_graphs_are_taken() -> None:
    graphs = [graph for name in shipped_models() for graph in find_model(name).glob("*.onnx")]
    assert len(graphs) > 5
    for graph in graphs:
        check_graph(graph)


@pytest.mark.parametrize("count", [3 * 10**9, 10**12, 2**62])
@pytest.mark.parametrize("kind", ["Expand", "ConstantOfShape", "Tile", "Range"])
def test_a_graph_that_asks_for_all_memory_gets_an_error(
    kind: str, count: int, tmp_path: Path
) -> None:
    sizes = helper.make_tensor("sizes", INT64, [1], [count])
    if kind == "ConstantOfShape":
        first = helper.make_node(kind, ["sizes"], ["large"])
    elif kind == "Range":
        ends = [helper.make_tensor(n, FLOAT, [], [v]) for n, v in (("a", 0), ("b", 1e38))]
        first = helper.make_node(kind, ["a", "b", "sizes"], ["large"])
        sizes, *more = [helper.make_tensor("sizes", FLOAT, [], [1e38 / count]), *ends]
    else:
        first = helper.make_node(kind, ["x", "sizes"], ["large"])
    more = more if kind == "Range" else []
    path = saved(
        tmp_path / "large.onnx",
        [first, helper.make_node("ReduceSum", ["large"], ["y"])],
        sizes,
        *more,
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ModelError):
        open_session(path, threads=1)(x=np.ones(1, np.float32))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000


def test_an_empty_graph_is_told(tmp_path: Path) -> None:
    (tmp_path / "empty.onnx").touch()
    with pytest.raises(ModelError, match=r"empty\.onnx cannot be read"):
        open_session(tmp_path / "empty.onnx")
