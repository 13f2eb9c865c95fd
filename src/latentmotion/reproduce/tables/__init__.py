"""Every table and figure by name."""

from __future__ import annotations

from collections.abc import Sequence

from latentmotion.errors import InputError, hint
from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.tables import ablations, tasks
from latentmotion.reproduce.tables.fast import FAST, FAST_VAE

TABLES: dict[str, Table] = {
    table.name: table
    for table in (
        tasks.HUMANML3D,
        tasks.QUALITY,
        tasks.KIT,
        tasks.HUMANACT12,
        tasks.UESTC,
        tasks.HDM05,
        tasks.UNCONDITIONAL,
        ablations.VAE,
        ablations.LAYERS,
        ablations.DECODER,
        ablations.TOKENS,
        ablations.DENOISER,
        ablations.LANGUAGE,
        ablations.AUTOENCODER,
        ablations.PREDICTION,
        tasks.STEPS,
        ablations.GUIDANCE,
        ablations.DROPPED,
        ablations.BATCH,
        ablations.TRAINING,
        tasks.LATENTS,
        FAST_VAE,
        FAST,
    )
}


def table_named(name: str) -> Table:
    """Returns a table.

    Raises:
        InputError: There is none of this name; the nearest is named.
    """
    if name not in TABLES:
        raise InputError(f"unknown experiment {name!r}; {hint(name, list(TABLES))}")
    return TABLES[name]


def rows_named(table: Table, names: Sequence[str]) -> list[Row]:
    """Returns some rows of a table in its order, or those that can be run where none is named.

    Raises:
        InputError: One of them is not in it; the nearest is named.
    """
    every = [row.name for row in table.rows]
    for name in names:
        if name not in every:
            raise InputError(f"experiment {table.name} has no row {name!r}; {hint(name, every)}")
    return [row for row in table.rows if (row.name in names if names else not row.missing)]
