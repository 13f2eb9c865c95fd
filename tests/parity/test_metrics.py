"""Metrics against the authors' numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.evaluation.metrics import (
    Gaussian,
    acceleration_errors,
    distances,
    drawn_diversity,
    fid,
    frechet_distance,
    joint_errors,
    label_pairs,
    pa_errors,
    r_precision,
    ranks,
)

Golden = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def golden(shared: Path) -> Golden:
    with np.load(shared / "reference" / "metrics.npz") as file:
        return {name: file[name] for name in file.files}


def test_fid(golden: Golden) -> None:
    real, generated = golden["fid_300_gt"], golden["fid_300_gen"]
    expected = pytest.approx(float(golden["fid_300_fid"]), rel=1e-6)
    assert fid(generated, real) == expected
    assert frechet_distance(Gaussian.of(generated, True), Gaussian.of(real, True)) == expected


def test_retrieval(golden: Golden) -> None:
    texts, motions = golden["retrieval_text"][:32], golden["retrieval_motion"][:32]
    apart = distances(texts, motions)
    assert np.allclose(apart, golden["retrieval_first32_distance"], rtol=1e-4)
    hits = np.array(r_precision(ranks(texts, motions))) * 32
    assert np.allclose(hits, golden["retrieval_first32_topk_hits"])


@pytest.mark.parametrize("kind", ["cropped", "as_coded_padded"])
def test_reconstruction(golden: Golden, kind: str) -> None:
    lengths = golden["recon_lengths"]
    pairs = [
        (pred.astype(np.float64), true.astype(np.float64))
        if kind == "as_coded_padded"
        else (pred[:n].astype(np.float64), true[:n].astype(np.float64))
        for pred, true, n in zip(golden["recon_pred"], golden["recon_true"], lengths, strict=True)
    ]
    metrics = [
        ("MPJPE", joint_errors, lengths.sum()),
        ("PAMPJPE", pa_errors, lengths.sum()),
        ("ACCEL", acceleration_errors, (lengths - 2).sum()),
    ]
    for name, metric, count in metrics:
        value = 1000 * sum(metric(a, b).sum() for a, b in pairs) / count
        assert value == pytest.approx(float(golden[f"recon_{kind}_{name}"]), rel=1e-4), name


def test_pairs_of_actions(golden: Golden) -> None:
    features, labels = golden["action_features"], golden["action_labels"]
    state = np.random.RandomState(int(golden["action_numpy_seed"]))
    one, other = state.randint(0, len(labels), 200), state.randint(0, len(labels), 200)
    expected = float(golden["action_diversity_200"])
    assert drawn_diversity(features, one, other) == pytest.approx(expected, rel=1e-5)
    pairs = label_pairs(labels, 20, lambda items: int(state.randint(0, items)))
    expected = float(golden["action_multimodality_20"])
    assert drawn_diversity(features, *pairs) == pytest.approx(expected, rel=1e-5)


def test_multimodality_of_shared_pairs(golden: Golden) -> None:
    groups = golden["multimodality_embeddings"]
    one, other = golden["multimodality_index_a"], golden["multimodality_index_b"]
    expected = float(golden["multimodality_first20"])
    assert drawn_diversity(groups, one, other) == pytest.approx(expected, rel=1e-5)
