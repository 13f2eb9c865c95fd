"""A pretrained encoder becomes the files of a model's folder, to be run without PyTorch.

What the tokenizer of `transformers` is told at every call, where to cut and how far to pad, goes
into `tokenizer.json`; so a sentence alone becomes the tokens that the network was read with.
"""

from __future__ import annotations

from pathlib import Path

from tokenizers import Tokenizer
from torch import Tensor, nn

from latentmotion.condition.text.encoder_files import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.export import write_graph
from latentmotion.condition.text.pretrained import PretrainedTextEncoder, Read
from latentmotion.errors import ModelError
from latentmotion.storage.files import atomic_file


def export_pretrained(encoder: PretrainedTextEncoder, folder: Path) -> None:
    """Writes `text_encoder.onnx` and `tokenizer.json`.

    Raises:
        ModelError: The encoder has no tokenizer that runs without `transformers`.
    """
    tokenizer = _tokenizer(encoder)
    with atomic_file(folder / TOKENIZER_FILE) as temporary:
        tokenizer.save(str(temporary), pretty=False)
    network = _ReadNetwork(encoder.model, encoder.kind.read)
    write_graph(network, {"name": encoder.name}, folder / GRAPH_FILE)


class _ReadNetwork(nn.Module):
    """The network with the way it is read: tokens, mask → pooled, words."""

    def __init__(self, network: nn.Module, read: Read) -> None:
        super().__init__()
        self.network = network
        self.read = read

    def forward(self, tokens: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        reading = self.read(self.network, tokens, mask)
        return reading.pooled, reading.words


def _tokenizer(encoder: PretrainedTextEncoder) -> Tokenizer:
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
    return tokenizer
