"""Cameras by figures worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.motion import Motion
from latentmotion.render.painter import (
    Camera,
    camera_around,
    camera_of_all,
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
