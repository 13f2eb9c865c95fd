"""Packaging: a trained model as a folder that runs without PyTorch.

The folder has card, weights, graphs and text encoder. Weights are stored in 16 bits, or the
denoiser's matrices and the decoder's layers but the last in 8, and the graphs are made from the
rounded weights, so that both give the same motions.

Decoder swap: one model's decoder for another model with the same encoder, so the same latents.

A few-step student and a light decoder are trained separately from the same model, and combined
here.

Truncation and padding, which the tokenizer of `transformers` gets at every call, are stored in
`tokenizer.json`, so that a sentence alone becomes the tokens that the network was trained with.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import onnx
import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.schedule import StepCondition
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.engine.session import PULLBACK_FILE, fused_sampler_file, open_session
from latentmotion.errors import InputError, ModelError
from latentmotion.export import onnx as graphs
from latentmotion.model import card as cards
from latentmotion.networks import checkpoint
from latentmotion.networks.pretrained_text import PretrainedTextEncoder
from latentmotion.networks.text_encoder import StudentNetwork, pack, packed
from latentmotion.networks.vae.interface import fingerprint
from latentmotion.progress import counted
from latentmotion.storage.files import atomic_file, atomic_folder
from latentmotion.storage.provenance import PIPELINE, front_matter, license_fields

# Largest difference allowed between the outputs of a graph and of its network.
TOLERANCE: dict[cards.GraphPrecision, float] = {"float32": 1e-4, "int8": 0.1}

MOST_FUSED = 4  # Maximum number of steps of a fused sampler: each step adds to its size.

WriteTextEncoder = Callable[[Path], None]  # Writes the files of a text encoder into a folder.


def package_model(
    source: Path,
    card: cards.ModelCard,
    text_encoder: WriteTextEncoder | None,
    output: Path,
    share_encoder: bool = False,
    weights: graphs.Weights = "float16",
) -> None:
    """Writes a folder from which `MotionPipeline.from_pretrained` generates.

    Args:
        source: Folder that training wrote, with the weights of all networks.
        card: The card to write, read from `source` or changed; it states the graphs' precision.
        text_encoder: Writes the text encoder; None for models of actions and unconditional ones.
        output: Folder to write, replaced as a whole.
        share_encoder: Whether to leave out the VAE's encoder if a shipped model has the same.
        weights: Precision of the denoiser's matrices and of the decoder's layers but the last in
            the file. Encoders stay in 16 bits, since other models may have the same one.

    Raises:
        ModelError: A file or network is missing, a graph does not repeat its network, or no
            shipped model has the encoder.
    """
    width = card.trained_denoiser.condition_width
    if card.condition.reads_text and text_encoder is None:
        raise ModelError(f"model {card.name!r} reads sentences; pass its text encoder")
    with atomic_folder(output, cards.CARD_FILE) as folder:
        card.write(folder)
        (folder / cards.README_FILE).write_text(readme(card), encoding="utf-8")
        rounded = {
            key: value.half() if value.is_floating_point() else value
            for key, value in checkpoint.model_weights(source).items()
        }
        left_out = checkpoint.encoder_weights(rounded) if share_encoder else {}
        shared = checkpoint.encoder_hash(left_out) if left_out else ""
        if share_encoder and not (shared and checkpoint.encoder_holder(shared, besides=output)):
            raise ModelError(
                "no shipped model has this VAE's encoder, so it cannot be left out; export without "
                "--share-encoder"
            )
        tensors = {key: value for key, value in rounded.items() if key not in left_out}
        for key in matrices_to_pack(tensors) if weights == "int8" else ():
            tensors[key], tensors[key + checkpoint.SCALE] = pack(tensors[key].float())
        metadata = {checkpoint.ENCODER_HASH: shared} if left_out else None
        save_file(tensors, folder / checkpoint.WEIGHTS_FILE, metadata)
        if text_encoder is not None:
            text_encoder(folder)
            encoder_width = load_text_encoder(folder).width
            if encoder_width != width:
                raise ModelError(
                    f"the text encoder has {encoder_width} numbers per vector, model {card.name!r} "
                    f"reads {width}; it was trained with "
                    f"{card.condition.encoder or 'another'!r}"
                )
        _write_graphs(checkpoint.load_model(folder), folder, with_encoder=not left_out)


def matrices_to_pack(weights: Mapping[str, torch.Tensor]) -> list[str]:
    """Returns the names of the matrices and kernels that lose nothing in 8 bits.

    These are the denoiser's, and those of a convolutional decoder but its last: in 8 bits that one
    adds jitter (jerk at the 99th percentile 0.74 to 0.89 of the recordings', errors unchanged).
    """
    large = [key for key, value in weights.items() if value.is_floating_point() and value.ndim > 1]
    layers = [key for key in large if key.startswith("vae.decoder.") and weights[key].ndim == 3]
    # Decoders of plugins need not be rows of layers.
    kernels = [key for key in layers if key.split(".")[2].isdigit()]
    kernels.sort(key=lambda key: int(key.split(".")[2]))
    matrices = [key for key in large if key.startswith("denoiser.") and weights[key].ndim == 2]
    return [*matrices, *kernels[:-1]]


def copied(folder: Path) -> WriteTextEncoder:
    """Returns a function that copies a text encoder, and its length model, from another folder.

    Raises:
        ModelError: There is no text encoder in it.
    """
    names = cards.TEXT_GRAPH_FILE, cards.TOKENIZER_FILE
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; make them: latentmotion train text-encoder"
        )

    def write(target: Path) -> None:
        onnx.save(
            graphs.anonymous(onnx.load(folder / cards.TEXT_GRAPH_FILE)),
            target / cards.TEXT_GRAPH_FILE,
        )
        shutil.copyfile(folder / cards.TOKENIZER_FILE, target / cards.TOKENIZER_FILE)
        if (folder / cards.LENGTHS_FILE).is_file():
            shutil.copyfile(folder / cards.LENGTHS_FILE, target / cards.LENGTHS_FILE)

    return write


def _write_graphs(model: checkpoint.LatentModel, folder: Path, with_encoder: bool) -> None:
    card, width = model.card, model.card.trained_denoiser.condition_width
    denoiser, decoder = folder / "denoiser.onnx", folder / "decoder.onnx"
    writers = [partial(graphs.export_denoiser, model.denoiser, card.latents.width, width, denoiser)]
    if card.vae.has_weights:
        per_token = card.latents.frames_per_token
        writers.append(partial(graphs.export_decoder, model.vae, per_token, decoder))
    if card.vae.has_weights and with_encoder:
        features, encoder = len(card.normalizer_mean), folder / cards.ENCODER_FILE
        writers.append(partial(graphs.export_encoder, model.vae, features, encoder))
    if card.vae.decoder_margin() is not None:
        writers.append(partial(graphs.export_pullback, model.vae, folder / PULLBACK_FILE))
    for steps in _fused_steps(card):
        sampler = folder / fused_sampler_file(steps)
        writers.append(partial(graphs.export_fused_sampler, model, steps, sampler))
    for write in counted(writers, "writing graphs"):
        write()
    for graph in counted(sorted(folder.glob("*.onnx")), "sharing weights"):
        if card.precision == "int8" and graph.name != PULLBACK_FILE:  # derivatives stay exact
            graphs.quantize(graph)
        if graph.name != cards.TEXT_GRAPH_FILE:  # whose weights are its own
            graphs.share_weights(graph, folder / checkpoint.WEIGHTS_FILE)
    _check_graphs(model, folder)


def _fused_steps(card: cards.ModelCard) -> list[int]:
    """Returns the numbers of steps that get a fused sampler."""
    return [steps for steps in card.few_step.steps if steps <= MOST_FUSED] if card.few_step else []


@torch.no_grad()
def _check_graphs(model: checkpoint.LatentModel, folder: Path) -> None:
    """Compares each graph with its network on random inputs."""
    card, count = model.card, 3
    tokens, width = card.latents.tokens_of(card.frames[0]), card.latents.width
    words = 1 if card.condition.prompted else 0
    t, frames = torch.full((count,), 0.5), torch.ones(count, card.frames[0], dtype=torch.bool)
    shared = {
        "words_mask": torch.ones(count, words, dtype=torch.bool),
        "mask": torch.ones(count, tokens, dtype=torch.bool),
    }

    def drawn(name: str) -> dict[str, torch.Tensor]:
        latents = torch.randn(count, tokens, width)
        return {name: latents, "words": torch.randn(count, words, shown), **shared}

    shown = card.trained_denoiser.condition_width
    inputs = {**drawn("z"), "t": t}
    further = {"guidance": 3 * t, "step_size": t} if model.denoiser.further_inputs else {}
    condition = Conditioning(inputs["words"], inputs["words_mask"])
    step_condition = StepCondition(**further) if further else None
    expected = model.denoiser(inputs["z"], t, condition, inputs["mask"], step_condition)
    _compare(folder / "denoiser.onnx", inputs | further, expected)
    if (folder / "decoder.onnx").is_file():
        latents = torch.randn(count, tokens, width)
        expected = model.vae.decode(latents, frames)
        _compare(folder / "decoder.onnx", {"latents": latents, "mask": frames}, expected)
    if (folder / cards.ENCODER_FILE).is_file():
        features = torch.randn(*frames.shape, len(card.normalizer_mean))
        expected = model.vae.encode(features, frames).mean
        _compare(folder / cards.ENCODER_FILE, {"features": features, "mask": frames}, expected)
    if (folder / PULLBACK_FILE).is_file():
        with torch.enable_grad():  # of which the pullback is the transpose
            error = graphs.pullback_error(model.vae, folder / PULLBACK_FILE)
        if not error < graphs.PULLBACK_TOLERANCE:
            raise ModelError(
                f"{PULLBACK_FILE} differs from its decoder by {error:.2g}; not written"
            )
    for steps in _fused_steps(card):
        inputs = {**drawn("noise"), "frames": frames, "guidance": torch.full((count,), 1.5)}
        expected = graphs.FusedSampler(model, steps)(**inputs)
        _compare(folder / fused_sampler_file(steps), inputs, expected)


def _compare(graph: Path, inputs: dict[str, torch.Tensor], expected: torch.Tensor) -> None:
    """Raises ModelError if a graph's output differs from the expected one."""
    session = open_session(graph, "onnxruntime")
    actual = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    difference = float(np.abs(actual - expected.numpy()).max())
    tolerance = TOLERANCE[cards.read_card(graph.parent).precision]
    if not difference < tolerance * max(1.0, float(expected.abs().max())):
        raise ModelError(f"{graph.name} differs from its network by {difference:.2g}; not written")


Model = TypeVar("Model", bound=checkpoint.FirstStageModel)

# Prefixes of figures that depend on the decoder alone, and of those that hold with any decoder.
OF_DECODER, OF_DENOISER = ("vae_", "decoder_"), ("denoiser_", "student_", "teacher")


def with_decoder(model: Model, other: checkpoint.FirstStageModel) -> Model:
    """Returns `model` with the decoder of `other`.

    Raises:
        InputError: Their latents are not the same.
        ModelError: One of them has no VAE.
    """
    check_latents(model, other)
    ours, theirs = model.card.provenance, other.card.provenance
    provenance = replace(
        ours,
        data=tuple(dict.fromkeys((*ours.data, *theirs.data))),
        data_hashes={**theirs.data_hashes, **ours.data_hashes},
        commands=tuple(dict.fromkeys((*ours.commands, *theirs.commands))),
        hours=round(ours.hours + other.card.figures.get("decoder_hours", 0.0), 3),
    )
    card = replace(
        model.card,
        vae=other.card.vae,
        provenance=provenance,
        figures={**figures_of(model.card, OF_DENOISER), **figures_of(other.card, OF_DECODER)},
    )
    return replace(model, card=card, vae=other.vae)


def check_latents(model: checkpoint.FirstStageModel, other: checkpoint.FirstStageModel) -> None:
    """Checks that the latents of two models are the same.

    Raises:
        InputError: They differ.
        ModelError: One of them has no VAE.
    """
    pairs = {
        "encoders": (_encoder_of(model), _encoder_of(other)),
        "normalizers": (scale_of(model.card), scale_of(other.card)),
    }
    for what, (ours, theirs) in pairs.items():
        if ours != theirs:
            raise InputError(
                f"models {model.card.name!r} and {other.card.name!r} have different {what}, so one "
                "cannot read the other's latents; make a decoder for them: latentmotion train "
                "decoder"
            )


def scale_of(card: cards.ModelCard) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
    """Returns the representation of a model and the scale of its features."""
    return card.representation, card.normalizer_mean, card.normalizer_std


def figures_of(card: cards.ModelCard, prefixes: tuple[str, ...]) -> dict[str, Any]:
    """Returns the figures of a model whose names begin with one of the prefixes."""
    return {name: value for name, value in card.figures.items() if name.startswith(prefixes)}


def _encoder_of(model: checkpoint.FirstStageModel) -> str:
    if not model.card.vae.has_weights:
        raise ModelError(f"model {model.card.name!r} has no VAE: run latentmotion train vae")
    return fingerprint(model.vae)


WEIGHTS_FILE = "text_encoder.safetensors"


def export_student(
    network: StudentNetwork, tokenizer: Tokenizer, known_words: Iterable[str], folder: Path
) -> torch.nn.Module:
    """Writes `text_encoder.onnx`, `text_encoder.safetensors` and `tokenizer.json` of a student.

    Returns:
        The network whose 8-bit weights both files hold.
    """
    small = packed(network)
    state = {name: tensor.contiguous() for name, tensor in small.state_dict().items()}
    digest = hashlib.sha256(b"".join(state[name].numpy().tobytes() for name in sorted(state)))
    card = {
        "name": f"student-{digest.hexdigest()[:12]}",
        "known_words": json.dumps(sorted(known_words)),
    }
    shape = {key: str(value) for key, value in vars(network.shape).items()}
    with atomic_file(folder / WEIGHTS_FILE) as temporary:
        save_file(state, temporary, metadata=shape)
    with atomic_file(folder / cards.TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)
    write_graph(small, card, folder / cards.TEXT_GRAPH_FILE)
    return small


def write_graph(network: torch.nn.Module, card: dict[str, str], path: Path) -> None:
    """Writes a network's graph, tokens, mask → pooled, words, with a card as its metadata."""
    tokens, mask = torch.zeros(2, 7, dtype=torch.long), torch.ones(2, 7, dtype=torch.bool)
    graphs.trace(network, {"tokens": tokens, "mask": mask}, path, ("pooled", "words"), card)


def export_pretrained(encoder: PretrainedTextEncoder, folder: Path) -> None:
    """Writes `text_encoder.onnx` and `tokenizer.json` of a pretrained encoder.

    Raises:
        ModelError: The encoder has no tokenizer that runs without `transformers`.
    """
    backend = getattr(encoder.tokenizer, "backend_tokenizer", None)
    if backend is None:
        raise ModelError(f"{encoder.name} has no fast tokenizer, which an export needs")
    tokenizer = Tokenizer.from_str(backend.to_str())
    tokenizer.enable_truncation(encoder.kind.longest)
    tokenizer.no_padding()
    if encoder.kind.padding == "max_length":
        tokenizer.enable_padding(
            pad_id=encoder.tokenizer.pad_token_id,
            pad_token=encoder.tokenizer.pad_token,
            length=encoder.kind.longest,
        )
    with atomic_file(folder / cards.TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)

    def read(tokens: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        reading = encoder.kind.read(encoder.model, tokens, mask)
        return reading.pooled, reading.words

    network = graphs.FunctionModule(read, network=encoder.model)
    write_graph(network, {"name": encoder.name}, folder / cards.TEXT_GRAPH_FILE)


_INPUTS = {
    "text": "an English sentence",
    "action": "the name of an action",
    "unconditional": "nothing but a seed",
}


def readme(card: cards.ModelCard) -> str:
    """Returns the page, with the YAML that the hub reads at its head."""
    provenance, text = card.provenance, card.task == "text"
    # The hub's table of results; none for a model without figures.
    data = str(card.figures.get("evaluation", {}).get("data", ""))
    metrics = [
        {"type": name.rpartition(".")[2], "name": name, "value": value}
        for name, value in numbers(card.figures)
    ]
    result = {
        "task": {"type": PIPELINE, "name": "Motion generation"},
        "dataset": {
            "type": data.partition(" ")[0] or "motion-capture",
            "name": data or "the validation split of its training data",
        },
        "metrics": metrics,
    }
    head = {
        **license_fields([provenance.license]),
        "library_name": "latentmotion",
        "pipeline_tag": PIPELINE if text else None,
        "language": ["en"] if text else None,
        "tags": ["latentmotion", "text-to-motion" if text else "motion-generation", "motion"],
        "datasets": [line.partition(":")[0] for line in provenance.data],
        "model-index": ([{"name": card.name, "results": [result]}] if metrics else []),
    }
    shortest, longest = card.frames
    prompt = '"a person walks"' if text else '"LABEL"' if card.task == "action" else "None"
    rows = [f"| {name} | {value:g} |" for name, value in numbers(card.figures)]
    hashes = (f"SHA-256 of {name}: {value}" for name, value in provenance.data_hashes.items())
    training = [
        *(f"* Data: {line}" for line in provenance.data),
        *(f"* {line}" for line in hashes),
        f"* {provenance.hours:g} hours on {provenance.machine or 'an unknown machine'}",
        *(["", "```bash", *provenance.commands, "```"] if provenance.commands else []),
    ]
    figures = ["| figure | value |", "|---|---|", *rows] if rows else ["None were measured."]
    page = Path(__file__).with_name("hub_page.md").read_text(encoding="utf-8")
    return page.format(
        head=front_matter(head),
        card=card,
        inputs=_INPUTS[card.task],
        shortest=shortest,
        longest=longest,
        prompt=prompt,
        training="\n".join(training),
        figures="\n".join(figures),
        rights=cards.RIGHTS_IN_MOTIONS,
    )


def numbers(figures: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yields the numbers of nested figures with their names, joined by dots."""
    for name, value in figures.items():
        if isinstance(value, Mapping):
            yield from numbers(value, f"{prefix}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{prefix}{name}", value
