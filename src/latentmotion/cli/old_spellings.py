"""Spellings of the release before: they work, stay out of `--help`, and say what to type instead.

Delete this file, and its two callers' lines, with the release after.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from latentmotion.errors import InputError

VERBS = {"exchange": "swap-decoder"}
"""Old verb → verb."""

_OUT = {"--out": "--output"}
_MAP = {"--joint-map": "--map"}

OPTIONS: dict[str, dict[str, str]] = {
    "data prepare cmu": _OUT,
    "data prepare hdm05": {**_OUT, "--clips": "FOLDER"},
    "data prepare snu": _OUT,
    "data prepare humanml3d": _OUT,
    "data prepare kit": _OUT,
    "data prepare humanact12": {**_OUT, "--poses": "FILE"},
    "data prepare uestc": {**_OUT, "--folder": "FOLDER"},
    "data prepare labelled": {**_OUT, **_MAP, "--folder": "FOLDER"},
    "data prepare own": {**_OUT, **_MAP},
    "data merge": _OUT,
    "data pack": _OUT,
    "data unpack": _OUT,
    "data compose": _OUT,
    "data describe": {**_OUT, **_MAP},
    "finetune": _MAP,
    "fit": {"--names": "--layout"},
    "train decoder": {"--vae": "--model"},
    "train text-encoder": {"--batch": "--batch-size"},
}
"""Verb → old option → the option, or the name of the argument that its value has become."""

COMMA_LISTS = {"experiment run": "--rows"}
"""Verb → option whose values were one word with commas between."""


def current_verb(words: Sequence[str]) -> list[str]:
    """Returns the words with the verb's name of today."""
    if words and (verb := VERBS.get(words[0])):
        _tell(f"latentmotion {words[0]}", f"latentmotion {verb}")
        return [verb, *words[1:]]
    return list(words)


def current_options(verb: str, words: Sequence[str]) -> list[str]:
    """Returns a verb's words with the options of today.

    Raises:
        InputError: An option is given in both spellings, or an old one without its value.
    """
    renamed = OPTIONS.get(verb, {})
    written = {_name(word) for word in words}
    arguments: list[str] = []
    options: list[str] = []
    rest = iter(words)
    for word in rest:
        old = _name(word)
        new = renamed.get(old)
        if new is None:
            options.append(word)
            continue
        if new in written or (new == "--output" and "-o" in written):
            raise InputError(f"{old} is the old spelling of {new}; give {new} alone")
        _tell(old, new if new.startswith("--") else f"{new} without {old}")
        value = word.partition("=")[2] if "=" in word else next(rest, None)
        if value is None:
            raise InputError(f"{old} needs a value; see latentmotion {verb} --help")
        if new.startswith("--"):
            options.append(f"{new}={value}")
        else:
            arguments.append(value)
    return [*arguments, *_without_commas(options, COMMA_LISTS.get(verb))]


def _without_commas(words: Sequence[str], option: str | None) -> list[str]:
    """Splits `--rows a,b` and `--rows=a,b` into `--rows a b`."""
    found: list[str] = []
    for word in words:
        behind = bool(found) and found[-1] == option
        listed = word if behind else word.partition("=")[2] if _name(word) == option else ""
        if option is None or "," not in listed:
            found.append(word)
            continue
        values = [value.strip() for value in listed.split(",") if value.strip()]
        _tell(f"{option} {listed}", f"{option} {' '.join(values)}")
        found += values if behind else [option, *values]
    return found


def _name(word: str) -> str:
    """Returns an option's name as it is listed here; tyro reads `_` as `-`."""
    name = word.partition("=")[0]
    return name.replace("_", "-") if name.startswith("--") else name


def _tell(old: str, new: str) -> None:
    print(f"warning: {old} is deprecated; type {new}", file=sys.stderr)
