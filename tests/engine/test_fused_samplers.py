"""Graphs of the whole way: the generator takes them by itself, and they say what the chain says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.options import Runtime


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
            np.testing.assert_allclose(one, other, atol=1e-5)
    alone = whole.features(["3"], [24], [4], 2, 3.5)[0]
    np.testing.assert_allclose(alone, expected[1], atol=1e-5)
    assert np.abs(expected[1] - stepwise.features(["3"], [24], [4], 2, 1.0)[0]).max() > 1e-4


def test_other_numbers_of_steps_go_step_by_step(student: Path) -> None:
    generate = MotionPipeline.from_pretrained(student, "onnxruntime", 1)
    called: list[str] = []
    fused = {2: lambda **_: called.append("fused") or np.zeros((1, 20, 263))}
    watched = replace(generate, backend=replace(generate.backend, fused=fused))
    watched("1", 1.0, steps=8, clean_up=None)
    assert not called
    watched("1", 1.0, steps=2, clean_up=None)
    assert called == ["fused"]


def test_graphs_share_their_weights_and_name_no_place(student: Path) -> None:
    for path in student.glob("*.onnx"):
        graph = onnx.load(path, load_external_data=False).graph
        assert any(tensor.external_data for tensor in graph.initializer)
        assert not any(node.metadata_props or node.doc_string for node in graph.node)
        assert b".py" not in path.read_bytes()
