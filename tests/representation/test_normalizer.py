"""Normalizer: the official statistics' form, both libraries, and refusal of wrong scales."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.errors import InputError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.interface import Normalizer

BLOCKS = HUMANML3D_FEATURES.blocks
SCALES = {"yaw_velocity": 0.0128, "root_velocity": 0.0169, "root_height": 0.1538}
SCALES |= {"positions": 0.1222, "rotations": 0.2997, "velocities": 0.0195, "contacts": 0.3559}


@pytest.fixture(scope="module")
def clips() -> list[np.ndarray]:
    random = np.random.default_rng(0)
    scale = np.concatenate([np.full(b.stop - b.start, SCALES[n]) for n, b in BLOCKS.items()])
    shift = random.standard_normal(263)
    return [(random.standard_normal((n, 263)) * scale + shift).astype("f4") for n in (300, 500)]


def test_fit_shares_one_scale_in_a_block(clips):
    normalizer = Normalizer.fit(clips, BLOCKS)
    everything = np.concatenate(clips).astype("f8")
    np.testing.assert_allclose(normalizer.mean, everything.mean(0), atol=1e-6)
    for block in BLOCKS.values():
        expected = everything[:, block].std(0).mean()
        np.testing.assert_allclose(normalizer.std[block], expected, rtol=1e-6)


def test_official_statistics_have_one_scale_in_a_block(shared):
    std = np.load(shared / "reference/humanml3d_sample/Std.npy")
    for name, block in BLOCKS.items():
        np.testing.assert_allclose(std[block], std[block].mean(), rtol=1e-5)
        np.testing.assert_allclose(std[block].mean(), SCALES[name], rtol=0.01)


def test_the_official_sample_passes_the_check(shared):
    folder = shared / "reference/humanml3d_sample"
    official = Normalizer(np.load(folder / "Mean.npy"), np.load(folder / "Std.npy"))
    features = np.load(folder / "012314_features.npy")
    official.check(official.normalize(features), BLOCKS)
    with pytest.raises(InputError, match="not normalized"):
        official.check(features, BLOCKS)


def test_there_and_back_in_both_libraries(clips):
    torch = pytest.importorskip("torch")
    normalizer = Normalizer.fit(clips, BLOCKS)
    normalizer.mean.flags.writeable = False
    normal = normalizer.normalize(clips[0][None])
    np.testing.assert_allclose(normalizer.denormalize(normal)[0], clips[0], atol=1e-5)
    theirs = normalizer.normalize(torch.from_numpy(clips[0]))
    np.testing.assert_allclose(theirs.numpy(), normal[0], atol=1e-5)
    assert normal.dtype == np.float32


def test_wrong_scales_are_refused(clips):
    normalizer = Normalizer.fit(clips, BLOCKS)
    normal = normalizer.normalize(np.concatenate(clips))
    normalizer.check(normal, BLOCKS)
    with pytest.raises(InputError, match="not normalized"):
        normalizer.check(normalizer.denormalize(normal), BLOCKS)
    with pytest.raises(InputError, match="twice"):
        normalizer.check(normalizer.normalize(normal), BLOCKS)
    other = normal.copy()
    other[:, BLOCKS["contacts"]] *= 25
    with pytest.raises(InputError, match="other data"):
        normalizer.check(other, BLOCKS)
    other[0, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        normalizer.check(other, BLOCKS)


def test_useless_statistics_are_refused():
    ones = np.ones(3, dtype="f4")
    with pytest.raises(InputError, match="above 0"):
        Normalizer(ones, 0 * ones)
    with pytest.raises(InputError, match="no frames"):
        Normalizer.fit([], BLOCKS)


def test_a_block_that_never_changes_keeps_its_scale(clips):
    still = [clip.copy() for clip in clips]
    for clip in still:
        clip[:, BLOCKS["contacts"]] = 1
    normalizer = Normalizer.fit(still, BLOCKS)
    assert (normalizer.std[BLOCKS["contacts"]] == 1).all()
    normalizer.check(normalizer.normalize(still[0]), BLOCKS)


def test_identity_changes_nothing():
    features = np.array([[0.01, 5.0, 100.0]], np.float32).repeat(4, 0)
    np.testing.assert_array_equal(Normalizer.identity(3).normalize(features), features)
