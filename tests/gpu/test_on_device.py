"""The chain on PyTorch's tensors: precision, buckets, recordings and compilation change nothing."""

from __future__ import annotations

import subprocess
import sys
import weakref
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from latentmotion.cli.loading import load_generator
from latentmotion.diffusion.samplers import sample
from latentmotion.engine.backend import ExecutionOptions
from latentmotion.engine.request import GenerationRequest, padded_batch
from latentmotion.errors import InputError
from latentmotion.model.card import find_model, read_card
from latentmotion.networks.backend import Buckets, denoiser_session, torch_pipeline
from latentmotion.networks.checkpoint import load_model
from latentmotion.networks.device import FunctionRecorder, on_gpu
from latentmotion.pipeline import MotionPipeline, sampler_of
from tests.support.played_graphs import play_graphs

PROMPTS = ["a person walks forward", "a person jumps", "someone turns left and waves with one hand"]
FRAMES, SEEDS = [41, 24, 30], [3, 4, 5]


@pytest.fixture(scope="module")
def exact() -> MotionPipeline:
    return torch_pipeline("starter")


def on_backend(pipeline: MotionPipeline, **changes: object) -> MotionPipeline:
    return replace(pipeline, backend=replace(pipeline.backend, **changes))


def latents_of(pipeline: MotionPipeline, request: GenerationRequest) -> np.ndarray:
    card, sampling, condition = pipeline.card, request.sampling, pipeline.condition(request.prompts)
    batch, noise = padded_batch(request, condition, card.latents, pipeline.backend)
    guided, sampler = pipeline.guided(sampling), sampler_of(card, sampling)
    z = sample(guided, sampler, batch.noise, batch.condition, batch.tokens, sampling.steps, noise)
    return pipeline.decoder.latents.denormalize(z).numpy()


def test_joints_found_for_a_batch_are_those_of_each_motion(exact: MotionPipeline) -> None:
    graphs = MotionPipeline.from_pretrained("starter", "onnxruntime", 1)
    seconds = [frames / 20 for frames in FRAMES]
    expected = graphs.batch(PROMPTS, seconds, SEEDS, steps=2, from_clips=False)
    found = exact.batch(PROMPTS, seconds, SEEDS, steps=2, from_clips=False)
    for one, other in zip(found, expected, strict=True):
        assert one.joints.dtype == np.float32 and one.metadata == other.metadata
        np.testing.assert_allclose(one.joints, other.joints, atol=1e-4)


def test_a_session_answers_in_kind() -> None:
    model = load_model(find_model("starter"))
    session = denoiser_session(model.denoiser)
    inputs = {
        "z": np.ones((1, 3, model.card.latents.width), np.float32),
        "t": np.ones(1, np.float32),
    }
    inputs |= {"words": np.ones((1, 2, 384), np.float32), "words_mask": np.ones((1, 2), bool)}
    inputs |= {"mask": np.ones((1, 3), bool)}
    arrays = session(**inputs)
    tensors = session(**{name: torch.tensor(array) for name, array in inputs.items()})
    assert isinstance(arrays, np.ndarray) and isinstance(tensors, Tensor)
    np.testing.assert_allclose(arrays, tensors.numpy(), atol=1e-6)


@pytest.mark.parametrize("sampler", ["ddim", "ddpm"])
def test_what_fills_a_bucket_moves_nothing(exact: MotionPipeline, sampler: str) -> None:
    filled = on_backend(exact, padding=Buckets(exact.card))
    options = {"steps": 2, "sampler": sampler}
    expected = exact.features(PROMPTS, FRAMES, SEEDS, **options)
    found = filled.features(PROMPTS, FRAMES, SEEDS, **options)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-5)
    sampling = exact.card.sampling.but(steps=2)
    request = GenerationRequest(tuple(PROMPTS), tuple(FRAMES), tuple(SEEDS), sampling)
    assert filled.generate_batch(request).shape == (4, 64, 263)
    latents = latents_of(filled, request)[:3, : exact.card.latents.tokens_of(41)]
    np.testing.assert_allclose(latents, latents_of(exact, request), atol=2e-5)


def test_sizes_of_buckets() -> None:
    card = read_card(find_model("starter"))
    buckets = Buckets(card)
    counts, words, lengths = (1, 2, 3, 9, 256), (0, 1, 2, 9, 10), (12, 32, 33, 195, 196)
    sizes = [buckets.sizes(*each) for each in zip(counts, words, lengths, strict=True)]
    assert [size[0] for size in sizes] == [1, 2, 4, 16, 256]
    assert [size[1] for size in sizes] == [0, 1, 9, 9, 17]
    assert [size[2] for size in sizes] == [32, 32, 64, 196, 196]
    # Padding would move these models' motions.
    config = card.trained_denoiser
    sees = Buckets(replace(card, denoiser=replace(config, attends_to_padding=True)))
    assert sees.sizes(1, 1, 33)[2] == 33
    first = Buckets(replace(card, denoiser=replace(config, positions="context_first")))
    assert first.sizes(1, 2, 32)[1] == 2


