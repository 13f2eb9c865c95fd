"""Parsing: words to a command by tyro, whose reports of a mistake become one line; completion.

tyro tells what is wrong as an event. Its module of events is not public, so what it reports
otherwise, in a box of text, is told in its own words.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, redirect_stderr, redirect_stdout, suppress
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from difflib import get_close_matches
from functools import reduce
from importlib import import_module
from inspect import getdoc
from operator import or_
from typing import Annotated, Any, Literal, TypeVar, get_type_hints

import tyro
from tyro.conf import Positional, UseAppendAction, arg, subcommand

from latentmotion.cli import VERBS
from latentmotion.errors import InputError, MissingExtraError, hint

events: Any
try:
    from tyro import _errors as events
except ImportError:
    events = None

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
    cls: Any = command
    if hasattr(cls, "training_of"):  # the settings of the typed preset are the defaults
        preset = cls.preset
        for word, behind in zip(words, [*words[1:], ""], strict=True):
            option, equals, value = word.partition("=")
            if option == "--preset":
                preset = value if equals else behind or preset
        settings = cls.training_of(preset)
        kind = get_type_hints(cls, include_extras=True)["training"]
        training = ("training", kind, field(default_factory=lambda: settings))
        cls = make_dataclass(cls.__name__, [training], bases=(cls,), frozen=True)
    # Only where it is seen: another class for each command would cost every start.
    if {"-h", "--help"} & set(words):
        cls = _with_optional_fields(cls)

    def refuse(event: Any) -> None:
        if problem := _explanation(event, cls):
            raise InputError(problem + ("" if problem.endswith("?") else advice))

    advice, box = f"; see latentmotion {name} --help", io.StringIO()
    try:
        hook = events.on_parse_error(refuse) if events else nullcontext()
        with hook, redirect_stderr(box):
            command_values = tyro.cli(
                cls,
                prog=f"latentmotion {name}",
                description=getdoc(command),  # tyro leaves out the examples
                config=(tyro.conf.DisallowNone,),  # an option that is left out is None
                args=words,
            )
    except SystemExit as end:
        if not end.code:
            raise
        # What tyro explains in a box, without its frame.
        rows = (row.strip(" │-─╭╮╰╯") for row in box.getvalue().splitlines())
        raise InputError(" ".join(filter(None, rows)) + advice) from None
    _check_lists(command_values, words)
    return command_values


def _with_optional_fields(command: Any) -> Any:
    """Returns the command with help that names no default where that is None or nothing at all."""
    kinds, changed = get_type_hints(command, include_extras=True), []
    for option in fields(command):
        kind, default = kinds[option.name], option.default
        if is_dataclass(default) and not isinstance(default, type):  # a group of options
            default = _with_optional_fields(type(default))()
            kind = Annotated[(type(default), *_markers(kind))]
        elif default in (None, ()) and UseAppendAction not in _markers(kind):
            kind = Annotated[kind, arg(help_behavior_hint="(optional)")]
        elif default is MISSING is option.default_factory and Positional in _markers(kind):
            kind = Annotated[kind, arg(help_behavior_hint="(required)")]
        else:
            continue
        changed.append((option.name, kind, field(default=default, kw_only=option.kw_only)))
    text = {"__doc__": command.__doc__}
    return make_dataclass(command.__name__, changed, bases=(command,), namespace=text, frozen=True)


def _check_lists(command: object, words: Sequence[str]) -> None:
    """Refuses `-o` with nothing behind it or given twice: tyro takes no value, or the last ones."""
    hints = get_type_hints(type(command), include_extras=True)
    for name, value in vars(command).items():
        if is_dataclass(value) and tyro.conf.OmitArgPrefixes in _markers(hints[name]):
            _check_lists(value, words)  # a group of options
        if not isinstance(value, tuple):
            continue
        # A short name, where there is one, is the first letter.
        count = sum(word.partition("=")[0] in (f"--{name}", f"-{name[0]}") for word in words)
        if count and not value:
            raise InputError(f"--{name} needs a value")
        if count > 1 and UseAppendAction not in _markers(hints[name]):
            raise InputError(f"--{name} is given {count} times; name all its values behind one")


def _markers(kind: Any) -> tuple[Any, ...]:
    return getattr(kind, "__metadata__", ())


def _explanation(event: Any, command: type) -> str | None:
    """Returns what is wrong, in one line; None where tyro's own message is best."""
    match event:
        case events.UnrecognizedArgs(tokens=[word, *_]):
            return _unknown(word, command)
        case events.MissingArgs(unrecognized_tokens=[word, *_]):
            return _unknown(word, command)
        case events.MissingArgs(missing_arguments=missing):
            names = [_name(each.arg) for each in missing]
            return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} missing"
        case events.BadValue(reason="too_few_values"):
            return f"{_name(event.argument)} needs a value"
        case events.InvalidChoice(value=value):
            return f"{_name(event.argument)} {value!r}: {hint(value, sorted(event.choices))}"
        case events.InstantiationFailure(argument=argument, message=message) if argument:
            for start, expected in _NUMBERS.items():
                _, separator, rest = message.partition(start)
                if separator:
                    value = rest.partition(": ")[2].splitlines()[0]
                    return f"{_name(argument)} {value}: expected {expected}"
            return f"{_name(argument)}: {' '.join(message.split()).rstrip('.')}"
    return None


