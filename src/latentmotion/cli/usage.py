"""Parsing: words to a command by tyro; mistakes in one line; spellings of the release before.

Delete this file, and its two callers' lines, with the release after.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import field, make_dataclass
from difflib import get_close_matches
from inspect import getdoc
from typing import Any, TypeVar, get_type_hints

import tyro

from latentmotion.errors import InputError, hint

VERBS = {"exchange": "swap-decoder"}
"""Old verb → verb."""

_OUT = {"--out": "--output"}

OPTIONS: dict[str, dict[str, str]] = {
    "data prepare cmu": _OUT,
    "data prepare hdm05": {**_OUT, "--clips": "FOLDER"},
    "data prepare snu": _OUT,
    "data prepare humanml3d": _OUT,
    "data prepare kit": _OUT,
    "data prepare humanact12": {**_OUT, "--poses": "FILE"},
    "data prepare uestc": {**_OUT, "--folder": "FOLDER"},
    "data prepare labelled": {**_OUT, "--folder": "FOLDER"},
    "data prepare own": _OUT,
    "data merge": _OUT,
    "data pack": _OUT,
    "data unpack": _OUT,
    "data compose": _OUT,
    "data describe": _OUT,
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


Command = TypeVar("Command")


def parsed(command: type[Command], name: str, words: Sequence[str]) -> Command:
    """Returns a command filled from words; `--help` is printed and ends the program.

    Args:
        command: A dataclass whose fields are the options. One with presets has `training_of`, which
            returns a preset's training settings, the defaults of the field `training`.
        name: The words that name the verb.
        words: The words after them.

    Raises:
        InputError: An option is unknown or missing, or its value is.
    """
    words = current_options(name, words)
    box = io.StringIO()
    try:
        with redirect_stderr(box):
            found = tyro.cli(
                _with_presets_training(command, words),
                prog=f"latentmotion {name}",
                description=getdoc(command),  # tyro leaves out the examples
                args=words,
            )
    except SystemExit as end:
        if not end.code:
            raise
        told = in_one_line(box.getvalue())
        advice = "" if told.endswith("?") else f"; see latentmotion {name} --help"
        raise InputError(told + advice) from None
    _check_lists(found, words)
    return found


def _with_presets_training(command: Any, words: Sequence[str]) -> Any:
    """Returns the command with the training settings of the typed preset as defaults."""
    if not hasattr(command, "training_of"):
        return command
    name = command.preset
    for word, behind in zip(words, [*words[1:], ""], strict=True):
        option, equals, value = word.partition("=")
        if option == "--preset":
            name = value if equals else behind or name
    settings = command.training_of(name)
    kind = get_type_hints(command, include_extras=True)["training"]
    training = ("training", kind, field(default_factory=lambda: settings))
    return make_dataclass(command.__name__, [training], bases=(command,), frozen=True)


def in_one_line(box: str) -> str:
    """Returns the message in a box of tyro's in one line; unknown messages in tyro's own words."""
    rows = [row.strip(" │") for row in box.splitlines()[1:]]
    text = " ".join(" ".join(row for row in rows if row.strip("-─╰╯ ")).split())
    for pattern, phrase in _PHRASES.items():
        if match := re.search(pattern, text):
            return phrase(match)
    return text.partition(" For full helptext")[0].rstrip(".")


def _check_lists(command: object, words: Sequence[str]) -> None:
    """Refuses `-o` with nothing behind it or given twice: tyro takes no value, or the last ones."""
    hints = get_type_hints(type(command), include_extras=True)
    for name, value in vars(command).items():
        if not isinstance(value, tuple):
            continue
        # A short name, where there is one, is the first letter.
        given = sum(word.partition("=")[0] in (f"--{name}", f"-{name[0]}") for word in words)
        if given and not value:
            raise InputError(f"--{name} needs a value")
        if given > 1 and tyro.conf.UseAppendAction not in getattr(hints[name], "__metadata__", ()):
            raise InputError(f"--{name} is given {given} times; name all its values behind one")


def missing_options(listed: str) -> str:
    """Says which options are missing, from tyro's list of them."""
    options = [re.match(r" ?(?:-\w .*?, )?(\S+)", text) for text in listed.split("(required)")]
    names = [option[1] for option in options if option]
    return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} missing"


def _unknown(match: re.Match[str]) -> str:
    word, told = match[1], match.string
    known = [name for name in re.findall(r"--[\w-]+", told) if name not in (word, "--help")]
    near = get_close_matches(word, known, n=1)
    return f"unknown option {word!r}" + "".join(f"; did you mean {name!r}?" for name in near)


def _not_a_choice(match: re.Match[str]) -> str:
    choices = sorted(set(re.findall(r"'([^']*)'", match[3])) - {"None"})
    return f"{match[2]} {match[1]!r}: {hint(match[1], choices)}"


_PHRASES: dict[str, Callable[[re.Match[str]], str]] = {
    r"Unrecognized options: (-[^\s,=]+)": _unknown,
    r"Unrecognized options: (\S+)": lambda it: f"{it[1]!r} belongs to no option",
    r"Missing value for argument '(.*?)'": lambda it: f"{it[1]} needs a value",
    r"invalid choice '(.*?)' for argument '(.*?)'. Expected one of \((.*?)\)": _not_a_choice,
    r"Error parsing (\S+):.* int\(\) with base 10: '(.*?)'": (
        lambda it: f"{it[1]} {it[2]!r}: expected a whole number"
    ),
    r"Error parsing (\S+):.* string to float: '(.*?)'": (
        lambda it: f"{it[1]} {it[2]!r}: expected a number"
    ),
    r"Error parsing (\S+): (.*?)\.? Argument helptext": lambda it: f"{it[1]}: {it[2]}",
    r"Missing from [^:]*:(.*\(required\))": lambda it: missing_options(it[1]),
}
"""Patterns of tyro's messages, and the messages that users get."""
