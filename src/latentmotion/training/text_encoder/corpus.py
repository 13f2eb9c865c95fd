"""Captions of HumanML3D, which of them are held out, and how student and teacher are compared.

A line of HumanML3D's text files is `caption#word/POS word/POS …#from#to`, with times in seconds.
One sentence in twenty is held out, by the hash of its text in which left and right are made equal:
a caption and its mirrored copy, or an equal variation, are never on different sides.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError
from latentmotion.storage.reading import parse_json, read_json_file, read_text, unpack_xz

HELD_OUT_PERCENT = 5
"""Share of sentences that are held out, in percent."""

GROUP = 33
"""Sentences among which the nearest one is looked for."""


@dataclass(frozen=True)
class TaggedCaption:
    """A caption with HumanML3D's part-of-speech tags."""

    text: str
    """The sentence in lower case, words separated by one blank each."""
    tags: tuple[tuple[str, str], ...]
    """(lemma, part of speech) of each word, such as ("walk", "VERB")."""


def read_captions(path: str | Path) -> list[TaggedCaption]:
    """Reads captions, each text once, in the order of the files.

    Args:
        path: `texts.json.xz` or `.json` (clip id → lines) or a folder of HumanML3D's `.txt` files.

    Raises:
        DataError: The path does not exist or holds no caption.
    """
    lines = (line for text in _caption_files(Path(path)) for line in text.splitlines())
    captions = {caption.text: caption for line in lines if (caption := parse_line(line)).text}
    if not captions:
        raise DataError(f"{path} holds no captions; expected HumanML3D's texts folder or JSON file")
    return list(captions.values())


def parse_line(line: str) -> TaggedCaption:
    """Reads one line `caption#word/POS …#from#to`; the tags may be missing."""
    text, _, rest = line.partition("#")
    words = rest.partition("#")[0].split()
    tags = tuple((lemma, tag) for lemma, _, tag in (word.rpartition("/") for word in words))
    return TaggedCaption(" ".join(text.lower().split()), tags)


def is_held_out(sentence: str) -> bool:
    """Returns whether a sentence belongs to the held-out 5 %, decided by its text alone."""
    side_blind = re.sub(r"\b(left|right)", "side", " ".join(sentence.lower().split()))
    digest = hashlib.sha256(side_blind.encode()).digest()
    return int.from_bytes(digest[:4], "big") % 100 < HELD_OUT_PERCENT


def _caption_files(path: Path) -> Iterable[str]:
    if path.is_dir():
        return (read_text(file) for file in sorted(path.rglob("*.txt")))
    if not path.is_file():
        raise DataError(f"{path} does not exist; expected HumanML3D's texts folder or JSON file")
    packed = path.suffix == ".xz"
    entries = parse_json(unpack_xz(path), path) if packed else read_json_file(path)
    if not isinstance(entries, dict) or not all(
        isinstance(e, str | list) for e in entries.values()
    ):
        raise DataError(f"{path}: expected captions by id, found something else")
    return (text if isinstance(text, str) else "\n".join(text) for text in entries.values())


@dataclass(frozen=True)
class Figures:
    """Agreement of a student's sentence embeddings with its teacher's."""

    sentences: int
    """Number of held-out sentences."""
    cosine: float
    """Mean cosine of both embeddings of a sentence."""
    cosine_5_percent: float
    """5th percentile of the cosines."""
    nearest: float
    """Share of sentences whose nearest among 32 others is the same for student and teacher."""
    own_first: float
    """Share of sentences whose student embedding is nearest to their own teacher embedding, among
    33 teacher embeddings."""


def compare(
    student: Float[np.ndarray, "sentences width"], teacher: Float[np.ndarray, "sentences width"]
) -> Figures:
    """Compares embeddings of at least 33 sentences.

    Args:
        student: The student's embeddings of unit length, in random order.
        teacher: The teacher's of the same sentences.
    """
    cosines = (student * teacher).sum(1)
    groups = [slice(first, first + GROUP) for first in range(0, len(student) - GROUP + 1, GROUP)]
    same = [_nearest_other(student[part]) == _nearest_other(teacher[part]) for part in groups]
    own = [(student[part] @ teacher[part].T).argmax(1) == np.arange(GROUP) for part in groups]
    return Figures(
        sentences=len(student),
        cosine=float(cosines.mean()),
        cosine_5_percent=float(np.percentile(cosines, 5)),
        nearest=float(np.mean(same)),
        own_first=float(np.mean(own)),
    )


def milliseconds(encode: Callable[[list[str]], object], sentences: Sequence[str]) -> float:
    """Returns the median time of encoding one sentence, in milliseconds of processor time.

    Unlike wall time it does not grow when other programs use the same cores.
    """
    encode([sentences[0]])
    times = []
    for sentence in sentences:
        started = time.process_time()
        encode([sentence])
        times.append(time.process_time() - started)
    return 1000 * float(np.median(times))


def _nearest_other(embeddings: Float[np.ndarray, "group width"]) -> np.ndarray:
    similarity = embeddings @ embeddings.T
    np.fill_diagonal(similarity, -np.inf)
    return similarity.argmax(1)
