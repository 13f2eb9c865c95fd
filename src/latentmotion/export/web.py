"""Export for web pages: a sentence's tokens, noise, frames, guidance → joints, in one graph.

The graph joins what the model's folder has, text encoder and fused sampler, with the reading of the
sentence and the way from features to joints, which are traced from the code that Python runs. There
is one graph for each number of steps; all read the same `weights.bin`, in which large matrices are
kept as 8-bit integers with one scale a row. Nothing that only training needs is in it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import ModelProto, TensorProto, compose, helper, numpy_helper, parser
from onnx.external_data_helper import set_external_data
from tokenizers import Tokenizer
from torch import Tensor

from latentmotion.diffusion.condition import SentenceCondition, TextEmbedding
from latentmotion.diffusion.samplers import SeededNoise
from latentmotion.engine.backend import representation_of
from latentmotion.engine.lengths import QUANTILES, SHORTEST_USUAL, LengthModel
from latentmotion.engine.session import fused_sampler_file, open_session
from latentmotion.errors import ModelError
from latentmotion.export.onnx import FunctionModule, Weights, anonymous, scaled_rows, trace
from latentmotion.model import card as cards
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import atomic_folder
from latentmotion.storage.reading import packaged_toml

MANIFEST_FILE = "web.json"
WEIGHTS_FILE = "weights.bin"
SECONDS_FILE = "seconds.onnx"
FORMAT = "latentmotion web 1"

# Largest distance allowed between joints of the graph and of the model, meters.
TOLERANCE: dict[Weights, float] = {"int8": 0.15, "float16": 1e-4}

# Minimum size of a tensor that is kept in the file of weights.
_LEAST_BYTES = 1024

_ALIGNMENT = 64

# Parts from tokens to `seen`, each with its prefix and names, and the name of the words' mask.
SeenPrompt = tuple[list[tuple[ModelProto, str, dict[str, str]]], str]

# Small graphs that join the parts, as text.
_GRAPHS = packaged_toml(__file__, "web_graphs.toml")


def export_web(source: Path, output: Path, weights: Weights = "int8") -> None:
    """Writes a folder from which the npm package `latentmotion` generates.

    Args:
        source: Model folder that `latentmotion export` wrote, of a few-step model.
        output: Folder to write, replaced as a whole.
        weights: Precision of large matrices in the file.

    Raises:
        InputError: There is something else at `output`.
        ModelError: The model is not distilled or lacks a file; or a graph does not repeat it.
    """
    card = cards.read_card(source)
    pipeline = MotionPipeline.from_pretrained(source, "onnxruntime", 1)
    if not pipeline.backend.fused:
        raise ModelError(
            f"model {card.name!r} has no fused sampler, as few-step models do (fused_4.onnx); "
            "distill it: latentmotion train distill, then latentmotion export"
        )
    with atomic_folder(output, MANIFEST_FILE) as folder, tempfile.TemporaryDirectory() as temporary:
        store = _WeightStore(weights)
        reads = isinstance(pipeline.condition, SentenceCondition)
        text_graph, tokenizer = cards.find_text_encoder(card, source) if reads else (None, None)
        text = onnx.load(text_graph) if text_graph else None
        prompt = _seen_prompt(pipeline, text, Path(temporary))
        representation = representation_of(card)
        example = {"features": torch.randn(1, 9, representation.width)}
        joints_graph = Path(temporary) / "joints.onnx"
        decode = FunctionModule(lambda features: representation.decode(features))
        trace(decode, example, joints_graph, ("joints",), free={"features": (1,)})
        joints = onnx.load(joints_graph)
        for steps in pipeline.backend.fused:
            fused = onnx.load(source / fused_sampler_file(steps))
            graph = store.taken(_joined(prompt, fused, joints))
            onnx.save(anonymous(graph), folder / motion_file(steps))
        lengths = cards.file_beside(card, source, cards.LENGTHS_FILE)
        if lengths and text:
            model = LengthModel.read(lengths, card.condition.encoder)
            onnx.save(anonymous(store.taken(_seconds(text, model))), folder / SECONDS_FILE)
        store.write(folder / WEIGHTS_FILE)
        if tokenizer:
            shutil.copyfile(tokenizer, folder / cards.TOKENIZER_FILE)
        for steps in pipeline.backend.fused:
            error = joints_error(pipeline, folder, steps)
            if not error < TOLERANCE[weights]:
                raise ModelError(
                    f"{motion_file(steps)} differs from its model by {error:.2g} m; not written"
                )
        manifest = _manifest(pipeline, folder, weights)
        (folder / MANIFEST_FILE).write_text(json.dumps(manifest, separators=(",", ":")), "utf-8")


def motion_file(steps: int) -> str:
    """Returns the name of the graph for so many steps."""
    return f"motion_{steps}.onnx"


def joints_error(pipeline: MotionPipeline, folder: Path, steps: int) -> float:
    """Returns the largest distance between joints of a graph and of its model, meters."""
    seed, guidance, frames = 7, pipeline.card.sampling.guidance, pipeline.card.frames[1]
    sentence = "a person walks forward and waves"
    if isinstance(pipeline.condition, SentenceCondition):
        tokenizer = Tokenizer.from_file(str(folder / cards.TOKENIZER_FILE))
        prompt, ids = sentence, tokenizer.encode(sentence).ids
    else:  # the first label, or nothing
        prompt = next(iter(pipeline.card.condition.labels), "")
        ids = [0] if prompt else []
    space = pipeline.card.latents
    session = open_session(folder / motion_file(steps), "onnxruntime", 1)
    actual = session(
        tokens=np.array([ids], np.int64),
        noise=SeededNoise([seed])((1, space.tokens_of(frames), space.width)),
        frames=np.array([frames]),
        guidance=np.array([guidance], np.float32),
    )
    seconds = frames / pipeline.representation.fps
    (expected,) = pipeline.batch([prompt], seconds, [seed], steps, guidance, from_clips=False)
    return float(np.linalg.norm(actual[0] - expected.joints, axis=-1).max())


def _seen_prompt(pipeline: MotionPipeline, text: ModelProto | None, folder: Path) -> SeenPrompt:
    """Returns the parts of a graph that lead from tokens to what the denoiser sees of a prompt."""
    condition = pipeline.condition
    if isinstance(condition, SentenceCondition):
        assert text is not None
        # How the condition is made of the text encoder's outputs, traced.
        width, words_width = (
            output.type.tensor_type.shape.dim[-1].dim_value for output in text.graph.output[:2]
        )
        conditioning = condition.conditioning
        pieces = 2 * (conditioning.words + 1)  # an example that is cut
        example = {
            "pooled": torch.randn(1, width),
            "words": torch.randn(1, pieces, words_width),
            "mask": torch.ones(1, pieces, dtype=torch.bool),
        }
        free = {"pooled": (), "words": (1,), "mask": (1,)}

        def read(pooled: Tensor, words: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
            conditioned = conditioning(TextEmbedding(pooled, words, mask))
            return conditioned.tokens, conditioned.mask

        trace(FunctionModule(read), example, folder / "r.onnx", ("seen", "seen_mask"), free=free)
        reading = onnx.load(folder / "r.onnx")
        first = _same("tokens", "mask", "pooled", "words")
        then = _same("pooled", "words", "mask", "seen", "seen_mask")
        return [(text, "text", first), (reading, "reading", then)], "seen_mask"
    width = np.array(pipeline.card.condition.condition_width)
    labels = _graph("labels", depth=width, values=np.array([0, 1], np.float32))
    return [(labels, "labels", _same("tokens", "seen"))], "mask"


def _joined(prompt: SeenPrompt, fused: ModelProto, joints: ModelProto) -> ModelProto:
    """Returns one graph of all parts."""
    parts, words_mask = prompt
    latents = fused.graph.input[0].type.tensor_type.shape.dim[2].dim_value
    skeleton = joints.graph.output[0].type.tensor_type.shape.dim[2].dim_value
    inputs = [
        helper.make_tensor_value_info("tokens", TensorProto.INT64, [1, "pieces"]),
        helper.make_tensor_value_info("noise", TensorProto.FLOAT, [1, "latents", latents]),
        helper.make_tensor_value_info("frames", TensorProto.INT64, [1]),
        helper.make_tensor_value_info("guidance", TensorProto.FLOAT, [1]),
    ]
    shape = [1, "frames_made", skeleton, 3]
    output = helper.make_tensor_value_info("joints", TensorProto.FLOAT, shape)
    graph = helper.make_graph([], "motion", inputs, [output])
    features = fused.graph.output[0].name
    prompt_inputs = {"words": "seen", "words_mask": words_mask}
    direct_inputs = {"mask": "latents_mask", "frames": "frames_mask", "noise": "noise"}
    _add(graph, _graph("mask"), "mask", _same("tokens", "mask"))
    names = _same("noise", "frames", "latents_mask", "frames_mask")
    _add(graph, _graph("masks"), "masks", names)
    for part, prefix, names in parts:
        _add(graph, part, prefix, names)
    _add(
        graph,
        fused,
        "fused",
        prompt_inputs | direct_inputs | {"guidance": "guidance", features: "features"},
    )
    _add(graph, joints, "joints", _same("features", "joints"))
    return helper.make_model(graph, opset_imports=fused.opset_import, ir_version=fused.ir_version)


def _same(*names: str) -> dict[str, str]:
    return {name: name for name in names}


def _seconds(text: ModelProto, model: LengthModel) -> ModelProto:
    """Returns the graph of a sentence's usual length: tokens → seconds."""
    inputs = helper.make_tensor_value_info("tokens", TensorProto.INT64, [1, "pieces"])
    output = helper.make_tensor_value_info("seconds", TensorProto.FLOAT, [1, 1])
    graph = helper.make_graph([], "seconds", [inputs], [output])
    _add(graph, _graph("mask"), "mask", _same("tokens", "mask"))
    _add(graph, text, "text", _same("tokens", "mask", "pooled"))
    longer = len(QUANTILES) - QUANTILES.index(0.5)  # the median is the last of so many from above
    *hidden, last = zip(model.weights, model.biases, strict=True)
    value = "pooled"
    for number, (weight, bias) in enumerate(hidden):
        layer = _graph("hidden_layer", weight=weight.T, bias=bias)
        _add(graph, layer, f"lengths{number}", {"into": value, "out": f"hidden{number}"})
        value = f"hidden{number}"
    layer = _graph(
        "last_layer",
        weight=last[0].T,
        bias=last[1],
        least=np.float32(SHORTEST_USUAL),
        count=np.array([longer]),
        first=np.array([longer - 1]),
    )
    _add(graph, layer, "lengths", {"into": value, "seconds": "seconds"})
    return helper.make_model(graph, opset_imports=text.opset_import, ir_version=text.ir_version)


