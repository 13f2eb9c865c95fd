"""USD: UsdSkel's own query poses the joints as they are, and each kind of file holds all takes."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from tests.support.walker import walker

pxr = pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdSkel  # noqa: E402


@pytest.fixture(scope="module")
def takes() -> list[Motion]:
    joints = walker(30).joints().astype("f4")
    first = Motion(joints, caption="jemand läuft", metadata={"seed": 7})
    return [first, Motion(joints[:12] * 1.1, fps=30)]


def test_usd_itself_poses_the_joints_so(takes: list[Motion], tmp_path: Path):
    path = takes[0].save(tmp_path / "a.usdc", fps=60)[0]
    stage = Usd.Stage.Open(str(path))
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1)
    assert (stage.GetTimeCodesPerSecond(), stage.GetEndTimeCode()) == (60, 87)
    root = UsdSkel.Root(stage.GetDefaultPrim())
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton(stage.GetPrimAtPath("/Figure/Skeleton")))
    assert [*query.GetSkeleton().GetJointNamesAttr().Get()] == [*takes[0].skeleton.names]
    for frame in (0, 3, 87):
        moves = query.ComputeJointSkelTransforms(frame)
        places = np.array([matrix.ExtractTranslation() for matrix in moves])
        expected = takes[0].resampled(60).joints[frame]
        np.testing.assert_allclose(places, expected, atol=1e-5)
    binding = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    assert [str(skin.GetPrim().GetPath()) for skin in binding[0].GetSkinningTargets()] == [
        "/Figure/Mannequin"
    ]


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usdz", ".usd"])
def test_each_kind_of_file_holds_all_takes(takes: list[Motion], tmp_path: Path, ending: str):
    (path,) = formats.save(tmp_path / f"a{ending}", takes)
    stage = Usd.Stage.Open(str(path))
    animations = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation)]
    notes = [json.loads(prim.GetCustomDataByKey("latentmotion")) for prim in animations]
    assert notes == [{"caption": "jemand läuft", "fps": 20, "seed": 7}, {"caption": "", "fps": 30}]
    lengths = [
        UsdSkel.Animation(prim).GetRotationsAttr().GetNumTimeSamples() for prim in animations
    ]
    assert lengths == [30, 12]
    assert [file.name for file in tmp_path.iterdir()] == [f"a{ending}"]


def test_one_frame_keeps_the_rate(takes: list[Motion], tmp_path: Path):
    still = replace(takes[0], joints=takes[0].joints[:1], fps=24.0)
    stage = Usd.Stage.Open(str(formats.save(tmp_path / "a.usda", [still])[0]))
    assert (stage.GetTimeCodesPerSecond(), stage.GetEndTimeCode()) == (24, 0)


def test_takes_of_different_skeletons_are_refused(takes: list[Motion], tmp_path: Path):
    kit = Motion(KIT.rest_joints()[None].astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="share a skeleton"):
        formats.save(tmp_path / "a.usda", [takes[0], kit])
    assert not list(tmp_path.iterdir())


def test_what_to_install_is_said(tmp_path: Path):
    code = (
        "import sys; sys.modules['pxr'] = None\n"
        "import numpy as np\n"
        "from latentmotion.motion import Motion\n"
        "from latentmotion.errors import MissingExtraError\n"
        "try: Motion(np.zeros((1, 22, 3))).save(sys.argv[1])\n"
        "except MissingExtraError as error: print(error)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "a.usda")]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert 'pip install "latentmotion[usd]"' in said
