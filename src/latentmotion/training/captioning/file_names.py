"""Captions from the names of motion files: `dataset-1_bow_angry_001` → "a person bows angrily".

What all names share says nothing, nor do numbers and words such as `take`. The first verb makes a
sentence; manners and directions follow it, and what stands behind it stays behind it. Names without
a verb stay words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePath

from latentmotion.language.inflection import third_person
from latentmotion.training.captioning.verbs import (
    BASE_OF_PARTICIPLE,
    BASE_OF_THIRD,
    TABLE,
    VERBS,
    word_set,
)

_FILLING, _DIRECTIONS = word_set("filling"), word_set("directions")
_MANNERS: Mapping[str, str] = TABLE["manners"]

_VERBS: Mapping[str, str] = {
    **dict(zip(VERBS, VERBS, strict=True)),
    **BASE_OF_THIRD,
    **BASE_OF_PARTICIPLE,
}
"""Base forms by forms of a verb."""


def captions_of_names(files: Iterable[str]) -> dict[str, str]:
    """Returns a caption for each file, by its path; empty where its name says nothing.

    Args:
        files: Paths of all files of a folder.
    """
    words = {file: _words(PurePath(file).stem) for file in files}
    shared = set.intersection(*map(set, words.values())) if len(words) > 1 else set()
    shared -= _VERBS.keys()  # of turn_left and turn_right, both turn
    if any(not set(row) - shared - _FILLING for row in words.values()):
        shared = set()  # names that differ by their numbers alone
    return {
        file: _sentence([word for word in row if word not in shared | _FILLING])
        for file, row in words.items()
    }


def _words(stem: str) -> list[str]:
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", stem)
    return [word for word in re.split(r"[\W\d_]+", spaced.lower()) if len(word) > 1]


def _sentence(words: list[str]) -> str:
    at = next((number for number, word in enumerate(words) if word in _VERBS), None)
    if at is None:
        return " ".join(words)
    manners = [_MANNERS[word] for word in words if word in _MANNERS]
    behind = [word for word in words[:at] if word in _DIRECTIONS]
    behind += [word for word in words[at + 1 :] if word not in _MANNERS]
    for number, word in enumerate(behind[1:], 1):
        if behind[number - 1] in ("and", "then") and word in _VERBS:
            behind[number] = third_person(_VERBS[word])
    return " ".join(filter(None, ["a person", third_person(_VERBS[words[at]]), *behind, *manners]))
