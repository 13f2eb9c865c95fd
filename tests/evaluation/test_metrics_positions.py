"""Position metrics against closed forms and the authors' numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.evaluation.metrics import TrainingClips, mpjpe


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
    assert TrainingClips([other, clip]).distance(motion) == pytest.approx(0.05)


def test_nearest_clip_compares_with_a_shorter_clip_over_its_length() -> None:
    motion = np.random.default_rng(2).standard_normal((30, 22, 3))
    assert TrainingClips([motion[4:12]]).distance(motion) == pytest.approx(0, abs=1e-6)


def test_nearest_clip_skips_only_stretches_that_cannot_be_nearer() -> None:
    generator = np.random.default_rng(3)
    clips = [
        np.cumsum(generator.normal(0, 0.02, (length, 22, 3)), axis=0) for length in (5, 30, 61, 90)
    ]
    for length in (6, 8, 37, 90, 100):
        motion = np.cumsum(generator.normal(0, 0.02, (length, 22, 3)), axis=0)
        every = [
            np.linalg.norm(longer[start : start + len(shorter)] - shorter, axis=-1).mean()
            for clip in clips
            for longer, shorter in [sorted((clip, motion), key=len, reverse=True)]
            for start in range(0, len(longer) - len(shorter) + 1, 4)
        ]
        assert TrainingClips(clips).distance(motion) == pytest.approx(min(every), rel=1e-5)
