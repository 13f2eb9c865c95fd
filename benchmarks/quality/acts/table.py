"""The table of acts, and the keys and verdicts of a judge, as files."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.instructions.benchmark import wilson
from latentmotion.storage.files import atomic_file

ACTS = Path(__file__).with_name("acts.tsv")  # The table that comes with the repository.

# How many clips of the training split name an act: lowest and highest.
STRATA = {"1 to 5 clips": (1, 5), "6 to 20 clips": (6, 20), "more": (21, 10**9)}

PROMPTS = 5  # Prompts of an act.


@dataclass(frozen=True)
class Act:
    """An act that captions name."""

    name: str  # Verb with object.
    clips: int  # Clips of the training split that a caption says it of.
    seconds: float  # Their length together, of what the captions describe.
    captions: str  # Regular expression that finds those captions, in small letters.
    prompts: tuple[str, ...]  # What users type who want it.

    @property
    def stratum(self) -> str:
        """Returns the name of its stratum."""
        return stratum_of(self.clips)


@dataclass(frozen=True)
class Judged:
    """A numbered motion: what was asked, what the judge named, and the verdict."""

    number: int
    act: str
    clips: int
    prompt: str
    seed: int
    seconds: float
    named: str = ""
    verdict: str = ""


def stratum_of(clips: int) -> str:
    """Returns the stratum of a number of clips."""
    return next(name for name, (low, high) in STRATA.items() if low <= clips <= high)


def read_acts(path: Path = ACTS) -> list[Act]:
    """Returns the acts of a table."""
    return [
        Act(row["act"], int(row["clips"]), float(row["seconds"]), row["captions"], prompts)
        for row in rows_of(path)
        for prompts in [tuple(row[f"prompt {n}"] for n in range(1, PROMPTS + 1))]
    ]


def write_acts(acts: Sequence[Act], path: Path = ACTS) -> None:
    """Writes a table of acts."""
    heads = ("act", "clips", "seconds", "captions", *(f"prompt {n + 1}" for n in range(PROMPTS)))
    lines = ((a.name, a.clips, f"{a.seconds:.0f}", a.captions, *a.prompts) for a in acts)
    _write(path, [heads, *lines])


def counted(acts: Sequence[Act], data: Path) -> list[Act]:
    """Returns the acts with the clips and seconds of a prepared folder or pack.

    Mirrored copies and composed sequences are not counted; a clip is counted once, however many
    sentences say it.
    """
    clips = [clip for clip in Dataset.load(data).clips("train") if clip.source != "composed"]
    found = []
    for act in acts:
        says, named, frames = re.compile(act.captions), 0, 0.0
        for clip in clips:
            spans = [
                (c.start_frame, c.end_frame) for c in clip.captions if says.search(c.text.lower())
            ]
            if spans:
                named += 1
                frames += max(end for _, end in spans) - min(start for start, _ in spans)
        found.append(Act(act.name, named, frames / 20, act.captions, act.prompts))
    return found


def read_judged(path: Path) -> list[Judged]:
    """Returns the lines of a key or of verdicts."""
    return [
        Judged(
            int(row["number"]),
            row["act"],
            int(row["clips"]),
            row["prompt"],
            int(row["seed"]),
            float(row["seconds"]),
            row["named"],
            row["verdict"],
        )
        for row in rows_of(path)
    ]


def write_judged(judged: Sequence[Judged], path: Path) -> None:
    """Writes a key, or verdicts."""
    _write(path, [tuple(field.name for field in fields(Judged)), *map(astuple, judged)])


def rows_of(path: Path) -> list[dict[str, str]]:
    """Returns the lines of a table by the names of its columns; cells are not quoted."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))


def report(judged: Sequence[Judged]) -> str:
    """Returns the table of verdicts by stratum, as Markdown.

    Raises:
        ValueError: A verdict is not good, half or bad.
    """
    wrong = [each for each in judged if each.verdict not in ("good", "half", "bad")]
    if wrong:
        raise ValueError(
            f"number {wrong[0].number}: verdict {wrong[0].verdict!r}; expected good, half or bad"
        )
    lines = [
        "| acts with | acts | motions | good | half | bad | good, share | 95 % |",
        "|---" * 8 + "|",
    ]
    for name in (*STRATA, "all"):
        chosen = [each for each in judged if name in ("all", stratum_of(each.clips))]
        if not chosen:
            continue
        by_act: dict[str, list[bool]] = {}
        for each in chosen:
            by_act.setdefault(each.act, []).append(each.verdict == "good")
        # Motions of one act are no independent trials.
        share = float(np.mean([np.mean(hits) for hits in by_act.values()]))
        low, high = wilson(share, len(by_act))
        counts = [sum(each.verdict == v for each in chosen) for v in ("good", "half", "bad")]
        cells = [
            name,
            len(by_act),
            len(chosen),
            *counts,
            f"{share:.0%}",
            f"{low:.0%} to {high:.0%}",
        ]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def _write(path: Path, lines: Sequence[Sequence[object]]) -> None:
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.writelines("\t".join(map(str, line)) + "\n" for line in lines)
