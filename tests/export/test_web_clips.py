"""Rotations and clips of the npm package: figures of three.js move as the joints do."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion.kinematics.rotations import matrix_from_quaternion
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.pages import walking

PACKAGE = Path(__file__).parents[2] / "packages" / "web"
WALK = walking()


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What figures do that clips of a walk move."""
    if shutil.which("node") is None or not (PACKAGE / "node_modules" / "three").is_dir():
        pytest.skip("needs Node.js, and the package's dependencies: cd packages/web && npm ci")
    folder = tmp_path_factory.mktemp("clips")
    WALK.save(folder / "figure.glb")
    skeleton = {
        "names": HUMANML3D.names,
        "parents": HUMANML3D.parents,
        "directions": HUMANML3D.offsets.tolist(),
    }
    given = {"joints": WALK.joints.tolist(), "fps": WALK.fps, "skeleton": skeleton}
    (folder / "given.json").write_text(json.dumps(given | {"figure": str(folder / "figure.glb")}))
    script = Path(__file__).with_name("clip.mjs")
    command = ["node", str(script), str(PACKAGE), str(folder / "given.json")]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_rotations_give_the_joints_again(played: dict[str, Any]):
    turns = np.reshape(played["rotations"], (len(WALK), 22, 4))[..., [3, 0, 1, 2]]
    local, offsets = matrix_from_quaternion(turns), np.reshape(played["offsets"], (22, 3))
    world, places = [], []
    for joint, parent in enumerate(HUMANML3D.parents):
        if parent < 0:
            world.append(local[:, joint])
            places.append(WALK.joints[:, 0])
        else:
            world.append(world[parent] @ local[:, joint])
            places.append(places[parent] + world[parent] @ offsets[joint])
    np.testing.assert_allclose(np.stack(places, 1), WALK.joints, atol=2e-2)
    # The rest pose is a T that looks along +z.
    assert offsets[HUMANML3D.names.index("left_elbow"), 0] > 0.2


def test_a_clip_moves_a_figure_of_ours(played: dict[str, Any]):
    assert np.abs(np.array(played["ours"]) - WALK.joints).max() < 0.03


def test_a_clip_moves_a_figure_of_another_size_pose_and_direction(played: dict[str, Any]):
    foreign = np.array(played["foreign"])
    hips = WALK.joints[:, 0] * (-1, 1, -1)
    # It looks the other way, so it walks the other way, by the length of its legs.
    scale = np.ptp(foreign[:, 0, 2]) / np.ptp(hips[:, 2])
    assert 0.9 < scale < 1.2 and np.corrcoef(foreign[:, 0, 2], hips[:, 2])[0, 1] > 0.999
    names = ["left_hip", "left_knee", "left_ankle", "right_shoulder", "right_elbow", "right_wrist"]
    joints = WALK.joints[:, [HUMANML3D.names.index(name) for name in names]] * (-1, 1, -1)
    for first in (0, 1, 3, 4):
        mine = joints[:, first + 1] - joints[:, first]
        theirs = foreign[:, first + 2] - foreign[:, first + 1]
        mine, theirs = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (mine, theirs))
        assert (mine * theirs).sum(-1).min() > 0.999, names[first]


def test_a_figure_without_bones_is_refused_in_words(played: dict[str, Any]):
    assert played["told"].startswith("InputError: the figure has no bone for pelvis")
