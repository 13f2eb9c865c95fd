"""The instructions of the benchmark, with checks that no training knows (`checks.csv`)."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path

from latentmotion.data import instructions as held_out
from latentmotion.data.instructions import Instruction, parse
from latentmotion.storage.files import atomic_file

VERSION = 2
"""Version of prompts and checks; figures of different versions do not compare."""


def packaged_text(name: str) -> str:
    """Returns a text file of this package."""
    return files("latentmotion.evaluation.instructions").joinpath(name).read_text(encoding="utf-8")


@cache
def instructions() -> tuple[Instruction, ...]:
    """Returns the list."""
    rows = csv.DictReader(packaged_text("checks.csv").splitlines())
    checks = {row["id"]: parse(row["check"]) for row in rows}
    listed = held_out.instructions()
    return tuple(replace(instruction, check=checks[instruction.id]) for instruction in listed)


def write_prompts(path: str | Path, takes: int) -> None:
    """Writes the list as CSV, with a column of seeds.

    Raises:
        InputError: The file cannot be written.
    """
    columns = ("id", "group", "prompt", "check", "seconds", "seeds")
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in instructions():
            length = "" if row.seconds is None else f"{row.seconds:g}"
            seeds = " ".join(map(str, row.seeds(takes)))
            writer.writerow(
                [
                    row.id,
                    row.group,
                    row.prompt,
                    str(row.check),
                    length,
                    seeds,
                ]
            )
