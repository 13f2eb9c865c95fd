"""The sentences a text encoder is distilled on, and the agreement of student and teacher.

A caption line is `caption#word/POS word/POS …#from#to` (HumanML3D's text files). One sentence in
twenty is held out by the hash of its text, with left and right made equal, so that neither a
caption's mirrored twin nor a variation that equals it is trained on. On the held-out ones:

* `cosine`: mean cosine between both embeddings of a sentence.
* `nearest`: in groups of 33, which of the 32 others is nearest, by the student's embeddings alone
  and by the teacher's alone; the share of equal answers.
* `own_first`: among the teacher's embeddings of a group, the share of sentences whose own is the
  nearest to the student's.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError

HELD_OUT_PERCENT = 5


@dataclass(frozen=True)
class TaggedCaption:
    """A caption and what HumanML3D's tagger said of it."""

    text: str
    """The sentence, lower case, without blanks at its ends."""

    tags: tuple[tuple[str, str], ...]
    """(lemma, part of speech) of each word, such as ("walk", "VERB")."""


def read_captions(path: str | Path) -> list[TaggedCaption]:
    """Reads captions, each text once, in the order of the file.

    Args:
        path: `texts.json.xz` or `.json` (clip id → lines) or a folder of HumanML3D's `.txt` files.

    Raises:
        DataError: There is no caption at this place.
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
    """Whether a sentence belongs to the held-out 5 %, decided by its text alone."""
    side_blind = re.sub(r"\b(left|right)", "side", " ".join(sentence.lower().split()))
    digest = hashlib.sha256(side_blind.encode()).digest()
    return int.from_bytes(digest[:4], "big") % 100 < HELD_OUT_PERCENT


def _caption_files(path: Path) -> Iterable[str]:
    if path.is_dir():
        return (file.read_text(encoding="utf-8") for file in sorted(path.rglob("*.txt")))
    if not path.is_file():
        raise DataError(f"{path} does not exist; expected HumanML3D's texts folder or JSON file")
    opener = lzma.open if path.suffix == ".xz" else open
    with opener(path, "rt", encoding="utf-8") as file:
        entries = json.load(file)
    return (text if isinstance(text, str) else "\n".join(text) for text in entries.values())


GROUP = 33


@dataclass(frozen=True)
class Figures:
    """Figures of one student, as its card tells them."""

    sentences: int
    """Number of held-out sentences."""

    cosine: float
    """Mean cosine to the teacher."""

    cosine_5_percent: float
    """The cosine that one sentence in twenty stays below."""

    nearest: float
    """Share of sentences with the same nearest among 32 others, by student and by teacher."""

    own_first: float
    """Share of sentences whose own teacher embedding is the nearest among 33."""


def compare(
    student: Float[np.ndarray, "sentences width"], teacher: Float[np.ndarray, "sentences width"]
) -> Figures:
    """Returns the figures of embeddings of unit length, in an order without meaning."""
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
    """Returns the median processor time of encoding one sentence.

    Processor time leaves out what other programs do on the same cores.
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
