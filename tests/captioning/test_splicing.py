"""Seams between motions: alignment, fading, what they measure and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.clip import Caption, Source
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.splicing import pose_descriptors, seam_of, splice
from latentmotion.training.captioning.compose import (
    Composition,
    composed_motion,
    composed_source,
    objection,
)
from tests.support.simple_motions import FPS, figure

FEET = [*HUMANML3D.left_foot, *HUMANML3D.right_foot]
ALL = np.arange(20)
TIME = np.arange(40)[:, None, None]


def turned(joints: np.ndarray, degrees: float, x: float = 0.0, z: float = 0.0) -> np.ndarray:
    turn = matrix_from_axis_angle(np.array([0.0, np.radians(degrees), 0.0]))
    return joints @ turn.T + [x, 0.0, z]


def on_floor(joints: np.ndarray) -> np.ndarray:
    return joints - [0.0, joints[..., 1].min(), 0.0]


WALK, STAND = on_floor(figure(2, speed=1.0)), on_floor(figure(2))


@pytest.mark.parametrize(
    ("degrees", "x", "z"), [(0.0, 3.0, -1.0), (130.0, 0.0, 0.0), (-90.0, 5.0, 2.0)]
)
def test_where_the_second_motion_was_recorded_does_not_matter(
    degrees: float, x: float, z: float
) -> None:
    expected = splice(WALK, STAND, 0.4, HUMANML3D_FEATURES)
    found = splice(WALK, turned(STAND, degrees, x, z), 0.4, HUMANML3D_FEATURES)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("seconds", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("speed", [0.0, 1.3])
def test_a_steady_motion_goes_on_as_itself(seconds: float, speed: float) -> None:
    moving = STAND + np.arange(len(STAND))[:, None, None] * [0.0, 0.0, speed / FPS]
    moving = HUMANML3D_FEATURES.retarget(moving)
    found = splice(moving[:21], turned(moving[20:], 70, 4), seconds, HUMANML3D_FEATURES)
    np.testing.assert_allclose(found, moving, atol=1e-6)


def test_speed_fades_and_does_not_stop_at_the_seam() -> None:
    moving = STAND + TIME * [0.05, 0.0, 0.0]
    steps = np.diff(splice(moving, STAND, 1.0, HUMANML3D_FEATURES)[:, 0, 0])
    assert steps[len(moving) - 1] == pytest.approx(0.05, rel=0.05)
    np.testing.assert_allclose(steps[len(moving) + 19 :], 0, atol=1e-9)


def test_the_whole_pair_may_be_turned() -> None:
    expected = turned(splice(WALK, STAND, 0.4, HUMANML3D_FEATURES), 55, 1, 2)
    found = splice(turned(WALK, 55, 1, 2), STAND, 0.4, HUMANML3D_FEATURES)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_transition_has_no_more_frames_than_the_second_motion() -> None:
    found = splice(WALK, STAND[:5], 9.0, HUMANML3D_FEATURES)
    assert len(found) == len(WALK) + 4 and np.isfinite(found).all()
    np.testing.assert_array_equal(found[: len(WALK) - 1], WALK[:-1])


@pytest.mark.parametrize("degrees", [40.0, 180.0, -100.0])
def test_poses_are_described_as_the_body_sees_them(degrees: float) -> None:
    expected = pose_descriptors(WALK, FPS, HUMANML3D, ALL)
    found = pose_descriptors(turned(WALK, degrees, 3, -7), FPS, HUMANML3D, ALL)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert expected.shape == (20, 2 * 3 * len(HUMANML3D))
    raised = pose_descriptors(WALK + np.array([0.0, 0.1, 0.0]), FPS, HUMANML3D, ALL)
    feet, joints = len(FEET), len(HUMANML3D)
    apart = 0.1 * np.sqrt((4 * feet + joints - feet) / joints)
    np.testing.assert_allclose(np.linalg.norm(raised - expected, axis=1), apart)


def test_speeds_count_as_a_sixth_of_a_second() -> None:
    slow, fast = (turned(STAND, 0) for _ in range(2))
    fast = fast + np.arange(len(fast))[:, None, None] * [0.0, 0.0, 0.6 / FPS]
    poses = [pose_descriptors(joints, FPS, HUMANML3D, ALL) for joints in (slow, fast)]
    feet, joints = len(FEET), len(HUMANML3D)
    apart = 0.1 * np.sqrt((4 * feet + joints - feet) / joints)
    np.testing.assert_allclose(np.linalg.norm(poses[1] - poses[0], axis=1), apart)


def test_a_seam_is_measured_by_slide_jerk_and_height() -> None:
    sliding = STAND + np.arange(len(STAND))[:, None, None] * [0.03, 0.0, 0.04]
    seam = seam_of(sliding, 10, FPS, HUMANML3D, 8)
    assert seam.slide == pytest.approx(0.05 * FPS)
    assert seam.jerk == pytest.approx(0, abs=1e-6) and seam.lowest == pytest.approx(0)
    assert seam_of(sliding + np.array([0.0, 0.5, 0.0]), 10, FPS, HUMANML3D, 8).slide == 0
    sunk = STAND.copy()
    sunk[12, :, 1] -= 0.2
    seam = seam_of(sunk, 10, FPS, HUMANML3D, 8)
    assert seam.lowest == pytest.approx(-0.2)
    assert seam.jerk == pytest.approx(3 * 0.2 * FPS**3)
    assert seam_of(sunk, 20, FPS, HUMANML3D, 8).jerk == 0, "outside the transition"


@pytest.mark.parametrize(
    ("change", "limits", "reason"),
    [
        (lambda joints: joints, {}, ""),
        (lambda joints: joints, {"seconds": (2.0, 9.8)}, "too short or too long"),
        (lambda joints: joints, {"seconds": (0.5, 1.9)}, "too short or too long"),
        (lambda joints: joints - [0.0, 0.016, 0.0], {}, "below the floor"),
        (lambda joints: joints - [0.0, 0.014, 0.0], {}, ""),
        (lambda joints: joints + TIME * [0.02, 0.0, 0.0], {}, "feet slide"),
        (lambda joints: joints + TIME * [0.02, 0.0, 0.0], {"slide": 0.5}, ""),
        (lambda joints: joints + (TIME == 12) * [0.0, 0.2, 0.0], {}, "jerk"),
    ],
)
def test_sequences_are_refused_for_a_reason(change, limits: dict, reason: str) -> None:
    wanted = replace(Composition(1, seconds=(1.0, 9.0)), **limits)
    assert objection(change(STAND), 10, HUMANML3D_FEATURES, wanted) == reason


def test_a_sequence_only_trains_and_has_the_terms_of_all_owners() -> None:
    captions = [Caption("kicks left, then turns right", 0, 12)]
    made = composed_motion("x", np.zeros((12, 263)), captions, "a + b")
    assert (made.clip.split, made.clip.source, made.clip.frames) == ("train", "composed", 12)
    assert made.clip.mirrored_captions == (("kicks right, then turns left", 0, 12, ""),)
    owners = [Source("a", "CC0", "A"), Source("b", "MIT", "B"), Source("c", "CC0", "C")]
    source = composed_source(owners)
    assert source.license == "CC0; MIT"
    assert source.credit == "synthetic, two clips in a row; a: A b: B c: C"
