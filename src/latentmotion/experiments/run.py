"""Runs a table: every row in turn, what is there is kept; writes NAME.json, NAME.md, NAME.png."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from latentmotion.experiments.drawing import draw
from latentmotion.experiments.measuring import Measurement
from latentmotion.experiments.result import RowResult, TableResult, markdown
from latentmotion.experiments.table import Row, Table
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.storage.files import atomic_file


def run_table(measurement: Measurement, rows: Sequence[Row]) -> Path:
    """Trains and measures rows; returns the Markdown page, which has those of earlier runs too.

    Raises:
        InputError: A folder holds another run.
        DataError: The data cannot be used for this table.
    """
    page = measurement.work.folder / f"{measurement.table.name}.md"
    for row in rows:
        if row.kind != "real":
            measurement.row(row)
            # After every row, so that a run that is killed leaves what it has.
            write_page(measurement, page)
    return page


def write_page(measurement: Measurement, page: Path) -> None:
    """Writes the page of a table with all rows that are measured so far."""
    table, work = measurement.table, measurement.work
    result = collected(measurement)
    write_json(page.with_suffix(".json"), result)
    text = markdown(table, result, work.budget.says)
    if draw(measurement, result, page.with_suffix(".png")):
        text += f"\n![{table.title}]({page.with_suffix('.png').name})\n"
    with atomic_file(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


def collected(measurement: Measurement) -> TableResult:
    """Returns the rows that are measured so far, the real motions first."""
    table, work, protocol = measurement.table, measurement.work, measurement.protocol
    folder = work.folder / table.name
    paths = {row.name: folder / f"{row.name}.json" for row in table.rows}
    kept = {name: read_json(RowResult, path) for name, path in paths.items() if path.is_file()}
    found = {name: row for name, row in kept.items() if row.made == measurement.made}
    evaluator = measurement.extractor.fingerprint[:12] if measurement.extractor else "none"
    return TableResult(
        table=table.name,
        budget=work.budget.name,
        data=f"{work.dataset.folder.name} ({work.dataset.fingerprint[:12]})",
        protocol=f"{protocol.name}, split {protocol.split}, {protocol.replications} repetitions, "
        f"evaluator {evaluator}",
        rows=tuple(_with_truth(table, found)),
    )


def _with_truth(table: Table, found: dict[str, RowResult]) -> list[RowResult]:
    """The row of the real motions is what the first other row was compared with."""
    real = next((row.name for row in table.rows if row.kind == "real"), None)
    first = next(iter(found.values()), None)
    if real and first:
        found = {
            real: replace(first, row=real, figures=first.truth, weights="", warnings=())
        } | found
    return [found[row.name] for row in table.rows if row.name in found]
