"""The paper's tables and figures (Chen et al., CVPR 2023), which are data: `tables.json`.

A row names its model and how it is sampled. Beside it stand the paper's figures, in the order in
which the table names them, empty if it has none there. Null is a figure of the published version
that no source at hand states: some of tables 9 and 10, which the arXiv version lacks. Sources: the
authors' `MLD_Arxiv.pdf` (in the history of their repository, commit f9ca628; its tables 7 to 10 are
7, 8, 11 and 12 of the published version), docs/reference/mld.md for FLOPs, and public reading notes
of the published version for tables 9 and 10.

Units: joint errors in mm, acceleration in mm per frame², FLOPs in 10⁹ as the authors count them
(twice THOP's multiply-adds at 40 frames, text encoder included).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from latentmotion.diffusion.samplers import SamplerName
from latentmotion.errors import InputError, named
from latentmotion.storage.configuration import from_json

# Motions that a row measures: real ones, reconstructions, samples of the denoiser or of a VAE's
# prior, or latents along the reverse process.
Kind = Literal["real", "reconstructed", "generated", "prior", "latents"]


@dataclass(frozen=True)
class Row:
    """A row of a table."""

    name: str  # Name for `--rows`.
    title: str  # Text in the table.
    motions: Kind = "generated"  # Motions that are measured.
    # Name of its model; empty for real motions, and for a row that cannot be run here.
    model: str = ""
    steps: int | None = None  # Sampling steps; by default those of the model.
    guidance: float | None = None  # Guidance scale; by default that of the model.
    sampler: SamplerName | None = None  # Sampler; by default that of the model.
    # Share of the denoiser's training after which it is measured; by default all of it.
    share: float | None = None
    # The paper's figures by metric; null if no source at hand states one that it has.
    paper: Mapping[str, float | None] = field(default_factory=dict)
    missing: str = ""  # Reason why it cannot be run here; empty if it can.


@dataclass(frozen=True)
class Table:
    """One table or figure."""

    name: str  # Name on the command line.
    title: str  # Title on its page.
    where: str  # Its place in the paper.
    rows: tuple[Row, ...]  # Rows in order.
    metrics: tuple[str, ...]  # Columns in order.
    data: str = "any text-motion data set"  # Data set that it is run on.
    # Splits whose FID are columns, the last with all other metrics; by default the protocol's.
    splits: tuple[str, ...] = ()
    source: str = ""  # Name of the only source that its data may have; empty for any.
    # Plot that goes with it.
    figure: Literal["", "time", "guidance", "training", "bars", "tsne"] = ""
    expects: str = ""  # The paper's conclusion from it.


TABLES: dict[str, Table] = {}  # Every table and figure by name, in the paper's order.
for _table in json.loads(Path(__file__).with_name("tables.json").read_text(encoding="utf-8")):
    _metrics = _table.pop("paper", ())
    for _row in _table["rows"]:
        _figures = zip(_metrics, _row.get("paper", ()), strict="paper" in _row)
        _row["paper"] = {name: value for name, value in _figures if value != ""}
    TABLES[_table["name"]] = from_json(Table, _table)


def rows_named(table: Table, names: Sequence[str]) -> list[Row]:
    """Returns some rows of a table in its order, or those that can be run where none is named.

    Raises:
        InputError: One of them is not in it, with the nearest name, or cannot be run.
    """
    rows = {row.name: row for row in table.rows}
    for name in names:
        if missing := named("row", name, rows).missing:
            raise InputError(f"experiment {table.name}, row {name!r}: {missing}")
    return [row for row in table.rows if (row.name in names if names else not row.missing)]
