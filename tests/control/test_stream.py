"""Windows decode what the whole does; streams resume to the bit; loops close."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from latentmotion import MotionPipeline
from latentmotion.cleanup.loops import seam_acceleration, turn_of, unrolled
from latentmotion.control.reach import DecodedMotion
from latentmotion.control.stream import (
    StreamState,
    advanced,
    decode_in_windows,
    generate_loop,
    looped,
    placed,
)
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    MirroredDecoder,
    QuarterRateDecoder,
)
from latentmotion.networks.checkpoint import build
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.interface import Scale


def decoders(config: ConvolutionalVAEConfig) -> object:
    torch.manual_seed(0)
    network = build(config).eval()
    for weights in network.parameters():  # some layers are nothing at first
        torch.nn.init.normal_(weights, std=0.08)

    def decode(latents: np.ndarray, mask: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network.decode(torch.tensor(latents), torch.tensor(mask)).numpy()

    scales = Scale(np.zeros(6), np.ones(6)), Scale(np.zeros(263), np.full(263, 0.1))
    return lambda frames: DecodedMotion(decode, decode, *scales, HUMANML3D_FEATURES, frames)


@pytest.mark.parametrize("decoder", [MirroredDecoder(), QuarterRateDecoder()])
def test_windows_decode_what_the_whole_does(
    decoder: MirroredDecoder | QuarterRateDecoder,
) -> None:
    config = ConvolutionalVAEConfig(width=16, channels=6, decoder=decoder)
    motion, z = decoders(config), np.random.default_rng(0).standard_normal((90, 6))
    whole, sees = motion(360).decode(z), config.decoder_margin()
    found = decode_in_windows(z, motion, sees, 20)
    assert np.abs(found - whole).max() < 1e-6
    assert np.abs(decode_in_windows(z, motion, sees - 2, 20) - whole).max() > 0


def sample(z: np.ndarray, known: np.ndarray, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).standard_normal(z.shape)
    return np.where(known[:, None], z, drawn)


def test_a_stream_resumes_to_the_bit_in_constant_memory() -> None:
    config = ConvolutionalVAEConfig(width=16, channels=6, decoder=QuarterRateDecoder())
    motion, state, sees = decoders(config), StreamState.start(6), config.decoder_margin()
    frames, sizes = [], []
    for call in range(6):
        joints, state = advanced(state, sample, motion, HUMANML3D_FEATURES, sees, 3)
        frames.append(joints)
        sizes.append(len(state.latents))
        if call == 2:
            third = state
    assert len(set(sizes[2:])) == 1
    state = third
    for expected in frames[3:]:
        joints, state = advanced(state, sample, motion, HUMANML3D_FEATURES, sees, 3)
        assert (joints == expected).all()


def test_pieces_go_on_where_the_last_ended() -> None:
    features = 0.1 * np.random.default_rng(0).standard_normal((30, 263))
    first, yaw, place = placed(features[:13], HUMANML3D_FEATURES, 0.0, (0.0, 0.0))
    second, _, _ = placed(features[13:], HUMANML3D_FEATURES, yaw, place)
    whole = HUMANML3D_FEATURES.decode(features)
    assert np.allclose(np.concatenate([first, second]), whole)


def test_a_loop_stays_one_when_it_is_cleaned_up() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    loop = generate_loop(pipeline, "a person walks forward", 2.4, 1)
    assert len(loop) == 49 and loop.metadata["loop"] is True
    again = loop.cleaned().resampled(24)
    assert len(again) == 59
    for motion in (loop, loop.cleaned(), loop.cleaned(in_place=True), again):
        angle, step = turn_of(motion)
        assert abs(angle) < 1e-3
        np.testing.assert_allclose(motion.joints[-1], motion.joints[0] + step, atol=2e-4)
        bends = np.linalg.norm(np.diff(unrolled(motion, 1, 1).joints, n=2, axis=0), axis=-1)
        count = len(motion) - 1
        seam = bends[count - 2 : count + 1].max()
        assert seam <= 1.01 * bends[count + 1 : 2 * count - 2].max()
    assert seam_acceleration(loop.cleaned()) <= seam_acceleration(loop)
    assert np.abs(turn_of(loop.cleaned(in_place=True))[1]).max() < 1e-4
    assert np.linalg.norm(turn_of(loop)[1]) > 1
    assert "loop" not in loop.cut(0, 1).metadata


def test_a_loop_is_followed_by_itself() -> None:
    config = ConvolutionalVAEConfig(width=16, channels=6, decoder=QuarterRateDecoder())
    motion, z = decoders(config), np.random.default_rng(0).standard_normal((12, 6))
    once = looped(z, sample, motion, config.decoder_margin(), 1)
    kept = np.where((np.arange(12) < 3) | (np.arange(12) > 8), False, True)
    again = sample(np.roll(z, 6, axis=0), np.roll(kept, 6), 1)
    endless = motion(12 * 4 * 9).decode(np.tile(np.roll(again, -6, axis=0), (9, 1)))
    assert once.shape == (48, 263)
    assert np.abs(endless[4 * 48 : 5 * 48] - once).max() < 1e-6
    assert np.abs(endless[5 * 48] - once[0]).max() < 1e-6
