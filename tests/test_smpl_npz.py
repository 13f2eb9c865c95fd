"""SMPL's poses as .npz: axes, rest pose and keys as AMASS and smplx have them, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError, InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT
from latentmotion.motion import Motion
from walker import walker

LAYOUTS = (".amass.npz", ".smplx.npz", ".smpl.npz")
LIMBS = [
    HUMANML3D.names.index(f"{side}_{joint}")
    for side in ("left", "right")
    for joint in ("elbow", "wrist", "knee", "ankle", "foot")
]
SMPL_BODY = replace(
    BODY, names=BODY.names[:22], parents=BODY.parents[:22], offsets=BODY.offsets[:22]
)


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(30).joints().astype("f4")
    return Motion(joints, caption="a walk", metadata={"seed": 7})


def directions(joints: np.ndarray) -> np.ndarray:
    bones = joints - joints[:, [max(parent, 0) for parent in HUMANML3D.parents]]
    return bones / np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-9)


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    cosine = (directions(a)[:, 1:] * directions(b)[:, 1:]).sum(-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("ending", LAYOUTS)
def test_a_body_like_smpls_comes_back(tmp_path: Path, ending: str):
    joints = replace(walker(30), skeleton=SMPL_BODY).joints().astype("f4")
    motion = Motion(joints, caption="a walk", metadata={"seed": 7})
    assert motion.save(tmp_path / f"a{ending}") == [tmp_path / f"a{ending}"]
    read = Motion.load(tmp_path / f"a{ending}")
    assert (read.caption, read.fps, read.metadata) == ("a walk", 20, {"seed": 7})
    assert np.linalg.norm(read.joints - joints, axis=-1).max() < 1e-3


def test_other_bodies_bend_their_limbs_the_same(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.amass.npz")
    read = Motion.load(tmp_path / "a.amass.npz")
    error = degrees(read.joints, motion.joints)
    assert error[:, [joint - 1 for joint in LIMBS]].max() < 0.1
    np.testing.assert_allclose(read.joints[:, 0], motion.joints[:, 0], atol=1e-5)


def test_amass_has_z_up_and_its_keys(motion: Motion, tmp_path: Path):
    joints = BODY.rest_joints()[None, :22] + [0, 1.0, 0.5]
    Motion(joints.repeat(2, 0).astype("f4"), fps=30).save(tmp_path / "t.amass.npz")
    with np.load(tmp_path / "t.amass.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert arrays["poses"].shape == (2, 156)
    assert (str(arrays["gender"]), float(arrays["mocap_framerate"])) == ("neutral", 30)
    assert {name: arrays[name].shape for name in ("betas", "dmpls", "trans")} == {
        **{"betas": (16,), "dmpls": (2, 8), "trans": (2, 3)}
    }
    # A T-pose that faced +z stands upright in z-up axes and faces -y.
    np.testing.assert_allclose(arrays["poses"][0, :3], [np.pi / 2, 0, 0], atol=0.02)
    assert np.abs(arrays["poses"][0, 3:]).max() < 0.25
    np.testing.assert_allclose(arrays["trans"][0], [0, -0.5 + 0.22, 1 - 0.03], atol=1e-6)


def test_smplx_has_all_parts(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.smplx.npz", fps=30)
    with np.load(tmp_path / "a.smplx.npz", allow_pickle=False) as file:
        parts = [file[f"{name}"] for name in ("root_orient", "pose_body", "pose_jaw", "pose_eye")]
        poses = np.concatenate([*parts, file["pose_hand"]], axis=1)
        np.testing.assert_array_equal(file["poses"], poses)
        assert poses.shape == (44, 165)
        assert int(file["mocap_frame_rate"]) == 30
        assert str(file["surface_model_type"]) == "smplx"


def test_smpl_are_the_arguments_of_the_package(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.smpl.npz")
    with np.load(tmp_path / "a.smpl.npz", allow_pickle=False) as file:
        shapes = {name: file[name].shape for name in ("global_orient", "body_pose", "transl")}
        turn = matrix_from_axis_angle(file["global_orient"])
    assert shapes == {"global_orient": (30, 3), "body_pose": (30, 69), "transl": (30, 3)}
    # y stays up, and the body faces where it walks to.
    assert turn[:, 1, 1].min() > 0.9
    way = np.gradient(motion.joints[:, 0], axis=0)[:, [0, 2]]
    across = motion.joints[:, 1] - motion.joints[:, 2]
    facing = np.stack([-across[:, 2], across[:, 0]], axis=-1)
    agree = np.sign((facing * turn[:, [0, 2], 2]).sum(-1))
    assert (agree == 1).all()
    assert way.shape == (30, 2)


def test_takes_are_numbered_before_the_whole_ending(motion: Motion, tmp_path: Path):
    written = formats.save(tmp_path / "a.amass.npz", [motion, motion])
    assert [path.name for path in written] == ["a-1.amass.npz", "a-2.amass.npz"]
    assert [path.name for path in formats.save(tmp_path / "a.v2.bvh", [motion, motion])] == [
        *("a.v2-1.bvh", "a.v2-2.bvh")
    ]
    assert formats.save(tmp_path / "b.v2.npz", [motion]) == [tmp_path / "b.v2.npz"]
    assert "joints" in np.load(tmp_path / "b.v2.npz").files


def test_other_skeletons_are_refused(tmp_path: Path):
    kit = Motion(KIT.rest_joints()[None].astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="SMPL's joints"):
        kit.save(tmp_path / "a.amass.npz")
    assert not list(tmp_path.iterdir())


def test_one_frame_and_24_joints(tmp_path: Path):
    body = Motion(BODY.rest_joints()[None].astype("f4"), skeleton=BODY)
    body.save(tmp_path / "a.smpl.npz")
    read = Motion.load(tmp_path / "a.smpl.npz")
    np.testing.assert_allclose(read.joints, body.joints[:, :22], atol=0.03)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"trans": np.zeros((3, 3))}, "found poses"),
        ({"poses": np.zeros((30, 12))}, "found poses"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "found poses"),
        ({"trans": np.full((30, 3), np.nan)}, "NaN"),
        ({"mocap_framerate": np.array(-1.0)}, "fps"),
        ({"mocap_framerate": None}, "frame rate"),
    ],
)
def test_bad_files_are_named(motion: Motion, tmp_path: Path, change: dict, says: str):
    motion.save(tmp_path / "a.amass.npz")
    with np.load(tmp_path / "a.amass.npz") as file:
        arrays = dict(file) | change
    np.savez(tmp_path / "b.npz", **{k: v for k, v in arrays.items() if v is not None})
    with pytest.raises(FileFormatError, match=says):
        Motion.load(tmp_path / "b.npz")
