"""FBX: how Blender is found and asked; by the true one where LATENTMOTION_BLENDER names it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.data.clip import Source
from latentmotion.data.recording import Recording
from latentmotion.data.sources.own import OwnMotions
from latentmotion.errors import FileFormatError, InputError, MissingProgramError
from latentmotion.formats import fbx
from latentmotion.motion import Motion
from latentmotion.retarget import read_rig
from latentmotion.retarget.transfer import check_output, write
from tests.support.walker import walker

REAL = os.environ.get(fbx.VARIABLE)
NEEDS_BLENDER = pytest.mark.skipif(
    not REAL,
    reason="needs Blender (blender.org): set LATENTMOTION_BLENDER to its program",
)

WRITES = """
source, target, fps = sys.argv[sys.argv.index("--") + 1 :]
assert open(source, "rb").read(4) == b"glTF"
open(target, "w").write(" ".join(sys.argv[1:]))
print("latentmotion: converted")
"""
FAILS = """
print("Error: no exporter")
sys.exit(3)
"""
READS = """
source, target = sys.argv[sys.argv.index("--") + 1 :]
assert open(source, "rb").read(3) == b"FBX"
open(target, "wb").write(open({glb!r}, "rb").read())
print("latentmotion: converted")
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
def test_a_glb_character_moves_into_fbx(motion: Motion, tmp_path: Path, monkeypatch):
    motion.save(tmp_path / "hero.glb")
    rig = read_rig(tmp_path / "hero.glb")
    monkeypatch.setenv(fbx.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(MissingProgramError, match="no program that can run"):
        check_output(rig, tmp_path / "out.fbx")
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, WRITES)))
    assert write(tmp_path / "out.fbx", rig, [motion]) == [tmp_path / "out.fbx"]
    assert (tmp_path / "out.fbx").read_text().split()[-1] == "20.0"


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


@pytest.fixture
def reading(motion: Motion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an FBX file, as which a Blender reads a GLB of two takes."""
    glb = tmp_path / "two.glb"
    formats.save(glb, [motion, motion])
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, READS.format(glb=str(glb)))))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "-a b.fbx").write_bytes(b"FBX that only Blender knows")
    return tmp_path / "in"


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_fbx_is_read_through_blender(reading: Path, motion: Motion):
    takes = formats.load(reading / "-a b.fbx")
    assert [len(take) for take in takes] == [6, 6]
    np.testing.assert_allclose(takes[1].joints, motion.joints, atol=1e-5)
    motions = OwnMotions(reading, Source("own", "mine", "me"))
    items = [item for item in motions.recordings() if isinstance(item, Recording)]
    assert [item.label.id for item in items] == ["-a b-1", "-a b-2"]
    assert [path.name for path in reading.iterdir()] == ["-a b.fbx"]


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_an_fbx_character_is_retargeted_to(reading: Path, motion: Motion, tmp_path: Path):
    rig = read_rig(reading / "-a b.fbx")
    assert rig.file.path == reading / "-a b.fbx" and rig.skeleton.name == "-a b"
    write(tmp_path / "out.glb", rig, [motion], names=["walk"])
    assert len(formats.load(tmp_path / "out.glb")) == 3  # beside the two that were there
    os.environ[fbx.VARIABLE] = str(program(tmp_path, WRITES))
    assert write(tmp_path / "out.fbx", rig, [motion], fps=30) == [tmp_path / "out.fbx"]
    assert (tmp_path / "out.fbx").read_text().split()[-1] == "30.0"


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_what_blender_cannot_read_is_told(reading: Path, tmp_path: Path, monkeypatch):
    path = reading / "-a b.fbx"
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, FAILS)))
    with pytest.raises(FileFormatError, match=r"-a b\.fbx: .*exit code 3.*no exporter"):
        formats.load(path)
    monkeypatch.setattr(fbx, "_MOST_SECONDS", 0.01)
    monkeypatch.setenv(fbx.VARIABLE, str(program(tmp_path, "import time\ntime.sleep(60)")))
    with pytest.raises(FileFormatError, match=r"took longer than 0\.01 s"):
        formats.load(path)
    path.write_bytes(b"PK")
    with pytest.raises(FileFormatError, match="is no FBX"):
        formats.load(path)
    assert [path.name for path in reading.iterdir()] == ["-a b.fbx"]


@pytest.mark.skipif(os.name == "nt", reason="a script is no program there")
def test_damage_that_blender_passed_on_is_blamed_on_the_fbx(reading: Path, tmp_path: Path):
    whole = (tmp_path / "two.glb").read_bytes()
    (tmp_path / "two.glb").write_bytes(whole[:5000])
    with pytest.raises(FileFormatError, match=r"in/-a b\.fbx: .*truncated.*as Blender"):
        read_rig(reading / "-a b.fbx")


def test_folders_with_fbx_need_blender_at_once(reading: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setenv(fbx.VARIABLE, str(tmp_path / "none"))
    with pytest.raises(MissingProgramError, match="no program"):
        next(OwnMotions(reading, Source("own", "mine", "me")).recordings())


@NEEDS_BLENDER
def test_blender_reads_what_it_wrote(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.fbx", fps=30)
    (back,) = formats.load(tmp_path / "a.fbx")
    meant = motion.resampled(30)
    assert back.fps == 30 and len(back) == len(meant)
    np.testing.assert_allclose(back.joints, meant.joints, atol=1e-4)


@NEEDS_BLENDER
def test_blender_writes_fbx(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.fbx")
    content = (tmp_path / "a.fbx").read_bytes()
    assert content.startswith(b"Kaydara FBX Binary")
    assert np.all([name.encode() in content for name in motion.skeleton.names])


@pytest.mark.skipif(
    not (REAL and os.environ.get("LATENTMOTION_SHARED")),
    reason="set LATENTMOTION_BLENDER and LATENTMOTION_SHARED",
)
def test_a_file_at_which_one_importer_fails_is_read_by_the_other() -> None:
    folder = Path(os.environ["LATENTMOTION_SHARED"]) / "cases"
    with_light, without = (
        formats.load(folder / f"{name}_light.fbx")[0] for name in ("with", "without")
    )
    np.testing.assert_allclose(with_light.joints[0], without.joints[0], atol=0.01)
