"""What a table's rows measured: JSON for programs, Markdown with the paper beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from latentmotion.evaluation.report import UNITS as REPORTED
from latentmotion.experiments.table import Row, Table

UNITS = {
    **REPORTED,
    "AITS": "s ↓",
    "GFLOPs": "↓",
    "Parameters": "10⁶ ↓",
    "Latent numbers": "of 4 s ↓",
    "Training step": "CPU s ↓",
    "Decoding": "of 4 s, CPU ms ↓",
    "Silhouette of noise": "",
    "Silhouette of latents": "↑",
}
"""Unit of each metric; ↓ where less is better, ↑ where more is, → where near the real is."""


@dataclass(frozen=True)
class RowResult:
    """One measured row."""

    row: str
    """Its name in the table."""
    key: str
    """Hash of all that decides the figures; a row is measured again where it differs."""
    figures: dict[str, list[float | None]] = field(default_factory=dict)
    """Mean and half of the 95 % interval by metric; no interval for a single repetition."""
    truth: dict[str, list[float | None]] = field(default_factory=dict)
    """The same of the real motions, measured in the same run."""
    items: int = 0
    """Motions of a repetition."""
    replications: int = 0
    """Repetitions."""
    made: dict[str, str] = field(default_factory=dict)
    """Data, evaluator, protocol and budget: a page has only rows that agree in these."""
    weights: str = ""
    """Hash of the model's weights."""
    hours: float = 0.0
    """Hours of training, both stages."""
    versions: dict[str, str] = field(default_factory=dict)
    """Of this package, its commit and what computes."""
    notes: tuple[str, ...] = ()
    """What a reader must know to compare the figures."""
    warnings: tuple[str, ...] = ()
    """What is wrong with them."""


@dataclass(frozen=True)
class TableResult:
    """A table as it was run."""

    table: str
    """Its name."""
    budget: str
    """Name of the budget."""
    data: str
    """The data set's folder name and fingerprint."""
    protocol: str
    """Name of the protocol, and how often it was repeated."""
    rows: tuple[RowResult, ...] = ()
    """Rows that are measured so far, in the table's order."""


def markdown(table: Table, result: TableResult, says: str) -> str:
    """Returns the table with our figures beside the paper's, and how they came to be.

    Args:
        table: What was asked.
        result: What was measured.
        says: What the budget made smaller.
    """
    measured = {row.row: row for row in result.rows}
    columns = _columns(table, measured.values())
    lines = [
        f"### {table.title}",
        "",
        _line(["", *(heading for heading, _, _ in columns)]),
        _line(["---"] * (len(columns) + 1)),
        *(
            _row_line(row, measured.get(row.name), columns)
            for row in table.rows
            if row.paper or row.name in measured
        ),
        *([f"\nThe paper finds: {table.expects}"] if table.expects else []),
        "",
        f"<details><summary>Paper: {table.where}. Here: {result.data}, budget "
        f"{result.budget}.</summary>",
        "",
        f"* Protocol {result.protocol}.",
        f"* Budget {result.budget}: {says}.",
        *(f"* {note}" for note in _notes(table, result)),
        "",
        "</details>",
    ]
    return "\n".join(lines) + "\n"


def number(value: float, like: float | None = None) -> str:
    """Prints three significant digits of a value, or as many places as another one has so."""
    scale = abs(value if like is None else like)
    places = next((n for limit, n in ((100, 0), (10, 1), (1, 2)) if scale >= limit), 3)
    return f"{value:.{places}f}"


def cell(figure: Sequence[float | None]) -> str:
    """Prints a mean with its interval."""
    mean, interval = figure
    if mean is None:
        return "–"
    around = number(interval or 0.0, like=mean)
    return f"{number(mean)} ± {around}" if float(around) else number(mean)


_Column = tuple[str, str, bool]
"""Heading, metric, and whether it is the paper's."""


def _columns(table: Table, measured: Iterable[RowResult]) -> list[_Column]:
    ours = {metric for row in measured for metric in row.figures}
    columns: list[_Column] = []
    for metric in table.metrics:
        heading = f"{metric} {UNITS.get(metric, '')}".strip()
        columns += [(heading, metric, False)] if metric in ours else []
        if any(metric in row.paper for row in table.rows):
            columns.append((f"{metric}, paper", metric, True))
    return columns


def _row_line(row: Row, found: RowResult | None, columns: Sequence[_Column]) -> str:
    cells = [row.title]
    for _, metric, papers in columns:
        if papers:
            cells.append(f"{row.paper[metric]:g}" if metric in row.paper else "")
        else:
            cells.append(cell(found.figures[metric]) if found and metric in found.figures else "–")
    return _line(cells)


def _notes(table: Table, result: TableResult) -> list[str]:
    notes = [f"{row.title}: not run, {row.missing}." for row in table.rows if row.missing]
    texts = dict.fromkeys(note for row in result.rows for note in row.notes)
    notes += [f"{text[0].upper()}{text[1:]}." for text in texts]
    notes += [f"{names}: {text}" for text, names in _by_text(result.rows).items()]
    return notes


def _by_text(rows: Iterable[RowResult]) -> dict[str, str]:
    """The same warning of several rows is printed once."""
    texts: dict[str, list[str]] = {}
    for row in rows:
        for warning in row.warnings:
            texts.setdefault(warning, []).append(row.row)
    return {text: "Warning for " + ", ".join(names) for text, names in texts.items()}


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
