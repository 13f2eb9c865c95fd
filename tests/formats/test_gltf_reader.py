"""glTF in: our own files come back, foreign rests, scales and splines become plain bones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError
from latentmotion.formats.bones import even_rate
from latentmotion.formats.gltf_document import Document
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.rotations import (
    matrix_from_axis_angle,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
)
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from tests.support.walker import walker


@pytest.fixture(scope="module")
def takes() -> list[Motion]:
    joints = walker(30).joints().astype("f4")
    first = Motion(joints, caption="a person walks", metadata={"seed": 7})
    return [first, Motion(joints[:12] * 1.1, fps=24)]


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_takes_come_back(takes: list[Motion], tmp_path: Path, ending: str):
    formats.save(tmp_path / f"a{ending}", takes)
    read = formats.load(tmp_path / f"a{ending}")
    assert [(m.caption, m.fps, len(m)) for m in read] == [("a person walks", 20, 30), ("", 24, 12)]
    assert read[0].metadata == {"seed": 7}
    for found, take in zip(read, takes, strict=True):
        assert np.linalg.norm(found.joints - take.animation().joints(), axis=-1).max() < 1e-4
        assert np.linalg.norm(found.joints - take.joints, axis=-1).max() < 1e-3


def test_animations_keep_rotations(takes: list[Motion], tmp_path: Path):
    takes[0].save(tmp_path / "a.glb")
    found, meant = read_animations(tmp_path / "a.glb")[0], takes[0].animation()
    np.testing.assert_allclose(found.rotations, meant.rotations, atol=1e-5)
    np.testing.assert_allclose(found.skeleton.offsets, meant.skeleton.offsets, atol=1e-6)
    assert found.skeleton.names == meant.skeleton.names
    assert found.translations is None


def test_kit_and_single_frames(tmp_path: Path):
    kit = Motion(np.tile(KIT.rest_joints(), (1, 1, 1)).astype("f4"), fps=12.5, skeleton=KIT)
    kit.save(tmp_path / "a.glb")
    read = Motion.load(tmp_path / "a.glb")
    assert (read.skeleton is KIT, len(read)) == (True, 1)
    np.testing.assert_allclose(read.joints, kit.joints, atol=1e-4)


def foreign(times: list[float], values: np.ndarray, kind: str = "LINEAR") -> Document:
    """Two bones below a node that turns z up and counts centimeters; their rests are turned."""
    up = quaternion_from_axis_angle(np.array([-np.pi / 2, 0, 0]))[[1, 2, 3, 0]].tolist()
    side = quaternion_from_axis_angle(np.array([0, 0, 0.3]))[[1, 2, 3, 0]].tolist()
    document = Document()
    clock = document.add_array(np.array(times, "f4"), bounds=True)
    output = document.add_array(values.astype("f4"))
    document.json |= {
        "nodes": [
            {"name": "Armature", "rotation": up, "scale": [0.01, 0.01, 0.01], "children": [2]},
            {"name": "Tip", "translation": [0, 50, 0]},
            {"name": "Hips", "translation": [0, 0, 100], "rotation": side, "children": [1]},
        ],
        "skins": [{"joints": [1, 2]}],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
                "samplers": [{"input": clock, "output": output, "interpolation": kind}],
            }
        ],
    }
    return document


def quaternions(angles: list[float]) -> np.ndarray:
    vectors = np.array([[0, 0, angle] for angle in angles])
    return quaternion_from_axis_angle(vectors)[:, [1, 2, 3, 0]]


def test_rests_scales_and_axes_are_folded_in(tmp_path: Path):
    foreign([0.0, 0.5], quaternions([0.3, 1.3])).write(tmp_path / "a.glb")
    animation = read_animations(tmp_path / "a.glb")[0]
    skeleton = animation.skeleton
    assert (skeleton.names, skeleton.parents) == (("Hips", "Tip"), (-1, 0))
    # z of the file is our y, its y our -z.
    tip = 0.5 * np.array([-np.sin(0.3), 0, -np.cos(0.3)])
    np.testing.assert_allclose(skeleton.offsets, [[0, 0, 0], tip], atol=1e-6)
    assert (animation.fps, len(animation)) == (30.0, 16)
    np.testing.assert_allclose(animation.root_positions, np.tile([0, 1, 0], (16, 1)), atol=1e-6)
    turns = np.array([[0, angle, 0] for angle in np.linspace(0, 1, 16)])
    np.testing.assert_allclose(animation.rotations[:, 0], matrix_from_axis_angle(turns), atol=1e-5)
    np.testing.assert_allclose(animation.rotations[:, 1], np.tile(np.eye(3), (16, 1, 1)), atol=1e-5)


@pytest.mark.parametrize("times", [[0.0, 1e9], [-1e30, 1e30], [0.0, 0.05, 1e9]])
def test_keys_too_far_apart_are_an_error_and_no_huge_array(tmp_path: Path, times: list[float]):
    foreign(times, quaternions([0.3] * len(times))).write(tmp_path / "a.glb")
    with pytest.raises(FileFormatError, match=r"a\.glb: has keys from .* expected at most 200,000"):
        read_animations(tmp_path / "a.glb")


def test_as_many_frames_as_keys_are_never_too_many():
    seconds = np.arange(300_000) / 1000
    fps, times = even_rate("a.glb", seconds)
    assert (fps, len(times)) == (1000, 300_000)


def test_steps_and_cubic_splines(tmp_path: Path):
    foreign([0.0, 0.5], quaternions([0.3, 1.3]), "STEP").write(tmp_path / "step.gltf")
    held = read_animations(tmp_path / "step.gltf")[0].rotations[:, 0]
    np.testing.assert_allclose(held[:-1], np.tile(np.eye(3), (15, 1, 1)), atol=1e-5)
    keys = quaternions([0.3, 0.5])
    slope = (keys[1] - keys[0]) / 0.5
    rows = np.stack([slope, keys[0], slope, slope, keys[1], slope])
    foreign([0.0, 0.5], rows, "CUBICSPLINE").write(tmp_path / "cubic.glb")
    turned = read_animations(tmp_path / "cubic.glb")[0].rotations[:, 0]
    turns = np.array([[0, angle, 0] for angle in np.linspace(0, 0.2, 16)])
    np.testing.assert_allclose(turned, matrix_from_axis_angle(turns), atol=1e-3)


def test_a_character_without_animations_stands(tmp_path: Path):
    document = foreign([0.0, 0.5], quaternions([0.3, 1.3]))
    del document.json["animations"]
    document.write(tmp_path / "a.glb")
    animation = read_animations(tmp_path / "a.glb")[0]
    assert len(animation) == 1
    np.testing.assert_allclose(animation.rotations, np.tile(np.eye(3), (1, 2, 1, 1)), atol=1e-6)


def test_buffers_and_pictures_beside_the_file_are_taken_in(tmp_path: Path):
    foreign([0.0, 0.5], quaternions([0.3, 1.3])).write(tmp_path / "a.gltf")
    document = Document.read(tmp_path / "a.gltf")
    (tmp_path / "a b.bin").write_bytes(document.binary)
    (tmp_path / "skin.png").write_bytes(b"picture")
    document.json["buffers"][0]["uri"] = "a%20b.bin"
    document.json["images"] = [{"uri": "skin.png"}]
    (tmp_path / "b.gltf").write_text(json.dumps(document.json))
    Document.read(tmp_path / "b.gltf").write(tmp_path / "c.glb")
    assert len(read_animations(tmp_path / "c.glb")[0]) == 16
    whole = Document.read(tmp_path / "c.glb")
    picture = whole.json["images"][0]
    view = whole.json["bufferViews"][picture["bufferView"]]
    assert picture["mimeType"] == "image/png"
    assert whole.binary[view["byteOffset"] :][: view["byteLength"]] == b"picture"
    (tmp_path / "a b.bin").unlink()
    with pytest.raises(FileFormatError, match=r"a b\.bin.*cannot be read"):
        Document.read(tmp_path / "b.gltf")


def test_arrays_there_and_back():
    document = Document()
    for array in (
        np.arange(3, dtype="u1"),
        np.arange(6, dtype="f4").reshape(2, 3),
        np.arange(32, dtype="f4").reshape(2, 4, 4),
    ):
        np.testing.assert_array_equal(document.array(document.add_array(array)), array)
    document.json["accessors"][0]["normalized"] = True
    np.testing.assert_allclose(document.array(0), np.arange(3) / 255)
    indices = document.add_view(np.array([1], "u1").tobytes())
    new = document.add_view(np.array([[7, 8, 9]], "f4").tobytes())
    document.json["accessors"][1]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": indices, "componentType": 5121},
        "values": {"bufferView": new},
    }
    np.testing.assert_array_equal(document.array(1), [[0, 1, 2], [7, 8, 9]])


def test_damaged_files_are_named(takes: list[Motion], tmp_path: Path):
    takes[0].save(tmp_path / "a.glb")
    whole = (tmp_path / "a.glb").read_bytes()
    bad = tmp_path / "bad.glb"
    for size in (0, 3, 10, 30, 2000, len(whole) // 2, len(whole) - 1):
        bad.write_bytes(whole[:size])
        with pytest.raises(FileFormatError, match=r"bad\.glb"):
            formats.load(bad)


@pytest.mark.parametrize(
    "damage",
    [
        lambda json: json["nodes"][1].update(children=[2]),
        lambda json: json["nodes"][2].update(children=[7]),
        lambda json: json["skins"][0].update(joints=[]),
        lambda json: json["accessors"][0].update(count=10**9),
        lambda json: json["accessors"][0].update(count=0),
        lambda json: json["accessors"][0].update(componentType=1),
        lambda json: json["bufferViews"][1].update(byteOffset=10**6),
        lambda json: json["animations"][0]["channels"][0].update(sampler=4),
        lambda json: json["animations"][0].update(samplers=None),
        lambda json: json.update(nodes=5),
        lambda json: json["asset"].update(version="1.0"),
    ],
)
def test_nonsense_is_refused(tmp_path: Path, damage):
    document = foreign([0.0, 0.5], quaternions([0.3, 1.3]))
    damage(document.json)
    document.write(tmp_path / "a.glb")
    with pytest.raises(FileFormatError, match=r"a\.glb"):
        read_animations(tmp_path / "a.glb")


def test_files_elsewhere_are_not_read(tmp_path: Path):
    (tmp_path / "secret.bin").write_bytes(b"1234")
    (tmp_path / "in").mkdir()
    for uri in ("../secret.bin", str(tmp_path / "secret.bin"), "https://a.b/c.bin"):
        buffers = [{"uri": uri, "byteLength": 4}]
        text = json.dumps({"asset": {"version": "2.0"}, "buffers": buffers})
        (tmp_path / "in" / "a.gltf").write_text(text)
        with pytest.raises(FileFormatError, match="own folder"):
            Document.read(tmp_path / "in" / "a.gltf")


def test_joints_that_slide(tmp_path: Path):
    joints = walker(20).joints()
    joints[:, 3] += 0.02 * np.sin(np.arange(20))[:, None] * (1.0, 0, 0)
    motion = Motion(joints.astype("f4"))
    motion.save(tmp_path / "a.glb")
    found = read_animations(tmp_path / "a.glb")[0]
    assert found.translations is not None
    np.testing.assert_allclose(found.joints(), motion.animation().joints(), atol=1e-4)
    assert (quaternion_from_matrix(found.rotations)[..., 0] > -1).all()
