"""The denoiser's shape (paper, table 5): how the condition enters, skips, layers."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS

MLD = published.HUMANML3D["mld"]

DENOISER = Table(
    name="denoiser",
    title="Denoiser by attention, skips and layers",
    where="table 5",
    metrics=METRICS[:6],
    expects="Five layers have the best FID.",
    rows=(
        Row("real", "Real", "real"),
        Row("cross_no_skip", "Cross-attention, no skips", model="cross_no_skip"),
        Row("cross", "Cross-attention, skips", model="cross"),
        Row("no_skip", "In one sequence, no skips", model="denoiser_no_skip"),
        Row("layers_5", "In one sequence, skips, 5 layers", model="denoiser_5_layers",
            paper=published.FIVE_LAYERS),
        Row("layers_7", "In one sequence, skips, 7 layers", model="denoiser_7_layers"),
        Row("layers_9", "In one sequence, skips, 9 layers", model="mld_1", paper=MLD),
        Row("layers_11", "In one sequence, skips, 11 layers", model="denoiser_11_layers"),
    ),
)  # fmt: skip
