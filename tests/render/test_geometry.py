"""Cameras by figures worked out by hand, and surfaces by their closed forms."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from latentmotion.render.mannequin import surface_net
from latentmotion.render.painter import (
    Camera,
    camera_around,
    camera_of_all,
    facing,
    half_front,
)
from latentmotion.representation.canonical import turn
from tests.support.simple_motions import figure

SIZE = (400, 200)


def looking_back() -> Camera:
    """At z = 5, toward the origin, -z ahead: +x is on its right."""
    return Camera(np.array([0.0, 0, 5]), np.zeros(3), 100.0, SIZE)


@pytest.mark.parametrize(
    ("point", "pixel", "depth"),
    [
        ((0, 0, 0), (200, 100), 5),
        ((1, 0, 0), (220, 100), 5),  # 100 px / 5 m
        ((0, 1, 0), (200, 80), 5),  # up is a smaller row
        ((1, -1, 3), (250, 150), 2),
        ((-2, 0.5, -5), (180, 95), 10),
        ((0.001, 0, 5), (201, 100), 0),  # never nearer than 0.1 m
    ],
)
def test_points_become_the_pixels_of_a_pinhole(
    point: tuple[float, ...], pixel: tuple[float, ...], depth: float
) -> None:
    (found,), (far,) = looking_back().project(np.array([point], float))
    np.testing.assert_allclose(found, pixel, atol=1e-9)
    assert far == pytest.approx(depth)


def test_many_points_are_each_seen_as_alone() -> None:
    points = np.random.default_rng(0).normal(size=(3, 4, 3))
    camera = camera_around(np.array([0.3, 1, 0]), 0.7, 0.2, 6.0, SIZE, 2.0)
    pixels, depths = camera.project(points)
    for row, column in np.ndindex(3, 4):
        (pixel,), (depth,) = camera.project(points[row, column][None])
        np.testing.assert_allclose(pixels[row, column], pixel)
        assert depths[row, column] == pytest.approx(depth)


@pytest.mark.parametrize("azimuth", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("elevation", [-0.3, 0.0, 1.2])
def test_axes_are_square_and_level(azimuth: float, elevation: float) -> None:
    camera = camera_around(np.array([1.0, 2, 3]), azimuth, elevation, 4.0, SIZE, 2.0)
    axes = np.stack(camera.axes())
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    right, up, ahead = axes
    np.testing.assert_allclose(np.cross(right, up), -ahead, atol=1e-12)
    assert right[1] == pytest.approx(0) and up[1] > 0
    assert ahead[1] == pytest.approx(-np.sin(elevation))


def test_a_camera_on_its_sphere_sees_the_height_that_it_was_asked_for() -> None:
    target = np.array([0.5, 1.0, -2.0])
    camera = camera_around(target, np.pi / 2, 0.0, 3.0, SIZE, 2.0)
    np.testing.assert_allclose(camera.eye, target + np.array([3, 0, 0]), atol=1e-12)
    shifts = np.array([[0, 1.0, 0], [0, 0, 0], [0, -1, 0], [0, 0, -1]])
    pixels, _ = camera.project(target + shifts)
    # The whole picture from top to bottom; seen from +x, -z is on the right.
    np.testing.assert_allclose(pixels, [(200, 0), (200, 100), (200, 200), (300, 100)], atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.4, -1.3, 3.0])
def test_who_is_turned_faces_that_way_and_is_seen_alike(angle: float) -> None:
    joints = turn(figure(1), np.array(angle))
    assert facing(joints, HUMANML3D.names) == pytest.approx(angle)
    assert half_front(Motion(joints)) == pytest.approx(angle - np.radians(38))
    camera = camera_around(np.zeros(3), half_front(Motion(joints)), 0.0, 5.0, SIZE, 2.0)
    front = turn(np.array([0.0, 0, 1]), np.array(angle))
    assert -camera.axes()[2] @ front == pytest.approx(np.cos(np.radians(38)))


@pytest.mark.parametrize("way", [0.0, 90.0, 200.0])
def test_a_camera_of_all_looks_across_the_path_and_sees_every_point(way: float) -> None:
    joints = figure(4, speed=1.0, way=way)
    camera, height = camera_of_all(Motion(joints), joints, SIZE)
    pixels, depths = camera.project(joints)
    off = np.abs(pixels / np.array(SIZE) - 0.5).max()
    assert 0.40 < off < 0.47 and depths.min() > 1
    along = np.array([np.sin(np.radians(way)), 0, np.cos(np.radians(way))])
    right, _, ahead = camera.axes()
    assert abs(right @ along) > 0.99 and abs(ahead @ along) < 0.1
    assert camera.focal == pytest.approx(SIZE[1] * max(9, 2 * height) / height)


# Surfaces


def ball(radius: float, center: tuple[float, float, float], shape: tuple[int, int, int]):
    grid = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    return np.linalg.norm(grid - np.array(center), axis=-1) - radius


@pytest.mark.parametrize("radius", [3.0, 4.3, 6.7])
def test_the_net_of_a_ball_is_a_closed_sphere(radius: float) -> None:
    center = (8.2, 8.5, 7.9)
    vertices, quads = surface_net(ball(radius, center, (17, 18, 17)))
    away = np.linalg.norm(vertices - center, axis=1)
    assert np.abs(away - radius).max() < 0.25
    edges = Counter((a, b) for quad in quads.tolist() for a, b in
                    zip(quad, quad[1:] + quad[:1], strict=True))  # fmt: skip
    assert set(edges.values()) == {1}  # once each way
    assert all((b, a) in edges for a, b in edges)
    assert len(vertices) - len(edges) // 2 + len(quads) == 2  # Euler


def test_corners_are_counterclockwise_from_outside_and_hold_the_volume() -> None:
    center, radius = np.array([9.0, 9.1, 9.2]), 6.0
    vertices, quads = surface_net(ball(radius, (9.0, 9.1, 9.2), (19, 19, 19)))
    a, b, c, d = (vertices[quads[:, n]] for n in range(4))
    normals = np.cross(c - a, d - b)
    outward = (normals * ((a + b + c + d) / 4 - center)).sum(axis=1)
    assert (outward > 0).all()
    triangles = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    volume = np.linalg.det(triangles - center).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_shifted_body_has_a_shifted_surface(axis: int) -> None:
    shape, center = (14, 14, 14), (6.1, 6.2, 6.3)
    shift = np.eye(3)[axis]
    moved = tuple(float(c) for c in np.array(center) + shift)
    vertices, quads = surface_net(ball(4.0, center, shape))
    others, faces = surface_net(ball(4.0, moved, shape))
    order, other_order = (np.lexsort(v.round(6).T) for v in (vertices + shift, others))
    np.testing.assert_allclose((vertices + shift)[order], others[other_order], atol=1e-9)
    assert len(faces) == len(quads)


def test_faces_of_a_box_lie_where_the_values_cross_zero() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * 3, indexing="ij"), axis=-1)
    vertices, _ = surface_net(np.abs(grid - 5.5).max(axis=-1) - 3.25)
    middle = np.abs(vertices[:, 1:] - 5.5).max(axis=1) < 2
    np.testing.assert_allclose(np.abs(vertices[middle, 0] - 5.5), 3.25)


def test_nothing_inside_has_no_surface() -> None:
    vertices, quads = surface_net(np.ones((4, 4, 4)))
    assert vertices.shape == (0, 3) and quads.shape == (0, 4)


def test_one_point_inside_is_wrapped_by_a_cube() -> None:
    values = np.ones((5, 5, 5))
    values[2, 2, 2] = -1.0
    vertices, quads = surface_net(values)
    assert (len(vertices), len(quads)) == (8, 6)
    # Of each cell's three crossings one is half way along each axis: off by (1/2 + 0 + 0) / 3.
    np.testing.assert_allclose(np.abs(vertices - 2), 1 / 6, atol=1e-12)
