"""Prepared data and tiny trained models, made once for all tests that only read them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from latentmotion.training.stages import train_denoiser, train_vae
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CONTEXT, small
from tests.support.students import write_student

# Writes a folder of a name with a function, unless another process of the run has written it.
Once = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def folder(name: str, write: Callable[[Path], object]) -> Path:
        written = base / f"{name}.written"
        with FileLock(base / f"{name}.lock"):
            if not written.exists():
                write(base / name)
                written.touch()
        return base / name

    return folder


@pytest.fixture(scope="session")
def figures(once: Once) -> Path:
    """A prepared folder of ten clips to train on and three to validate with."""
    return once("figures", write_moving_figures)


@pytest.fixture(scope="session")
def vae_run(figures: Path, once: Once) -> Path:
    """The run folder of the small VAE."""
    return once("vae", lambda folder: train_vae(small(), figures, folder, CONTEXT))


@pytest.fixture(scope="session")
def student(once: Once) -> Path:
    """The exported folder of a small untrained student."""
    return once("student", write_student) / "model"


@pytest.fixture
def without_pullback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exports leave the decoder's pullback out, which takes longest to trace."""
    monkeypatch.setattr("latentmotion.export.onnx.export_pullback", lambda *_: None)


@pytest.fixture(scope="session")
def unconditional_run(figures: Path, vae_run: Path, once: Once) -> Path:
    """The run folder of the small denoiser that takes no prompts."""
    experiment = small(task="unconditional")
    return once(
        "denoiser",
        lambda folder: train_denoiser(experiment, figures, vae_run, None, folder, CONTEXT),
    )
