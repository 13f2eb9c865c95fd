"""What uses a trained model runs without PyTorch and is imported in no time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


def run(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | environment,
    )
    return done.stdout.strip()


def test_importing_the_package_imports_nothing_else() -> None:
    code = "import sys; import latentmotion as l; print('numpy' in sys.modules, l.__version__)"
    assert run(code).startswith("False")


def test_generation_imports_no_pytorch() -> None:
    code = (
        "import sys; import latentmotion.pipeline, latentmotion.cli.generate;"
        "print(sorted({'torch', 'scipy', 'transformers', 'onnx', 'PIL', 'av'} & set(sys.modules)))"
    )
    assert run(code) == "[]"


def test_verbs_of_the_plain_installation_need_neither_pytorch_nor_pillow() -> None:
    modules = (
        *("bulk", "convert", "data", "edit", "evaluate", "generate", "motions", "pages"),
        *("render", "search", "serve", "states", "teach"),
    )
    code = (
        "import sys; sys.modules.update(dict.fromkeys(('torch', 'onnx', 'PIL', 'av')));"
        "from importlib import import_module as load;"
        f"print(len([load('latentmotion.cli.' + name) for name in {modules}]))"
    )
    assert run(code) == str(len(modules))


def test_public_names_exist() -> None:
    code = "import latentmotion as l; print(all(getattr(l, n) is not None for n in l.__all__))"
    assert run(code) == "True"


@pytest.mark.parametrize("runtime", ["onnxruntime", "openvino"])
def test_the_engine_keeps_no_record_of_its_user(runtime: str, tmp_path: Path) -> None:
    pytest.importorskip(runtime)
    code = (
        "from latentmotion.engine.session import open_session as s;"
        "from latentmotion.model.card import find_model as f;"
        f"s(f('starter') / 'decoder.onnx', {runtime!r}, 1)"
    )
    run(code, HOME=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert list(tmp_path.rglob("*")) == []
