"""Which plot goes with a table, and what of its results is in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from latentmotion.experiments.measuring import Measurement
from latentmotion.experiments.plots import Points, by_guidance, time_against_fid, training_curves
from latentmotion.experiments.result import TableResult
from latentmotion.training.journal import read_journal

LOOKED_AT = ("FID", "R@3", "MM-Dist")
"""Metrics that are drawn by guidance scale."""


def draw(measurement: Measurement, result: TableResult, path: Path) -> bool:
    """Draws the figure of a table, if it has one and its rows are there; says whether it did."""
    drawer = _DRAWERS.get(measurement.table.figure)
    return drawer(measurement, result, path) if drawer else False


def _training(measurement: Measurement, result: TableResult, path: Path) -> bool:
    rows = [row for row in measurement.table.rows if _found(result, row.name)]
    folders = {row.title: measurement.work.folder / row.model / "vae" for row in rows}
    curves = {title: _curves(folder) for title, folder in folders.items()}
    if curves:
        training_curves(path, curves)
    return bool(curves)


def _curves(folder: Path) -> dict[str, Points]:
    lines = read_journal(folder)
    parts = {"loss": ("train", "total"), "error": ("validation", "val_mm")}
    return {
        part: [(line["step"], line[key]) for line in lines if line["kind"] == kind and key in line]
        for part, (kind, key) in parts.items()
    }


def _time(measurement: Measurement, result: TableResult, path: Path) -> bool:
    series: dict[str, list[tuple[str, float, float]]] = {}
    for row in measurement.table.rows:
        figures = _found(result, row.name)
        if "AITS" in figures and "FID" in figures:
            method, _, label = row.title.partition(", ")
            point = (label, figures["AITS"], figures["FID"])
            series.setdefault(f"{method} ({label.split()[0]})", []).append(point)
    if series:
        time_against_fid(path, series)
    return bool(series)


def _guidance(measurement: Measurement, result: TableResult, path: Path) -> bool:
    rows = [row for row in measurement.table.rows if row.guidance and _found(result, row.name)]
    figures = [_found(result, row.name) for row in rows]
    names = [name for name in LOOKED_AT if all(name in found for found in figures)]
    if rows and names:
        values = {name: [found[name] for found in figures] for name in names}
        by_guidance(path, [row.guidance or 0.0 for row in rows], values)
    return bool(rows and names)


def _tsne(measurement: Measurement, result: TableResult, path: Path) -> bool:
    return path.is_file()


def _found(result: TableResult, name: str) -> Mapping[str, float]:
    row = next((row for row in result.rows if row.row == name), None)
    figures = row.figures if row else {}
    return {metric: values[0] for metric, values in figures.items() if values[0] is not None}


_DRAWERS: dict[str, Callable[[Measurement, TableResult, Path], bool]] = {
    "training": _training,
    "time": _time,
    "guidance": _guidance,
    "tsne": _tsne,
}
