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
from types import ModuleType

import numpy as np
import pytest

from latentmotion.blender.build import SOURCE, build_zip, own_command
from latentmotion.cli.main import main
from latentmotion.errors import InputError
from latentmotion.formats.bvh import read_bvh, write_bvh
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


command, bvh = part("command"), part("bvh")


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

    job = command.Job(calls(), tmp_path)
    assert not job.is_done()
    start.touch()
    job.wait()
    assert job.is_done() and not job.error
    assert asked == [("x", ""), ("y", "x")]
    assert log.read_text() == "xy"


@posix
def test_errors_are_the_commands_own_line(tmp_path: Path):
    bad = script(tmp_path / "a", "sys.exit('warning: so so\\nerror: no such thing; do that')")
    job = command.Job([[bad], [bad]], tmp_path)
    job.wait()
    assert job.error == "no such thing; do that"
    silent = command.Job([[script(tmp_path / "b", "sys.exit(3)")]], tmp_path)
    silent.wait()
    assert "code 3" in silent.error
    missing = command.Job([[str(tmp_path / "c")]], tmp_path)
    missing.wait()
    assert "cannot run" in missing.error


@posix
def test_a_job_can_be_ended(tmp_path: Path):
    late = tmp_path / "late"
    slow = script(tmp_path / "a", f"time.sleep(600); open({str(late)!r}, 'w').close()")
    job = command.Job([[slow]] * 2, tmp_path)
    assert not job.is_done()
    job.cancel()
    assert job.is_done() and not late.exists()
