"""The surface of a character: all its meshes, in meters, each part with its bone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import RIGS, write_rig
from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.bvh import write_bvh
from latentmotion.formats.gltf_document import Document
from latentmotion.motion import Motion
from latentmotion.render.mannequin import make_mannequin
from latentmotion.retarget import read_rig, retarget
from latentmotion.retarget.flesh import surface_of
from latentmotion.retarget.transfer import CharacterFigure
from tests.support.walker import t_pose, walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(8).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), caption="a person walks")


@pytest.fixture(scope="module")
def own(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "own.glb"
    motion.save(path)
    return path


def test_our_own_file_has_the_mannequin_in_it(motion: Motion, own: Path):
    found = surface_of(read_rig(own))
    made = make_mannequin(motion.animation().skeleton)
    np.testing.assert_allclose(found.vertices, made.vertices, atol=1e-5)
    assert (found.normals * made.normals).sum(-1).min() > 0.5
    np.testing.assert_allclose(found.weights.sum(-1), 1, atol=1e-6)


@pytest.mark.parametrize("name", sorted(RIGS))
def test_parts_keep_their_distance_from_their_bones(motion: Motion, tmp_path: Path, name: str):
    rig = read_rig(write_rig(tmp_path / "a.glb", RIGS[name]))
    skin, animation = CharacterFigure(rig)(motion)
    bone = skin.joints[np.arange(len(skin.joints)), skin.weights.argmax(-1)]
    rest = np.linalg.norm(skin.vertices - rig.skeleton.rest_joints()[bone], axis=-1)
    assert rest.max() < 1.0  # meters, whatever the file's unit
    vertices, _ = skin.pose(animation)
    rigid = skin.weights.max(-1) > 0.999
    now = np.linalg.norm(vertices - animation.joints()[:, bone], axis=-1)
    assert rigid.any()
    np.testing.assert_allclose(now[:, rigid], np.tile(rest[rigid], (len(now), 1)), atol=1e-5)
    assert -0.15 < vertices[..., 1].min() < 0.1  # it stands on the floor


def test_a_mesh_without_skin_goes_with_the_bone_it_hangs_on(
    motion: Motion, own: Path, tmp_path: Path
):
    document = Document.read(own)
    nodes = document.json["nodes"]
    head = next(n for n, node in enumerate(nodes) if node["name"] == "head")
    hat = {"name": "hat", "mesh": 0, "translation": [0, 0.5, 0]}
    nodes[head].setdefault("children", []).append(len(nodes))
    nodes.append(hat)
    document.write(tmp_path / "hat.glb")
    rig = read_rig(tmp_path / "hat.glb")
    skin, plain = surface_of(rig), surface_of(read_rig(own))
    count = len(plain.vertices)
    assert len(skin.vertices) == 2 * count
    assert {rig.skeleton.names[j] for j in skin.joints[count:, 0]} == {"head"}
    np.testing.assert_array_equal(skin.weights[count:, 0], 1)
    assert len(retarget(motion, rig)) == len(motion)


def test_bones_alone_and_damage_are_told(motion: Motion, own: Path, tmp_path: Path):
    write_bvh(tmp_path / "bones.bvh", motion.animation())
    with pytest.raises(InputError, match="bones but no surface that they carry"):
        surface_of(read_rig(tmp_path / "bones.bvh"))
    for number, change in enumerate([{"indices": 999}, {"attributes": {}}, {"mode": "lines"}]):
        document = Document.read(own)
        for primitive in document.json["meshes"][0]["primitives"]:
            primitive |= change
        document.write(tmp_path / f"{number}.glb")
        with pytest.raises((FileFormatError, InputError)):
            surface_of(read_rig(tmp_path / f"{number}.glb"))


@pytest.mark.parametrize("name", sorted(RIGS))
def test_who_kneels_has_the_surface_on_the_floor(tmp_path: Path, name: str):
    pose = t_pose().skeleton.rest_joints()
    at = dict(zip(t_pose().skeleton.names, range(len(pose)), strict=True))
    legs = [at[f"{side}_{part}"] for side in ("left", "right") for part in ("ankle", "foot")]
    knees = [at["left_knee"], at["right_knee"]]
    shank = pose[knees, 1].mean() - pose[[legs[0], legs[2]], 1].mean()
    for side in ("left", "right"):
        pose[at[f"{side}_ankle"]] = pose[at[f"{side}_knee"]] - (0, 0, shank)
        pose[at[f"{side}_foot"]] = pose[at[f"{side}_ankle"]] - (0, 0, 0.13)
    pose[:, 1] -= pose[:, 1].min()  # joints of knees, ankles and toes are at the floor's height
    kneeling = Motion(np.repeat(pose[None], 8, axis=0).astype("f4"))
    rig = read_rig(write_rig(tmp_path / "a.glb", RIGS[name]))
    skin, animation = CharacterFigure(rig)(kneeling)
    lowest = skin.pose(animation)[0][..., 1].min(axis=1)
    assert lowest.min() > -0.003 and lowest.max() < 0.02
    raised = animation.joints()[0, rig.body.joints["left_knee"], 1]
    assert raised > 0.01  # the joint is inside the knee


def test_hair_and_capes_do_not_lift_a_body(motion: Motion, tmp_path: Path):
    document = Document.read(write_rig(tmp_path / "a.glb", RIGS["mixamo"]))
    nodes = document.json["nodes"]
    head = next(n for n, node in enumerate(nodes) if node["name"].endswith("Spine"))
    nodes[head].setdefault("children", []).append(len(nodes))
    nodes.append({"name": "cape", "mesh": 0, "translation": [0, -150, -150]})
    document.write(tmp_path / "cape.glb")
    plain, caped = (retarget(motion, read_rig(tmp_path / f"{n}.glb")) for n in ("a", "cape"))
    np.testing.assert_allclose(caped.joints(), plain.joints(), atol=0.01)
