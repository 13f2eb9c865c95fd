"""Joined runs of a table: the same rows trained with other seeds, or judged by other evaluators.

A row that was trained several times has the mean of its trainings and the 95 % interval of that
mean, by Student's t; one that was trained once keeps the interval of its replications. There is a
page for each evaluator, the first of which has the table's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev

from latentmotion.errors import InputError
from latentmotion.reproduce.markdown import RowResult, TableResult, markdown
from latentmotion.reproduce.plots import draw_figure
from latentmotion.reproduce.table import Table
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.storage.files import atomic_file

SEED = "denoiser_training.seed="
"""Setting that may differ between the runs."""


def join_runs(table: Table, folders: Sequence[Path], output: Path) -> Path:
    """Writes OUTPUT/TABLE.md, .json and .svg, and OUTPUT/TABLE_2.md of a second evaluator.

    Args:
        table: The table.
        folders: Output folders of `latentmotion experiment run`.
        output: Folder to write.

    Returns:
        The page of the first evaluator.

    Raises:
        InputError: A folder has no such table, they differ in data or protocol, or a row in more
            than the seed.
    """
    results = [read_json(TableResult, folder / f"{table.name}.json") for folder in folders]
    settings = [row.made for result in results for row in result.rows]
    if len({(run["data"], run["protocol"]) for run in settings}) != 1:
        raise InputError(
            f"{table.name}: the runs in {', '.join(map(str, folders))} differ in data or protocol; "
            "join runs that differ in seed, evaluator or lengths of training"
        )
    says = _without_seed(settings[0]["budget"])
    evaluators = dict.fromkeys(result.rows[0].made["evaluator"] for result in results)
    pages = []
    for number, evaluator in enumerate(evaluators, start=1):
        theirs = [run for run in results if run.rows[0].made["evaluator"] == evaluator]
        name = table.name if number == 1 else f"{table.name}_{number}"
        pages.append(replace(theirs[0], table=name, rows=_joined_rows(table, theirs, says)))
    output.mkdir(parents=True, exist_ok=True)
    for number, joined in enumerate(pages, start=1):
        name = joined.table
        path = output / f"{name}.md"
        write_json(path.with_suffix(".json"), joined)
        titled = replace(table, title=f"{table.title}, by evaluator {number}", expects="")
        text = markdown(titled if number > 1 else table, joined, says)
        if draw_figure(table, joined, path.with_suffix(".svg")):
            text += f"\n![{table.title}]({name}.svg)\n"
        with atomic_file(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return output / f"{table.name}.md"


def joined_row(rows: Sequence[RowResult]) -> RowResult:
    """Returns the row of several trainings, each measured once; a single one is returned as it is.

    Args:
        rows: One per training.
    """
    if len({row.weights for row in rows}) < 2:
        return rows[0]
    figures: dict[str, list[float | None]] = {}
    for name in rows[0].figures:
        means = [row.figures[name][0] for row in rows if name in row.figures]
        values = [mean for mean in means if mean is not None]
        figures[name] = [fmean(values) if values else None, interval(values)]
    note = (
        f"mean of {len(rows)} trainings of the denoiser, ± the 95 % interval of that mean by "
        "Student's t, where other rows have that of their replications"
    )
    hours = fmean(row.hours for row in rows)
    warnings = list(dict.fromkeys(w for row in rows for w in row.warnings))
    return replace(rows[0], figures=figures, hours=hours, warnings=(*warnings, note))


def interval(values: Sequence[float]) -> float | None:
    """Returns half of the 95 % interval of a mean of few independent values; None of one."""
    from scipy.stats import t

    if len(values) < 2:
        return None
    return float(t.ppf(0.975, len(values) - 1)) * stdev(values) / sqrt(len(values))


def _joined_rows(table: Table, results: Sequence[TableResult], says: str) -> tuple[RowResult, ...]:
    measured = [row for result in results for row in result.rows]
    kinds = {row.name: row.motions for row in table.rows}
    named = [
        [measured_row for measured_row in measured if measured_row.row == name] for name in kinds
    ]
    joined = []
    for rows in filter(None, named):
        row = joined_row(rows)
        budgets = {_without_seed(measured_row.made["budget"]) for measured_row in rows}
        if len(budgets) > 1 and len({measured_row.weights for measured_row in rows}) > 1:
            raise InputError(
                f"{table.name}/{row.row} was trained in {len(budgets)} ways: "
                f"{' / '.join(sorted(budgets))}; join runs of one"
            )
        if says not in budgets and kinds[row.row] != "real":
            changed = max(budgets).partition("changed: ")[2]
            row = replace(row, warnings=(*row.warnings, f"trained with {changed}"))
        joined.append(row)
    return tuple(joined)


def _without_seed(says: str) -> str:
    return ", ".join(part for part in says.split(", ") if SEED not in part)
