"""The add-on for Blender without Blender: the zip, its files, the command that it runs."""

from __future__ import annotations

import ast
import importlib.util
import os
import stat
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from latentmotion.blender import SOURCE, build_zip, own_command
from latentmotion.cli.main import main
from latentmotion.control.goals import Reach, RootPath
from latentmotion.control.scene import read_scene
from latentmotion.control.timeline import Span
from latentmotion.errors import InputError
from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.walker import walker

FILES = sorted(SOURCE.glob("*.py"))
IN_BLENDER = {"bpy", "mathutils", "numpy", "__future__"}


def part(name: str) -> ModuleType:
    """A file of the add-on that needs no Blender."""
    spec = importlib.util.spec_from_file_location(f"addon_{name}", SOURCE / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


command, bvh, directing = part("command"), part("bvh"), part("directing")
PLACE = directing.Place((1.0, 2.0, 0.0), 0.0, 11, 25.0)


def test_the_command_writes_the_zip(tmp_path: Path, capsys):
    main(["blender-addon", "-o", str(tmp_path / "a.zip")])
    assert f"wrote {tmp_path / 'a.zip'}" in capsys.readouterr().out
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.testzip() is None
        names = set(archive.namelist())
        expected = {file.name for file in FILES} | {"blender_manifest.toml"}
        expected |= {"command.txt"} if own_command() else set()
        assert names == {f"latentmotion_blender/{name}" for name in expected}


def test_the_same_zip_each_time_and_no_path_of_this_machine_if_not_wanted(tmp_path: Path):
    main(["blender-addon", "-o", str(tmp_path / "a.zip"), "--no-remember"])
    build_zip(tmp_path / "b.zip")
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert not [name for name in archive.namelist() if name.endswith(".txt")]


def test_bad_names_are_refused(tmp_path: Path):
    with pytest.raises(SystemExit, match="2"):
        main(["blender-addon", "-o", str(tmp_path / "a.tar")])
    with pytest.raises(InputError, match="does not exist"):
        build_zip(tmp_path / "nowhere" / "a.zip")
    assert not list(tmp_path.iterdir())


def test_the_manifest_is_what_blender_wants():
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text())
    assert manifest["schema_version"] == "1.0.0"
    assert manifest["id"] == SOURCE.name
    assert manifest["id"].isidentifier()
    assert manifest["type"] == "add-on"
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["license"] == ["SPDX:MIT"]
    assert len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert all(len(reason) <= 64 for reason in manifest["permissions"].values())
    about = next(
        ast.literal_eval(node.value)
        for node in ast.parse((SOURCE / "__init__.py").read_text()).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "bl_info"
    )
    assert about["blender"] == (4, 2, 0)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_files_import_only_what_blender_has(file: Path):
    tree = ast.parse(file.read_text(), feature_version=(3, 11))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            modules = [node.module or ""]
        else:
            continue
        tops = {module.partition(".")[0] for module in modules}
        assert tops <= IN_BLENDER | sys.stdlib_module_names, ast.unparse(node)


def test_takes_are_read_as_we_wrote_them(tmp_path: Path):
    animation = walker(20)
    write_bvh(tmp_path / "a.bvh", animation)
    take = bvh.read_take(tmp_path / "a.bvh")
    order = [take.names.index(name) for name in animation.skeleton.names]
    joints = take.positions[:, 0][:, None] + np.zeros((20, len(order), 3))
    for joint, parent in enumerate(take.parents):
        if parent >= 0:
            away = np.einsum("tab,tb->ta", take.rotations[:, parent], take.positions[:, joint])
            joints[:, joint] = joints[:, parent] + away
    np.testing.assert_allclose(joints[:, order], animation.joints(), atol=1e-5)
    np.testing.assert_allclose(take.rest()[order], animation.skeleton.rest_joints(), atol=1e-6)
    with pytest.raises(ValueError, match="not a BVH"):
        (tmp_path / "b.bvh").write_text("solid cube")
        bvh.read_take(tmp_path / "b.bvh")


