"""The list of instructions, which is fixed: a test set that nothing is trained on."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from zlib import crc32

import numpy as np

from latentmotion.data.captions import mirror_words
from latentmotion.describe.prompting import plain
from latentmotion.evaluation.instructions.expressions import Check, parse
from latentmotion.storage.files import atomic_file

VERSION = 1
"""Version of the list; figures of different versions do not compare."""

GROUPS = ("side", "turns", "counts", "order", "pace", "posture", "direction", "action")
"""Groups of instructions in the order of reports."""

_LIST = "prompts.csv"


@dataclass(frozen=True)
class Instruction:
    """A sentence and what a motion must do to fulfill it."""

    id: str
    """Unique name, e.g. `side-01`."""
    group: str
    """Its group."""
    prompt: str
    """The sentence, as a user would type it."""
    check: Check
    """What is demanded."""
    seconds: float | None = None
    """Length of the motion; by default the model's own choice."""

    def seeds(self, takes: int) -> list[int]:
        """Returns one seed per take: no two of the list are the same."""
        sequences = (np.random.SeedSequence([crc32(self.id.encode()), n]) for n in range(takes))
        return [int(sequence.generate_state(1)[0]) for sequence in sequences]


@cache
def refused_captions() -> frozenset[str]:
    """Returns the list's sentences and their mirror images, plain: what no training caption is."""
    sentences = [instruction.prompt for instruction in instructions()]
    return frozenset(plain(text) for each in sentences for text in (each, mirror_words(each)))


@cache
def instructions() -> tuple[Instruction, ...]:
    """Returns the list."""
    return tuple(
        Instruction(
            id=row["id"],
            group=row["group"],
            prompt=row["prompt"],
            check=parse(row["check"]),
            seconds=float(row["seconds"]) if row["seconds"] else None,
        )
        for row in csv.DictReader(_text().splitlines())
    )


def write_prompts(path: str | Path, takes: int) -> None:
    """Writes the list as CSV: the packaged one, with a column of seeds.

    Raises:
        InputError: The file cannot be written.
    """
    columns = ("id", "group", "prompt", "check", "seconds", "seeds")
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for one in instructions():
            length = "" if one.seconds is None else f"{one.seconds:g}"
            seeds = " ".join(map(str, one.seeds(takes)))
            writer.writerow([one.id, one.group, one.prompt, str(one.check), length, seeds])


def _text() -> str:
    return files("latentmotion.evaluation.instructions").joinpath(_LIST).read_text(encoding="utf-8")
