"""Reports of evaluations: figures with 95 % intervals, their protocol and provenance.

interval = 1.96 · std / √replications
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from math import sqrt
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.candidates import Candidate, Generated
from latentmotion.evaluation.cost import Cost
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.protocol import Protocol
from latentmotion.evaluation.scores import body_of
from latentmotion.model.card import ModelCard
from latentmotion.networks.device import describe_machine
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_folder, sha256
from latentmotion.storage.provenance import commit
from latentmotion.storage.reading import packaged_toml

REPORT_FILE = "report.json"
PAGE_FILE = "report.md"
GROUND_TRUTH = "ground truth"  # Row of the real motions.

_METRICS = packaged_toml(__file__, "metrics.toml")

# Unit of each metric of reports, in their order, and of those of the paper's tables.
UNITS: dict[str, str] = _METRICS["reports"]
UNITS_OF_TABLES: dict[str, str] = UNITS | _METRICS["tables"]


@dataclass(frozen=True)
class Figure:
    """A measured number."""

    mean: float  # Mean over the replications.
    # Half of the 95 % interval of the mean; null for a single replication.
    interval: float | None = None
    values: tuple[float, ...] = ()  # Figure of each replication.

    @classmethod
    def of(cls, values: Sequence[float], population: bool = False) -> Figure:
        """Summarizes replications.

        Args:
            values: One per replication.
            population: Whether the variance is divided by their number, or by one less.
        """
        count = len(values)
        deviation = float(np.std(values, ddof=0 if population else 1)) if count > 1 else None
        # 1.96 deviations of the mean: the 95 % interval of a normal distribution.
        interval = None if deviation is None else 1.96 * deviation / sqrt(count)
        return cls(float(np.mean(values)), interval, tuple(map(float, values)))

    def __str__(self) -> str:
        number = _rounded(self.mean, 4)
        return number if self.interval is None else f"{number} ± {_rounded(self.interval, 2)}"


@dataclass(frozen=True)
class ReportProvenance:
    """Data, models, evaluator and versions behind a report."""

    KIND: ClassVar[str] = "Provenance"  # Its name in files.
    data: str  # The prepared folder.
    data_hash: str  # SHA-256 of its manifest, which holds those of its shards.
    weights: Mapping[str, str]  # Hash of the model's files, by row.
    statistics: Mapping[str, str]  # SHA-256 of the model's normalizer, by row.
    models: Mapping[str, str]  # Name of the model, by row.
    sampling: Mapping[str, str]  # Sampler, steps and guidance, by row.
    evaluator: str  # Fingerprint of the evaluator; empty without one.
    body: str  # SHA-256 of the SMPL model file of the joints; empty without one.
    # Versions of this package, its commit, its libraries and the machine.
    versions: Mapping[str, str]


@dataclass(frozen=True)
class Report:
    """Figures of an evaluation."""

    rows: Mapping[str, Mapping[str, Figure]]  # Figures by row and metric; see `UNITS`.
    items: Mapping[str, int]  # Motions of a replication, by row.
    protocol: Protocol  # Rules of the evaluation.
    provenance: ReportProvenance  # Data, models, evaluator and versions.
    notes: tuple[str, ...] = ()  # Limits that a reader must know to compare the figures.
    warnings: tuple[str, ...] = ()  # Problems of the figures.
    cost: Cost | None = None  # Parameters, FLOPs and seconds, if they were measured.

    def __getitem__(self, row: str) -> Mapping[str, Figure]:
        """Returns the figures of a row."""
        return self.rows[row]

    @property
    def json(self) -> dict[str, Any]:
        """The report as plain values."""
        return to_json(self)

    @property
    def metrics(self) -> list[str]:
        """The metrics that occur, in the order of reports."""
        names = dict.fromkeys(name for figures in self.rows.values() for name in figures)
        return sorted(names, key=lambda name: [*UNITS, name].index(name))

    def table(self) -> str:
        """Returns the figures as a Markdown table, one line per metric."""
        lines = [table_line(["metric", *self.rows]), "|---" * (len(self.rows) + 1) + "|"]
        for name in self.metrics:
            cells = [str(figures.get(name, "–")) for figures in self.rows.values()]
            lines.append(table_line([f"{name} {UNITS.get(name, '')}".strip(), *cells]))
        return "\n".join(lines)

    def markdown(self) -> str:
        """Returns a page: figures, warnings, notes and provenance."""
        p, provenance = self.protocol, self.provenance
        models: dict[str, list[str]] = {}
        for row, name in provenance.models.items():
            weights, statistics = (
                provenance.weights[row] or "not from a folder",
                provenance.statistics[row],
            )
            model = f"{name}: weights {weights}, statistics {statistics}"
            models.setdefault(model, []).append(row + provenance.sampling[row])
        origins = [
            f"protocol {p.name}, split {p.split}, {p.replications} replications, seed {p.seed}",
            "motions: " + ", ".join(f"{row} {count}" for row, count in self.items.items()),
            f"data {provenance.data} {provenance.data_hash}",
            f"evaluator {provenance.evaluator or 'none'}",
            *([f"body {provenance.body}"] if provenance.body else ()),
            *(f"{model} ({'; '.join(rows)})" for model, rows in models.items()),
            "versions: " + ", ".join(f"{name} {v}" for name, v in provenance.versions.items()),
        ]
        parts = [
            f"# {', '.join(dict.fromkeys(provenance.models.values()))}: {p.name} protocol",
            "\n".join(f"> **Warning.** {line}" for line in self.warnings),
            self.table(),
            "± is a 95 % interval over replications; ↓ less is better, ↑ more, → near the truth.",
            "\n".join(f"* {line}" for line in (self.cost.lines() if self.cost else ())),
            "\n".join(f"* {line}" for line in self.notes),
            "## Made from\n\n" + "\n".join(f"* {line}" for line in origins),
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


def card_figures(report: Report) -> dict[str, Any]:
    """Returns the figures for a model card: the means of every row, and how they were measured."""
    protocol, provenance = report.protocol, report.provenance
    rows = {
        row: {name: float(f"{figure.mean:.4g}") for name, figure in figures.items()}
        for row, figures in report.rows.items()
    }
    return {
        "data": f"{provenance.data} {provenance.data_hash}",
        "evaluator": provenance.evaluator,
        "protocol": protocol.name,
        "split": protocol.split,
        "replications": protocol.replications,
        "seed": protocol.seed,
        "motions": dict(report.items),
        "rows": rows,
    }


def table_line(cells: Sequence[str]) -> str:
    """Returns a line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def _rounded(value: float, digits: int) -> str:
    """Formats a number with some significant digits; rounding errors around 0 are 0."""
    return f"{value:.{digits}g}" if abs(value) > 1e-9 else "0"