# Python's messages about numbers, and what was expected.
_NUMBERS = {
    "invalid literal for int()": "a whole number",
    "could not convert string to float": "a number",
}


def _unknown(word: str, command: type) -> str:
    if not word.startswith("-"):
        return f"{word!r} belongs to no option"
    option = word.partition("=")[0]
    near = get_close_matches(option, _options(command), n=1)
    if option in near:  # the name of an argument
        return f"unknown option {option!r}; leave it out, its value stands by itself"
    return f"unknown option {option!r}" + "".join(f"; did you mean {name!r}?" for name in near)


def _options(command: type) -> Iterator[str]:
    """Yields options and arguments of a command, those of its nested settings too."""
    for name, kind in get_type_hints(command).items():
        if is_dataclass(kind) and isinstance(kind, type):
            yield from _options(kind)
        else:
            yield f"--{name.replace('_', '-')}"
            if kind is bool:
                yield f"--no-{name.replace('_', '-')}"


def _name(argument: Any) -> str:
    """Returns the long name of an option, or what help pages call an argument."""
    if argument.is_positional():
        return str(argument.lowered.metavar).strip("[]").split()[0]
    return argument.lowered.name_or_flags[-1]


@dataclass(frozen=True)
class Completion:
    """Print the script by which a shell completes commands, options and choices.

    Example: latentmotion completion bash > ~/.local/share/bash-completion/completions/latentmotion
    """

    shell: Annotated[Positional[Literal["bash", "fish", "zsh"]], arg(metavar="SHELL")]
    """The shell."""

    def run(self) -> None:
        """Prints the script."""
        tree: dict[str, Any] = {}
        for name, verb in VERBS.items():
            *groups, last = name.split()
            if " ".join(groups) in VERBS:  # such as `convert evaluator`: tyro knows no such thing
                continue
            branch = reduce(lambda inside, group: inside.setdefault(group, {}), groups, tree)
            module, _, cls = verb.target.partition(":")
            try:
                branch[last] = getattr(import_module(f"latentmotion.cli.{module}"), cls)
            except (ModuleNotFoundError, MissingExtraError):  # completed by its name alone
                branch[last] = make_dataclass(last.title(), [])
        printed = io.StringIO()
        with redirect_stdout(printed), suppress(SystemExit):
            tyro.cli(
                _union(tree), prog="latentmotion", args=["--tyro-print-completion", self.shell]
            )
        # Tyro's script prints a line for each word that fits; help of several lines became words.
        one_line = 'print(completion.replace("\\n", " "))'
        print(printed.getvalue().replace("print(completion)", one_line), end="")


def _union(tree: dict[str, Any]) -> Any:
    members = (
        Annotated[_union(branch) if isinstance(branch, dict) else branch, subcommand(name)]
        for name, branch in tree.items()
    )
    return reduce(or_, members)
