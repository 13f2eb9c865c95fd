"""FBX: how Blender is found and asked; by the true one where LATENTMOTION_BLENDER names it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import InputError, MissingProgramError
from latentmotion.formats import fbx
from latentmotion.motion import Motion
from tests.support.walker import walker

REAL = os.environ.get(fbx.VARIABLE)

WRITES = """
source, target, fps = sys.argv[sys.argv.index("--") + 1 :]
assert open(source, "rb").read(4) == b"glTF"
open(target, "w").write(" ".join(sys.argv[1:]))
print("latentmotion: fbx written")
"""
FAILS = """
print("Error: no exporter")
sys.exit(3)
"""
HALF = """
open(sys.argv[-2], "w").write("half")
raise SystemExit("disk full")
"""


@pytest.fixture
def motion() -> Motion:
    return Motion(walker(6).joints().astype("f4"))


def program(folder: Path, code: str, name: str = "blender") -> Path:
    path = folder / name
    path.write_text(f"#!{sys.executable}\nimport sys\n{code}")
    path.chmod(0o755)
    return path


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_blender_is_asked_in_the_background(motion: Motion, tmp_path: Path, monkeypatch):
    (tmp_path / "out").mkdir()
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, WRITES)))
    assert motion.save(tmp_path / "out" / "a.fbx", fps=60) == [tmp_path / "out" / "a.fbx"]
    said = (tmp_path / "out" / "a.fbx").read_text().split()
    assert said[:3] == ["--background", "--factory-startup", "--python-exit-code"]
    assert said[-1] == "60.0"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a.fbx"]


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_a_python_gets_the_script_alone(motion: Motion, tmp_path: Path, monkeypatch):
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, WRITES, "python3")))
    motion.save(tmp_path / "a.fbx")
    assert (tmp_path / "a.fbx").read_text().split()[1] == "--"


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
@pytest.mark.parametrize(("code", "says"), [(FAILS, "no exporter"), (HALF, "disk full")])
def test_failures_leave_nothing(motion: Motion, tmp_path: Path, monkeypatch, code: str, says: str):
    (tmp_path / "out").mkdir()
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, code)))
    with pytest.raises(InputError, match=says):
        motion.save(tmp_path / "out" / "a.fbx")
    assert not list((tmp_path / "out").iterdir())


def test_without_blender_it_says_where_it_looked(motion: Motion, tmp_path: Path, monkeypatch):
    monkeypatch.delenv(fbx.VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(fbx, "_PLACES", {sys.platform: (str(tmp_path / "Blender*" / "blender"),)})
    monkeypatch.setattr(fbx.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingProgramError, match=r"LATENTMOTION_BLENDER.*Blender\*.*set"):
        motion.save(tmp_path / "a.fbx")
    assert not list(tmp_path.iterdir())
    for version in ("Blender 4.2", "Blender 5.0"):
        (tmp_path / version).mkdir()
        program(tmp_path / version, FAILS)
    assert fbx.find_blender() == tmp_path / "Blender 5.0" / "blender"


def test_a_variable_that_leads_nowhere(motion: Motion, tmp_path: Path, monkeypatch):
    monkeypatch.setenv(fbx.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(MissingProgramError, match="no program"):
        motion.save(tmp_path / "a.fbx")
    with pytest.raises(MissingProgramError, match="no program"):
        formats.check_ending("a.fbx")


@pytest.mark.skipif(not REAL, reason="set LATENTMOTION_BLENDER to try the true one")
def test_blender_writes_fbx(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.fbx")
    content = (tmp_path / "a.fbx").read_bytes()
    assert content.startswith(b"Kaydara FBX Binary")
    assert np.all([name.encode() in content for name in motion.skeleton.names])
