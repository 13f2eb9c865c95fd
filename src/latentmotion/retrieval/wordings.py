"""Wordings: captions of an index in the words that people type, so that "archery" finds its clip.

    nearest(s) = argmax over captions and their wordings w of cos(P s, P w)

Captions say what a body does ("a person shoots a bow and arrow"), prompts name activities and
purposes ("archery"); a text encoder of sentences puts the two about as far apart as two movements.
A wording is kept by its embedding alone, in 4 bits; in the index that ships along directions P in
which captions differ, but not a caption and its wordings (linear discriminants).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.errors import FileFormatError, InputError
from latentmotion.retrieval.index import EMBEDDING_LEVELS, SHOWN, ClipIndex, quantized
from latentmotion.storage.reading import read_text, unpack_xz

# Directions that are kept of 384. Of 1,195 phrases whose captions no direction was computed from,
# 21 % find the caption among all keys along 64, 20 % along 128, 17 % in the embedding itself.
COMPONENTS = 64

# Share of the mean scatter that is added to that within captions; between 0.03 and 0.3 the figures
# above do not change.
RIDGE = 0.1

# Cosine from which a caption of the index says the same as one that it was thinned from.
SAME = 0.85

# Cosine from which a wording repeats another: three in ten; what the rest finds hardly changes.
REPEATED = 0.76

# Sentences that are embedded together.
_AT_ONCE = 512


def with_wordings(
    index: ClipIndex, wordings: Mapping[str, Sequence[str]], text_encoder: TextEncoder
) -> ClipIndex:
    """Returns an index whose captions are found by further wordings, too.

    Args:
        index: With wordings or without.
        wordings: Of captions of the data; those of captions that were left out go to the nearest
            that says the same, if there is one.
        text_encoder: The encoder of the index.

    Raises:
        InputError: No wording is of a caption of the index.
    """

    def along(sentences: Sequence[str]) -> Float[np.ndarray, "sentences components"]:
        vectors = embedded(sentences, text_encoder)
        return unit(vectors @ index.directions) if index.directions.size else vectors

    captions = index.embeddings[: len(index.captions)].astype(np.float32)
    said = along(list(wordings)) @ unit(captions).T
    nearest, same = said.argmax(axis=1), said.max(axis=1) >= SAME
    rows = [
        (wording, int(caption))
        for texts, caption, alike in zip(wordings.values(), nearest, same, strict=True)
        if alike
        for wording in texts
    ]
    if not rows:
        raise InputError(
            f"none of {len(wordings)} captions with wordings is among those of the data; a line is "
            "CAPTION<tab>WORDS|WORDS"
        )
    codes, _ = quantized(along([text for text, _ in rows]), 1, EMBEDDING_LEVELS)
    numbers = np.array([caption for _, caption in rows], np.int32)
    return replace(
        index,
        wordings=np.concatenate([index.wordings, numbers]),
        embeddings=np.concatenate([index.embeddings, codes]),
    )


def along_discriminants(index: ClipIndex) -> ClipIndex:
    """Returns an index that keeps embeddings along its linear discriminants (Fisher 1936).

    They maximize the scatter between captions over that of a caption's wordings, so two ways to say
    the same are nearer than in the embedding. Without wordings they are the principal components.
    Such an index joins with those of all directions only.
    """
    vectors = unit(index.embeddings.astype(np.float64))
    # Sentences with which somebody showed one clip say the same, as captions of data need not.
    said = [
        -1 - caption.clip if caption.support <= SHOWN else number
        for number, caption in enumerate(index.captions)
    ]
    _, same = np.unique(said, return_inverse=True)
    same = np.concatenate([same, same[index.wordings]])
    counts = np.bincount(same)
    means = np.zeros((len(counts), vectors.shape[1]))
    np.add.at(means, same, vectors)
    means /= counts[:, None]
    off = (vectors - means[same]) / np.sqrt(counts[same])[:, None]
    within, between = off.T @ off, np.cov(means.T, bias=True)
    width = len(within)
    within = within / max(float(np.trace(within)), 1e-9) + RIDGE / width * np.eye(width)
    whitening = np.linalg.inv(np.linalg.cholesky(within))
    _, along = np.linalg.eigh(whitening @ between @ whitening.T)
    return index.along((whitening.T @ along[:, ::-1][:, :COMPONENTS]).astype(np.float32))


def distinct(index: ClipIndex) -> ClipIndex:
    """Returns an index without wordings that nearly repeat their caption or another of its own."""
    vectors = unit(index.embeddings.astype(np.float32))
    captions = len(index.captions)
    rows_of: dict[int, list[int]] = {}
    for row, caption in enumerate(index.wordings.tolist(), captions):
        rows = rows_of.setdefault(caption, [caption])
        if float((vectors[rows] @ vectors[row]).max()) < REPEATED:
            rows.append(row)
    remaining = sorted(row for rows in rows_of.values() for row in rows[1:])
    return replace(
        index,
        wordings=index.wordings[np.array(remaining, np.int64) - captions],
        embeddings=np.concatenate([index.embeddings[:captions], index.embeddings[remaining]]),
    )


def read_wordings(files: Sequence[Path]) -> dict[str, list[str]]:
    """Returns the wordings of captions that files hold, one caption a line: `CAPTION<tab>A|B|C`.

    Args:
        files: Texts, packed by xz where the name ends so; lines that start with # are comments.

    Raises:
        InputError: A file cannot be read, or a line is of another form.
    """
    wordings: dict[str, list[str]] = {}
    for file in files:
        try:
            text = unpack_xz(file).decode() if file.suffix == ".xz" else read_text(file)
        except (FileFormatError, UnicodeDecodeError) as error:
            raise InputError(f"{file} cannot be read as wordings ({error})") from error
        for number, line in enumerate(text.splitlines(), 1):
            if line.startswith("#") or not line.strip():
                continue
            caption, tab, texts = line.partition("\t")
            if not (caption.strip() and tab and texts.strip()):
                raise InputError(
                    f"line {number} of {file} is {line[:60]!r}, expected a caption, a tab, and "
                    "wordings with | between them"
                )
            every = [text.strip() for text in texts.split("|")]
            wordings.setdefault(caption, []).extend(filter(None, every))
    if not any(wordings.values()):
        raise InputError(f"{', '.join(map(str, files))}: no line has wordings of a caption")
    return wordings


def embedded(
    sentences: Sequence[str], text_encoder: TextEncoder
) -> Float[np.ndarray, "sentences width"]:
    """Returns the pooled embeddings of sentences, of unit length."""
    parts = [
        text_encoder(sentences[first : first + _AT_ONCE]).pooled
        for first in range(0, len(sentences), _AT_ONCE)
    ]
    return unit(np.concatenate(parts))
