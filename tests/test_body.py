"""SMPL model files and skinning: closed forms, another way to compute it, bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import FileFormatError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY
from latentmotion.kinematics.smpl import SkinnedBody, load_smpl
from latentmotion.representation.smpl import representation_of
from synthetic_smpl import synthetic_arrays, write_synthetic_smpl


def two_bones() -> SkinnedBody:
    """A forearm and a hand along x, of three vertices: on each and where they meet."""
    return SkinnedBody(
        template=np.array([[0.5, 0.1, 0.0], [1.0, 0.0, 0.2], [1.5, 0.0, 0.0]]),
        shape_directions=np.zeros((3, 3, 1)),
        pose_directions=np.zeros((3, 3, 9)),
        joint_regressor=np.array([[2.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) * [1.0, 1.0, 1.0],
        weights=np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]),
        parents=(-1, 0),
    )


@pytest.fixture(scope="module")
def body(tmp_path_factory) -> SkinnedBody:
    path = write_synthetic_smpl(tmp_path_factory.mktemp("smpl") / "smpl.npz")
    return load_smpl(path).body.like(np.zeros(1))


def some_rotations(*batch, seed=0):
    vectors = np.random.default_rng(seed).normal(0, 0.5, (*batch, 24, 3))
    return matrix_from_axis_angle(vectors)


def test_two_bones_bend_as_on_paper():
    bent = matrix_from_axis_angle(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2]]))
    body = two_bones()
    wrist = body.rest_joints()[1]
    np.testing.assert_allclose(wrist, [1.0, 0.0, 0.2])
    arm, skin, hand = body.posed(bent)
    np.testing.assert_allclose(arm, [0.5, 0.1, 0.0])  # on the bone that does not turn
    np.testing.assert_allclose(skin, [1.0, 0.0, 0.2], atol=1e-12)  # at the joint itself
    np.testing.assert_allclose(hand, [1.0, 0.5, 0.0], atol=1e-12)  # a quarter turn about z


def test_rest_pose_is_the_template(body):
    rest = np.broadcast_to(np.eye(3), (2, 24, 3, 3))
    np.testing.assert_allclose(body.posed(rest), np.stack([body.template] * 2), atol=1e-6)
    shape = np.linspace(-1, 1, 10)
    np.testing.assert_allclose(body.posed(rest[0], shape), body.shaped(shape), atol=1e-6)
    assert abs(body.shaped(shape) - body.template).max() > 0.01


def test_turning_the_root_turns_every_vertex_about_it(body):
    rotations = some_rotations(3)
    turn = matrix_from_axis_angle(np.array([0.3, -0.8, 0.5]))
    turned = rotations.copy()
    turned[:, 0] = turn @ rotations[:, 0]
    root = body.rest_joints()[0]
    expected = (body.posed(rotations) - root) @ turn.T + root
    np.testing.assert_allclose(body.posed(turned), expected, atol=1e-9)


def test_joints_of_the_surface_are_those_of_forward_kinematics(tmp_path):
    # A surface that follows one joint each, without bulges, keeps the joints in its middle.
    arrays = synthetic_arrays()
    whole = {"weights": np.repeat(np.eye(24), 8, axis=0), "posedirs": 0 * arrays["posedirs"]}
    model = load_smpl(write_synthetic_smpl(tmp_path / "a.npz", **whole))
    rotations = some_rotations(4).astype(np.float32)
    found = model.body.joint_regressor @ model.body.posed(rotations)
    root = np.zeros((4, 3), np.float32)
    expected = model.skeleton.forward_kinematics(rotations, root)
    np.testing.assert_allclose(found - found[:, :1], expected, atol=1e-5)
    np.testing.assert_allclose(model.skeleton.offsets, BODY.offsets, atol=1e-6)
    assert representation_of(model).skeleton.name == "smpl"


def test_against_the_formula_with_homogeneous_matrices():
    """SMPL as its paper writes it: 4 x 4 transforms, each relative to the rest pose."""
    arrays, rotations = synthetic_arrays(), some_rotations(seed=3)
    shape = np.random.default_rng(1).normal(size=10)
    surface = arrays["v_template"] + np.einsum("vds,s->vd", arrays["shapedirs"], shape)
    joints = arrays["J_regressor"] @ surface
    surface = surface + arrays["posedirs"] @ (rotations[1:] - np.eye(3)).ravel()
    chain = []
    for joint, parent in enumerate(BODY.parents):
        own = np.eye(4)
        own[:3, :3] = rotations[joint]
        own[:3, 3] = joints[joint] - (joints[parent] if parent >= 0 else 0)
        chain.append(own if parent < 0 else chain[parent] @ own)
    homogeneous = np.concatenate([surface, np.ones((len(surface), 1))], axis=1)
    expected = np.zeros_like(surface)
    for joint, transform in enumerate(chain):
        back = np.eye(4)
        back[:3, 3] = -joints[joint]
        moved = homogeneous @ (transform @ back).T
        expected += arrays["weights"][:, [joint]] * moved[:, :3]
    body = SkinnedBody(
        arrays["v_template"],
        arrays["shapedirs"],
        arrays["posedirs"],
        arrays["J_regressor"],
        arrays["weights"],
        BODY.parents,
    )
    np.testing.assert_allclose(body.posed(rotations, shape), expected, atol=1e-12)


def test_both_libraries_and_batches_agree_and_gradients_are_right(body):
    torch = pytest.importorskip("torch")
    rotations = some_rotations(2, 3)
    expected = body.posed(rotations)
    assert expected.shape == (2, 3, 192, 3)
    theirs = torch.from_numpy(rotations)
    torch_body = body.like(theirs)
    np.testing.assert_allclose(torch_body.posed(theirs).numpy(), expected, atol=1e-12)
    np.testing.assert_allclose(body.posed(rotations[1, 2]), expected[1, 2], atol=1e-12)
    small = two_bones().like(theirs)
    bends = torch.randn(2, 3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(small.posed, bends)


@pytest.mark.parametrize("ending", [".npz", ".pkl"])
def test_files(tmp_path, ending):
    model = load_smpl(write_synthetic_smpl(tmp_path / f"smpl{ending}"))
    np.testing.assert_allclose(model.body.template, synthetic_arrays()["v_template"], rtol=1e-6)
    assert model.body.parents == BODY.parents
    assert model.faces.shape == (300, 3)
    assert len(model.fingerprint) == 64


def test_a_file_with_a_sparse_regressor(tmp_path):
    sparse = pytest.importorskip("scipy.sparse")
    regressor = sparse.csc_matrix(synthetic_arrays()["J_regressor"])
    model = load_smpl(write_synthetic_smpl(tmp_path / "smpl.pkl", J_regressor=regressor))
    np.testing.assert_allclose(model.body.joint_regressor, regressor.todense())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": None}, "lacks weights; found v_template"),
        ({"posedirs": np.zeros((192, 3, 486))}, r"posedirs has the shape \(192, 3, 486\).*SMPL-X"),
        ({"weights": np.zeros((100, 24))}, r"weights has the shape \(100, 24\)"),
        ({"kintree_table": np.zeros((2, 24), np.uint32)}, "joints with the parents"),
        ({"f": np.full((2, 3), 500, np.uint32)}, "names vertex 500 of 192"),
        ({"v_template": np.full((192, 3), np.nan)}, "not finite"),
        ({"v_template": np.array(["a"])}, "holds <U1, expected numbers"),
    ],
)
def test_files_that_are_not_smpl(tmp_path, changes, message):
    path = write_synthetic_smpl(tmp_path / "smpl.npz", **changes)
    with pytest.raises(FileFormatError, match=message):
        load_smpl(path)


def test_files_that_cannot_be_read(tmp_path: Path):
    (tmp_path / "a.npz").write_bytes(b"x")
    (tmp_path / "a.txt").write_bytes(b"x")
    (tmp_path / "list.pkl").write_bytes(b"\x80\x04].")
    for name, message in (
        ("none.npz", "no such file; bring a SMPL model"),
        ("a.npz", "no .npz of plain arrays"),
        ("a.txt", "the ending '.txt' is unknown"),
        ("list.pkl", "expected a dictionary, found a list"),
    ):
        with pytest.raises(FileFormatError, match=message):
            load_smpl(tmp_path / name)