_WEIGHTS = ("*.safetensors", "*.onnx", "tokenizer.json")


def provenance_of(
    candidates: Sequence[Candidate], dataset: Dataset, evaluator: Evaluator | None
) -> ReportProvenance:
    """Returns the provenance of a report."""
    sampling = dict.fromkeys((candidate.row for candidate in candidates), "")
    for candidate in candidates:
        if isinstance(candidate, Generated):
            used = candidate.sampling or candidate.card.sampling
            sampling[candidate.row] = (
                f", {used.sampler} {used.steps} steps, guidance {used.guidance:g}"
            )
    packages = {name: version(name) for name in ("latentmotion", "numpy", "scipy", "torch")}
    return ReportProvenance(
        data=dataset.folder.name,
        data_hash=dataset.fingerprint,
        weights={candidate.row: candidate.weights for candidate in candidates},
        statistics={candidate.row: statistics_hash(candidate.card) for candidate in candidates},
        models={candidate.row: candidate.card.name for candidate in candidates},
        sampling=sampling,
        evaluator="" if evaluator is None else evaluator.fingerprint,
        body=body_of(dataset),
        versions={**packages, "commit": commit() or "unknown", "machine": describe_machine()},
    )


def weights_hash(folder: str | Path) -> str:
    """Returns one hash of all weight files of a model folder."""
    files = sorted({path for pattern in _WEIGHTS for path in Path(folder).glob(pattern)})
    lines = (f"{sha256(path)} {path.name}\n" for path in files)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def statistics_hash(card: ModelCard) -> str:
    """Returns a hash of the mean and standard deviation of a model's normalizer."""
    values = np.array([card.normalizer_mean, card.normalizer_std], np.float32)
    return hashlib.sha256(values.tobytes()).hexdigest()
