"""Joint maps: every dialect lands on HumanML3D's 22 joints, unknown ones say how to go on."""

from __future__ import annotations

import json

import numpy as np
import pytest

from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.kinematics.bone_names import find_joint_map, joint_maps
from latentmotion.kinematics.humanoid import load_joint_map, to_humanml3d
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton

H = {name: number for number, name in enumerate(HUMANML3D.names)}

ACCLAIM_PLACES = {
    **{"root": (0, 0, 0), "lowerback": (0, 0, 0), "upperback": (0, 0.12, 0)},
    **{"thorax": (0, 0.24, 0), "lowerneck": (0, 0.36, 0), "upperneck": (0, 0.46, 0)},
    **{"head": (0, 0.56, 0), "lfemur": (0.08, -0.1, 0.05), "ltibia": (0.22, -0.48, 0.05)},
    **{"lfoot": (0.37, -0.87, 0.05), "ltoes": (0.38, -0.9, 0.17), "lclavicle": (0, 0.36, 0)},
    **{"lhumerus": (0.19, 0.42, 0), "lradius": (0.47, 0.42, 0), "lwrist": (0.66, 0.42, 0)},
    "lhand": (0.76, 0.42, 0),
}
MOTIONBUILDER_NAMES = {
    **{"root": "Hips", "lowerback": "LowerBack", "upperback": "Spine", "thorax": "Spine1"},
    **{"lowerneck": "Neck", "upperneck": "Neck1", "head": "Head", "lfemur": "LeftUpLeg"},
    **{"ltibia": "LeftLeg", "lfoot": "LeftFoot", "ltoes": "LeftToeBase"},
    **{"lclavicle": "LeftShoulder", "lhumerus": "LeftArm", "lradius": "LeftForeArm"},
    **{"lwrist": "LeftFingerBase", "lhand": "LeftHand"},
}
DAZ_PLACES = {
    **{"hip": (0, 0, 0), "abdomen": (0, 0.207, 0), "chest": (0, 0.324, 0)},
    **{"neck": (0, 0.546, 0), "head": (0, 0.616, 0), "lCollar": (0.027, 0.516, 0)},
    **{"lShldr": (0.115, 0.497, 0), "lForeArm": (0.396, 0.48, 0), "lHand": (0.622, 0.488, 0)},
    **{"lButtock": (0.088, 0.044, 0), "lThigh": (0.088, 0.026, 0), "lShin": (0.088, -0.342, 0)},
    **{"lFoot": (0.08, -0.793, -0.05), "lFoot_end": (0.091, -0.83, 0.071)},
}
MIXAMO_PLACES = {
    **{"Hips": (0, 0, 0), "Spine": (0, 0.1, 0), "Spine1": (0, 0.22, 0), "Spine2": (0, 0.35, 0)},
    **{"Neck": (0, 0.5, 0), "Head": (0, 0.6, 0), "LeftShoulder": (0.06, 0.45, 0)},
    **{"LeftArm": (0.18, 0.44, 0), "LeftForeArm": (0.46, 0.44, 0), "LeftHand": (0.74, 0.44, 0)},
    **{"LeftUpLeg": (0.09, -0.06, 0), "LeftLeg": (0.09, -0.5, 0), "LeftFoot": (0.09, -0.94, 0)},
    "LeftToeBase": (0.09, -1.0, 0.12),
}


def other_side(name):
    if name.startswith("Left"):
        return "Right" + name.removeprefix("Left")
    is_left = name.startswith("l") and name not in ("lowerback", "lowerneck")
    return "r" + name[1:] if is_left else name


def standing(places, rename=lambda name: name):
    """One frame of a figure whose joints all hang on its root; its right mirrors its left."""
    both = {other_side(name): (-x, y, z) for name, (x, y, z) in places.items()} | places
    names = tuple(places)[:1] + tuple(sorted(set(both) - {next(iter(places))}))
    offsets = np.array([both[name] for name in names], dtype=float)
    parents = (-1, *[0] * (len(names) - 1))
    skeleton = Skeleton("figure", tuple(rename(name) for name in names), parents, offsets)
    rotations = np.tile(np.eye(3), (1, len(names), 1, 1))
    return Animation(skeleton, rotations, np.array([[0, 1.0, 0]]), 30.0)


FIGURES = {
    "acclaim": standing(ACCLAIM_PLACES),
    "motionbuilder": standing({MOTIONBUILDER_NAMES[n]: p for n, p in ACCLAIM_PLACES.items()}),
    "daz": standing(DAZ_PLACES),
    "mixamo": standing(MIXAMO_PLACES),
    "mixamorig:": standing(MIXAMO_PLACES, lambda name: f"mixamorig:{name}"),
    "mixamorig7:": standing(MIXAMO_PLACES, lambda name: f"mixamorig7:{name}"),
    "Bob:": standing(MIXAMO_PLACES, lambda name: f"Bob:{name}"),
}


