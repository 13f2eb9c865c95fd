"""A shipped model, exported for web pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import jaxtyping
import pytest

from latentmotion.export.web import export_web
from latentmotion.model.card import find_model


@pytest.fixture(scope="session")
def four_steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The model `fast` with the fused sampler of four steps alone, which saves time."""
    folder = tmp_path_factory.mktemp("models") / "fast"
    shutil.copytree(find_model("fast"), folder, ignore=shutil.ignore_patterns("fused_[12].onnx"))
    return folder


@contextmanager
def unchecked() -> Iterator[None]:
    """Leaves shapes unchecked: comparing broadcast ones would fix a traced graph's sizes."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def without_shape_checks() -> Iterator[None]:
    with unchecked():
        yield


@pytest.fixture(scope="session")
def web_folder(four_steps: Path) -> Path:
    """That model for web pages, with exact weights."""
    with unchecked():
        export_web(four_steps, four_steps.parent / "web", "float16")
    return four_steps.parent / "web"


@pytest.fixture(scope="session")
def labels_folder(student: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of actions for web pages, with exact weights."""
    folder = tmp_path_factory.mktemp("labels") / "web"
    with unchecked():
        export_web(student, folder, "float16")
    return folder
