"""Lists of tables and of their rows, as `latentmotion experiment list` prints them."""

from __future__ import annotations

from collections.abc import Iterable

from latentmotion.reproduce.models import MODELS
from latentmotion.reproduce.table import Row, Table

MINUTES = {"vae": 11, "denoiser": 2, "raw": 5}
"""Minutes of training on one core in the small budget, measured on an AMD EPYC."""


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
        if row.kind not in ("reconstructed", "prior"):
            stages.add(("denoiser", model.name))
    return sum(MINUTES[kind] for kind, _ in stages)
