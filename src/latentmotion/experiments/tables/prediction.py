"""What the denoiser predicts (paper, table 9): the noise, or the clean latents."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS

PREDICTION = Table(
    name="prediction",
    title="Noise or clean latents",
    where="table 9",
    metrics=METRICS[:6],
    expects="Predicting the noise is slightly better.",
    rows=(
        Row("real", "Real", "real"),
        Row("z0", "MLD, predicts z₀", model="z0", paper=published.PREDICTION["sample"]),
        Row("epsilon", "MLD, predicts ε", model="mld_1", paper=published.PREDICTION["epsilon"]),
    ),
)