def test_rest_poses_are_read_as_the_addon_writes_them(tmp_path: Path):
    skeleton = walker(1).skeleton
    rest = skeleton.rest_joints() + np.array((0, 0.9, 0.1))
    movable = [parent < 1 for parent in skeleton.parents]
    tips = rest + np.array((0, 0.1, 0))
    bvh.write_rest(tmp_path / "a.bvh", skeleton.names, skeleton.parents, rest, tips, movable)
    read = read_bvh(tmp_path / "a.bvh")
    joints = read.joints()[0]
    order = [read.skeleton.names.index(name) for name in skeleton.names]
    np.testing.assert_allclose(joints[order], rest, atol=1e-6)
    tip = read.skeleton.names.index("head_end")
    np.testing.assert_allclose(joints[tip], tips[skeleton.names.index("head")], atol=1e-6)


def script(path: Path, body: str) -> str:
    """A command that is a Python script."""
    path.write_text(f"#!{sys.executable}\nimport os, sys, time\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


posix = pytest.mark.skipif(os.name == "nt", reason="needs scripts with a first line")


@posix
def test_the_command_is_found_where_it_usually_is(tmp_path: Path, monkeypatch):
    for name in ("VIRTUAL_ENV", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    assert command.find_command() is None
    project = tmp_path / "film" / ".venv" / "bin"
    project.mkdir(parents=True)
    there = script(project / "latentmotion", "")
    assert command.find_command() is None
    assert command.find_command("", tmp_path / "film") == there
    assert command.find_command(there) == there
    assert command.find_command(str(tmp_path / "film" / ".venv")) == there
    assert command.find_command(str(tmp_path / "nothing"), tmp_path / "film") is None
    monkeypatch.setenv("PATH", str(project))
    assert command.find_command() == there


@posix
def test_calls_run_in_order_and_nobody_waits(tmp_path: Path):
    log, start = tmp_path / "log", tmp_path / "start"
    waiting = f"while not os.path.exists({str(start)!r}): time.sleep(0.01)"
    made = script(tmp_path / "a", f"{waiting}\nopen({str(log)!r}, 'a').write(sys.argv[1])")
    asked = []

    def calls():
        for word in "xy":
            asked.append((word, log.read_text() if log.exists() else ""))
            yield [made, word]

    job = command.CommandJob(calls(), tmp_path)
    assert not job.is_done()
    start.touch()
    job.wait()
    assert job.is_done() and not job.error
    assert asked == [("x", ""), ("y", "x")]
    assert log.read_text() == "xy"


@posix
def test_errors_are_the_commands_own_line(tmp_path: Path):
    bad = script(tmp_path / "a", "sys.exit('warning: so so\\nerror: no such thing; do that')")
    job = command.CommandJob([[bad], [bad]], tmp_path)
    job.wait()
    assert job.error == "no such thing; do that"
    silent = command.CommandJob([[script(tmp_path / "b", "sys.exit(3)")]], tmp_path)
    silent.wait()
    assert "code 3" in silent.error
    missing = command.CommandJob([[str(tmp_path / "c")]], tmp_path)
    missing.wait()
    assert "cannot run" in missing.error


@posix
def test_a_job_can_be_ended(tmp_path: Path):
    late = tmp_path / "late"
    slow = script(tmp_path / "a", f"time.sleep(600); open({str(late)!r}, 'w').close()")
    job = command.CommandJob([[slow]] * 2, tmp_path)
    assert not job.is_done()
    job.cancel()
    assert job.is_done() and not late.exists()


class Thing(dict[str, object]):
    """An object of Blender with its custom properties."""

    def __init__(self, name: str, kind: str = "EMPTY", **properties: object) -> None:
        super().__init__(properties)
        self.name, self.type = name, kind


def keyed(path: str, *frames: float) -> SimpleNamespace:
    keys = [SimpleNamespace(co=(frame, 0.0)) for frame in frames]
    return SimpleNamespace(data_path=path, keyframe_points=keys)


def test_goals_become_a_scene_that_the_command_reads(tmp_path: Path):
    goals = [
        directing.Goal("right_wrist", 61, (1.5, 1.0, 1.2)),
        directing.Goal("head", 36, (1, 2, 1.6)),
    ]
    scene = directing.goal_scene("a person walks", 4.0, goals, [(1, 2, 0), (1, 0, 0)], PLACE)
    directing.write_scene(scene, tmp_path / "scene.json")
    read = read_scene(tmp_path / "scene.json")
    assert (read.prompt, read.seconds) == ("a person walks", 4.0)
    assert read.all_goals(tmp_path) == [
        RootPath(((0.0, 0.0), (0.0, 2.0))),
        Reach("head", 1.0, (0.0, 1.6, 0.0)),
        Reach("right_wrist", 2.0, (0.5, 1.2, 1.0)),
    ]


def test_places_turn_with_the_figure():
    # Rotated a quarter to the left, seen from above, a figure that faced -y faces +x.
    place = directing.Place((0.0, 0.0, 0.0), np.pi / 2, 1, 24.0)
    assert place.inside((2.0, 0.0, 1.0)) == (0.0, 1.0, 2.0)
    assert place.inside((0.0, 2.0, 1.0)) == (2.0, 1.0, 0.0)


def test_empties_have_a_joint_and_frames():
    assert set(HUMANML3D.names) == directing.JOINTS
    assert directing.joint_of(Thing("right_wrist.001")) == "right_wrist"
    assert directing.joint_of(Thing("door", joint="right_wrist")) == "right_wrist"
    assert directing.joint_of(Thing("door")) is None
    assert directing.joint_of(Thing("head", "MESH")) is None
    with pytest.raises(ValueError, match="door has the joint 'hand'; known are head"):
        directing.joint_of(Thing("door", joint="hand"))
    curves = [keyed("location", 30, 12), keyed("location", 12), keyed("rotation_euler", 50)]
    assert directing.frames_of(Thing("head"), curves) == [12, 30]
    assert directing.frames_of(Thing("head", frame=20), curves) == [20]
    with pytest.raises(ValueError, match="head has no time: key its location"):
        directing.frames_of(Thing("head"), curves[2:])


def test_paths_are_points_on_the_curve():
    corner = [SimpleNamespace(co=(x, y, 0.0, 1.0)) for x, y in ((0, 0), (0, 2), (1, 2))]
    poly = SimpleNamespace(type="POLY", points=corner)
    assert directing.path_points([poly]) == [(0, 0, 0), (0, 2, 0), (1, 2, 0)]
    ends = [
        SimpleNamespace(co=(0, 0, 0), handle_left=(-1, 0, 0), handle_right=(1, 0, 0)),
        SimpleNamespace(co=(3, 0, 0), handle_left=(2, 0, 0), handle_right=(4, 0, 0)),
    ]
    found = np.array(directing.path_points([SimpleNamespace(type="BEZIER", bezier_points=ends)]))
    np.testing.assert_allclose(
        found, np.outer(np.linspace(0, 3, len(found)), (1, 0, 0)), atol=1e-12
    )
    with pytest.raises(ValueError, match="has 2 splines"):
        directing.path_points([poly, poly])
    with pytest.raises(ValueError, match="type NURBS: make it Bezier or Poly"):
        directing.path_points([SimpleNamespace(type="NURBS")])


def test_markers_become_a_timeline(tmp_path: Path):
    markers = [("a person sits down", 86), ("F_20", 20), ("a person jumps", 61)]
    scene = directing.marker_scene("a person walks", markers, PLACE, 135)
    directing.write_scene(scene, tmp_path / "scene.json")
    spans = [Span("a person walks", 2), Span("a person jumps", 1), Span("a person sits down", 2)]
    assert read_scene(tmp_path / "scene.json").timeline == tuple(spans)
    last = directing.marker_scene("", markers, PLACE, 61)["timeline"][-1]
    assert last == {"prompt": "a person sits down"}


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: directing.goal_scene("a", 4, [], [], PLACE), "no goals: name an empty"),
        (
            lambda: directing.goal_scene("a", 4, [directing.Goal("head", 3, (0, 0, 0))], [], PLACE),
            "head has a goal in frame 3, before the scene's first, 11",
        ),
        (lambda: directing.marker_scene("a", [("F_1", 1)], PLACE, 99), "no markers: add some"),
        (
            lambda: directing.marker_scene("a", [("b", 20), ("c", 20)], PLACE, 99),
            "'b' and 'c' are at one frame",
        ),
    ],
)
def test_scenes_that_cannot_be_directed_say_why(call, error: str):
    with pytest.raises(ValueError, match=error):
        call()
