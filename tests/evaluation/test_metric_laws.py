"""Metrics under shifts, turns, scales and other orders: what must change, and what must not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist
from scipy.stats import special_ortho_group

from latentmotion.evaluation import metrics as diversity_file
from latentmotion.evaluation.metrics import (
    Gaussian,
    TrainingClips,
    acceleration_errors,
    ave,
    distances,
    diversity,
    drawn_diversity,
    fid,
    frechet_distance,
    joint_errors,
    kid,
    mm_dist,
    mpjpe,
    pa_errors,
    parts_of,
    r_precision,
    ranks,
)
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration, skating_ratio
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.moving_figures import joints_of

FPS = 20.0
TURN = special_ortho_group.rvs(5, random_state=3)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def joints(random: np.random.Generator) -> np.ndarray:
    return joints_of(random, 30)


@pytest.mark.parametrize("rows", [1, 4, 50])
def test_distances_are_scipys(random: np.random.Generator, rows: int) -> None:
    one, other = random.standard_normal((rows, 5)) + 100, random.standard_normal((9, 5)) + 100
    np.testing.assert_allclose(distances(one, other), cdist(one, other), rtol=1e-6)


def test_distances_of_equal_rows_are_no_root_of_a_negative_number() -> None:
    rows = np.full((3, 512), 1e3 / 3, np.float32)
    np.testing.assert_allclose(distances(rows, rows), 0, atol=0.05)


@pytest.mark.parametrize("metric", [fid, kid])
def test_features_may_be_turned_and_reordered_together(
    random: np.random.Generator, metric: Callable[..., float]
) -> None:
    one, other = random.standard_normal((12, 5)), random.standard_normal((15, 5)) + 0.5
    expected = metric(one, other)
    assert expected > 0.1
    assert metric(one @ TURN, other @ TURN) == pytest.approx(expected)
    assert metric(one[::-1], np.roll(other, 4, axis=0)) == pytest.approx(expected)
    assert metric(other, one) == pytest.approx(expected)


@pytest.mark.parametrize("scale", [0.1, 3.0])
def test_fid_grows_with_the_square_and_diversity_with_the_scale(
    random: np.random.Generator, scale: float
) -> None:
    one, other = random.standard_normal((2, 20, 4))
    assert fid(scale * one, scale * other) == pytest.approx(scale**2 * fid(one, other))
    assert diversity(scale * one + 7) == pytest.approx(scale * diversity(one))
    assert mm_dist(scale * one, scale * other) == pytest.approx(scale * mm_dist(one, other))


@pytest.mark.parametrize(("shift", "spread"), [(0.0, 2.0), (3.0, 1.0), (-1.0, 0.25)])
def test_fid_of_one_feature(random: np.random.Generator, shift: float, spread: float) -> None:
    one = random.standard_normal((40, 1))
    expected = ((spread - 1) * one.mean() + shift) ** 2 + ((spread - 1) * one.std(ddof=1)) ** 2
    assert fid(spread * one + shift, one) == pytest.approx(expected)


def test_a_mean_in_float32_is_less_exact(random: np.random.Generator) -> None:
    features = 1000 + random.standard_normal((5000, 3))
    exact, rounded = (Gaussian.of(features, float32_mean=single) for single in (False, True))
    np.testing.assert_array_equal(exact.covariance, rounded.covariance)
    assert 0 < np.abs(exact.mean - rounded.mean).max() < 0.01
    assert frechet_distance(exact, rounded) < 1e-3


def test_diversity_is_the_same_in_parts(
    random: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    features = random.standard_normal((11, 3))
    expected = diversity(features)
    monkeypatch.setattr(diversity_file, "_ROWS", 4)
    assert diversity(features) == pytest.approx(expected)


def test_shared_pairs_by_hand() -> None:
    groups = np.array([[[0.0, 0], [3, 4], [6, 8]], [[1.0, 1], [1, 1], [1, 2]]])
    one, other = np.array([0, 1, 2]), np.array([1, 1, 0])
    expected = np.mean([5, 0, 10, 0, 0, 1])
    assert drawn_diversity(groups, one, other) == pytest.approx(expected)


def test_a_motion_as_far_as_the_own_ranks_after_it(random: np.random.Generator) -> None:
    texts = random.standard_normal((6, 4))
    assert ranks(texts, np.repeat(texts[:1], 6, axis=0)).tolist() == [0] * 6
    assert r_precision(np.array([0, 1, 2, 3, 9]), (1, 2, 3, 10)) == [0.2, 0.4, 0.6, 1.0]


@pytest.mark.parametrize("stride", [1, 2, 4, 8])
def test_the_nearest_clip_of_a_clip_is_itself(random: np.random.Generator, stride: int) -> None:
    clips = [random.standard_normal((length, 4, 3)) for length in (17, 40)]
    found = TrainingClips(clips, stride)
    assert found.distance(clips[1][stride : stride + 20]) == pytest.approx(0, abs=1e-6)
    assert found.distance(clips[0] + [0.0, 0.3, 0.4]) == pytest.approx(0.5, rel=1e-5)


@pytest.mark.parametrize("height", [-0.4, 0.03, 1.0])
def test_only_the_height_above_the_floor_counts(joints: np.ndarray, height: float) -> None:
    joints[..., 1] -= joints[..., 1].min() + 0.02
    moved = joints + np.array([5.0, height, -3.0])
    for metric in (foot_sliding, skating_ratio):
        assert metric(moved, FPS, floor=height) == pytest.approx(metric(joints, FPS)) != 0
    assert penetration(moved, height) == pytest.approx(penetration(joints)) != 0
    assert jitter(moved, FPS) == pytest.approx(jitter(joints, FPS))


def test_frame_rates_give_speeds_and_jerks_their_powers(joints: np.ndarray) -> None:
    joints[..., 1] -= joints[..., 1].min()
    assert jitter(joints, 2 * FPS) == pytest.approx(8 * jitter(joints, FPS))
    assert foot_sliding(joints, 2 * FPS) == pytest.approx(2 * foot_sliding(joints, FPS))
    assert skating_ratio(joints, 2 * FPS) >= skating_ratio(joints, FPS)


def test_errors_by_frame_have_the_mean_of_the_metric(
    joints: np.ndarray, random: np.random.Generator
) -> None:
    wrong = joints + 0.03 * random.standard_normal(joints.shape)
    assert 1000 * joint_errors(wrong, joints).mean() == pytest.approx(mpjpe(wrong, joints))
    as_tensors = mpjpe(torch.from_numpy(wrong), torch.from_numpy(joints))
    assert as_tensors == pytest.approx(mpjpe(wrong, joints))
    assert (pa_errors(wrong, joints) < joint_errors(wrong, joints)).mean() > 0.9


def test_steady_drift_has_no_acceleration(joints: np.ndarray) -> None:
    drift = np.arange(30.0)[:, None, None] * [0.1, 0.0, -0.2] + 4
    np.testing.assert_allclose(acceleration_errors(joints + drift, joints), 0, atol=1e-12)
    jump = joints.copy()
    jump[10:] += [0.0, 0.5, 0.0]
    expected = np.zeros(28)
    expected[[8, 9]] = 0.5
    np.testing.assert_allclose(acceleration_errors(jump, joints), expected, atol=1e-12)


@pytest.mark.parametrize("angle", [-2.5, 0.4, 3.0])
def test_the_pose_has_neither_heading_nor_place(joints: np.ndarray, angle: float) -> None:
    turn = matrix_from_axis_angle(np.array([0.0, angle, 0.0]))
    before = parts_of(joints, HUMANML3D)
    after = parts_of(joints @ turn.T + [3.0, 0.0, 1.0], HUMANML3D)
    np.testing.assert_allclose(after["pose"], before["pose"], atol=1e-12)
    assert np.abs(after["root"] - before["root"]).max() > 0.5
    assert ave(after, before)["pose"] == pytest.approx(0, abs=1e-12)


def test_a_single_frame_has_no_variance(joints: np.ndarray) -> None:
    one, other = (parts_of(joints[n : n + 1], HUMANML3D) for n in (0, 20))
    assert set(ave(one, other).values()) == {0.0}
