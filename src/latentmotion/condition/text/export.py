"""A trained student becomes the files of a model's folder: ONNX graph, weights, tokenizer."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from tokenizers import Tokenizer
from torch import nn

from latentmotion.condition.text.encoder_files import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.network import NetworkShape, StudentNetwork
from latentmotion.condition.text.packing import packed
from latentmotion.storage.files import atomic_file
from latentmotion.tracing import trace

WEIGHTS_FILE = "text_encoder.safetensors"


def export_student(
    network: StudentNetwork, tokenizer: Tokenizer, known_words: Iterable[str], folder: Path
) -> nn.Module:
    """Writes `text_encoder.onnx`, `text_encoder.safetensors` and `tokenizer.json`.

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
    with atomic_file(folder / TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)
    write_graph(small, card, folder / GRAPH_FILE)
    return small


def load_student(path: Path) -> nn.Module:
    """Returns the network of a `text_encoder.safetensors`, for PyTorch."""
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        shape = {key: int(value) for key, value in file.metadata().items()}
    network = packed(StudentNetwork(NetworkShape(**shape)))
    network.load_state_dict(load_file(path))
    return network


def write_graph(network: nn.Module, card: dict[str, str], path: Path) -> None:
    """Writes a network's graph, tokens and mask → pooled and words, with what its card says."""
    tokens, mask = torch.zeros(2, 7, dtype=torch.long), torch.ones(2, 7, dtype=torch.bool)
    free = {"tokens": (0, 1), "mask": (0, 1)}
    trace(network, {"tokens": tokens, "mask": mask}, free, path, ("pooled", "words"), card)
