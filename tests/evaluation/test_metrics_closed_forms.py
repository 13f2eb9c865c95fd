"""Metrics of features and of positions against closed forms and laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import special_ortho_group

from latentmotion.errors import InputError
from latentmotion.evaluation.metrics import (
    Gaussian,
    acceleration_errors,
    accuracy,
    ape,
    ave,
    diversity,
    drawn_diversity,
    drawn_kid,
    fid,
    frechet_distance,
    kid,
    label_pairs,
    mm_dist,
    multimodality,
    pa_errors,
    parts_of,
    r_precision,
    ranks,
)
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.moving_figures import joints_of


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(0)


def test_fid_of_gaussians_whose_covariances_commute(random: np.random.Generator) -> None:
    turn = special_ortho_group.rvs(6, random_state=1)
    one, other = random.uniform(0.5, 2, (2, 6))
    shift = random.standard_normal(6)
    a = Gaussian(np.zeros(6), turn @ np.diag(one) @ turn.T)
    b = Gaussian(shift, turn @ np.diag(other) @ turn.T)
    expected = shift @ shift + ((np.sqrt(one) - np.sqrt(other)) ** 2).sum()
    assert frechet_distance(a, b) == pytest.approx(expected)
    assert frechet_distance(b, a) == pytest.approx(expected)


def test_fid_of_fewer_motions_than_features(random: np.random.Generator) -> None:
    few = random.standard_normal((5, 64))
    assert fid(few, few[::-1]) == pytest.approx(0, abs=1e-6)
    assert fid(few + 1.0, few) == pytest.approx(64)
    assert fid(few * 3, few) == pytest.approx(
        4 * (few.mean(0) @ few.mean(0) + np.trace(np.cov(few, rowvar=False)))
    )


@pytest.mark.parametrize("bad", [np.zeros((1, 4)), np.full((3, 4), np.nan)])
def test_fid_needs_two_finite_motions(bad: np.ndarray) -> None:
    with pytest.raises(InputError, match="two motions"):
        Gaussian.of(bad)


def test_kid_has_no_bias_and_a_closed_form(random: np.random.Generator) -> None:
    draws = [kid(*random.standard_normal((2, 30, 4))) for _ in range(300)]
    assert abs(np.mean(draws)) < 4 * np.std(draws) / np.sqrt(300)
    same = random.standard_normal((300, 30, 4))
    paired = [kid(x, x + 0.01, paired=True) for x in same]
    assert abs(np.mean(paired)) < 0.01 < -np.mean([kid(x, x + 0.01) for x in same])
    x, y = np.array([[0.0], [1.0], [2.0]]), np.array([[1.0], [3.0]])
    within_x = 2 * ((0 + 1) ** 3 + (0 + 1) ** 3 + (2 + 1) ** 3) / 6
    within_y = (3 + 1) ** 3
    across = np.mean([(a * b + 1) ** 3 for a in (0, 1, 2) for b in (1, 3)])
    assert kid(x, y) == pytest.approx(within_x + within_y - 2 * across)
    assert drawn_kid(x[:2], y, 5, 9, random) == pytest.approx(kid(x[:2], y))
    with pytest.raises(InputError, match="KID"):
        kid(x[:1], y)


def test_r_precision_of_a_permutation() -> None:
    texts = np.eye(8)
    order = np.array([0, 2, 1, 3, 4, 5, 7, 6])
    places = ranks(texts, texts[order] + 1e-3 * np.arange(64).reshape(8, 8))
    assert r_precision(places)[0] == pytest.approx((order == np.arange(8)).mean())


def test_r_precision_is_the_place_on_a_line() -> None:
    """Caption 0 is nearer to motions 1 and 2 than to its own; the others are matched."""
    texts = np.array([[0.0], [1.0], [2.0]])
    motions = np.array([[5.0], [1.1], [2.1]])
    assert ranks(texts, motions).tolist() == [2, 0, 0]
    assert r_precision(ranks(texts, motions)) == pytest.approx([2 / 3, 2 / 3, 1])
    assert mm_dist(texts, motions) == pytest.approx((5 + 0.1 + 0.1) / 3)


def test_diversity_is_the_mean_of_all_pairs(random: np.random.Generator) -> None:
    features = random.standard_normal((7, 3))
    pairs = [(a, b) for a in range(7) for b in range(7) if a != b]
    expected = np.mean([np.linalg.norm(features[a] - features[b]) for a, b in pairs])
    assert diversity(features) == pytest.approx(expected)
    one, other = np.array(pairs).T
    assert drawn_diversity(features, one, other) == pytest.approx(expected)
    assert diversity(features[:1]) == 0


def test_multimodality_is_within_groups() -> None:
    tight, wide = np.zeros((3, 2)), np.array([[0.0, 0.0], [3.0, 4.0]])
    assert multimodality([tight, wide + 100, wide[:1]]) == pytest.approx(2.5)
    assert multimodality([wide[:1]]) == 0


def test_pairs_of_labels_share_them_and_fill_every_quota(random: np.random.Generator) -> None:
    labels = np.array([4, 4, 9, 4, 9, 7])
    one, other = label_pairs(labels, 5, lambda items: int(random.integers(items)))
    assert (labels[one] == labels[other]).all()
    assert {int(x): int((labels[one] == x).sum()) for x in (4, 7, 9)} == {4: 5, 7: 5, 9: 5}


def test_accuracy() -> None:
    assert accuracy(np.eye(4)[[0, 1, 2, 0]], np.arange(4)) == 0.75


def test_aligned_errors_ignore_similarities_but_no_reflection(random: np.random.Generator) -> None:
    true = random.standard_normal((5, 22, 3))
    turns = special_ortho_group.rvs(3, size=5, random_state=2)
    moved = 1.7 * true @ turns + random.standard_normal((5, 1, 3))
    assert pa_errors(moved, true) == pytest.approx(0, abs=1e-9)
    assert pa_errors(true * [-1, 1, 1], true).mean() > 0.1
    assert pa_errors(np.zeros_like(true), true).mean() > 0.1


def test_the_acceleration_of_a_parabola(random: np.random.Generator) -> None:
    true = random.standard_normal((9, 22, 3))
    time = np.arange(9.0)[:, None, None]
    bent = true + 0.001 * time**2 * np.array([1.0, 0.0, 0.0]) + 0.3 * time + 5
    assert acceleration_errors(bent, true) == pytest.approx(0.002)
    assert not len(acceleration_errors(true[:2], true[:2]))


def test_ape_and_ave_of_a_shift_and_of_a_wave(random: np.random.Generator) -> None:
    joints = joints_of(random, 40)
    shifted = joints + np.array([0.3, 0.0, 0.4])
    errors = ape(parts_of(shifted, HUMANML3D), parts_of(joints, HUMANML3D))
    assert errors["root"] == errors["joints"] == errors["trajectory"] == pytest.approx(0.5)
    assert errors["pose"] == pytest.approx(0, abs=1e-12)
    still, wave = np.tile(joints[:1], (40, 1, 1)), np.sin(np.arange(40.0))
    moved = still + wave[:, None, None] * np.array([0.0, 0.0, 2.0])
    spread = ave(parts_of(moved, HUMANML3D), parts_of(still, HUMANML3D))
    assert spread["root"] == spread["trajectory"] == pytest.approx(4 * wave.var(ddof=1))
    assert spread["pose"] == pytest.approx(0, abs=1e-12)
