"""A text encoder as an ONNX graph and a tokenizer: ONNX Runtime alone, no PyTorch.

Sentences go through the graph one at a time: padding would only cost time, and so an embedding
does not depend on the company its sentence is in, not even in the last bit. Where an encoder wants
padding, as CLIP's 77 places, its tokenizer's file says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from tokenizers import Tokenizer

from latentmotion.condition.interface import TextEmbedding, stack
from latentmotion.condition.text.encoder_files import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.engines import onnxruntime_session
from latentmotion.errors import InputError, ModelError


@dataclass(frozen=True)
class GraphTextEncoder:
    """An exported encoder, ready to use. Immutable, so that one serves many threads."""

    name: str
    """What distinguishes its embeddings from any other's."""
    width: int
    """Numbers per vector."""
    session: Any
    """ONNX Runtime's session: tokens, mask → pooled, words."""
    tokenizer: Tokenizer
    """Sentences to tokens, cut and padded as its file says."""

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings and the states of the word pieces.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        found = {sentence: self._encode(sentence) for sentence in dict.fromkeys(sentences)}
        return stack([found[sentence] for sentence in sentences])

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that it can only guess: none are known to be."""
        return []

    def _encode(self, sentence: str) -> TextEmbedding:
        tokens = np.array([self.tokenizer.encode(sentence).ids], np.int64)
        mask = np.ones(tokens.shape, dtype=bool)
        pooled, words = self.session.run(None, {"tokens": tokens, "mask": mask})
        return TextEmbedding(pooled, words, mask)


Encoder = TypeVar("Encoder", bound=GraphTextEncoder)


def open_encoder(
    folder: Path, threads: int, build: Callable[[Any, Tokenizer, Mapping[str, str]], Encoder]
) -> Encoder:
    """Opens the files of an encoder; `build` makes it of session, tokenizer and the graph's card.

    Raises:
        ModelError: A file is missing or damaged.
    """
    graph, tokenizer = folder / GRAPH_FILE, folder / TOKENIZER_FILE
    for path in (graph, tokenizer):
        if not path.is_file():
            raise ModelError(
                f"{path} is missing; a text encoder needs {GRAPH_FILE} and {TOKENIZER_FILE}: "
                "copy the model's folder again or run latentmotion train text-encoder"
            )
    try:
        session = onnxruntime_session(graph, threads)
        card = session.get_modelmeta().custom_metadata_map
        return build(session, Tokenizer.from_file(str(tokenizer)), card)
    except Exception as error:  # onnxruntime and tokenizers have error classes of their own
        raise ModelError(f"{folder}: the text encoder cannot be loaded: {error}") from error


def width_of(session: Any) -> int:
    """Returns the width of an encoder's pooled embeddings."""
    return int(session.get_outputs()[0].shape[-1])
