"""The add-on in a real Blender: installed from its zip, used, measured, taken away."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from latentmotion.cli.main import main
from tests.clients.clients import HERE, run

COMMAND = Path(sys.executable).with_name("latentmotion")


@pytest.fixture(scope="module")
def report(blender: str, results: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What addon_in_blender.py measured."""
    if not COMMAND.exists():
        pytest.skip(f"needs the command {COMMAND}")
    folder = tmp_path_factory.mktemp("addon")
    main(["blender-addon", "-o", str(folder / "addon.zip"), "--no-remember"])
    # The add-on is told the same model.
    sentence = ["generate", "a person walks in a circle", "--model", "starter"]
    prompt = [*sentence, "--seed", "3", "--seconds", "3"]
    subprocess.run([COMMAND, *prompt, "--fps", "24", "-o", folder / "truth.npz"], check=True)
    paths = [folder / "addon.zip", COMMAND, folder / "truth.npz", folder, results / "addon.png"]
    said = run([blender, str(HERE / "addon_in_blender.py"), *map(str, paths)])
    (line,) = [line for line in said.splitlines() if line.startswith("REPORT ")]
    return json.loads(line.removeprefix("REPORT "))


def test_it_installs_either_way_and_leaves_nothing(report):
    assert report["legacy"]
    assert not report["left"]
    assert report["icons"] == []


def test_mistakes_are_told(report):
    assert "not found" in report["missing"]
    assert "pip install latentmotion" in report["missing"]
    assert "no model 'nonesuch'" in report["bad_model"]


def test_the_mannequin_moves_as_the_motion_does(report):
    assert report["said"] == ""
    assert report["actions"] == ["a person walks in a circle", "a person walks in a circle 2"]
    assert report["mannequin_error_m"][1] < 0.01
    assert report["meshes"] == ["mannequin"]


def test_our_names_in_another_rest_pose(report):
    assert report["same_names_said"] == ""
    assert max(report["same_names_angles"].values()) < 1
    assert report["same_names_path"] == pytest.approx(1.15, abs=0.01)
    assert -0.01 < report["same_names_floor_m"] < 0.05


def test_foreign_names_go_through_retarget(report):
    assert report["mixamo_said"] == ""
    assert max(report["mixamo_angles"].values()) < 15
    assert -0.03 < report["mixamo_floor_m"] < 0.05


def test_blender_is_never_kept_waiting(report):
    window = report["window"]
    assert window["result"] == ["FINISHED"]
    assert window["looks"] > 5
    assert window["longest_look_s"] < 0.1
    assert window["escaped"] == ["CANCELLED"]
    assert not window["left"]
