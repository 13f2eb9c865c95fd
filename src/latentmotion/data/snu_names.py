"""What the names of Seoul National University's files say happens in them.

The files were looked at: where a name misled (`box` is a carton, `huddle` a hurdle, `duck` the
bird, `pobok` crawling), the sentence says what is seen; where nothing can be told, there is none.
A sentence goes only to pieces that show what it says; see `evidence.py`. The table is
`snu_names.tsv`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
from jaxtyping import Float

from latentmotion.data.evidence import shows

_PACES = {
    **{"VFast": "very fast", "Fast": "fast", "Slow": "slowly", "Normal": ""},
    **{"_fast": "fast", "_slow": "slowly", "_normal": "", "slow": "slowly"},
    **{"very_fast": "very fast", "very_slow": "very slowly", "sssslow": "very slowly"},
}


@dataclass(frozen=True)
class Naming:
    """One kind of file name and its sentences."""

    pattern: re.Pattern[str]
    """What the whole name matches; its groups fill `{side}` and the like."""
    needs: str
    """What a piece must show, as `shows` takes it."""
    sentences: tuple[str, ...]
    """What happens."""


def sentences_for(
    name: str, joints: Float[np.ndarray, "frames 22 3"], floor: float, whole: bool
) -> tuple[str, ...]:
    """Returns sentences for a piece of a file; none where the name or the piece does not say.

    Args:
        name: The file's name without ending, person and session.
        joints: The piece at 20 frames per second, meters.
        floor: Height of the floor.
        whole: Whether the piece is nearly all of its take.
    """
    for naming in namings():
        if match := naming.pattern.fullmatch(name):
            groups = {key: text or "" for key, text in match.groupdict().items()}
            words = {key: _PACES.get(text, text) for key, text in groups.items()}
            if shows(naming.needs.format(**words), joints, floor, whole):
                return tuple(_filled(sentence, words) for sentence in naming.sentences)
    return ()


@cache
def namings() -> tuple[Naming, ...]:
    """Returns the table, in the order in which its rows are tried."""
    file = resources.files("latentmotion.data").joinpath("snu_names.tsv")
    lines = file.read_text(encoding="utf-8").splitlines()
    rows = [line.split("\t") for line in lines if line and line[0] != "#"]
    return tuple(
        Naming(re.compile(pattern), needs, tuple(sentences.split("|")))
        for pattern, needs, sentences in rows
    )


def _filled(sentence: str, words: dict[str, str]) -> str:
    """Fills in words; one that is empty takes its space along."""
    return " ".join(sentence.format(**words).split()).replace(" .", ".").replace(" ,", ",")
