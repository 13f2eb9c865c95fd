"""Autoencoder or VAE (paper, table 8): does the diffusion need a regular latent space?"""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS

AUTOENCODER = Table(
    name="autoencoder",
    title="Autoencoder or VAE",
    where="table 8",
    metrics=METRICS[:6],
    expects="Diffusion on a plain autoencoder's latents is far worse.",
    rows=(
        Row("real", "Real", "real"),
        Row("autoencoder", "MLD on an autoencoder", model="autoencoder",
            paper=published.AUTOENCODER["without"]),
        Row("vae", "MLD on a VAE", model="mld_1", paper=published.AUTOENCODER["with"]),
    ),
)  # fmt: skip
