"""SMPL's pose features: the layout of ACTOR's data, upright joints, blank frames."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY
from latentmotion.motion import Motion
from latentmotion.representation import representation_named
from latentmotion.representation.canonical import canonicalize
from latentmotion.representation.smpl import SMPL_FEATURES, UPRIGHT, smpl_features
from tests.support.walker import walker

FACING_CAMERA = np.array([np.pi, 0, 0])


def some_poses(frames=12, seed=0):
    random = np.random.default_rng(seed)
    vectors = random.normal(0, 0.3, (frames, 24, 3))
    vectors[:, 0] = FACING_CAMERA + random.normal(0, 0.1, (frames, 3))
    return matrix_from_axis_angle(vectors), np.cumsum(random.normal(0, 0.1, (frames, 3)), axis=0)


def test_layout_is_channels_outermost_and_two_rows():
    rotations, way = some_poses()
    tokens = np.zeros((25, 6, 12))  # as ACTOR has it: joints, channels, frames
    tokens[:24] = rotations[:, :, :2].reshape(12, 24, 6).transpose(1, 2, 0)
    tokens[24, :3] = way.T
    expected = tokens.transpose(2, 1, 0).reshape(12, 150)
    np.testing.assert_allclose(smpl_features(rotations, way), expected, atol=1e-6)
    turns, found = SMPL_FEATURES.pose(expected)
    np.testing.assert_allclose(turns, rotations, atol=1e-9)
    np.testing.assert_allclose(found, way)


def test_joints_are_those_of_forward_kinematics_made_upright():
    rotations, way = some_poses()
    expected = BODY.forward_kinematics(rotations, way - way[0])
    features = smpl_features(rotations, way)
    np.testing.assert_allclose(SMPL_FEATURES.camera_joints(features), expected, atol=1e-5)
    joints = SMPL_FEATURES.decode(features)
    np.testing.assert_allclose((joints - joints[0, 0]) * UPRIGHT, expected, atol=1e-5)


def test_who_faces_the_camera_stands_upright_and_faces_ahead():
    vectors = np.zeros((3, 24, 3))
    vectors[:, 0] = FACING_CAMERA
    features = smpl_features(matrix_from_axis_angle(vectors), np.zeros((3, 3)))
    joints = SMPL_FEATURES.decode(features)
    np.testing.assert_allclose(joints[0] - joints[0, 0], BODY.rest_joints(), atol=1e-6)
    assert joints[..., 1].min() == pytest.approx(0, abs=1e-6)
    toes = joints[0, BODY.names.index("left_foot")] - joints[0, BODY.names.index("left_ankle")]
    assert toes[2] > 0.1


def test_padding_has_finite_joints_and_gradients():
    torch = pytest.importorskip("torch")
    features = torch.zeros(2, 5, 150)
    features[0] = torch.from_numpy(smpl_features(*some_poses(5)))
    features.requires_grad_()
    joints = SMPL_FEATURES.decode(features)
    joints.square().sum().backward()
    assert joints.isfinite().all()
    assert features.grad.isfinite().all()


def test_decoding_has_the_right_slope():
    torch = pytest.importorskip("torch")
    features = torch.from_numpy(smpl_features(*some_poses(3))).double().requires_grad_()
    assert torch.autograd.gradcheck(SMPL_FEATURES.decode, features)


def test_another_body_without_hands_is_followed(tmp_path):
    joints = 1.1 * walker().joints()
    body = SMPL_FEATURES.retarget(joints)
    assert body.shape == (60, 24, 3)
    found = SMPL_FEATURES.decode(SMPL_FEATURES.encode(body))
    expected = canonicalize(body, SMPL_FEATURES.skeleton)[:-1]
    np.testing.assert_allclose(canonicalize(found, SMPL_FEATURES.skeleton), expected, atol=1e-5)
    for child in (4, 5, 7, 8, 18, 19, 20, 21):  # limbs point where they did
        bones = [j[:, child] - j[:, BODY.parents[child]] for j in (joints, body)]
        ones = [b / np.linalg.norm(b, axis=-1, keepdims=True) for b in bones]
        np.testing.assert_allclose(*ones, atol=1e-9)
    Motion(found, 20.0, BODY).save(tmp_path / "walk.bvh")


def test_known_by_name_and_bad_joints():
    assert representation_named("smpl") is SMPL_FEATURES
    with pytest.raises(InputError, match="22 joints; smpl describes 24"):
        SMPL_FEATURES.encode(np.zeros((5, 22, 3)))
    with pytest.raises(InputError, match="1 frames"):
        SMPL_FEATURES.encode(np.zeros((1, 24, 3)))
    with pytest.raises(InputError, match="not finite"):
        SMPL_FEATURES.encode(np.full((5, 24, 3), np.nan))
