"""A table or figure: rows, each a model with its sampling settings, and the metrics of its columns.

The paper's figures stand beside ours. One that could not be found in a source stays empty;
`published.py` names the source of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from latentmotion.diffusion.samplers import SamplerName

Kind = Literal["real", "reconstructed", "generated", "prior", "latents"]
"""Motions that a row measures: real ones, reconstructions, samples of the denoiser or of a VAE's
prior, or latents along the reverse process."""


@dataclass(frozen=True)
class Row:
    """A row of a table."""

    name: str
    """Name for `--rows`."""
    title: str
    """Text in the table."""
    kind: Kind = "generated"
    """Motions that are measured."""
    model: str = ""
    """Name of its model; empty for real motions, and for a row that cannot be run here."""
    steps: int | None = None
    """Sampling steps; by default those of the model."""
    guidance: float | None = None
    """Guidance scale; by default that of the model."""
    sampler: SamplerName | None = None
    """Sampler; by default that of the model."""
    paper: Mapping[str, float] = field(default_factory=dict)
    """The paper's figures by metric."""
    missing: str = ""
    """Reason why it cannot be run here; empty if it can."""


@dataclass(frozen=True)
class Table:
    """One table or figure."""

    name: str
    """Name on the command line."""
    title: str
    """Title on its page."""
    where: str
    """Its place in the paper."""
    rows: tuple[Row, ...]
    """Rows in order."""
    metrics: tuple[str, ...]
    """Columns in order."""
    data: str = "any text-motion data set"
    """Data set that it is run on."""
    figure: Literal["", "time", "guidance", "training", "tsne"] = ""
    """Plot that goes with it."""
    expects: str = ""
    """The paper's conclusion from it."""
