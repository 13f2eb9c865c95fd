"""Training curves (paper, appendix): the VAE with and without long skips."""

from __future__ import annotations

from latentmotion.experiments.table import Table
from latentmotion.experiments.tables.vae import rebuilt

TRAINING = Table(
    name="training",
    title="Training of the VAE with and without skips",
    where="figure of the appendix",
    metrics=("MPJPE", "PA-MPJPE", "ACCL"),
    figure="training",
    rows=(rebuilt("mld_1", "With skips"), rebuilt("mld_1_no_skip", "Without skips", paper=False)),
)
