"""Prepared folders and captions of others: links, NaN, spans that are no times."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from latentmotion.data.clip import Source, fit_sentences, parse_sentences
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.humanml3d import read_texts
from latentmotion.data.sources.own import OwnMotions, _read_csv
from latentmotion.errors import DataError, InputError, LatentMotionError
from latentmotion.kinematics.skeleton import interpolate
from tests.support import damaged
from tests.support.moving_figures import write_moving_figures


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_moving_figures(tmp_path / "data", train=1, val=1)


def shard_of(folder: Path) -> Path:
    return next(folder.glob("*.safetensors"))


def test_a_shard_that_is_a_link_to_another_folder(folder: Path, tmp_path: Path) -> None:
    shard = shard_of(folder)
    shard.rename(tmp_path / "elsewhere.safetensors")
    shard.symlink_to(tmp_path / "elsewhere.safetensors")
    with pytest.raises(DataError, match="lies in another folder"):
        Dataset.load(folder)


@pytest.mark.parametrize("name", ["../secret.safetensors", "/etc/passwd"])
def test_a_shard_by_a_path(name: str, folder: Path) -> None:
    (folder.parent / "secret.safetensors").write_bytes(b"")
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["shards"][0]["file"] = name
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="lies in another folder"):
        Dataset.load(folder)


@pytest.mark.parametrize("change", ["nan", "float64", "narrow"])
def test_features_that_are_not_what_the_manifest_says(change: str, folder: Path) -> None:
    features = load_file(shard_of(folder))["features"].copy()
    if change == "nan":
        features[:] = np.nan
    features = features.astype("f8") if change == "float64" else features
    features = features[:, 1:].copy() if change == "narrow" else features
    save_file({"features": features}, shard_of(folder))
    dataset = Dataset.load(folder)
    with pytest.raises(DataError, match=r"motions-000\.safetensors"):
        dataset.features(dataset.clips("train")[0])


@pytest.mark.parametrize("span", ["inf#inf", "0#inf", "1e308#1e309", "-inf#2", "nan#inf"])
def test_captions_with_spans_that_are_no_times(span: str) -> None:
    captions, reasons = fit_sentences(parse_sentences(f"he waves.#he/PRON#{span}"), 40)
    assert not captions and len(reasons) == 1


def test_latin_1_captions_and_rates_beside_own_motions(tmp_path: Path) -> None:
    damaged.arrays(tmp_path / "a.npz", fps=np.array([0.01]))
    damaged.arrays(tmp_path / "b.npz")
    (tmp_path / "b.txt").write_bytes("Grüße".encode("latin1"))
    found = list(OwnMotions(tmp_path, Source("own", "mine", "me")).recordings())
    reasons = [item.reason for item in found if hasattr(item, "reason")]
    assert sum("b.txt" in reason and "not UTF-8" in reason for reason in reasons) == 1
    assert sum("0.01 frames per second are too few" in reason for reason in reasons) == 1


def test_own_csv(tmp_path: Path) -> None:
    path = tmp_path / "captions.csv"
    for text in ("file,caption\na,caf\xe9", f"file,caption\na,{'x' * 200_000}"):
        path.write_bytes(text.encode("latin1"))
        with pytest.raises(DataError, match=r"captions\.csv"):
            _read_csv(path)
    path.write_text("file,caption,from,to\na,he waves,inf,2")
    with pytest.raises(DataError, match=r"captions\.csv:2: expected seconds"):
        _read_csv(path)


def test_texts_that_are_no_text(tmp_path: Path) -> None:
    import lzma

    (tmp_path / "texts.json.xz").write_bytes(lzma.compress(b'{"a": 1}'))
    with pytest.raises(DataError, match="captions by id"):
        read_texts(tmp_path)
    (tmp_path / "texts.json.xz").write_bytes(lzma.compress(b'{"a": "' + b"x" * 80_000_000 + b'"}'))
    with pytest.raises(LatentMotionError, match="unpack to more"):
        read_texts(tmp_path)


def test_too_many_frames_in_between() -> None:
    with pytest.raises(InputError, match="check the frame rate"):
        interpolate(np.zeros((3, 22, 3)), 1e-9)
    assert math.isclose(len(interpolate(np.zeros((3, 22, 3)), 0.5)), 5)
