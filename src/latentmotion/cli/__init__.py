"""The command line, one file per verb."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Verb:
    """One command of the command line."""

    target: str  # `file:class` in this folder: its fields are the options, its `run` does the job.
    purpose: str  # One line for the overview.


# The commands by name, from `commands.toml`. Only the verb that was typed is imported.
VERBS = {
    name: Verb(*row)
    for name, row in tomllib.loads(
        Path(__file__).with_name("commands.toml").read_text(encoding="utf-8")
    ).items()
}
