"""Lists of tables, and their results: JSON, and Markdown with the paper's figures beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from latentmotion.evaluation.report import UNITS_OF_TABLES, table_line
from latentmotion.reproduce.budget import MODELS
from latentmotion.reproduce.table import Row, Table


@dataclass(frozen=True)
class RowResult:
    """One measured row."""

    row: str  # Its name in the table.
    # Hash of everything that determines the figures; a row is measured again if it changes.
    key: str
    # Mean and half of the 95 % interval by metric; no interval for a single replication.
    figures: dict[str, list[float | None]] = field(default_factory=dict)
    # Figures of the ground truth, measured in the same run.
    truth: dict[str, list[float | None]] = field(default_factory=dict)
    items: int = 0  # Motions of a replication.
    replications: int = 0  # Number of replications.
    # Data, evaluator, protocol and budget; rows of one page agree in them.
    made: dict[str, str] = field(default_factory=dict)
    weights: str = ""  # Hash of the model's weights.
    hours: float = 0.0  # Hours of training, both stages.
    # Versions of this package, its commit and its libraries.
    versions: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # Limits that a reader must know to compare the figures.
    warnings: tuple[str, ...] = ()  # Problems of the figures.


@dataclass(frozen=True)
class TableResult:
    """The measured rows of a table."""

    table: str  # Its name.
    budget: str  # Name of the budget.
    data: str  # Folder name and fingerprint of the data set.
    protocol: str  # Name of the protocol, its split, replications and evaluator.
    rows: tuple[RowResult, ...] = ()  # Measured rows, in the table's order.


def markdown(table: Table, result: TableResult, says: str) -> str:
    """Returns the table with our figures beside the paper's, and its protocol and notes.

    Args:
        table: The table.
        result: Its measured rows.
        says: Description of the budget.
    """
    measured = {row.row: row for row in result.rows}
    ours = {metric for row in result.rows for metric in row.figures}
    papers = {metric for row in table.rows for metric in row.paper}
    # Heading, metric, and whether the figures are the paper's.
    columns: list[tuple[str, str, bool]] = []
    for metric in table.metrics:
        if metric in ours:
            columns.append((f"{metric} {UNITS_OF_TABLES.get(metric, '')}".strip(), metric, False))
        if metric in papers:
            columns.append((f"{metric}, paper", metric, True))
    lines = [
        table_line(["", *(heading for heading, _, _ in columns)]),
        table_line(["---"] * (len(columns) + 1)),
    ]
    for row in table.rows:
        if not row.paper and row.name not in measured:
            continue
        figures = measured[row.name].figures if row.name in measured else {}
        cells = [row.title]
        for _, metric, from_paper in columns:
            value = row.paper.get(metric)
            if not from_paper:
                cells.append(cell(figures[metric]) if metric in figures else "–")
            elif value is None:
                cells.append(UNSTATED if metric in row.paper else ABSENT)
            else:
                cells.append(f"{value:g}")
        lines.append(table_line(cells))
    parts = [
        f"### {table.title}",
        "",
        *lines,
        *([f"\nThe paper finds: {table.expects}"] if table.expects else []),
        "",
        f"<details><summary>Paper: {table.where}. Here: {result.data}, budget "
        f"{result.budget}.</summary>",
        "",
        f"* Protocol {result.protocol}.",
        f"* Budget {result.budget}: {says}.",
        f"* Columns of the paper: {ABSENT} is not in the paper; {UNSTATED} is not in its arXiv "
        "version, and no source here states what the published one has.",
        *(f"* {note}" for note in _notes(table, result)),
        "",
        "</details>",
    ]
    return "\n".join(parts) + "\n"


ABSENT, UNSTATED = "·", "?"  # Cells of the paper's columns without a figure.


def number(value: float, like: float | None = None) -> str:
    """Formats a value with three significant digits, or with as many decimals as `like` gets."""
    scale = abs(value if like is None else like)
    decimals = next((n for limit, n in ((100, 0), (10, 1), (1, 2)) if scale >= limit), 3)
    return f"{value:.{decimals}f}"


def cell(figure: Sequence[float | None]) -> str:
    """Formats a mean with its interval."""
    mean, interval = figure
    if mean is None:
        return "–"
    half = number(interval or 0.0, like=mean)
    return f"{number(mean)} ± {half}" if float(half) else number(mean)


def _notes(table: Table, result: TableResult) -> list[str]:
    """Missing rows, notes, and warnings, each once with the rows that it applies to."""
    reasons: dict[str, list[str]] = {}
    for row in table.rows:
        if row.missing:
            reasons.setdefault(row.missing, []).append(row.title)
    notes = [f"{', '.join(titles)}: not run, {reason}." for reason, titles in reasons.items()]
    texts = dict.fromkeys(note for row in result.rows for note in row.notes)
    notes += [f"{text[0].upper()}{text[1:]}." for text in texts]
    warned: dict[str, list[str]] = {}
    for row in result.rows:
        for warning in row.warnings:
            warned.setdefault(warning, []).append(row.row)
    return notes + [f"Warning for {', '.join(rows)}: {text}" for text, rows in warned.items()]


# Minutes of training on one core in the small budget: those of five layers, as measured on an AMD
# EPYC, times 7 / 5.
MINUTES = {"vae": 15, "denoiser": 3, "raw": 7}


def overview(tables: Iterable[Table]) -> str:
    """Returns a line per table: rows, minutes of training in the small budget, title."""
    lines = ["name              rows  minutes  shows"]
    for table in tables:
        runnable = [row for row in table.rows if not row.missing]
        lines.append(
            f"{table.name:<18}{len(runnable):>4}  {minutes(runnable):>7}  "
            f"{table.title}: {table.where}"
        )
    return "\n".join(
        [
            *lines,
            "",
            "minutes: training on one core with --budget small, for models not trained before;",
            "tables that share a folder share models. latentmotion experiment list NAME: its rows.",
        ]
    )


def rows_of(table: Table) -> str:
    """Returns the description of a table and its rows."""
    lines = []
    for row in table.rows:
        reason = f" (not run here: {row.missing})" if row.missing else ""
        lines.append(f"{row.name:<18}{row.title}{reason}")
    return "\n".join(
        [
            f"{table.title}: {table.where}",
            f"data: {table.data}",
            f"metrics: {', '.join(table.metrics)}",
            *([f"the paper finds: {table.expects}"] if table.expects else []),
            "",
            *lines,
        ]
    )


def minutes(rows: Iterable[Row]) -> int:
    """Returns the minutes of training of all stages that rows need, each counted once."""
    stages: set[tuple[str, str]] = set()
    for row in rows:
        model = MODELS.get(row.model)
        if model is None or model.shipped:
            continue
        if model.raw:
            stages.add(("raw", model.name))
            continue
        stages.add(("vae", model.first or model.name))
        if row.motions not in ("reconstructed", "prior"):
            stages.add(("denoiser", model.name))
    return sum(MINUTES[kind] for kind, _ in stages)
