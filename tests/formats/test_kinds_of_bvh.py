"""Other people's BVH: the same walk, whatever unit, axes and rest pose a program writes it in."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.data.clip import Source
from latentmotion.data.recording import Recording
from latentmotion.data.sources.own import OwnMotions
from latentmotion.errors import DataError, InputError
from latentmotion.formats.bvh import read_bvh
from latentmotion.kinematics.standing import Stated
from latentmotion.motion import Motion
from latentmotion.retarget import read_rig
from latentmotion.retarget.transfer import write
from tests.support.bvh_kinds import KINDS, walk

pytestmark = pytest.mark.filterwarnings("ignore:.*a guess:latentmotion.errors.ReadingWarning")


@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_is_of_life_size_and_upright(kind: str, tmp_path: Path) -> None:
    motion, meant = Motion.load(KINDS[kind](tmp_path / "a.bvh")), walk()
    # CMU's skeleton has no joints where the chest and the collars of ours are.
    np.testing.assert_allclose(motion.joints, meant.joints, atol=0.05 if "CMU" in kind else 0.01)
    assert motion.recorded is not None
    again = motion.recorded.animation.joints()[:, motion.recorded.body.joints["left_ankle"]]
    np.testing.assert_allclose(again, meant.joints[:, 7], atol=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_a_guess_is_told_in_one_line(kind: str, tmp_path: Path) -> None:
    path = KINDS[kind](tmp_path / "a.bvh")
    certain = (
        "centimeters, y up",
        "facing backward at rest",
        "bones along one axis",
        "bones in a heap",
        "of LAFAN1",
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        formats.load(path)
    lines = [str(one.message) for one in told]
    assert len(lines) == (kind not in certain)
    for line in lines:
        assert re.fullmatch(rf"{path}: a guess: [^\n]*\(or --(unit|up)\)", line)


@pytest.mark.parametrize("kind", KINDS)
def test_as_a_target_it_stands_on_its_own_floor(kind: str, tmp_path: Path) -> None:
    path, out = KINDS[kind](tmp_path / "a.bvh"), tmp_path / "out.bvh"
    rig = read_rig(path)
    write(out, rig, [walk(24)])
    heads = [file.read_text().partition("MOTION")[0] for file in (path, out)]
    assert heads[0] == heads[1]
    up = rig.axes[:, 1]
    lowest = [rig.meters * (read_bvh(file, 1.0).joints() @ up).min() for file in (path, out)]
    assert abs(lowest[1] - lowest[0]) < 0.01
    ahead = -1 if "backward" in kind else 1  # the way that the character faces at rest
    shown = Motion.load(out).joints * (ahead, 1, ahead)
    np.testing.assert_allclose(shown, walk(24).joints, atol=0.06)


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_motion_comes_back_as_it_is(kind: str, tmp_path: Path) -> None:
    path, out = KINDS[kind](tmp_path / "a.bvh"), tmp_path / "out.bvh"
    write(out, read_rig(path), [Motion.load(path)])
    before, after = (read_bvh(file, 1.0) for file in (path, out))
    np.testing.assert_allclose(after.rotations, before.rotations, atol=0.005)
    scale = np.abs(before.joints()).max()
    np.testing.assert_allclose(after.joints(), before.joints(), atol=0.002 * scale)


def test_a_folder_is_guessed_file_by_file(tmp_path: Path) -> None:
    for number, kind in enumerate(KINDS):
        KINDS[kind](tmp_path / f"{number}.bvh")
    items = list(OwnMotions(tmp_path, Source("own", "mine", "me")).recordings())
    assert len(items) == len(KINDS)
    for item in items:
        assert isinstance(item, Recording)
        np.testing.assert_allclose(item.joints[-1], walk().joints[-1], atol=0.05)


def test_what_is_stated_beats_the_guess(tmp_path: Path) -> None:
    path = KINDS["cmu, y up"](tmp_path / "a.bvh")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for unit in ("cmu", 0.0564444, "0.0564444"):
            found = Motion.load(path, Stated(unit=unit))
            np.testing.assert_allclose(found.joints, walk().joints, atol=0.01)
    with pytest.raises(DataError, match=r"--unit meters makes its legs 14\.\d m long"):
        Motion.load(path, Stated(unit="meters"))
    faster = Motion.load(path, Stated("cmu", fps=60.0))
    assert faster.fps == 60 and len(faster) == len(walk())
    with pytest.raises(InputError, match="did you mean 'meters'"):
        Stated(unit="meter")
    with pytest.raises(InputError, match="expected y, z"):
        Stated(up="w")