def test_one_recording_serves_a_bucket(exact: MotionPipeline) -> None:
    made: list[object] = []

    def record(
        function: Callable[..., Tensor], inputs: tuple[Tensor, ...]
    ) -> Callable[..., Tensor]:
        made.append(function)
        return function

    recorded = on_backend(exact, padding=Buckets(exact.card), launch=FunctionRecorder(record))
    for frames in (33, 40, 64):
        recorded.batch([PROMPTS[0]], frames / 20, [1], steps=1)
    assert len(made) == 2  # features and joints
    recorded.features(PROMPTS[:1], [65], [1], steps=1)
    recorded.features(PROMPTS[:1], [65], [1], steps=2)
    assert len(made) == 4
    # Fresh noise of every step is drawn on the host: nothing to record.
    recorded.features(PROMPTS[:1], [65], [1], steps=2, sampler="ddpm")
    assert len(made) == 4


def test_the_recording_unused_for_longest_goes() -> None:
    made: list[int] = []

    def record(
        function: Callable[..., Tensor], inputs: tuple[Tensor, ...]
    ) -> Callable[..., Tensor]:
        made.append(len(inputs[0]))
        return function

    recorder = FunctionRecorder(record, most=2)
    for size in (1, 2, 1, 3, 1, 2):
        assert recorder("twice", lambda x: 2 * x, torch.ones(size)).sum() == 2 * size
    assert made == [1, 2, 3, 2]


@pytest.mark.parametrize("model", ["starter", "fast"])
def test_a_recording_makes_the_motions_of_other_prompts(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = play_graphs(monkeypatch)
    alone = torch_pipeline(model)
    filled = on_backend(alone, padding=Buckets(alone.card))
    recorded = on_backend(filled, launch=FunctionRecorder(on_gpu(torch.device("cuda:1"))))
    orders = [
        (PROMPTS[:2], [2.0, 3.0], [1, 2], 2),
        (PROMPTS[1:], [3.2, 2.5], [5, 6], 2),
        (PROMPTS[:2], [2.0, 3.0], [1, 2], 2),
    ]
    found = [recorded.batch(*order) for order in orders]
    for motions, order in zip(found, orders, strict=True):
        for one, other in zip(motions, filled.batch(*order), strict=True):
            np.testing.assert_array_equal(one.joints, other.joints)
    assert set(devices) == {torch.device("cuda:1")} and len(devices) == 3  # with joints


def test_a_recording_keeps_what_it_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    play_graphs(monkeypatch)
    recorder, constant = FunctionRecorder(on_gpu(torch.device("cuda"))), torch.ones(3)
    there = weakref.ref(constant)

    def make() -> Callable[..., Tensor]:
        return lambda x, constant=constant: x + constant

    first = recorder("plus one", make(), torch.zeros(3))
    del constant
    assert there() is not None
    assert recorder("plus one", torch.add, torch.full((3,), 4.0)).tolist() == [5.0] * 3
    assert first.tolist() == [1.0] * 3


def test_bfloat16_stays_near_and_answers_in_float32(exact: MotionPipeline) -> None:
    halved = torch_pipeline("starter", execution=ExecutionOptions(precision="bfloat16"))
    expected = exact.features(PROMPTS, FRAMES, SEEDS, steps=4)
    found = halved.features(PROMPTS, FRAMES, SEEDS, steps=4)
    scale = np.array(exact.card.normalizer_std)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == np.float32
        error = np.sqrt((((one - other) / scale) ** 2).mean())
        assert 0 < error < 0.1


def test_a_compiled_chain_makes_the_same_motion() -> None:
    # In a process of its own: shapes are not checked there, and checks cannot be compiled.
    program = """
from latentmotion.networks import device
from latentmotion.engine.backend import ExecutionOptions
from latentmotion.networks.backend import torch_pipeline
# The compiler proper takes a minute; this one traces, takes gradients apart and runs the rest.
device.COMPILER = "aot_eager"
made = [
    torch_pipeline("starter", execution=ExecutionOptions(launch=launch)).features(
        ["a person walks"], [41], [3], steps=1
    )[0]
    for launch in ("eager", "compiled")
]
print(abs(made[0] - made[1]).max())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 1e-4


def test_what_does_not_go_together_says_so() -> None:
    with pytest.raises(InputError, match=r"CUDA graphs need cuda; use launch eager"):
        ExecutionOptions(launch="graph")
    with pytest.raises(InputError, match="onnxruntime computes on the CPU, in float32; for cpu, b"):
        load_generator("starter", "onnxruntime", execution=ExecutionOptions(precision="bfloat16"))
    chosen = load_generator("starter", execution=ExecutionOptions(precision="bfloat16"))
    assert isinstance(chosen.backend.to_device(np.zeros(1)), Tensor)
