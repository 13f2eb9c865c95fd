"""ONNX export: trained networks as graphs that run without PyTorch.

Each graph has named inputs, and batch and length of any size. A fused sampler is one graph of all
that follows the condition: a few unrolled steps, scales and decoder. Graphs do not state who made
them: source paths, stack traces and class names are left out.

Weights of graphs: read from the model's `weights.safetensors`, or kept in 8 bits.

An initializer that equals a tensor of that file, as it is or transposed, becomes external data of
ONNX (file, offset, length): 16 bits, or 8 with a scale for each row, which the engine makes 32
while it loads. The network was rounded before, so nothing is lost. Tensors that are not in the file
stay in the graph.

In graphs of 8 bits 64 weights share a scale, and so do 64 inputs. This is ONNX Runtime's
MatMulNBits, which OpenVINO reads, too. Dynamic quantization has one scale for all inputs, so that a
motion would depend on its batch. Convolutions stay in float32: in 8 bits they took three times as
long (lab/diary/runtime.md).
"""

from __future__ import annotations

import json
import logging
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
import torch
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, helper, numpy_helper
from onnx.external_data_helper import set_external_data
from torch import Tensor, nn
from torch.export import Dim

from latentmotion.diffusion.guidance import DistilledGuidance
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.engine.backend import Batch, FeatureDecoder
from latentmotion.engine.session import onnxruntime_session, open_session
from latentmotion.errors import ModelError
from latentmotion.model.config import STRIDE, Sampling
from latentmotion.networks.checkpoint import SCALE, LatentModel
from latentmotion.networks.denoiser import DenoiserNetwork, forward_of
from latentmotion.networks.vae.convolutional import Pullback
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import features_from_noise, sampler_of
from latentmotion.representation.interface import Scale
from latentmotion.storage.files import atomic_file, write_file

# Sizes of the example inputs that graphs are traced with; all of them stay free.
_BATCH, _TOKENS, _WORDS = 2, 7, 3

# Further sizes of the pullback's example, which stay free as well.
_ROWS, _FEATURES = 3, 67

# Largest difference between graph and automatic differentiation, relative to the largest value.
PULLBACK_TOLERANCE = 1e-5


def export_denoiser(
    denoiser: DenoiserNetwork, latent_width: int, words_width: int, path: Path
) -> None:
    """Writes a denoiser's graph, with the inputs of `forward_of`."""
    inputs = {
        "z": torch.randn(_BATCH, _TOKENS, latent_width),
        "t": torch.rand(_BATCH),
        **_condition(words_width),
        "mask": torch.ones(_BATCH, _TOKENS, dtype=torch.bool),
        **{name: torch.rand(_BATCH) for name in denoiser.further_inputs},
    }
    trace(FunctionModule(forward_of(denoiser), denoiser=denoiser), inputs, path)


def export_decoder(vae: MotionVAE, frames_per_token: int | None, path: Path) -> None:
    """Writes a VAE decoder's graph: latents, mask → normalized features."""
    inputs = {
        "latents": torch.randn(_BATCH, _TOKENS, vae.latent_width),
        "mask": _frames(frames_per_token),
    }
    trace(FunctionModule(lambda latents, mask: vae.decode(latents, mask), vae=vae), inputs, path)


def export_encoder(vae: MotionVAE, features: int, path: Path) -> None:
    """Writes a VAE encoder's graph: normalized features, mask → mean of the posterior.

    Args:
        vae: The network.
        features: Features of a frame.
        path: The `.onnx` file.
    """
    mask = _frames(None)
    inputs = {"features": torch.randn(*mask.shape, features), "mask": mask}
    mean = FunctionModule(lambda features, mask: vae.encode(features, mask).mean, vae=vae)
    trace(mean, inputs, path)


def export_pullback(vae: MotionVAE, path: Path) -> None:
    """Writes the pullback of a decoder of convolutions, which directing a motion needs.

    Its graph: latents, mask, gradient of features → gradient of latents.
    """
    inputs = _pullback_inputs(vae.latent_width, _TOKENS, _ROWS, _FEATURES)
    trace(Pullback(vae), inputs, path, free={"latents": (1,), "mask": (1,), "gradient": (0, 1, 2)})


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


def _condition(width: int) -> dict[str, Tensor]:
    real = torch.ones(_BATCH, _WORDS, dtype=torch.bool)
    return {"words": torch.randn(_BATCH, _WORDS, width), "words_mask": real}


def _frames(per_token: int | None) -> Tensor:
    return torch.ones(_BATCH, _TOKENS * (per_token or 4), dtype=torch.bool)


class FunctionModule(nn.Module):
    """A function of networks as a module, which is all that the exporter takes.

    Args:
        forward: The function; its arguments are the inputs of the graph.
        networks: The networks that it calls, by the names under which the graph has their weights.
    """

    def __init__(self, forward: Callable[..., Any], **networks: nn.Module) -> None:
        super().__init__()
        self.forward = forward
        for name, network in networks.items():
            self.add_module(name, network)


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
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    structured = logging.getLogger("torch.__trace")  # PyTorch's trace, which takes most time
    handlers, structured.handlers = structured.handlers, []
    try:
        with warnings.catch_warnings():
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
    finally:
        structured.handlers = handlers
    assert program is not None  # as dynamo is asked for
    graph = anonymous(program.model_proto)
    onnx.helper.set_model_props(graph, dict(card or {}))
    with atomic_file(path) as temporary:
        onnx.save(graph, temporary)


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


# Storage of large matrices: 8 bits with a scale for each row, or 16 bits.
Weights = Literal["int8", "float16"]

FEWEST = 256  # Minimum size of a tensor that is worth a reference.

