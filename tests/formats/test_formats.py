"""All formats alike: joints come back, bad input is told in words, nothing is half-written."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.skeleton import HUMANML3D, Skeleton
from latentmotion.motion import Motion
from tests.support.walker import walker

EXACT = {".npz": 0, ".csv": 1e-6, ".bvh": 1e-3, ".glb": 1e-3, ".gltf": 1e-3}
USD = {".usda": 1e-3, ".usdc": 1e-3, ".usdz": 1e-3, ".usd": 1e-3}
if importlib.util.find_spec("pxr") is not None:
    EXACT |= USD
PLAIN = [e for e in formats.ENDINGS if e not in (*USD, ".fbx", ".gif", ".mp4", ".png")]


@pytest.fixture(scope="module")
def motion() -> Motion:
    return Motion(walker(12).joints().astype("f4"))


def starter() -> Motion:
    from latentmotion import MotionPipeline

    return MotionPipeline.from_pretrained("starter")(
        "a person waves with the right hand", seconds=2
    )


@pytest.mark.parametrize("ending", EXACT)
def test_round_trips_within_a_millimeter(motion: Motion, tmp_path: Path, ending: str):
    motion.save(tmp_path / f"a{ending}")
    read = Motion.load(tmp_path / f"a{ending}")
    assert (read.fps, read.skeleton) == (20, HUMANML3D)
    assert np.linalg.norm(read.joints - motion.joints, axis=-1).max() <= EXACT[ending]


@pytest.mark.parametrize("ending", [".npz", ".bvh", ".html"])
def test_text_with_nul_is_refused(motion: Motion, tmp_path: Path, ending: str):
    with pytest.raises(InputError, match="the character NUL, which files lose"):
        formats.save(tmp_path / f"a{ending}", [replace(motion, caption="walks\0")])
    assert not list(tmp_path.iterdir())


def test_what_a_model_made_comes_back(tmp_path: Path):
    made = starter().cleaned()
    rotated = made.animation().joints()
    for ending in EXACT:
        made.save(tmp_path / f"a{ending}")
        read = Motion.load(tmp_path / f"a{ending}")
        expected = made.joints if ending in (".npz", ".csv") else rotated
        assert np.linalg.norm(read.joints - expected, axis=-1).max() < 1e-4


@pytest.mark.parametrize("ending", EXACT)
def test_one_frame(motion: Motion, tmp_path: Path, ending: str):
    Motion(motion.joints[:1]).save(tmp_path / f"a{ending}")
    assert len(Motion.load(tmp_path / f"a{ending}")) == 1


@pytest.mark.parametrize("ending", PLAIN)
def test_a_folder_without_permission(motion: Motion, tmp_path: Path, monkeypatch, ending: str):
    # Root may write everywhere, so the system's answer is given for it.
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    with pytest.raises(InputError, match="no permission"):
        motion.save(tmp_path / f"a{ending}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", PLAIN)
def test_a_full_disk_leaves_the_old_file(motion: Motion, tmp_path: Path, monkeypatch, ending: str):
    (tmp_path / f"a{ending}").write_text("old")

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        motion.save(tmp_path / f"a{ending}")
    assert (tmp_path / f"a{ending}").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == [f"a{ending}"]


@pytest.mark.parametrize(
    "ending", [e for e in PLAIN if e not in (".amass.npz", ".smplx.npz", ".smpl.npz", ".vrma")]
)
@pytest.mark.parametrize("names", [("root",), ("root", "a", "b"), ("pelvis", "left_hip", "tip")])
def test_a_skeleton_without_feet(tmp_path: Path, ending: str, names: tuple[str, ...]):
    offsets = np.array([(0, 0, 0), (0, 1, 0), (0, 0.5, 0.1)])[: len(names)]
    skeleton = Skeleton("chain", names, (-1, 0, 1)[: len(names)], offsets)
    joints = np.tile(skeleton.rest_joints(), (4, 1, 1)).astype("f4")
    motion = Motion(joints, skeleton=skeleton)
    written = motion.save(tmp_path / f"a{ending}")
    assert written[0].stat().st_size > 0
    if ending == ".glb":
        found = read_animations(written[0])[0]
        np.testing.assert_allclose(found.joints(), joints, atol=1e-5)


def test_generate_at_another_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from latentmotion.cli.main import main

    words = ["a person walks", "--seconds", "2", "--fps", "120", "--steps", "2", "--json"]
    main(["generate", *words, "-o", str(tmp_path / "a.bvh")])
    told = json.loads(capsys.readouterr().out)["motions"][0]
    assert (told["fps"], told["frames"]) == (120, 235)
    assert "Frames: 235\nFrame Time: 0.00833333" in (tmp_path / "a.bvh").read_text()
    with pytest.raises(SystemExit):
        main(["generate", "a person walks", "--fps", "0", "-o", str(tmp_path / "b.bvh")])
    assert "fps is 0" in capsys.readouterr().err


def test_every_ending_names_a_function():
    for target in {*formats.ENDINGS.values(), *formats.READABLE.values()}:
        module, _, name = target.partition(":")
        path = importlib.util.find_spec(module)
        assert path is not None
        assert path.origin is not None
        assert f"def {name}(" in Path(path.origin).read_text()


def test_the_command_line_lists_what_there_is(capsys: pytest.CaptureFixture[str]):
    from latentmotion.cli.main import main

    with pytest.raises(SystemExit):
        main(["generate", "--help"])
    shown = capsys.readouterr().out.replace("│", " ").split()
    assert {*formats.ENDINGS} <= {word.rstrip(".") for word in shown}
