"""MMCP: animation programs, by the SDK's own client over HTTP."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.skeleton import HUMANML3D

pytest.importorskip("motionmcp.server", reason='needs motionmcp: pip install "latentmotion[mmcp]"')

import uvicorn
from motionmcp import client

from latentmotion.service.mmcp import application

WALK = {"type": "text", "prompt": "a person walks forward", "duration_frames": 80}
FAST = {"seed": 1, "model_options": {"takes": 1}}
MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck",
    "head": "Head", "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
}  # fmt: skip


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A server of the model that ships."""
    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    app = application(MotionPipeline.from_pretrained(threads=1))
    server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
    thread = threading.Thread(target=server.run, args=([listener],))
    thread.start()
    while not server.started:
        time.sleep(0.02)
    yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    server.should_exit = True
    thread.join()


def model_of(url: str) -> dict[str, Any]:
    return client.pick_model(client.get_capabilities(url))


def generate(url: str, **asked: Any) -> list[dict[str, Any]]:
    """Returns the samples of an answer, read by the client."""
    model = model_of(url)
    body = {
        "protocol_version": "1.4",
        "model": model["id"],
        "skeleton": model["canonical_skeleton"],
        "segments": [WALK],
        "options": FAST,
    }
    return client.parse_gltf_samples(client.generate(url, body | asked))


def world(sample: dict[str, Any]) -> np.ndarray:
    """Returns joint positions, by the parents, rotations and translations of the answer."""
    names = sample["joint_names"]
    turned, moved = sample["local_rot_mats"], sample["local_translations"]
    rotations, places = np.empty_like(turned), np.empty_like(moved)
    for joint, (_, parent) in enumerate(sample["hierarchy"]):
        rotations[:, joint], places[:, joint] = turned[:, joint], moved[:, joint]
        if parent is not None:
            above = names.index(parent)
            rotations[:, joint] = rotations[:, above] @ turned[:, joint]
            step = np.einsum("tab,tb->ta", rotations[:, above], moved[:, joint])
            places[:, joint] = places[:, above] + step
    return places


def test_a_sentence_becomes_the_motion_of_the_library(url: str) -> None:
    (sample,) = generate(url)
    expected = MotionPipeline.from_pretrained(threads=1)(WALK["prompt"], 4, seed=1, takes=1)
    assert sample["joint_names"] == list(HUMANML3D.names) and sample["fps"] == 20
    assert np.abs(world(sample) - expected.joints).max() < 1e-4
    feet = sample["foot_contacts"][:, [*HUMANML3D.left_foot, *HUMANML3D.right_foot]]
    assert 0.2 < feet.mean() < 0.95 and not sample["foot_contacts"][:, 0].any()


def test_samples_rates_loops_and_several_prompts(url: str) -> None:
    three = generate(url, options=FAST | {"num_samples": 3}, timing={"fps": 30})
    assert [(one["num_frames"], one["fps"]) for one in three] == [(80, 30)] * 3
    assert np.abs(world(three[0]) - world(three[1])).max() > 0.05
    (loop,) = generate(url, options=FAST | {"loop": True})
    joints = world(loop)
    inside = np.abs(np.diff(joints[:, 1:] - joints[:, :1], axis=0)).max()
    assert np.abs((joints[0] - joints[0, 0]) - (joints[-1] - joints[-1, 0])).max() < 1.5 * inside
    sits = {"type": "text", "prompt": "a person sits down", "duration_frames": 60}
    (both,) = generate(url, segments=[WALK, sits])
    heights = world(both)[:, 0, 1]
    assert len(heights) == 140 and heights[-1] < heights[40] - 0.2
    (pose,) = generate(url, segments=[{"type": "pose", "prompt": "a person raises both hands"}])
    assert pose["num_frames"] == 1


def test_paths_targets_and_poses_are_met(url: str) -> None:
    path = {"type": "root_path", "frames": [0, 40, 79], "positions_xz": [[0, 0], [0, 1.5], [1, 3]]}
    (walked,) = generate(url, constraints=[path])
    assert np.abs(world(walked)[path["frames"], 0][:, [0, 2]] - path["positions_xz"]).max() < 0.01
    place = [-0.3, 1.4, 1.5]
    hand = {"type": "effector_target", "joint": "right_wrist", "frames": [40]}
    (reached,) = generate(url, constraints=[hand | {"positions": [place]}])
    assert np.abs(world(reached)[40, HUMANML3D.names.index("right_wrist")] - place).max() < 0.01
    (free,) = generate(url)
    rotations = {
        name: quaternion(free["local_rot_mats"][60, joint])
        for joint, name in enumerate(free["joint_names"])
    }
    root = free["posed_joints"][60, 0].tolist()
    key = {"type": "pose_keyframe", "frame": 40, "joint_rotations": rotations}
    for given in ({"root_position": [root[0], root[1], root[2] - 1]}, {}):
        (posed,) = generate(url, constraints=[key | given])
        shape, wanted = (p - p[0] for p in (world(posed)[40], world(free)[60]))
        assert np.abs(shape - wanted).max() < 0.12  # the canonical body has other bones


def quaternion(matrix: np.ndarray) -> list[float]:
    from latentmotion.kinematics.rotations import quaternion_from_matrix

    return quaternion_from_matrix(matrix.astype(float))[[1, 2, 3, 0]].tolist()


def test_a_skeleton_of_another_program_is_retargeted(url: str) -> None:
    joints = model_of(url)["canonical_skeleton"]["joints"]

    def theirs(name: str | None) -> str | None:
        side, _, part = (name or "").partition("_")
        words = side.title() + MIXAMO[part] if side in SIDES else MIXAMO[name or "pelvis"]
        return name and f"mixamorig:{words}"

    skeleton = {
        "joints": [
            joint
            | {"name": theirs(joint["name"]), "parent": theirs(joint["parent"])}
            | {"rest_translation": [1.2 * value for value in joint["rest_translation"]]}
            for joint in joints
        ]
    }
    skeleton["joints"][4]["rest_rotation"] = [1.0, 0.0, 0.0, 0.0]  # a bone with axes of its own
    for joint in skeleton["joints"]:
        if joint["parent"] == skeleton["joints"][4]["name"]:
            x, y, z = joint["rest_translation"]
            joint |= {"rest_translation": [x, -y, -z], "rest_rotation": [-1.0, 0.0, 0.0, 0.0]}
    (plain,), (moved,) = generate(url), generate(url, skeleton=skeleton)
    ours, large = world(plain), world(moved)
    assert large[:, 0, 1].mean() == pytest.approx(1.2 * ours[:, 0, 1].mean(), rel=0.1)
    for joint in (4, 5, 7, 18):  # bones point where ours do
        parent = HUMANML3D.parents[joint]
        a, b = (p[:, joint] - p[:, parent] for p in (ours, large))
        cosine = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
        assert np.median(cosine) > 0.97, HUMANML3D.names[joint]


def test_what_cannot_be_met_is_said(url: str) -> None:
    target = {"type": "effector_target", "joint": "right_wrist", "frames": [40]}
    with pytest.raises(client.MmcpError, match="9 m high: this body reaches"):
        generate(url, constraints=[target | {"positions": [[0, 9, 1]]}])
    skeleton = {"joints": [model_of(url)["canonical_skeleton"]["joints"][0] | {"name": "bone"}]}
    with pytest.raises(client.MmcpError, match=r"unknown names of joints"):
        generate(url, skeleton=skeleton)
    with pytest.raises(client.MmcpError, match="above the maximum"):
        generate(url, options={"model_options": {"takes": 99}})
