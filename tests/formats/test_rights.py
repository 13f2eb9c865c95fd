"""What files and the command line say of rights in a motion, and of the license of the weights."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.model.card import RIGHTS_IN_MOTIONS
from latentmotion.motion import Motion
from tests.support.walker import walker

WEIGHTS = "CC BY-SA 3.0 Unported"
ENDINGS = [".npz", ".amass.npz", ".smpl.npz", ".glb", ".gltf"]
if importlib.util.find_spec("pxr") is not None:
    ENDINGS.append(".usdc")


@pytest.fixture(scope="module")
def made() -> Motion:
    return MotionPipeline.from_pretrained(threads=1)("a person walks", seconds=1)


@pytest.mark.parametrize("ending", ENDINGS)
def test_files_tell_rights_in_the_motion_from_the_license_of_the_weights(
    made: Motion, tmp_path: Path, ending: str
):
    made.save(tmp_path / f"a{ending}")
    read = Motion.load(tmp_path / f"a{ending}").metadata
    assert (read["rights"], read["weights_license"]) == (RIGHTS_IN_MOTIONS, WEIGHTS)
    assert "license" not in read


def test_so_does_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    main(["generate", "a person walks", "--seconds=1", "--json", "-o", str(tmp_path / "a.npz")])
    (told,) = json.loads(capsys.readouterr().out)["motions"]
    assert (told["rights"], told["weights_license"]) == (RIGHTS_IN_MOTIONS, WEIGHTS)


def test_a_license_of_somebody_elses_stays(tmp_path: Path):
    motion = Motion(walker(8).joints().astype(np.float32), metadata={"license": "CC0"})
    motion.save(tmp_path / "a.glb")
    assert Motion.load(tmp_path / "a.glb").metadata == {"license": "CC0"}
