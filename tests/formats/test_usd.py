"""USD: UsdSkel's own query agrees, takes come back, foreign axes and units become ours."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import DiskFullError, FileFormatError, InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from tests.support.walker import walker

pxr = pytest.importorskip("pxr")
from pxr import Gf, Usd, UsdGeom, UsdSkel  # noqa: E402

from latentmotion.formats import usd_reader  # noqa: E402

ENDINGS = (".usda", ".usdc", ".usdz", ".usd")


@pytest.fixture(scope="module")
def takes() -> list[Motion]:
    joints = walker(30).joints().astype("f4")
    first = Motion(joints, caption="jemand läuft", metadata={"seed": 7})
    return [first, Motion(joints[:12] * 1.1, fps=30)]


@pytest.mark.parametrize("ending", ENDINGS)
def test_takes_come_back(takes: list[Motion], tmp_path: Path, ending: str):
    formats.save(tmp_path / f"a{ending}", takes)
    read = formats.load(tmp_path / f"a{ending}")
    assert [(m.caption, m.fps, len(m)) for m in read] == [("jemand läuft", 20, 30), ("", 30, 12)]
    assert read[0].metadata == {"seed": 7}
    for found, take in zip(read, takes, strict=True):
        assert np.linalg.norm(found.joints - take.joints, axis=-1).max() < 1e-3
    assert [path.name for path in tmp_path.iterdir()] == [f"a{ending}"]


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


def test_one_frame_keeps_the_rate(takes: list[Motion], tmp_path: Path):
    formats.save(tmp_path / "a.usda", [replace(takes[0], joints=takes[0].joints[:1], fps=24.0)])
    (read,) = formats.load(tmp_path / "a.usda")
    assert (read.fps, len(read)) == (24, 1)


def test_one_frame_and_another_skeleton(tmp_path: Path):
    kit = Motion(KIT.rest_joints()[None].astype("f4"), fps=12.5, skeleton=KIT)
    kit.save(tmp_path / "a.usda")
    read = Motion.load(tmp_path / "a.usda")
    assert (read.skeleton is KIT, len(read)) == (True, 1)
    np.testing.assert_allclose(read.joints, kit.joints, atol=1e-4)


def test_axes_units_and_turned_rests(tmp_path: Path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetTimeCodesPerSecond(24)
    bones = UsdSkel.Skeleton.Define(stage, "/Bones")
    UsdGeom.Xformable(bones).AddTranslateOp().Set(Gf.Vec3d(10, 0, 0))
    hips = Gf.Matrix4d(Gf.Rotation(Gf.Vec3d(0, 0, 1), 30), Gf.Vec3d(0, 0, 100))
    bones.CreateJointsAttr(["hips", "hips/tip"])
    bones.CreateRestTransformsAttr([hips, Gf.Matrix4d(1).SetTranslate(Gf.Vec3d(0, 50, 0))])
    take = UsdSkel.Animation.Define(stage, "/Take")
    take.CreateJointsAttr(["hips"])
    for frame in range(3):
        turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), 30 + 10 * frame).GetQuat()
        take.CreateRotationsAttr().Set([Gf.Quatf(turn)], frame)
    stage.Save()
    animation = usd_reader.read_takes(tmp_path / "a.usda")[0].animation
    assert (animation.fps, animation.skeleton.names) == (24, ("hips", "tip"))
    np.testing.assert_allclose(animation.root_positions, np.tile([0.1, 1, 0], (3, 1)), atol=1e-6)
    tip = 0.5 * np.array([-0.5, 0, -np.sqrt(0.75)])
    np.testing.assert_allclose(animation.skeleton.offsets[1], tip, atol=1e-6)
    turns = np.radians([[0, angle, 0] for angle in (0, 10, 20)])
    np.testing.assert_allclose(animation.rotations[:, 0], matrix_from_axis_angle(turns), atol=1e-6)
    assert animation.translations is None


def test_takes_of_different_skeletons_are_refused(takes: list[Motion], tmp_path: Path):
    kit = Motion(KIT.rest_joints()[None].astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="share a skeleton"):
        formats.save(tmp_path / "a.usda", [takes[0], kit])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ENDINGS[:3])
def test_damaged_files_are_named(takes: list[Motion], tmp_path: Path, ending: str):
    takes[0].save(tmp_path / f"a{ending}")
    whole = (tmp_path / f"a{ending}").read_bytes()
    bad = tmp_path / f"bad{ending}"
    for size in (5, len(whole) // 2):  # each is read by a process; nothing at all: below
        bad.write_bytes(whole[:size])
        with pytest.raises(FileFormatError, match="bad"):
            formats.load(bad)


def test_files_without_a_figure(tmp_path: Path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.Cube.Define(stage, "/Cube")
    stage.Save()
    with pytest.raises(FileFormatError, match="no skeleton"):
        formats.load(tmp_path / "a.usda")


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


def test_a_file_that_crashes_the_library_is_an_error(tmp_path: Path, monkeypatch):
    (tmp_path / "crash.py").write_text("import os; os.abort()")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(usd_reader, "_PROGRAM", "crash")
    (tmp_path / "a.usdc").write_bytes(b"PXR-USDC")
    with pytest.raises(FileFormatError, match=r"a\.usdc: USD's library ended with -6"):
        usd_reader.read_takes(tmp_path / "a.usdc")


def test_a_layer_of_another_folder_is_refused(tmp_path: Path):
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.usda").write_text('#usda 1.0\ndef Skeleton "a" {\n}\n')
    (tmp_path / "in" / "a.usda").write_text("#usda 1.0\n(\n subLayers = [@../secret.usda@]\n)\n")
    with pytest.raises(FileFormatError, match="expected files in its own folder"):
        usd_reader.read_takes(tmp_path / "in" / "a.usda")


@pytest.mark.parametrize("content", [b"PXR-USDC" + bytes(80), b"PK\x03\x04", b"#usda 1.0\n(", b""])
def test_damaged_layers(content: bytes, tmp_path: Path):
    (tmp_path / "a.usd").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"a\.usd: "):
        usd_reader.read_takes(tmp_path / "a.usd")


CANARIES = ("json", "numpy", "random")  # Modules that a child process imports early.


def command(*words: str, here: Path, before: str = "") -> subprocess.CompletedProcess[str]:
    """Runs the command as users do, in a folder, after a command of the shell."""
    program = str(Path(sys.executable).with_name("latentmotion"))
    line = f"{before}\nexec {shlex.join([program, *words])}"
    return subprocess.run(["bash", "-c", line], cwd=here, capture_output=True, text=True)


def test_code_beside_a_file_is_not_run(takes: list[Motion], tmp_path: Path):
    takes[0].save(tmp_path / "a.usda")
    for name in CANARIES:
        (tmp_path / f"{name}.py").write_text("open('canary', 'w'); raise SystemExit(9)")
    done = command("clean", "a.usda", "-o", "b.bvh", here=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "b.bvh").is_file()
    assert not (tmp_path / "canary").exists()


def test_a_lower_limit_of_the_system_holds(takes: list[Motion], tmp_path: Path):
    takes[0].save(tmp_path / "a.usda")
    words = "clean", "a.usda", "-o", "b.bvh"
    done = command(*words, here=tmp_path, before="ulimit -v 3000000 -t 60")
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_not_the_files_fault_is_not_called_damage(
    takes: list[Motion], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    takes[0].save(tmp_path / "a.usda")
    monkeypatch.setattr(usd_reader, "_PROGRAM", "no_such_program")
    with pytest.raises(InputError, match="says nothing of the file") as raised:
        usd_reader.read_takes(tmp_path / "a.usda")
    assert "damaged" not in str(raised.value)
    monkeypatch.undo()
    with monkeypatch.context() as patch, pytest.raises(DiskFullError, match="temporary file"):
        patch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
        usd_reader.read_takes(tmp_path / "a.usda")
    with monkeypatch.context() as patch, pytest.raises(DiskFullError, match="File too large"):
        patch.setattr(usd_reader.children, "command", partial(limited, usd_reader.children.command))
        usd_reader.read_takes(tmp_path / "a.usda")


def test_errors_do_not_name_the_folder(tmp_path: Path):
    (tmp_path / "a.usdc").write_bytes(b"PXR-USDC" + bytes(80))
    with pytest.raises(FileFormatError) as raised:
        usd_reader.read_takes(tmp_path / "a.usdc")
    assert str(raised.value).count(str(tmp_path)) == 1, "which is the name that was given"


def limited(command: Callable[..., list[str]], *words: str) -> list[str]:
    """Returns a command that may write files of no size, as on a full disk."""
    ignore = "trap '' XFSZ; ulimit -f 0; exec \"$@\""
    return ["bash", "-c", ignore, "bash", *command(*words)]
