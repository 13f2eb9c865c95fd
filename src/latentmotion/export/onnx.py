"""ONNX export: trained networks as graphs that run without PyTorch.

Each graph has named inputs, and batch and length of any size. A fused sampler is one graph of all
that follows the condition: a few unrolled steps, scales and decoder. Graphs do not state who made
them: source paths, stack traces and class names are left out.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import onnx
import torch
from onnx import GraphProto, ModelProto
from torch import Tensor, nn
from torch.export import Dim

from latentmotion.condition import Conditioning
from latentmotion.diffusion.guidance import DistilledGuidance
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.diffusion.schedule import StepCondition
from latentmotion.engine.backend import Batch, FeatureDecoder
from latentmotion.engine.session import open_session
from latentmotion.errors import ModelError
from latentmotion.model.config import STRIDE, Sampling
from latentmotion.networks.checkpoint import LatentModel
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.convolutional import Pullback
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import features_from_noise, sampler_of
from latentmotion.representation.interface import Scale
from latentmotion.storage.files import atomic_file

# Sizes of the example inputs that graphs are traced with; all of them stay free.
_BATCH, _TOKENS, _WORDS = 2, 7, 3

# Further sizes of the pullback's example, which stay free as well.
_ROWS, _FEATURES = 3, 67

PULLBACK_TOLERANCE = 1e-5
"""Largest difference between graph and automatic differentiation, relative to the largest value."""


def export_denoiser(
    denoiser: DenoiserNetwork, latent_width: int, words_width: int, path: Path
) -> None:
    """Writes a denoiser's graph: z, t, words, words_mask, mask → prediction.

    A distilled one has two more inputs, guidance and step_size.
    """
    further = denoiser.further_inputs
    graph = _StudentGraph(denoiser) if further else _DenoiserGraph(denoiser)
    inputs = {
        "z": torch.randn(_BATCH, _TOKENS, latent_width),
        "t": torch.rand(_BATCH),
        **_condition(words_width),
        "mask": torch.ones(_BATCH, _TOKENS, dtype=torch.bool),
        **{name: torch.rand(_BATCH) for name in further},
    }
    trace(graph, inputs, path)


def export_decoder(vae: MotionVAE, frames_per_token: int | None, path: Path) -> None:
    """Writes a VAE decoder's graph: latents, mask → normalized features."""
    inputs = {
        "latents": torch.randn(_BATCH, _TOKENS, vae.latent_width),
        "mask": _frames(frames_per_token),
    }
    trace(_DecoderGraph(vae), inputs, path)


def export_encoder(vae: MotionVAE, features: int, path: Path) -> None:
    """Writes a VAE encoder's graph: normalized features, mask → mean of the posterior.

    Args:
        vae: The network.
        features: Features of a frame.
        path: The `.onnx` file.
    """
    mask = _frames(None)
    inputs = {"features": torch.randn(*mask.shape, features), "mask": mask}
    trace(_EncoderGraph(vae), inputs, path)


def export_pullback(vae: MotionVAE, path: Path) -> None:
    """Writes the pullback of a decoder of convolutions, which directing a motion needs.

    Its graph: latents, mask, gradient of features → gradient of latents.
    """
    inputs = _pullback_inputs(vae.latent_width, _TOKENS, _ROWS, _FEATURES)
    free = {"latents": (1,), "mask": (1,), "gradient": (0, 1, 2)}
    trace(Pullback(vae), inputs, path, free=free)


def pullback_error(vae: MotionVAE, graph: Path) -> float:
    """Returns how far a graph is from automatic differentiation, relative to the largest value."""
    inputs = _pullback_inputs(vae.latent_width, _TOKENS + 2, _ROWS + 1, _FEATURES)
    rows = len(inputs["gradient"])
    z = inputs["latents"].repeat(rows, 1, 1).requires_grad_(True)
    features = vae.decode(z, inputs["mask"].expand(rows, -1))[..., :_FEATURES]
    (expected,) = torch.autograd.grad(features, z, inputs["gradient"])
    session = open_session(graph, "onnxruntime")
    actual = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    return float((torch.from_numpy(actual) - expected).abs().max() / expected.abs().max())


def _pullback_inputs(width: int, tokens: int, rows: int, features: int) -> dict[str, torch.Tensor]:
    """Returns inputs of a pullback."""
    frames = tokens * STRIDE
    return {
        "latents": torch.randn(1, tokens, width),
        "mask": torch.ones(1, frames, dtype=torch.bool),
        "gradient": torch.randn(rows, frames, features),
    }


def export_fused_sampler(model: LatentModel, steps: int, path: Path) -> None:
    """Writes a distilled model's graph from noise to features in this number of steps.

    noise, words, words_mask, mask, frames, guidance → features in their own units.
    """
    card = model.card
    inputs = {
        "noise": torch.randn(_BATCH, _TOKENS, card.latents.width),
        **_condition(card.trained_denoiser.condition_width),
        "mask": torch.ones(_BATCH, _TOKENS, dtype=torch.bool),
        "frames": _frames(card.latents.frames_per_token),
        "guidance": torch.rand(_BATCH),
    }
    trace(FusedSampler(model, steps), inputs, path)


