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
from tests.support.fixtures import Once


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
def web_folder(four_steps: Path, once: Once) -> Path:
    """That model for web pages, with exact weights."""
    with unchecked():
        return once("web", lambda folder: export_web(four_steps, folder, "float16"))


@pytest.fixture(scope="session")
def labels_folder(student: Path, once: Once) -> Path:
    """A model of actions for web pages, with exact weights."""
    with unchecked():
        return once("labels", lambda folder: export_web(student, folder, "float16"))
