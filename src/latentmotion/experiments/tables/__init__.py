"""Every table and figure by name; one file each."""

from __future__ import annotations

from collections.abc import Sequence

from latentmotion.errors import InputError, hint
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.action import HDM05, HUMANACT12, UESTC
from latentmotion.experiments.tables.autoencoder import AUTOENCODER
from latentmotion.experiments.tables.batch import BATCH
from latentmotion.experiments.tables.denoiser import DENOISER
from latentmotion.experiments.tables.fast import FAST
from latentmotion.experiments.tables.fast_vae import FAST_VAE
from latentmotion.experiments.tables.guidance import DROPPED, GUIDANCE
from latentmotion.experiments.tables.language import LANGUAGE
from latentmotion.experiments.tables.latents import LATENTS
from latentmotion.experiments.tables.prediction import PREDICTION
from latentmotion.experiments.tables.steps import STEPS
from latentmotion.experiments.tables.text import HUMANML3D, KIT
from latentmotion.experiments.tables.training import TRAINING
from latentmotion.experiments.tables.unconditional import UNCONDITIONAL
from latentmotion.experiments.tables.vae import DECODER, LAYERS, TOKENS, VAE

TABLES: dict[str, Table] = {
    table.name: table
    for table in (
        HUMANML3D,
        KIT,
        HUMANACT12,
        UESTC,
        HDM05,
        UNCONDITIONAL,
        VAE,
        LAYERS,
        DECODER,
        TOKENS,
        DENOISER,
        LANGUAGE,
        AUTOENCODER,
        PREDICTION,
        STEPS,
        GUIDANCE,
        DROPPED,
        BATCH,
        TRAINING,
        LATENTS,
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
