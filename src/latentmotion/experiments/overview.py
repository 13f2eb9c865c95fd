"""What `latentmotion experiment list` prints."""

from __future__ import annotations

from collections.abc import Iterable

from latentmotion.experiments.models import MODELS
from latentmotion.experiments.table import Row, Table

MINUTES = {"vae": 11, "denoiser": 2, "raw": 5}
"""Minutes of one core that training takes in the small budget: measured on an AMD EPYC."""


def overview(tables: Iterable[Table]) -> str:
    """Returns a line for each table: rows, minutes in the small budget, what it shows."""
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
    """Returns what a table is about and its rows."""
    lines = [f"{row.name:<18}{row.title}{_why(row)}" for row in table.rows]
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
    """Returns the minutes of training of all stages that rows need, each once."""
    stages: set[tuple[str, str]] = set()
    for row in rows:
        if row.model:
            stages |= _stages(row)
    return sum(MINUTES[kind] for kind, _ in stages)


def _stages(row: Row) -> set[tuple[str, str]]:
    model = MODELS[row.model]
    if model.base == "starter":
        return set()
    if model.raw:
        return {("raw", model.name)}
    first = {("vae", model.first or model.name)}
    return first if row.kind in ("reconstructed", "prior") else {*first, ("denoiser", model.name)}


def _why(row: Row) -> str:
    return f" (not run here: {row.missing})" if row.missing else ""
