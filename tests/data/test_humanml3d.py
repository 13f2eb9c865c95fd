from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.data.recording import Dropped
from latentmotion.data.sources.humanml3d import HUMANML3D, official_normalizer, official_recordings
from latentmotion.errors import DataError
from latentmotion.evaluation.evaluate import PUBLISHED, other_size
from latentmotion.evaluation.protocol import CLEAN, PAPER, Lengths, TestSet
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from tests.support.mocap_folders import write_official, write_splits, write_texts

WIDTHS = {"humanml3d": HUMANML3D_FEATURES, "kit": KIT_FEATURES}


@pytest.mark.parametrize("name", ["humanml3d", "kit"])
def test_an_official_folder(tmp_path: Path, name: str) -> None:
    folder = write_official(tmp_path / "official", WIDTHS[name])
    main(["data", "prepare", name, str(folder), "-o", str(tmp_path / "out")])
    dataset = Dataset.load(tmp_path / "out")
    assert dataset.representation.name == WIDTHS[name].name
    assert dataset.sources[0].name == name
    clip, copy = dataset.clips("train", mirrored=True)
    np.testing.assert_array_equal(
        dataset.features(clip), np.load(folder / "new_joint_vecs/000000.npy")
    )
    np.testing.assert_array_equal(dataset.normalizer.mean, 0.5)
    np.testing.assert_array_equal(dataset.normalizer.std, 2.0)
    assert [(c.text, c.start_frame, c.end_frame) for c in clip.captions] == [
        ("he waves left.", 0, 40),
        ("he stops.", 20, 30),
    ]
    assert clip.captions[0].tokens == "he/PRON wave/VERB left/ADV"
    assert [c.text for c in copy.captions] == ["he waves to the right."]


def test_copies_without_captions_of_their_own_mirror_the_words(tmp_path: Path) -> None:
    folder = write_official(tmp_path / "official", HUMANML3D_FEATURES)
    items = {i.label.id: i for i in official_recordings(folder, HUMANML3D, 263)}
    assert items["000001"].label.mirrored_sentences[0].text == "he waves right."


@pytest.mark.parametrize("name", ["humanml3d", "kit"])
def test_mirrored_ids_of_the_test_split_are_items_of_the_papers_protocol(
    tmp_path: Path, name: str
) -> None:
    folder, ids = (
        write_official(tmp_path / "official", WIDTHS[name]),
        [f"{n:06}" for n in range(50)],
    )
    every, generator = [*ids, *(f"M{one}" for one in ids)], np.random.default_rng(0)
    for one in every:
        features = generator.normal(size=(48, WIDTHS[name].width)).astype(np.float32)
        np.save(folder / "new_joint_vecs" / f"{one}.npy", features)
    write_splits(folder, {**dict.fromkeys(every, "test"), "000099": "train", "M000099": "train"})
    for one in ("000099", "M000099"):
        np.save(folder / "new_joint_vecs" / f"{one}.npy", features)
    shutil.rmtree(folder / "texts")
    write_texts(folder, dict.fromkeys([*every, "000099"], "he waves.#he/PRON#0.0#0.0\n"))
    main(["data", "prepare", name, str(folder), "-o", str(tmp_path / "out")])
    dataset = Dataset.load(tmp_path / "out")
    assert len(dataset.clips("test")) == 50 and len(dataset.clips("train", mirrored=True)) == 2
    clean, paper = (
        TestSet(dataset, rules, "text", Lengths(40, 196, 4)) for rules in (CLEAN, PAPER)
    )
    assert (len(clean.items), len(paper.items)) == (50, 100)
    copy = paper.items[-1].clip
    assert copy.mirrored and copy.id == "M000049"
    expected = np.load(folder / "new_joint_vecs/M000049.npy")
    np.testing.assert_array_equal(dataset.features(copy), expected)
    published = next(row for row in PUBLISHED if row.source == name)
    (warning,) = other_size(paper, published)
    assert f"100 clips and 100 items in test, {published.paper} has {published.clips:,}" in warning
    assert "--protocol paper" in other_size(clean, published)[0]
    exact = replace(published, clips=100, items=100)
    assert not other_size(paper, exact) and other_size(clean, exact)


def test_damaged_folders(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="found no new_joint_vecs"):
        list(official_recordings(tmp_path, HUMANML3D, 263))
    folder = write_official(tmp_path / "official", KIT_FEATURES)
    with pytest.raises(DataError, match=r"expected \(frames, 263\)"):
        list(official_recordings(folder, HUMANML3D, 263))
    with pytest.raises(DataError, match="is it the other data set's"):
        official_normalizer(folder, 263)
    (folder / "Mean.npy").write_bytes(b"no array")
    with pytest.raises(DataError, match=r"Mean.npy: expected a NumPy array"):
        official_normalizer(folder, 251)


def test_clips_that_are_missing_or_not_finite_are_dropped(tmp_path: Path) -> None:
    folder = write_official(tmp_path / "official", HUMANML3D_FEATURES)
    (folder / "new_joint_vecs/000001.npy").unlink()
    np.save(folder / "new_joint_vecs/000002.npy", np.full((40, 263), np.nan))
    items = list(official_recordings(folder, HUMANML3D, 263))
    dropped = {item.id: item.reason for item in items if isinstance(item, Dropped)}
    assert dropped == {
        "000001": "listed in val.txt, but there is no 000001.npy",
        "000002": "features that are not finite",
    }
