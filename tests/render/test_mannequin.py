"""The mannequin: one mesh for all bodies, closed, around its bones, and small."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Skeleton
from latentmotion.render.mannequin import make_mannequin
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


PEOPLE = [person(0, 0.0), person(1, 15.0, 20.0), person(2, 35.0), person(3, 55.0, 45.0)]
BODIES = [*PEOPLE, person(0, 55.0, arms=45.0), BODY, KIT, replace(BODY, offsets=2 * BODY.offsets)]


@pytest.mark.parametrize("skeleton", BODIES)
def test_every_body_has_the_same_mesh_around_its_own_bones(skeleton: Skeleton) -> None:
    found, other = make_mannequin(skeleton), make_mannequin(PEOPLE[0])
    np.testing.assert_array_equal(found.triangles, other.triangles)
    scale = np.ptp(skeleton.rest_joints()[:, 1]) / 1.5
    rest = skeleton.rest_joints()
    assert np.linalg.norm(found.vertices[:, None] - rest, axis=-1).min(0).max() < 0.14 * scale
    np.testing.assert_allclose(found.weights.sum(-1), 1, atol=1e-6)
    assert found.joints.max() < len(skeleton)


@pytest.mark.parametrize("skeleton", BODIES)
def test_parts_are_closed_and_face_outward(skeleton: Skeleton) -> None:
    found = make_mannequin(skeleton)
    edges = Counter(
        (face[corner], face[corner - 2]) for face in found.triangles.tolist() for corner in range(3)
    )
    assert set(edges.values()) == {1}
    open_edges = [edge for edge in edges if edge[::-1] not in edges]
    assert len(open_edges) == 28  # the rim of the face, which lies in the head
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=-1), 1, atol=1e-6)
    a, b, c = np.moveaxis(found.vertices[found.triangles], 1, 0)
    outward = np.cross(b - a, c - a) * found.normals[found.triangles].sum(1)
    assert (outward.sum(-1) > 0).mean() > 0.995
    volume = (a * np.cross(b, c)).sum() / 6
    height = np.ptp(found.vertices[:, 1])
    assert 0.008 < volume / height**3 < 0.02


def test_it_is_small_and_mostly_grey_and_the_same_on_both_sides() -> None:
    found = make_mannequin(BODY)
    assert len(found.triangles) <= 6000
    assert 0.7 < found.shell / len(found.triangles) < 0.9
    mirrored = found.vertices * (-1, 1, 1)
    apart = np.linalg.norm(mirrored[:, None] - found.vertices, axis=-1).min(-1)
    assert np.quantile(apart, 0.99) < 0.003


def test_the_face_looks_ahead_and_the_toes_point_there() -> None:
    found = make_mannequin(t_pose().skeleton)
    names = found.skeleton.names
    accent = np.unique(found.triangles[found.shell :])
    face = [v for v in accent if found.joints[v, 0] == names.index("head")]
    face = [v for v in face if found.weights[v, 0] == 1 and found.vertices[v, 2] > 0.06]
    assert len(face) > 30
    assert (found.normals[face] @ (0, 0, 1)).mean() > 0.6
    toes = found.vertices[found.joints[:, 0] == names.index("left_foot")]
    assert toes[:, 2].max() > found.skeleton.rest_joints()[names.index("left_foot"), 2] + 0.05


def test_other_joints_get_a_stick_for_each_bone() -> None:
    names = ("root", "tail", "tip")
    offsets = np.array([(0, 0, 0), (0, 0.3, 0), (0.2, 0, 0)], float)
    found = make_mannequin(Skeleton("snake", names, (-1, 0, 1), offsets))
    assert found.shell == 0
    assert set(found.joints[:, 0]) == {0, 1}
    np.testing.assert_allclose(np.ptp(found.vertices, axis=0)[:2], (0.24, 0.34), atol=0.05)
