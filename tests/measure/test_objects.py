"""Objects that motions need: seats and steps in the motion, in files and on pages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from latentmotion.viewer.page import marks_of
from tests.support.walker import t_pose

AT = {name: joint for joint, name in enumerate(HUMANML3D.names)}
LEGS = [
    AT[f"{side}_{part}"] for side in ("left", "right") for part in ("hip", "knee", "ankle", "foot")
]


def standing() -> np.ndarray:
    joints = t_pose().skeleton.rest_joints()
    ankles = [AT["left_ankle"], AT["right_ankle"]]
    joints[:, 1] += 0.07 - joints[ankles, 1].min()  # above soles that stand
    joints[[AT["left_foot"], AT["right_foot"]], 1] = 0.015
    return joints


def seated(height: float) -> np.ndarray:
    """Returns somebody whose thighs are level and whose pelvis is at a height."""
    joints = standing()
    up = height - joints[0, 1]
    body = [joint for joint in range(22) if joint not in LEGS]
    joints[body, 1] += up
    for side in ("left", "right"):
        hip, knee, ankle, foot = (AT[f"{side}_{part}"] for part in ("hip", "knee", "ankle", "foot"))
        thigh, toe = np.linalg.norm(joints[knee] - joints[hip]), joints[foot] - joints[ankle]
        joints[hip, 1] += up
        joints[knee] = joints[hip] + (0, 0, thigh)
        joints[ankle] = joints[knee] * (1, 0, 1) + (0, 0.07, 0)
        joints[foot] = joints[ankle] + toe
    return joints


def moving(poses: list[np.ndarray], frames: int, caption: str = "") -> Motion:
    """Returns a motion that stays in each pose for some frames and goes on in ten."""
    joints = []
    for here, there in zip(poses, [*poses[1:], poses[-1]], strict=True):
        joints += [here] * frames
        joints += [here + (there - here) * share for share in np.linspace(0, 1, 10)]
    return Motion(np.array(joints), caption=caption)


def test_a_sitter_has_a_seat_under_the_pelvis():
    sits = moving([standing(), seated(0.54)], 20, "a person sits down on a chair")
    (seat,) = sits.objects
    assert (seat.kind, seat.name) == ("seat", f"seat at {seat.height:.2f} m")
    assert abs(seat.height - 0.45) < 0.02
    np.testing.assert_allclose(seat.place, sits.joints[-1, 0, [0, 2]], atol=0.05)
    assert 1 < seat.start < 1.7 and seat.end == sits.seconds
    assert abs(seat.degrees) < 5
    faster = Motion(np.repeat(sits.joints, 2, axis=0), fps=40.0)
    assert faster.objects == sits.objects


@pytest.mark.parametrize("caption", ["a person squats down", "a person crouches"])
def test_who_squats_gets_no_chair(caption: str):
    assert moving([standing(), seated(0.54)], 20, caption).objects == ()


def test_who_sits_on_the_ground_or_stands_gets_no_chair():
    ground = seated(0.2)
    ground[:, 1] = np.maximum(ground[:, 1], 0.02)
    assert moving([standing(), ground], 20, "a person sits on the floor").objects == ()
    assert moving([standing()], 40).objects == ()


def test_steps_are_where_feet_stand():
    ground, poses = standing(), []
    for number in range(4):
        poses.append(ground + np.array([0, 0.2 * number, 0.3 * number]))
    climbs = moving(poses, 12, "a person walks up the stairs")
    steps = climbs.objects
    assert [one.kind for one in steps] == ["step"] * 3
    np.testing.assert_allclose([one.height for one in steps], [0.2, 0.4, 0.6], atol=0.03)
    along = np.diff([one.place[1] for one in steps])
    np.testing.assert_allclose(along, 0.3, atol=0.05)
    (box,) = moving(poses[::2], 20).objects
    assert (box.kind, round(box.height, 1)) == ("box", 0.4)
    low = [ground, ground + np.array([0, 0.12, 0.3])]
    assert moving(low, 12, "a person walks").objects == ()
    assert moving(low, 12, "a person climbs the stairs").objects


def test_files_and_pages_have_them(tmp_path: Path):
    sits = moving([standing(), seated(0.54)], 20, "a person sits down")
    sits.save(tmp_path / "sits.glb")
    nodes = Document.read(tmp_path / "sits.glb").json["nodes"]
    (node,) = (node for node in nodes if node["name"] == sits.objects[0].name)
    assert node["extras"]["kind"] == "seat" and "mesh" not in node
    assert abs(node["translation"][1] - 0.45) < 0.02
    again = Motion.load(tmp_path / "sits.glb")
    assert [one.kind for one in again.objects] == ["seat"]
    assert [box["kind"] for box in marks_of(sits)["boxes"]] == ["seat"]
    moving([standing()], 40).save(tmp_path / "stands.glb")
    assert "seat" not in str(Document.read(tmp_path / "stands.glb").json["nodes"])
