"""Figures for game engines: the same body under other names, carried by a root bone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.errors import InputError
from latentmotion.formats import engines
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.bone_names import match_names
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from latentmotion.retarget import find_humanoid
from tests.support.walker import walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(24).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), caption="a person walks")


@pytest.mark.parametrize(("name", "known"), [("unreal", "Unreal"), ("unity", "VRM")])
def test_the_body_is_the_same_and_its_root_on_the_floor(
    name: engines.EngineName, known: str, motion: Motion, tmp_path: Path
) -> None:
    figure = engines.for_engine(motion, name)
    assert match_names(figure.skeleton.names).convention == known
    assert find_humanoid(figure.skeleton).pelvis == 1
    np.testing.assert_allclose(figure.joints[:, 1:], motion.joints, atol=1e-5)
    assert (figure.joints[:, 0, 1] == 0).all()
    path = figure.joints[:, 0] - figure.joints[:, 1]
    assert np.linalg.norm(path[:, [0, 2]], axis=-1).max() < 0.7
    assert np.ptp(figure.joints[:, 0], axis=0).max() > 0.5
    formats.save(tmp_path / "a.glb", [figure, figure])
    found = read_animations(tmp_path / "a.glb")
    assert len(found) == 2 and found[0].skeleton.names == figure.skeleton.names
    np.testing.assert_allclose(found[0].joints(), figure.joints, atol=1e-5)
    again = formats.load(tmp_path / "a.glb")[0]
    np.testing.assert_allclose(again.joints, motion.joints, atol=1e-5)


def test_the_mannequin_stays_the_mannequin(motion: Motion) -> None:
    figure = engines.for_engine(motion, "unreal").animation().skeleton
    ours, theirs = (engines.mannequin_of(s) for s in (motion.animation().skeleton, figure))
    np.testing.assert_allclose(theirs.vertices - figure.offsets[1], ours.vertices, atol=1e-9)
    np.testing.assert_array_equal(theirs.joints, ours.joints + 1)


def test_what_has_no_such_bones_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    kit = Motion(np.random.default_rng(0).normal(size=(4, 21, 3)).astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="not for 'kit'"):
        engines.for_engine(kit, "unity")
    with pytest.raises(SystemExit):
        main(["generate", "a", "--preset", "unity", "-o", str(tmp_path / "a.npz")])
    assert "--preset unity cannot be written as" in capsys.readouterr().err
