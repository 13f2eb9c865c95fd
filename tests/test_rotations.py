"""Rotations: group laws, oracles (roma, scipy), and the places where formulas divide by zero."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from latentmotion.errors import InputError
from latentmotion.kinematics import rotations as R

torch = pytest.importorskip("torch")
roma = pytest.importorskip("roma")
Rotation = pytest.importorskip("scipy.spatial.transform").Rotation

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)
ORDERS = ["".join(order) for order in permutations("XYZ")]
few = settings(max_examples=25)


def close(a, b, atol=1e-9):
    np.testing.assert_allclose(np.asarray(a), np.asarray(b), atol=atol, rtol=0)


def random_quaternions(*shape, seed=0):
    q = np.random.default_rng(seed).standard_normal((*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@few
@given(vectors, vectors, vectors)
def test_group_laws(u, v, w):
    a, b, c = (R.quaternion_from_axis_angle(x) for x in (u, v, w))
    one = np.array([1.0, 0, 0, 0])
    left = R.quaternion_multiply(R.quaternion_multiply(a, b), c)
    close(left, R.quaternion_multiply(a, R.quaternion_multiply(b, c)))
    close(R.quaternion_multiply(a, R.quaternion_conjugate(a)), one)
    close(R.quaternion_multiply(a, one), a)
    turned = R.quaternion_rotate(a, R.quaternion_rotate(b, w))
    close(R.quaternion_rotate(R.quaternion_multiply(a, b), w), turned)
    product = R.matrix_from_quaternion(a) @ R.matrix_from_quaternion(b)
    close(R.matrix_from_quaternion(R.quaternion_multiply(a, b)), product)


@few
@given(vectors, st.sampled_from(ORDERS))
def test_every_form_returns_to_the_same_matrix(v, order):
    m = R.matrix_from_axis_angle(v)
    close(m @ m.T, np.eye(3))
    close(R.matrix_from_quaternion(R.quaternion_from_matrix(m)), m)
    close(R.matrix_from_axis_angle(R.axis_angle_from_matrix(m)), m, 1e-8)
    close(R.matrix_from_euler(R.euler_from_matrix(m, order), order), m, 1e-6)
    for layout in ("columns", "rows"):
        close(R.matrix_from_sixd(R.sixd_from_matrix(m, layout), layout), m)


def test_agrees_with_scipy_and_roma():
    q = random_quaternions(200)
    oracle = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    m = R.matrix_from_quaternion(q)
    close(m, oracle.as_matrix())
    close(R.axis_angle_from_matrix(m), oracle.as_rotvec(), 1e-7)
    for order in ORDERS:
        close(R.euler_from_matrix(m, order), oracle.as_euler(order))
        close(R.matrix_from_euler(oracle.as_euler(order), order), m)
    flat = torch.from_numpy(q)[:, [1, 2, 3, 0]]
    expected = roma.utils.unitquat_slerp(flat[:100], flat[100:], torch.tensor([0.3]), True)[0]
    found = R.slerp(q[:100], q[100:], 0.3)
    same = abs(np.sum(found[:, [1, 2, 3, 0]] * expected.numpy(), axis=-1))
    close(same, np.ones(100))
    sixd = np.random.default_rng(1).standard_normal((50, 6))
    gram = roma.special_gramschmidt(torch.from_numpy(sixd.reshape(50, 2, 3)).mT)
    close(R.matrix_from_sixd(sixd, "columns"), gram.numpy())


def test_numpy_and_torch_agree_in_their_own_precision():
    q = random_quaternions(2, 7).astype(np.float32)
    m = R.matrix_from_quaternion(q)
    chain = [
        (R.quaternion_from_matrix, m),
        (R.axis_angle_from_matrix, m),
        (R.quaternion_from_axis_angle, q[..., :3]),
        (lambda x: R.sixd_from_matrix(x, "rows"), m),
        (lambda x: R.euler_from_matrix(x, "ZXY"), m),
        (lambda x: R.matrix_from_euler(x, "ZXY"), q[..., :3]),
        (lambda x: R.quaternion_between(x[..., :3], x[..., 1:]), q),
        (R.continuous_quaternions, q),
        (lambda x: R.slerp(x[0], x[1], x[0, :, 0]), q),
    ]
    for function, argument in chain:
        ours, theirs = function(argument), function(torch.from_numpy(argument))
        assert ours.dtype == np.float32
        assert theirs.dtype == torch.float32
        close(ours, theirs, 1e-5)


@few
@given(vectors, vectors)
def test_between_takes_one_direction_to_the_other(a, b):
    a, b = a + np.array([4, 0, 0]), b + np.array([0, 4, 0])
    turned = R.quaternion_rotate(R.quaternion_between(a, b), a / np.linalg.norm(a))
    close(turned, b / np.linalg.norm(b))


@pytest.mark.parametrize("axis", np.eye(3).tolist())
def test_between_opposite_and_zero(axis):
    a = np.array(axis)
    close(R.quaternion_rotate(R.quaternion_between(a, -a), a), -a)
    close(R.quaternion_between(a, a), [1, 0, 0, 0])
    close(R.quaternion_between(0 * a, a), [1, 0, 0, 0])


def test_half_turns_and_gimbal_lock():
    for axis in np.eye(3):
        m = R.matrix_from_axis_angle(np.pi * axis)
        close(abs(R.axis_angle_from_matrix(m)), np.pi * axis, 1e-7)
    for order in ORDERS:
        m = R.matrix_from_euler(np.array([0.4, np.pi / 2, -0.7]), order)
        angles = R.euler_from_matrix(m, order)
        assert angles[2] == 0
        close(R.matrix_from_euler(angles, order), m, 1e-6)


def test_gradients_are_finite_at_the_identity():
    v = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    loops = R.axis_angle_from_matrix(R.matrix_from_axis_angle(v))
    jacobian = torch.stack([torch.autograd.grad(x, v, retain_graph=True)[0] for x in loops])
    close(jacobian, np.eye(3))
    q = torch.tensor([1.0, 0, 0, 0], requires_grad=True)
    R.slerp(q, q, 0.5).sum().backward()
    assert torch.isfinite(q.grad).all()


def test_continuity_removes_sign_jumps():
    angle = np.linspace(0, 12, 100)[:, None, None]
    smooth = R.quaternion_from_axis_angle(angle * np.array([[0, 1, 0], [0, 0.6, 0.8]]))
    signs = np.random.default_rng(0).choice([-1, 1], (100, 2, 1))
    signs[0] = 1
    close(R.continuous_quaternions(signs * smooth), smooth)


def test_wrong_orders_are_refused():
    with pytest.raises(InputError, match="one of the letters"):
        R.matrix_from_euler(np.zeros(3), "ZX")
    with pytest.raises(InputError, match="permutation"):
        R.euler_from_matrix(np.eye(3), "ZXZ")
