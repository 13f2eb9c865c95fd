"""Mannequins: bodies of all rest poses have one mesh, which lies on the skin of each."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Skeleton
from latentmotion.render import mannequin
from latentmotion.render.mannequin import Mannequin, make_mannequin
from tests.support.walker import t_pose


def person(seed: int, collar: float, slope: float = 30.0, arms: float = 0.0) -> Skeleton:
    """A rest pose with bones of its own: angles of collars, feet and arms in degrees."""
    rng = np.random.default_rng(seed)
    offsets = t_pose().skeleton.offsets * rng.uniform(0.95, 1.05, (len(HUMANML3D), 1))
    for joint, name in enumerate(HUMANML3D.names):
        side, _, part = name.rpartition("_")
        angles = {"collar": collar, "elbow": -arms, "wrist": -arms}
        length, sign = np.linalg.norm(offsets[joint]), 1 if side == "left" else -1
        if part in angles:
            along = np.radians(angles[part])
            offsets[joint] = length * np.array([sign * np.cos(along), np.sin(along), 0])
        elif part == "foot":
            down = np.radians(slope)
            offsets[joint] = length * np.array([0, -np.sin(down), np.cos(down)])
        elif part == "head":
            offsets[joint] = 0, length, 0
        elif part == "hip":
            offsets[joint] = length * np.array([sign * 0.71, -0.68, rng.uniform(0, 0.35)])
    return replace(HUMANML3D, offsets=rng.uniform(0.8, 1.2) * offsets)


def off_the_skin(found: Mannequin) -> Float[np.ndarray, " vertices"]:
    """How far each vertex is from the surface that the formula gives, in meters."""
    body, points = mannequin._Body(found.skeleton), np.ascontiguousarray(found.vertices.T)
    value, slope, _ = body.evaluate(points, body.near(points))
    return np.abs(value) / np.linalg.norm(slope, axis=0)


PEOPLE = [person(0, 0.0), person(1, 15.0, 20.0), person(2, 35.0), person(3, 55.0, 45.0)]


@pytest.mark.parametrize("skeleton", [*PEOPLE, BODY, replace(BODY, offsets=1.1 * BODY.offsets)])
def test_vertices_lie_on_the_skin_of_their_own_body(skeleton: Skeleton) -> None:
    found = make_mannequin(skeleton)
    off = off_the_skin(found)
    assert np.quantile(off, 0.99) < 5e-4
    assert (off > 1e-3).mean() < 5e-3  # between the thighs, where the skins of two legs meet


@pytest.mark.parametrize("skeleton", PEOPLE)
def test_the_mesh_stays_closed_and_faces_outward(skeleton: Skeleton) -> None:
    found = make_mannequin(skeleton)
    edges = Counter((a, b) for quad in found.quads.tolist() for a, b in
                    zip(quad, quad[1:] + quad[:1], strict=True))  # fmt: skip
    assert set(edges.values()) == {1} and all((b, a) in edges for a, b in edges)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=-1), 1, atol=1e-6)
    faces = found.vertices[found.quads]
    outward = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    assert ((outward * found.normals[found.quads].sum(1)).sum(-1) > 0).mean() > 0.995
    np.testing.assert_allclose(found.weights.sum(-1), 1, atol=1e-6)
    assert found.vertices[:, 1].min() == pytest.approx(skeleton.rest_joints()[:, 1].min(), abs=1e-4)


def test_it_surrounds_its_bones() -> None:
    found = make_mannequin(t_pose().skeleton)
    rest = found.skeleton.rest_joints()
    assert np.linalg.norm(found.vertices[:, None] - rest, axis=-1).min(0).max() < 0.2


def test_bodies_of_two_kinds_of_shoulders_take_two_meshes() -> None:
    meshes = {id(make_mannequin(person(seed, collar)).quads)
              for seed in range(4) for collar in (0.0, 55.0)}  # fmt: skip
    assert len(meshes) == 2


@pytest.mark.parametrize("skeleton", [person(0, 55.0, arms=45.0), KIT])
def test_other_rest_poses_are_meshed_anew(skeleton: Skeleton) -> None:
    found = make_mannequin(skeleton)
    assert found.quads is not make_mannequin(PEOPLE[3]).quads
    assert np.quantile(off_the_skin(found), 0.99) < 5e-4


def test_shared_meshes_cannot_be_written_to() -> None:
    found = make_mannequin(PEOPLE[0])
    for array in (found.quads, found.joints, found.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
