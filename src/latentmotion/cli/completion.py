"""`latentmotion completion`: what a shell needs to complete commands, options and choices."""

from __future__ import annotations

from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, make_dataclass
from functools import reduce
from importlib import import_module
from io import StringIO
from operator import or_
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import Positional, arg, subcommand

from latentmotion.errors import MissingExtraError


@dataclass(frozen=True)
class Completion:
    """Print the script by which a shell completes commands, options and choices.

    Example: latentmotion completion bash > ~/.local/share/bash-completion/completions/latentmotion
    """

    shell: Annotated[Positional[Literal["bash", "fish", "zsh"]], arg(metavar="SHELL")]
    """The shell."""

    def run(self) -> None:
        """Prints the script."""
        # Not imported above, since the table of commands has this one, too.
        from latentmotion.cli.main import VERBS

        tree: dict[str, Any] = {}
        for name, verb in VERBS.items():
            *groups, last = name.split()
            if " ".join(groups) in VERBS:  # such as `convert evaluator`: tyro knows no such thing
                continue
            branch = reduce(lambda inside, group: inside.setdefault(group, {}), groups, tree)
            branch[last] = _command(last, verb.target)
        printed = StringIO()
        with redirect_stdout(printed), suppress(SystemExit):
            tyro.cli(
                _union(tree), prog="latentmotion", args=["--tyro-print-completion", self.shell]
            )
        # Tyro's script prints a line for each word that fits; help of several lines became words.
        one_line = 'print(completion.replace("\\n", " "))'
        print(printed.getvalue().replace("print(completion)", one_line), end="")


def _command(name: str, target: str) -> Any:
    """Imports a command; one whose extra is not installed is completed by its name alone."""
    module, _, cls = target.partition(":")
    try:
        return getattr(import_module(f"latentmotion.cli.{module}"), cls)
    except (ModuleNotFoundError, MissingExtraError):
        return make_dataclass(name.title(), [])


def _union(tree: dict[str, Any]) -> Any:
    members = (
        Annotated[_union(branch) if isinstance(branch, dict) else branch, subcommand(name)]
        for name, branch in tree.items()
    )
    return reduce(or_, members)