@pytest.mark.parametrize("dialect", FIGURES)
def test_a_standing_figure_becomes_a_standing_body(dialect):
    figure = FIGURES[dialect]
    assert find_joint_map(figure.skeleton.names) is joint_maps().get(
        dialect, joint_maps()["mixamo"]
    )
    joints = to_humanml3d(figure)
    assert joints.shape == (1, 22, 3)
    (body,) = joints
    # Left is left, and the right mirrors it.
    np.testing.assert_allclose(body[list(HUMANML3D.mirror)], body * [-1, 1, 1], atol=1e-12)
    sides = [number for name, number in H.items() if name.startswith("left")]
    assert (body[sides, 0] > 0).all()
    # Joints follow one another upwards along the spine, downwards along the legs, and outwards.
    spine = [H[n] for n in ("pelvis", "spine1", "spine2", "spine3", "neck", "head")]
    assert (np.diff(body[spine, 1]) > 0).all()
    legs = [H[f"left_{n}"] for n in ("hip", "knee", "ankle", "foot")]
    assert (np.diff(body[legs, 1]) < 0).all()
    arms = [H[f"left_{n}"] for n in ("collar", "shoulder", "elbow", "wrist")]
    assert (np.diff(body[arms, 0]) > 0).all()
    assert body[H["left_foot"], 2] > body[H["left_ankle"], 2]
    assert body[H["pelvis"], 1] > body[H["left_hip"], 1]


@pytest.mark.parametrize("dialect", FIGURES)
def test_bones_come_close_to_the_canonical_ones(dialect):
    (body,) = to_humanml3d(FIGURES[dialect])
    lengths = np.linalg.norm(body - body[list(HUMANML3D.parents)], axis=-1)[1:]
    canonical = np.linalg.norm(HUMANML3D.offsets, axis=-1)[1:]
    assert lengths.min() > 0.03
    assert np.abs(lengths - canonical).max() < 0.1


def test_motionbuilder_is_acclaim_under_other_names():
    expected = to_humanml3d(FIGURES["acclaim"])
    np.testing.assert_allclose(to_humanml3d(FIGURES["motionbuilder"]), expected, atol=1e-12)


def test_our_own_files_come_back(tmp_path):
    rotations = np.tile(np.eye(3), (3, 22, 1, 1))
    animation = Animation(HUMANML3D, rotations, np.array([[0, 0.9, 0]] * 3), 20.0)
    write_bvh(tmp_path / "own.bvh", animation)
    joints = to_humanml3d(read_bvh(tmp_path / "own.bvh"))
    np.testing.assert_allclose(joints, animation.joints(), atol=1e-6)


def test_an_unknown_skeleton_names_ten_joints_and_what_to_do():
    assert find_joint_map(["bone1", "bone2"]) is None
    figure = standing(MIXAMO_PLACES, lambda name: f"the_{name[::-1]}")
    with pytest.raises(DataError) as error:
        to_humanml3d(figure)
    said = str(error.value)
    assert "'the_spiH'" in said and "--draft-map map.json" in said
    assert said.count("'the_") == 10 and len(said) < 500


def test_a_map_of_ones_own(tmp_path):
    figure = standing(MIXAMO_PLACES, lambda name: f"my_{name}")
    sources = [
        next(iter(source)) if isinstance(source, dict) else source
        for source in (joint_maps()["mixamo"][name] for name in HUMANML3D.names)
    ]
    joint_map = {n: f"my_{s}" for n, s in zip(HUMANML3D.names, sources, strict=True)}
    expected = to_humanml3d(FIGURES["mixamo"])
    np.testing.assert_allclose(to_humanml3d(figure, joint_map), expected)
    joint_map["spine3"] = {"my_Spine1": 0.5, "my_Spine2": 0.5}
    (tmp_path / "map.json").write_text(json.dumps(joint_map))
    mixed = to_humanml3d(figure, load_joint_map(tmp_path / "map.json"))
    np.testing.assert_allclose(mixed[0, H["spine3"], 1], 1.0 + (0.22 + 0.35) / 2)


def test_a_map_that_does_not_fit():
    figure = FIGURES["mixamo"]
    own = dict(joint_maps()["mixamo"])
    with pytest.raises(DataError, match=r"'hips', which is none of .* nearest are 'Hips'"):
        to_humanml3d(figure, own | {"pelvis": "hips"})
    del own["left_wrist"]
    with pytest.raises(DataError, match="found no left_wrist"):
        to_humanml3d(figure, own)


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        ('{"pelvis": "Hips"\n]', 2, "not JSON"),
        ('["Hips"]', None, "expected an object"),
        ('{"pelvis": 3}', None, "expected an object"),
        ('{"pelvis": {"Hips": 0.5}}', None, "sum to 1"),
        ('{"pelvis": {"Hips": "1"}}', None, "sum to 1"),
    ],
)
def test_damaged_map_files(tmp_path, content, line, message):
    path = tmp_path / "map.json"
    path.write_text(content)
    with pytest.raises(FileFormatError, match=message) as error:
        load_joint_map(path)
    assert error.value.line == line


def test_map_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FileFormatError, match="No such file"):
        load_joint_map(tmp_path / "none.json")
    (tmp_path / "map.json").write_bytes(b"\xff\xfe\xfa")
    with pytest.raises(FileFormatError, match="UTF-8"):
        load_joint_map(tmp_path / "map.json")