BLOCK = 64  # Numbers that share a scale.

# MatMulNBits' name for products of integers.
_EIGHT_BIT_INPUTS = 4

# Types of numbers as safetensors files name them, in NumPy and in ONNX.
_TYPES = {
    "F16": (np.float16, TensorProto.FLOAT16),
    "F32": (np.float32, TensorProto.FLOAT),
    "I8": (np.int8, TensorProto.INT8),
}

_HEADER_LENGTH = 8  # a safetensors file begins with the length of its JSON header


@dataclass(frozen=True)
class StoredTensor:
    """A tensor in a file, whole or a matrix in 8 bits with a scale for each row."""

    kind: int  # ONNX's type of its numbers.
    shape: tuple[int, ...]  # Its shape in the file.
    offset: int  # Position of its first byte.
    length: int  # Number of bytes.
    scale: StoredTensor | None = None  # Scales of the rows of a matrix in 8 bits.
    transposed: bool = False  # Whether the graph has the transpose.

    def external(self, name: str, file: str) -> TensorProto:
        """Returns the initializer that a graph reads from that file."""
        tensor = TensorProto(name=name, data_type=self.kind, dims=self.shape, raw_data=b"")
        set_external_data(tensor, file, self.offset, self.length)
        tensor.ClearField("raw_data")
        return tensor


def share_weights(graph: Path, weights: Path) -> None:
    """Rewrites a graph so that its weights are read from a file in the same folder.

    Args:
        graph: The `.onnx` file.
        weights: The `.safetensors` file beside it, which has to stay there.
    """
    model = onnx.load(graph, load_external_data=False)
    stored = stored_tensors(weights)
    initializers: list[TensorProto] = []
    nodes: list[NodeProto] = []
    for tensor in model.graph.initializer:
        inside = tensor.data_location != TensorProto.EXTERNAL
        float32 = inside and tensor.data_type == TensorProto.FLOAT
        shared = stored.get(_key(numpy_helper.to_array(tensor))) if float32 else None
        if shared is None:
            initializers.append(tensor)
            continue
        name, stored_as, file = tensor.name, f"{tensor.name}.stored", weights.name
        initializers.append(shared.external(stored_as, file))
        # Nodes that restore the graph's tensor; engines run them once, while loading.
        whole = f"{name}.whole" if shared.transposed else name
        if shared.scale is None:
            nodes.append(helper.make_node("Cast", [stored_as], [whole], to=TensorProto.FLOAT))
        else:
            initializers.append(shared.scale.external(f"{name}.scale", file))
            nodes += scaled_rows(stored_as, f"{name}.scale", whole)
        if shared.transposed:
            nodes.append(helper.make_node("Transpose", [whole], [name]))
    nodes += model.graph.node
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(initializers)
    model.graph.node.extend(nodes)
    write_file(graph, model.SerializeToString())


def scaled_rows(packed: str, scale: str, matrix: str) -> list[NodeProto]:
    """Returns nodes that make a matrix of its numbers in 8 bits and a scale for each row."""
    return [
        helper.make_node("Cast", [packed], [f"{packed}.float"], to=TensorProto.FLOAT),
        helper.make_node("Mul", [f"{packed}.float", scale], [matrix]),
    ]


def stored_tensors(weights: Path) -> dict[tuple[tuple[int, ...], bytes], StoredTensor]:
    """Returns every tensor of a file in 16 or 8 bits, and its transpose, by shape and numbers."""
    content = weights.read_bytes()
    start = _HEADER_LENGTH + int.from_bytes(content[:_HEADER_LENGTH], "little")
    entries = json.loads(content[_HEADER_LENGTH:start])

    def read(name: str) -> tuple[StoredTensor, np.ndarray]:
        first, last = (start + offset for offset in entries[name]["data_offsets"])
        dtype, kind = _TYPES[entries[name]["dtype"]]
        array = np.frombuffer(content[first:last], dtype).reshape(entries[name]["shape"])
        return StoredTensor(kind, array.shape, first, last - first), array

    stored = {}
    for name, entry in entries.items():
        if name == "__metadata__" or entry["dtype"] not in ("F16", "I8"):
            continue
        tensor, array = read(name)
        if array.size < FEWEST:
            continue
        if name + SCALE in entries:
            scale, factors = read(name + SCALE)
            tensor, array = replace(tensor, scale=scale), array * factors
        for values, transposed in ((array.T, True), (array, False)):
            stored[_key(values)] = replace(tensor, transposed=transposed)
    return stored


def _key(array: np.ndarray) -> tuple[tuple[int, ...], bytes]:
    return array.shape, np.ascontiguousarray(array, np.float32).tobytes()


def quantize(graph: Path) -> None:
    """Rewrites a graph with its matrix products in 8 bits."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    from onnxruntime.quantization.matmul_nbits_quantizer import MatMulNBitsQuantizer

    # While it is imported, that module sets up logging for the whole program.
    root.handlers[:], root.level = handlers, level
    # ONNX Runtime computes constants as it loads a graph; so every weight becomes a matrix.
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "folded.onnx"
        onnxruntime_session(graph, 1, optimized=written)
        model = onnx.load(written)
    card = {entry.key: entry.value for entry in onnx.load(graph).metadata_props}
    onnx.helper.set_model_props(model, card)
    quantizer = MatMulNBitsQuantizer(
        model, bits=8, block_size=BLOCK, is_symmetric=True, accuracy_level=_EIGHT_BIT_INPUTS
    )
    quantizer.process()
    with atomic_file(graph) as temporary:
        onnx.save(quantizer.model.model, temporary)  # pyright: ignore[reportAttributeAccessIssue]
