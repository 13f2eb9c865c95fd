"""Prepared data and tiny trained models, made once for all tests that only read them."""

from __future__ import annotations

from pathlib import Path

import pytest

from latentmotion.training.stages import train_denoiser, train_vae
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CONTEXT, small
from tests.support.students import write_student


@pytest.fixture(scope="session")
def figures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A prepared folder of ten clips to train on and three to validate with."""
    return write_moving_figures(tmp_path_factory.mktemp("data") / "figures")


@pytest.fixture(scope="session")
def vae_run(figures: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of the small VAE."""
    folder = tmp_path_factory.mktemp("runs") / "vae"
    train_vae(small(), figures, folder, CONTEXT)
    return folder


@pytest.fixture(scope="session")
def student(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The exported folder of a small untrained student."""
    return write_student(tmp_path_factory.mktemp("student"))


@pytest.fixture
def without_pullback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exports leave the decoder's pullback out, which takes longest to trace."""
    monkeypatch.setattr("latentmotion.export.onnx.export_pullback", lambda *_: None)


@pytest.fixture(scope="session")
def unconditional_run(
    figures: Path, vae_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The run folder of the small denoiser that takes no prompts."""
    folder = tmp_path_factory.mktemp("runs") / "denoiser"
    train_denoiser(small(task="unconditional"), figures, vae_run, None, folder, CONTEXT)
    return folder
