"""A table or figure: its rows and columns, and the paper's figures (Chen et al., CVPR 2023).

The paper's figures stand beside ours. One that could not be found in a source stays empty.

Sources, none of them copied but for the numbers:
 [S] the paper and its code (targets, cost), see docs/reference/mld.md
 [M] README of OpenMotionLab/MotionGPT, whose authors are the paper's: motion reconstruction
 [H] published lists of results on HumanML3D and KIT that quote table 1 and the appendix
 [N] public reading notes of arXiv 2212.04048 that quote tables 4, 6, 8, 9 and 10

Units: joint errors in mm, acceleration in mm per frame², FLOPs in 10⁹ as the authors count them
(twice THOP's multiply-adds at 40 frames, text encoder included).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, nan
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


Figures = Mapping[str, float]


def _text(
    r1: float, r2: float, r3: float, fid: float, distance: float, div: float, various: float = nan
) -> Figures:
    names = ("R@1", "R@2", "R@3", "FID", "MM-Dist", "Diversity", "MultiModality")
    values = zip(names, (r1, r2, r3, fid, distance, div, various), strict=True)
    return {name: value for name, value in values if not isnan(value)}


def _rebuilt(mpjpe: float, pa_mpjpe: float, accl: float, fid: float, div: float) -> Figures:
    names = ("MPJPE", "PA-MPJPE", "ACCL", "FID", "Diversity")
    return dict(zip(names, (mpjpe, pa_mpjpe, accl, fid, div), strict=True))


HUMANML3D: dict[str, Figures] = {
    "real": _text(0.511, 0.703, 0.797, 0.002, 2.974, 9.503),  # [S]
    "mdm": _text(0.320, 0.498, 0.611, 0.544, 5.566, 9.559, 2.799),  # [H]
    "mld": _text(0.481, 0.673, 0.772, 0.473, 3.196, 9.724, 2.413),  # [S] [H]
}
KIT: dict[str, Figures] = {
    "mdm": _text(0.164, 0.291, 0.396, 0.497, 9.191, 10.85, 1.907),  # [H]
    "mld": _text(0.390, 0.609, 0.734, 0.404, 3.204, 10.80, 2.192),  # [S] [H]
}
HUMANACT12: dict[str, Figures] = {
    "mld": {"FID": 0.077, "Accuracy": 0.964, "Diversity": 6.831, "MultiModality": 2.824},  # [S]
}
UESTC: dict[str, Figures] = {
    "mld": {"Accuracy": 0.954},  # [S]
}
UNCONDITIONAL: dict[str, Figures] = {
    "mld_1": {"FID": 1.055},  # [N]
    "mld_7": {"FID": 7.614},  # [N]
}
RECONSTRUCTION: dict[str, Figures] = {
    "vposer_t": _rebuilt(75.6, 48.6, 9.3, 1.430, 8.336),  # [M]
    "actor": _rebuilt(65.3, 41.0, 7.0, 0.341, 9.569),  # [M]
    "mld_1": _rebuilt(54.4, 41.6, 8.3, 0.247, 9.630),  # [S] [M]
    "mld_7": {"MPJPE": 14.7, "PA-MPJPE": 8.9, "ACCL": 5.1, "FID": 0.017, "Diversity": 9.554},
    # mld_7: [S], its diversity [H]
}
AUTOENCODER: dict[str, Figures] = {
    "without": {"FID": 5.033, "R@3": 0.581},  # [N]
    "with": {"FID": 0.473, "R@3": 0.772},  # [N]
}
PREDICTION: dict[str, Figures] = {"epsilon": {"FID": 0.473}, "sample": {"FID": 0.513}}  # [N]
GENERATED_7: Figures = {"FID": 1.011}  # [H] design notes of the field: MLD-7 as a generator
FIVE_LAYERS: Figures = {"FID": 0.314}  # [S] the best of the denoiser's layers
DROPPED_25: Figures = {"FID": 0.229}  # [H] a quarter of the conditions dropped
COST: dict[str, Figures] = {
    "mld_50": {"FID": 0.473, "GFLOPs": 29.86},  # [S] [N]
    "mld_100": {"GFLOPs": 33.12},  # [S]
    "mld_200": {"GFLOPs": 39.61},  # [S]
    "mld_1000": {"GFLOPs": 91.60},  # [S]
    "mdm_50": {"FID": 7.334, "GFLOPs": 597.97},  # [N]
    "mdm_1000": {"FID": 0.544},  # [N]
}
