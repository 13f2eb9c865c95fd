"""Export of text encoders to the files of a model folder: ONNX graph, tokenizer, weights.

Truncation and padding, which the tokenizer of `transformers` gets at every call, are stored in
`tokenizer.json`, so that a sentence alone becomes the tokens that the network was trained with.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from tokenizers import Tokenizer
from torch import Tensor, nn

from latentmotion.errors import ModelError
from latentmotion.export.onnx import trace
from latentmotion.model.card import TEXT_GRAPH_FILE, TOKENIZER_FILE
from latentmotion.networks.pretrained_text import PretrainedTextEncoder, Read
from latentmotion.networks.text_encoder import NetworkShape, StudentNetwork, packed
from latentmotion.storage.files import atomic_file

WEIGHTS_FILE = "text_encoder.safetensors"


def export_student(
    network: StudentNetwork, tokenizer: Tokenizer, known_words: Iterable[str], folder: Path
) -> nn.Module:
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
    with atomic_file(folder / TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)
    write_graph(small, card, folder / TEXT_GRAPH_FILE)
    return small


def load_student(path: Path) -> nn.Module:
    """Returns the network of a `text_encoder.safetensors`, for PyTorch."""
    with safe_open(path, "pt") as file:
        shape = {key: int(value) for key, value in file.metadata().items()}
    network = packed(StudentNetwork(NetworkShape(**shape)))
    network.load_state_dict(load_file(path))
    return network


def write_graph(network: nn.Module, card: dict[str, str], path: Path) -> None:
    """Writes a network's graph, tokens, mask → pooled, words, with a card as its metadata."""
    tokens, mask = torch.zeros(2, 7, dtype=torch.long), torch.ones(2, 7, dtype=torch.bool)
    trace(network, {"tokens": tokens, "mask": mask}, path, ("pooled", "words"), card)


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
    with atomic_file(folder / TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)
    network = _ReadNetwork(encoder.model, encoder.kind.read)
    write_graph(network, {"name": encoder.name}, folder / TEXT_GRAPH_FILE)


class _ReadNetwork(nn.Module):
    """A pretrained network with the reading of its states: tokens, mask → pooled, words."""

    def __init__(self, network: nn.Module, read: Read) -> None:
        super().__init__()
        self.network = network
        self.read = read

    def forward(self, tokens: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        reading = self.read(self.network, tokens, mask)
        return reading.pooled, reading.words