class FusedSampler(nn.Module):
    """The pipeline from noise to features as one network.

    Args:
        model: A distilled model.
        steps: Number of sampling steps.

    Raises:
        ModelError: The model is not distilled.
    """

    def __init__(self, model: LatentModel, steps: int) -> None:
        super().__init__()
        self.card = card = model.card
        if card.few_step is None:
            raise ModelError(f"model {card.name!r} is not distilled, so no few steps are its way")
        self.denoiser, self.vae = model.denoiser, model.vae
        self.steps = steps
        self.sampler = sampler_of(card, Sampling(steps, sampler="ddim"))
        self.latents = _Scale(card.latents.mean, card.latents.std)
        self.features = _Scale(card.normalizer_mean, card.normalizer_std)

    def forward(
        self,
        noise: Tensor,
        words: Tensor,
        words_mask: Tensor,
        mask: Tensor,
        frames: Tensor,
        guidance: Tensor,
    ) -> Tensor:
        """Returns features in their own units, (batch, frames, features)."""
        batch, no_more = Batch(noise, mask, words, words_mask, frames), SeededNoise([])
        guided = self.card.parametrized(DistilledGuidance(self.denoiser, guidance, self.steps))
        decoder = FeatureDecoder(self.vae.decode, self.latents.scale, self.features.scale)
        return features_from_noise(batch, guided, self.sampler, self.steps, no_more, decoder)


class _Scale(nn.Module):
    """A scale whose numbers are part of the graph."""

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Sequence[float], std: Sequence[float]) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(mean))
        self.register_buffer("std", torch.tensor(std))

    @property
    def scale(self) -> Scale:
        """The scale as the pipeline uses it."""
        return Scale(self.mean, self.std)


class _DenoiserGraph(nn.Module):
    """The denoiser with plain tensors as inputs."""

    def __init__(self, denoiser: nn.Module) -> None:
        super().__init__()
        self.denoiser = denoiser

    def forward(
        self, z: Tensor, t: Tensor, words: Tensor, words_mask: Tensor, mask: Tensor
    ) -> Tensor:
        return self.denoiser(z, t, Conditioning(words, words_mask), mask)


class _StudentGraph(_DenoiserGraph):
    """A distilled denoiser with plain tensors as inputs."""

    def forward(  # one graph has two inputs more
        self,
        z: Tensor,
        t: Tensor,
        words: Tensor,
        words_mask: Tensor,
        mask: Tensor,
        guidance: Tensor,
        step_size: Tensor,
    ) -> Tensor:
        step_condition = StepCondition(guidance, step_size)
        return self.denoiser(z, t, Conditioning(words, words_mask), mask, step_condition)


class _EncoderGraph(nn.Module):
    """The encoder of a VAE, without the deviation of its posterior."""

    def __init__(self, vae: MotionVAE) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, features: Tensor, mask: Tensor) -> Tensor:
        return self.vae.encode(features, mask).mean


class _DecoderGraph(nn.Module):
    """The decoder of a VAE with plain tensors as inputs."""

    def __init__(self, vae: MotionVAE) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        return self.vae.decode(latents, mask)


def _condition(width: int) -> dict[str, Tensor]:
    real = torch.ones(_BATCH, _WORDS, dtype=torch.bool)
    return {"words": torch.randn(_BATCH, _WORDS, width), "words_mask": real}


def _frames(per_token: int | None) -> Tensor:
    return torch.ones(_BATCH, _TOKENS * (per_token or 4), dtype=torch.bool)


def trace(
    network: nn.Module,
    inputs: Mapping[str, Tensor],
    path: Path,
    outputs: Sequence[str] = (),
    card: Mapping[str, str] | None = None,
    free: Mapping[str, Sequence[int]] | None = None,
) -> None:
    """Writes the graph of a network.

    The first two axes of every input, batch and length, may be of any size, or those in `free`.

    Args:
        network: The network to trace, in `eval()` mode.
        inputs: An example of each input, by the name of the network's argument.
        path: The `.onnx` file.
        outputs: Names of the outputs; by default the exporter's.
        card: Metadata to store in the graph.
        free: Axes of each input that may be of any size.
    """
    free = free or {name: range(min(value.ndim, 2)) for name, value in inputs.items()}
    axes = {name: dict.fromkeys(free[name], Dim.DYNAMIC) for name in inputs}
    with warnings.catch_warnings(), _quiet():
        # The exporter warns of its own internals; tests compare the graph with the network.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network.eval(),
            kwargs=dict(inputs),
            input_names=list(inputs),
            output_names=list(outputs) or None,
            dynamic_shapes=axes,
            dynamo=True,
            verbose=False,
        )
    assert program is not None  # as dynamo is asked for
    graph = anonymous(program.model_proto)
    onnx.helper.set_model_props(graph, dict(card or {}))
    with atomic_file(path) as temporary:
        onnx.save(graph, temporary)


@contextmanager
def _quiet() -> Iterator[None]:
    """Switches the exporter's log off, and PyTorch's structured trace, which takes most time."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    structured = logging.getLogger("torch.__trace")
    handlers, structured.handlers = structured.handlers, []
    try:
        yield
    finally:
        structured.handlers = handlers


def anonymous(model: ModelProto) -> ModelProto:
    """Returns a graph without the exporter's notes: source paths, stack traces, class names."""
    clean = ModelProto()
    clean.CopyFrom(model)
    graphs: list[GraphProto | onnx.FunctionProto] = [clean.graph, *clean.functions]
    for graph in graphs:
        values = [*graph.value_info, *getattr(graph, "input", []), *getattr(graph, "output", [])]
        named = [value for value in values if not isinstance(value, str)]
        for message in (graph, *graph.node, *getattr(graph, "initializer", []), *named):
            message.ClearField("metadata_props")
            message.ClearField("doc_string")
    return clean