def _graph(name: str, **arrays: np.ndarray | np.generic) -> ModelProto:
    """Returns one of the small graphs, with constants by name."""
    model = parser.parse_model(_GRAPHS[name])
    model.graph.initializer.extend(
        numpy_helper.from_array(np.array(array), name) for name, array in arrays.items()
    )
    return model


def _add(graph: onnx.GraphProto, part: ModelProto, prefix: str, names: dict[str, str]) -> None:
    """Adds the nodes of a model to a graph.

    Args:
        graph: The graph to add to.
        part: The model.
        prefix: Begins the names of its own values.
        names: The graph's names of the values that it shares with the model, by the model's.
    """
    prefixed = compose.add_prefix(part, f"{prefix}.").graph
    shared = {f"{prefix}.{name}": whole for name, whole in names.items()}
    for node in prefixed.node:
        node.input[:] = [shared.get(name, name) for name in node.input]
        node.output[:] = [shared.get(name, name) for name in node.output]
    graph.node.extend(prefixed.node)
    graph.initializer.extend(prefixed.initializer)


class _WeightStore:
    """The file of weights: every tensor once, whichever graphs read it."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self._content = bytearray()
        self._offsets: dict[bytes, int] = {}

    def taken(self, model: ModelProto) -> ModelProto:
        """Moves the weights of a graph to the file, those in 16 bits as they are to be kept."""
        casts, initializers = [], []
        for tensor in model.graph.initializer:
            array = numpy_helper.to_array(tensor)
            if array.dtype == np.float16 and array.ndim > 1 and self.weights == "int8":
                rows = array.astype(np.float32)
                most = np.abs(rows).max(tuple(range(1, rows.ndim)), keepdims=True)
                scale = np.maximum(most / 127, 1e-12).astype(np.float32)  # of each row
                packed = np.round(rows / scale).astype(np.int8)
                names = f"{tensor.name}.packed", f"{tensor.name}.scale"
                initializers += [self._stored(packed, names[0]), self._stored(scale, names[1])]
                casts += scaled_rows(*names, tensor.name)  # engines run them once, while loading
            else:
                initializers.append(self._stored(array, tensor.name))
        nodes = list(model.graph.node)
        del model.graph.initializer[:], model.graph.node[:]
        model.graph.initializer.extend(initializers)
        model.graph.node.extend([*casts, *nodes])
        return model

    def write(self, path: Path) -> None:
        """Writes the file."""
        path.write_bytes(self._content)

    def _stored(self, array: np.ndarray, name: str) -> TensorProto:
        tensor, content = numpy_helper.from_array(array, name), array.tobytes()
        if len(content) < _LEAST_BYTES:
            return tensor
        key = hashlib.sha256(content).digest()
        if key not in self._offsets:
            self._content.extend(bytes(-len(self._content) % _ALIGNMENT))
            self._offsets[key] = len(self._content)
            self._content.extend(content)
        set_external_data(tensor, WEIGHTS_FILE, self._offsets[key], len(content))
        tensor.ClearField("raw_data")
        return tensor


def _manifest(pipeline: MotionPipeline, folder: Path, weights: Weights) -> dict[str, Any]:
    """Returns what a page has to know of the model."""
    card, features = pipeline.card, pipeline.representation
    assert card.few_step is not None  # as there are fused samplers
    files = sorted(file for file in folder.iterdir())
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    tokenizer = folder / cards.TOKENIZER_FILE
    text = json.loads(tokenizer.read_text("utf-8")) if tokenizer.is_file() else {}
    labels = card.condition.labels
    steps = sorted(pipeline.backend.fused)  # larger numbers have no graph
    usual = card.sampling.steps if card.sampling.steps in steps else steps[-1]
    return {
        "format": FORMAT,
        "name": card.name,
        "hash": digest.hexdigest(),
        "rights": cards.RIGHTS_IN_MOTIONS,
        "weightsLicense": card.provenance.license,
        "prompts": "sentences" if text else "labels" if labels else "nothing",
        "labels": labels,
        "weights": weights,
        "files": {file.name: file.stat().st_size for file in files},
        "skeleton": {
            "name": features.skeleton.name,
            "names": features.skeleton.names,
            "parents": features.skeleton.parents,
            "directions": features.skeleton.offsets.tolist(),
        },
        "fps": features.fps,
        "frames": card.frames,
        "latents": {
            "width": card.latents.width,
            "tokens": card.latents.tokens,
            "framesPerToken": card.latents.frames_per_token,
        },
        "mostPieces": (text.get("truncation") or {}).get("max_length"),
        "padding": text.get("padding"),
        "steps": steps,
        "guidance": card.few_step.guidance,
        "usual": {"steps": usual, "guidance": card.sampling.guidance},
    }
