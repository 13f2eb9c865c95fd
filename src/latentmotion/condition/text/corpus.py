"""The sentences a text encoder is distilled on: HumanML3D's captions and variations of them.

A caption line is `caption#word/POS word/POS …#from#to` (HumanML3D's text files). One sentence in
twenty is held out by the hash of its text, left and right made equal, so that neither a caption's
mirrored twin nor a variation that equals it is ever trained on.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

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
