from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data import store
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.inspection import inspect_folder
from latentmotion.data.prepare import merge
from latentmotion.data.store import MANIFEST, StoredNormalizer
from latentmotion.errors import DataError, InputError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from tests.support.moving_figures import motion, write_moving_figures


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_moving_figures(tmp_path / "set")


def test_features_come_back_exactly(folder: Path) -> None:
    generator = np.random.default_rng(0)
    originals = [motion(generator, number, "train") for number in range(10)]
    dataset = Dataset.load(folder)
    clips = dataset.clips("train")
    assert [clip.id for clip in clips] == [m.clip.id for m in originals]
    for clip, original in zip(clips, originals, strict=True):
        np.testing.assert_array_equal(dataset.features(clip), original.features)


def test_shards_are_split_between_clips(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "SHARD_FRAMES", 100)
    merge([folder], tmp_path / "small")
    whole, small = Dataset.load(folder), Dataset.load(tmp_path / "small")
    assert len(small.manifest.shards) > 3
    for clip in whole.clips("train"):
        np.testing.assert_array_equal(whole.features(clip), small.features(clip))


def test_mirrored_copies_follow_their_clips(folder: Path) -> None:
    dataset = Dataset.load(folder)
    clips = dataset.clips("train", mirrored=True)
    assert len(clips) == 20
    clip, copy = clips[:2]
    assert copy.id == f"M{clip.id}"
    assert copy.mirrored
    assert "left" in clip.captions[0].text
    assert "right" in copy.captions[0].text
    joints, mirrored = (dataset.representation.decode(dataset.features(c)) for c in (clip, copy))
    order = list(dataset.representation.skeleton.mirror)
    np.testing.assert_allclose(mirrored, (joints * [-1, 1, 1])[:, order], atol=1e-5)


def test_unknown_split_and_clip(folder: Path) -> None:
    dataset = Dataset.load(folder)
    with pytest.raises(DataError, match="train, val, test"):
        dataset.clips("training")
    stranger = motion(np.random.default_rng(0), 77, "train").clip.clip()
    with pytest.raises(DataError, match="no clip '077'"):
        dataset.features(stranger)


def test_no_such_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder; make one with"):
        Dataset.load(tmp_path / "nothing")
    with pytest.raises(DataError, match="found a folder without it"):
        Dataset.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.pop("clips"), "missing key 'clips'"),
        (lambda m: m.update(format="latentmotion dataset 9"), "expected format"),
        (lambda m: m.update(representation="humanml4d"), "humanml3d"),
        (lambda m: m.update(fpss=20), "did you mean 'fps'"),
        (lambda m: m["clips"][0].update(offset=10**6), "outside its shard"),
        (lambda m: m["shards"][0].update(file="gone.safetensors"), "lacks gone.safetensors"),
    ],
)
def test_a_damaged_manifest(folder: Path, change, message: str) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    change(manifest)
    (folder / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=message):
        Dataset.load(folder)


def test_a_manifest_that_is_no_json(folder: Path) -> None:
    (folder / MANIFEST).write_text("{")
    with pytest.raises(DataError, match="not JSON"):
        Dataset.load(folder)


def test_a_damaged_shard_is_found(folder: Path) -> None:
    shard = next(folder.glob("*.safetensors"))
    data = bytearray(shard.read_bytes())
    data[-100] ^= 1
    shard.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        inspect_folder(folder)
    shard.write_bytes(data[:2000])
    dataset = Dataset.load(folder)
    with pytest.raises(DataError, match="damaged"):
        dataset.features(dataset.clips("train")[0])


def test_other_folders_are_never_overwritten(tmp_path: Path, folder: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("...")
    with pytest.raises(InputError, match=r"has no manifest\.json"):
        merge([folder], precious)
    assert (precious / "thesis.tex").is_file()
    merge([folder], tmp_path / "new" / "below")
    assert (tmp_path / "new" / "below" / "manifest.json").is_file()


def test_merging(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(DataError, match="two clips are called"):
        merge([folder, folder], tmp_path / "both")
    with pytest.raises(DataError, match="nothing to merge"):
        merge([], tmp_path / "both")
    assert not (tmp_path / "both").exists()
    report = merge([folder], tmp_path / "one")
    assert sum(part.clips for part in report.parts) == 13
    assert "all" in report.text()


def test_the_normalizer_is_fit_on_train_and_mirrored(tmp_path: Path, folder: Path) -> None:
    merge([folder], tmp_path / "one")
    dataset = Dataset.load(tmp_path / "one")
    clips = dataset.clips("train", mirrored=True)
    every = np.concatenate([dataset.normalizer.normalize(dataset.features(c)) for c in clips])
    np.testing.assert_allclose(every.mean(axis=0), 0, atol=1e-4)
    mean = dataset.normalizer.mean
    np.testing.assert_allclose(HUMANML3D_FEATURES.mirror(mean[None])[0], mean, atol=1e-6)


def test_nothing_to_write(tmp_path: Path) -> None:
    source = Source("x", "y", "z")
    normalizer = StoredNormalizer("", (0.0,), (1.0,))
    with pytest.raises(DataError, match="no clip is left"):
        store.write_dataset(tmp_path / "a", [], (source,), HUMANML3D_FEATURES, normalizer)
