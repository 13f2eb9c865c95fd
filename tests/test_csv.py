"""CSV of joints: to a micrometer there and back; what is wrong is named with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError
from latentmotion.kinematics.skeleton import BODY, KIT
from latentmotion.motion import Motion
from walker import walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Motion(walker(12).joints().astype("f4"), fps=24)


def test_there_and_back(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.csv")
    read = Motion.load(tmp_path / "a.csv")
    assert (read.fps, len(read)) == (24, 12)
    np.testing.assert_allclose(read.joints, motion.joints, atol=6e-7)
    first, second = (tmp_path / "a.csv").read_text().splitlines()[:2]
    assert first.startswith("time,pelvis_x,pelvis_y,pelvis_z,left_hip_x")
    assert second.startswith("0.000000,")


def test_takes_are_files_and_skeletons_are_known(motion: Motion, tmp_path: Path):
    assert [path.name for path in formats.save(tmp_path / "a.csv", [motion, motion])] == [
        *("a-1.csv", "a-2.csv")
    ]
    for skeleton in (KIT, BODY):
        still = Motion(skeleton.rest_joints()[None].astype("f4"), skeleton=skeleton)
        still.save(tmp_path / "b.csv")
        read = Motion.load(tmp_path / "b.csv")
        assert (read.skeleton is skeleton, len(read), read.fps) == (True, 1, 20)


def test_other_columns_and_orders(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.csv")
    rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()]
    shuffled = [["note", *reversed(row)] for row in rows]
    (tmp_path / "b.csv").write_bytes(
        b"\xef\xbb\xbf" + "\r\n".join(",".join(row) for row in shuffled).encode()
    )
    np.testing.assert_allclose(Motion.load(tmp_path / "b.csv").joints, motion.joints, atol=6e-7)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda text: text.replace("0.041667", "NaN"), r":3: found 'NaN'"),
        (lambda text: text.replace("pelvis_y", "hip"), r":1: lacks the columns pelvis_y"),
        (lambda text: text[: len(text) // 2], r"values, expected 67|found ''"),
        (lambda text: text.splitlines()[0], r":1: .*no frame"),
        (lambda text: text.replace("0.041667", "0.051667"), "evenly"),
        (lambda text: text.replace("0.458333", "0.000000"), "evenly"),
        (lambda text: "", "empty"),
        (lambda text: text + "\0", "binary"),
    ],
)
def test_damaged_files_are_named(motion: Motion, tmp_path: Path, change, says: str):
    motion.save(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text(change((tmp_path / "a.csv").read_text()))
    with pytest.raises(FileFormatError, match=says):
        Motion.load(tmp_path / "b.csv")
