"""Parsing: words to a command by tyro, whose boxes of text for a mistake become one line."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import field, make_dataclass
from difflib import get_close_matches
from inspect import getdoc
from typing import Any, TypeVar, get_type_hints

import tyro

from latentmotion.cli.old_spellings import current_options
from latentmotion.errors import InputError, hint

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
