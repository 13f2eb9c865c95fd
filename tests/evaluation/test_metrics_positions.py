"""Position metrics against closed forms and the authors' numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.evaluation.metrics.mpjpe import mpjpe
from latentmotion.evaluation.metrics.nearest_clip import nearest_clip_distance


def test_mpjpe_of_a_shift_is_seen_only_in_the_world() -> None:
    joints = np.random.default_rng(0).standard_normal((5, 22, 3))
    moved = joints + np.array([0.003, 0.0, 0.004])
    assert mpjpe(moved, joints) == pytest.approx(0, abs=1e-9)
    assert mpjpe(moved, joints, align=False) == pytest.approx(5.0)


def test_mpjpe_equals_the_authors_on_cropped_motions(shared: Path) -> None:
    golden = np.load(shared / "reference" / "metrics.npz")
    lengths = golden["recon_lengths"]
    errors = [
        mpjpe(pred[:n].astype(np.float64), true[:n].astype(np.float64)) * n
        for pred, true, n in zip(golden["recon_pred"], golden["recon_true"], lengths, strict=True)
    ]
    assert sum(errors) / lengths.sum() == pytest.approx(float(golden["recon_cropped_MPJPE"]), 1e-5)


def test_nearest_clip_finds_the_stretch_it_was_cut_from() -> None:
    clip = np.random.default_rng(1).standard_normal((40, 22, 3))
    other = clip + 1.0
    motion = clip[8:24] + np.array([0.0, 0.03, 0.04])
    assert nearest_clip_distance(motion, [other, clip]) == pytest.approx(0.05)


def test_nearest_clip_compares_with_a_shorter_clip_over_its_length() -> None:
    motion = np.random.default_rng(2).standard_normal((30, 22, 3))
    assert nearest_clip_distance(motion, [motion[4:12]]) == pytest.approx(0)
