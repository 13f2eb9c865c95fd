"""The report of an evaluation: figures with 95 % intervals, and all that decides them.

interval = 1.96 · std / √replications
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.evaluation.cost import Cost
from latentmotion.evaluation.settings import Protocol
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_folder

REPORT_FILE = "report.json"
PAGE_FILE = "report.md"
TRUTH = "ground truth"
"""Row of the real motions."""

UNITS = {
    "MPJPE": "mm ↓",
    "PA-MPJPE": "mm ↓",
    "ACCL": "mm/frame² ↓",
    "FID": "↓",
    "KID": "↓",
    "R@1": "↑",
    "R@2": "↑",
    "R@3": "↑",
    "MM-Dist": "↓",
    "Diversity": "→",
    "MultiModality": "→",
    "Accuracy": "↑",
    "APE root": "m ↓",
    "APE trajectory": "m ↓",
    "APE pose": "m ↓",
    "APE joints": "m ↓",
    "AVE root": "m² ↓",
    "AVE trajectory": "m² ↓",
    "AVE pose": "m² ↓",
    "AVE joints": "m² ↓",
    "Foot sliding": "m/s ↓",
    "Skating": "share ↓",
    "Jitter": "m/s³ →",
    "Penetration": "mm ↓",
    "Nearest clip": "mm",
}
"""Every metric in the order of reports: its unit, and ↓ where less is better, ↑ where more is, →
where near the ground truth is."""


@dataclass(frozen=True)
class Figure:
    """A measured number."""

    mean: float
    """Mean over the replications."""
    interval: float | None = None
    """Half of the 95 % interval of the mean; null for a single replication."""
    values: tuple[float, ...] = ()
    """Each replication's."""

    @classmethod
    def of(cls, values: Sequence[float], population: bool = False) -> Figure:
        """Summarizes replications.

        Args:
            values: One per replication.
            population: Whether their deviation is divided by their number, or by one less.
        """
        count = len(values)
        deviation = float(np.std(values, ddof=0 if population else 1)) if count > 1 else None
        interval = None if deviation is None else 1.96 * deviation / sqrt(count)
        return cls(float(np.mean(values)), interval, tuple(map(float, values)))

    def __str__(self) -> str:
        number = _rounded(self.mean, 4)
        return number if self.interval is None else f"{number} ± {_rounded(self.interval, 2)}"


@dataclass(frozen=True)
class Provenance:
    """What a report was made from."""

    data: str
    """The prepared folder."""
    data_hash: str
    """SHA-256 of its manifest, which holds those of its shards."""
    weights: Mapping[str, str]
    """Hash of the model's files, by row."""
    statistics: Mapping[str, str]
    """SHA-256 of the model's normalizer, by row."""
    models: Mapping[str, str]
    """Name of the model, by row."""
    sampling: Mapping[str, str]
    """How it was sampled, by row."""
    evaluator: str
    """Fingerprint of the evaluator; empty without one."""
    body: str
    """SHA-256 of the SMPL model file whose joints were looked at; empty without one."""
    versions: Mapping[str, str]
    """Of this package, its commit and what computes."""


@dataclass(frozen=True)
class Report:
    """What an evaluation found."""

    rows: Mapping[str, Mapping[str, Figure]]
    """Figures by row and metric; see `UNITS`."""
    items: Mapping[str, int]
    """How many motions a row has in a replication."""
    protocol: Protocol
    """How it was measured."""
    provenance: Provenance
    """What from."""
    notes: tuple[str, ...] = ()
    """What a reader must know to compare these figures."""
    warnings: tuple[str, ...] = ()
    """What is wrong with them."""
    cost: Cost | None = None
    """Parameters, FLOPs and seconds, where they were asked for."""

    def __getitem__(self, row: str) -> Mapping[str, Figure]:
        """Returns the figures of a row."""
        return self.rows[row]

    @property
    def json(self) -> dict[str, Any]:
        """The same as plain values."""
        return to_json(self)

    @property
    def metrics(self) -> list[str]:
        """The metrics that occur, in the order of reports."""
        found = dict.fromkeys(name for figures in self.rows.values() for name in figures)
        return sorted(found, key=lambda name: [*UNITS, name].index(name))

    def table(self) -> str:
        """Returns the figures as a Markdown table, a metric a line."""
        lines = [_line(["metric", *self.rows]), "|---" * (len(self.rows) + 1) + "|"]
        for name in self.metrics:
            cells = [str(figures.get(name, "–")) for figures in self.rows.values()]
            lines.append(_line([f"{name} {UNITS.get(name, '')}".strip(), *cells]))
        return "\n".join(lines)

    def markdown(self) -> str:
        """Returns a page: figures, warnings, notes and provenance."""
        p, made = self.protocol, self.provenance
        about = [
            f"protocol {p.name}, split {p.split}, {p.replications} replications, seed {p.seed}",
            "motions: " + ", ".join(f"{row} {count}" for row, count in self.items.items()),
            f"data {made.data} {made.data_hash}",
            f"evaluator {made.evaluator or 'none'}",
            *([f"body {made.body}"] if made.body else ()),
            *self._models(),
            "versions: " + ", ".join(f"{name} {v}" for name, v in made.versions.items()),
        ]
        parts = [
            f"# {', '.join(dict.fromkeys(made.models.values()))}: {p.name} protocol",
            "\n".join(f"> **Warning.** {line}" for line in self.warnings),
            self.table(),
            "± is a 95 % interval over replications; ↓ less is better, ↑ more, → near the truth.",
            "\n".join(f"* {line}" for line in (self.cost.lines() if self.cost else ())),
            "\n".join(f"* {line}" for line in self.notes),
            "## Made from\n\n" + "\n".join(f"* {line}" for line in about),
        ]
        return "\n\n".join(part for part in parts if part) + "\n"

    def write(self, folder: str | Path) -> None:
        """Writes `report.json` and `report.md` in place of what is there.

        Raises:
            InputError: The folder cannot be written, or holds something else.
        """
        with atomic_folder(folder, REPORT_FILE) as temporary:
            text = json.dumps(self.json, indent=1, ensure_ascii=False)
            (temporary / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
            (temporary / PAGE_FILE).write_text(self.markdown(), encoding="utf-8")

    def _models(self) -> list[str]:
        """Says of each model which rows are its own."""
        made, rows = self.provenance, dict[str, list[str]]()
        for row, name in made.models.items():
            weights, statistics = made.weights[row] or "not from a folder", made.statistics[row]
            rows.setdefault(f"{name}: weights {weights}, statistics {statistics}", []).append(
                row + made.sampling[row]
            )
        return [f"{model} ({'; '.join(own)})" for model, own in rows.items()]


def _rounded(value: float, digits: int) -> str:
    """Returns a number to so many digits; what only rounding makes is 0."""
    return f"{value:.{digits}g}" if abs(value) > 1e-9 else "0"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
