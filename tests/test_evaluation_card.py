"""The figures of a card: a motion of the training set is found again, and the command writes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.card import measure, real_figures, reconstruction
from latentmotion.model_card import read_card
from latentmotion.models import find_model
from latentmotion.vae.convolutional import ConvolutionalVAEConfig
from moving_figures import write_moving_figures


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_moving_figures(tmp_path_factory.mktemp("data") / "figures", train=4, val=2)


def test_a_training_clip_is_its_own_nearest(data: Path) -> None:
    dataset = Dataset.load(data)
    clips = [dataset.features(clip) for clip in dataset.clips("train")]
    seen = measure([dataset.representation.decode(features) for features in clips], dataset)
    assert seen.motions == 4
    assert seen.nearest_clip_mm == pytest.approx(0, abs=1.0)
    assert real_figures(dataset, "val").nearest_clip_mm > 20


def test_reconstruction_of_an_untrained_vae_is_bad_but_finite(data: Path) -> None:
    vae = ConvolutionalVAEConfig(width=8, channels=4).build().eval()
    error = reconstruction(vae, Dataset.load(data), "val")
    assert np.isfinite(error) and error > 10


def test_a_split_without_captions_is_named(data: Path) -> None:
    with pytest.raises(DataError, match="no captioned clip in its test split"):
        real_figures(Dataset.load(data), "test")


def test_the_command_writes_the_figures_into_the_card(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(find_model("starter"), tmp_path / "model")
    main(["evaluate", str(tmp_path / "model"), "--data", str(data), "--split", "val"])
    assert "| generated |" in capsys.readouterr().out
    figures = read_card(tmp_path / "model").figures
    assert figures["generated"]["motions"] == figures["real"]["motions"] == 2
    assert set(figures["reconstruction_mpjpe_mm"]) == {"train", "val"}
