"""GLB: read back by pygltflib, its nodes posed as a foreign program poses them."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import InputError
from latentmotion.formats import gltf
from latentmotion.kinematics.rotations import matrix_from_quaternion
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from tests.support.walker import walker

pygltflib = pytest.importorskip("pygltflib")
TYPES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DTYPES = {5126: "<f4", 5121: "u1", 5123: "<u2", 5125: "<u4"}


def array(file, number: int) -> np.ndarray:
    accessor = file.accessors[number]
    view = file.bufferViews[accessor.bufferView]
    width = TYPES[accessor.type]
    flat = np.frombuffer(
        file.binary_blob(), DTYPES[accessor.componentType], accessor.count * width, view.byteOffset
    )
    return flat.reshape(accessor.count, width)


def posed(file, take: int) -> np.ndarray:
    """Plays an animation: the positions of the joint nodes (frames, joints, 3)."""
    animation = file.animations[take]
    frames = max(file.accessors[s.input].count for s in animation.samplers)
    joints = file.skins[0].joints
    places = np.array([file.nodes[j].translation for j in joints])[None].repeat(frames, 0)
    rests = np.array([file.nodes[j].rotation for j in joints])
    turns = matrix_from_quaternion(rests[:, [3, 0, 1, 2]])[None].repeat(frames, 0)
    for channel in animation.channels:
        values = array(file, animation.samplers[channel.sampler].output).astype(float)
        if channel.target.path == "rotation":
            turns[:, channel.target.node] = matrix_from_quaternion(values[:, [3, 0, 1, 2]])
        else:
            places[:, channel.target.node] = values
    world, positions = turns.copy(), places.copy()
    for joint in joints:
        for child in file.nodes[joint].children or []:
            step = np.einsum("tij,tj->ti", world[:, joint], places[:, child])
            positions[:, child] = positions[:, joint] + step
            world[:, child] = world[:, joint] @ turns[:, child]
    return positions


@pytest.fixture(scope="module")
def takes() -> list[Motion]:
    person = walker(30)
    joints = person.joints().astype("f4")
    return [Motion(joints, caption="a person walks"), Motion(joints[:12] * 1.1)]


@pytest.fixture(scope="module")
def path(takes: list[Motion], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gltf.write(tmp_path_factory.mktemp("glb") / "a.glb", takes)[0]


def test_nodes_move_as_the_joints_do(takes: list[Motion], path: Path):
    file = pygltflib.GLTF2().load(str(path))
    assert [file.nodes[j].name for j in file.skins[0].joints] == list(takes[0].skeleton.names)
    for number, take in enumerate(takes):
        np.testing.assert_allclose(posed(file, number), take.animation().joints(), atol=1e-5)
        np.testing.assert_allclose(posed(file, number), take.joints, atol=0.002)
        times = array(file, file.animations[number].samplers[0].input)[:, 0]
        np.testing.assert_allclose(times, np.arange(len(take)) / 20)


def test_what_one_take_moves_all_takes_place(path: Path):
    """Blender leaves a bone where the last take had it, unless the next one says where it is."""
    file = pygltflib.GLTF2().load(str(path))
    moved = [
        {(c.target.node, c.target.path) for c in animation.channels}
        for animation in file.animations
    ]
    assert moved[0] == moved[1]
    assert (1, "translation") in moved[0]


def test_takes_are_named_by_their_captions(path: Path):
    file = pygltflib.GLTF2().load(str(path))
    assert [animation.name for animation in file.animations] == ["1: a person walks", "take 2"]
    assert file.animations[0].extras["caption"] == "a person walks"


def test_the_mesh_is_closed_and_moved_by_its_joints(path: Path):
    file = pygltflib.GLTF2().load(str(path))
    body, accent = file.meshes[0].primitives
    assert [material.name for material in file.materials] == ["body", "mannequin"]
    assert array(file, accent.indices).size < array(file, body.indices).size / 2
    corners = array(file, body.indices).reshape(-1, 3)
    points = array(file, body.attributes.POSITION)
    edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]))
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    volume = np.einsum(
        "ij,ij->", points[corners[:, 0]], np.cross(points[corners[:, 1]], points[corners[:, 2]])
    )
    assert 0.04 < volume / 6 < 0.12
    assert 1.5 < np.ptp(points[:, 1]) < 2
    np.testing.assert_allclose(array(file, body.attributes.WEIGHTS_0).sum(1), 1, atol=1e-6)
    assert abs(points[:, 1].min()) < 3e-4


def test_bones_point_to_the_next_joint_and_bind_the_standing_figure(path: Path):
    file = pygltflib.GLTF2().load(str(path))
    matrices = array(file, file.skins[0].inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    world = np.linalg.inv(matrices.astype(float))
    names = [file.nodes[joint].name for joint in file.skins[0].joints]
    for joint, name in enumerate(names):
        node = file.nodes[joint]
        for child in node.children or []:
            np.testing.assert_allclose(
                world[joint] @ [*file.nodes[child].translation, 1], world[child, :, 3], atol=1e-5
            )
        if len(node.children or []) == 1:
            along = world[node.children[0], :3, 3] - world[joint, :3, 3]
            np.testing.assert_allclose(
                world[joint, :3, 1], along / np.linalg.norm(along), atol=1e-4, err_msg=name
            )
    assert world[:, 1, 3].min() == pytest.approx(0, abs=1e-6)
    # Knees and elbows bend about x.
    hinges = {"left_knee": (-1, 0, 0), "left_elbow": (0, -1, 0), "right_elbow": (0, 1, 0)}
    for name, hinge in hinges.items():
        assert world[names.index(name), :3, 0] @ hinge > 0.98


def test_joints_that_slide_are_animated(tmp_path: Path):
    joints = walker(20).joints()
    joints[:, 3] += 0.02 * np.sin(np.arange(20))[:, None] * (1.0, 0, 0)
    motion = Motion(joints.astype("f4"))
    file = pygltflib.GLTF2().load(str(gltf.write(tmp_path / "a.glb", [motion])[0]))
    np.testing.assert_allclose(posed(file, 0), motion.animation().joints(), atol=1e-5)


def test_kit_gets_a_body_too(tmp_path: Path):
    joints = np.tile(KIT.rest_joints(), (3, 1, 1)).astype("f4")
    motion = Motion(joints, fps=12.5, skeleton=KIT)
    file = pygltflib.GLTF2().load(str(gltf.write(tmp_path / "a.glb", [motion])[0]))
    np.testing.assert_allclose(posed(file, 0), joints, atol=1e-4)


def test_takes_of_different_skeletons_are_refused(takes: list[Motion], tmp_path: Path):
    kit = Motion(np.tile(KIT.rest_joints(), (3, 1, 1)).astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="share a skeleton"):
        gltf.write(tmp_path / "a.glb", [takes[0], kit])
    assert not list(tmp_path.iterdir())


def test_khronos_validator(path: Path, tmp_path: Path):
    """Runs where `npm install gltf-validator` was done above this folder; skipped elsewhere."""
    node = shutil.which("node")
    script = (
        "const v = require('gltf-validator'), fs = require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    if node is None:
        pytest.skip("needs Node.js (Debian: apt-get install nodejs npm)")
    run = subprocess.run([node, "-e", script, str(path)], capture_output=True, text=True)
    if "Cannot find module" in run.stderr:
        pytest.skip(
            "needs gltf-validator: npm install gltf-validator, set NODE_PATH to its node_modules"
        )
    issues = json.loads(run.stdout)
    assert (issues["numErrors"], issues["numWarnings"], issues["numInfos"]) == (0, 0, 0)
