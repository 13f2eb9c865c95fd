"""Latent spaces for the fast family: what rebuilds best, and what one flow makes of each.

The paper's tokens are as wide as its transformer; narrow tokens have linear adapters (MLD++);
convolutional latents keep the time axis at a quarter of the frame rate.
"""

from __future__ import annotations

from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.vae import rebuilt

METRICS = (
    "MPJPE",
    "PA-MPJPE",
    "ACCL",
    "FID",
    "R@3",
    "Foot sliding",
    "Parameters",
    "Latent numbers",
    "Training step",
    "Decoding",
)

SPACES = {
    "mld_1": "one token",
    "mld_7": "7 tokens",
    "narrow_16x16": "16 narrow tokens of 16",
    "narrow_16x32": "16 narrow tokens of 32",
    "fast": "convolutional, T/4 × 16",
    "conv_32": "convolutional, T/4 × 32",
}
"""What a flow is trained on, by the model of the first stage."""


def _rebuilt(name: str, title: str) -> Row:
    return rebuilt(name, f"Rebuilt: {title}", paper=False)


def _generated(name: str, title: str) -> Row:
    own = name in ("fast", "conv_32")
    model = name if own else f"flow_on_{name}"
    return Row(f"generated_{name}", f"Generated: {title}", model=model)


FAST_VAE = Table(
    name="fast_vae",
    title="Latent spaces: rebuilding against generating",
    where="no table of it",
    metrics=METRICS,
    rows=(
        Row("real", "Real", "real"),
        *(_rebuilt(name, title) for name, title in SPACES.items()),
        _rebuilt("conv_paper_loss", "convolutional, T/4 × 16, the paper's loss"),
        *(_generated(name, title) for name, title in SPACES.items()),
    ),
)
