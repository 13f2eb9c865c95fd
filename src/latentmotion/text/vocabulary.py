"""Vocabularies: WordPiece tokenizers reduced to what motion captions and everyday English need.

Pieces keep their teacher's spelling, so that a sentence of kept pieces is split in the same places
as its teacher splits it, and the states of both can be compared word by word.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Int
from tokenizers import Tokenizer

SPECIAL = ("[PAD]", "[UNK]", "[CLS]", "[SEP]")
CONTINUATION = "##"


def frequent_words(tokenizer: Tokenizer, count: int) -> list[str]:
    """Returns the first `count` whole English words of a BERT vocabulary, most frequent first."""
    pieces = sorted(tokenizer.get_vocab().items(), key=lambda item: item[1])
    words = (piece for piece, _ in pieces if piece.isascii() and piece.isalpha() and len(piece) > 1)
    return [word for _, word in zip(range(count), words, strict=False)]


def pieces_to_keep(
    tokenizer: Tokenizer, sentences: Iterable[str], words: int, continuations: int
) -> list[str]:
    """Chooses the pieces of a smaller vocabulary, in the order of the large one.

    Args:
        tokenizer: The teacher's WordPiece tokenizer.
        sentences: Text whose every piece is kept.
        words: Number of most frequent whole words kept beside them.
        continuations: Number of most frequent `##` pieces kept beside them.
    """
    order = tokenizer.get_vocab()
    pieces = {piece for sentence in sentences for piece in tokenizer.encode(sentence).tokens}
    pieces |= {piece for piece in order if len(piece.removeprefix(CONTINUATION)) == 1}
    pieces |= set(frequent_words(tokenizer, words))
    tails = (piece for piece in order if piece.startswith(CONTINUATION) and piece.isascii())
    pieces |= set(sorted(tails, key=order.__getitem__)[:continuations])
    return sorted(pieces - set(SPECIAL), key=order.__getitem__)


def restrict(tokenizer: Tokenizer, pieces: Sequence[str], max_length: int) -> Tokenizer:
    """Returns the same tokenizer with the special pieces and `pieces` only, nothing padded."""
    vocabulary = {piece: place for place, piece in enumerate((*SPECIAL, *pieces))}
    settings = json.loads(tokenizer.to_str())
    settings["model"]["vocab"] = vocabulary
    settings["added_tokens"] = [
        token | {"id": vocabulary[token["content"]]}
        for token in settings["added_tokens"]
        if token["content"] in SPECIAL
    ]
    for name, token in settings["post_processor"]["special_tokens"].items():
        token["ids"] = [vocabulary[name]]
    settings |= {"padding": None, "truncation": None}
    smaller = Tokenizer.from_str(json.dumps(settings))
    smaller.enable_truncation(max_length)
    return smaller


def places_in(large: Tokenizer, small: Tokenizer) -> Int[np.ndarray, " pieces"]:
    """Returns the id in the large vocabulary of every piece of the small one, in its order."""
    order = large.get_vocab()
    pieces = sorted(small.get_vocab().items(), key=lambda item: item[1])
    return np.array([order[piece] for piece, _ in pieces])
