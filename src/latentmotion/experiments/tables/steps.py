"""Sampling steps, time and cost (paper, tables 7 and 10): MLD against diffusion on raw frames."""

from __future__ import annotations

from collections.abc import Mapping

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table


def _mld(steps: int, sampler: str = "ddim") -> Row:
    paper: Mapping[str, float] = published.COST.get(f"mld_{steps}", {})
    name, title = f"mld_{sampler}_{steps}", f"MLD, {sampler.upper()} {steps}"
    kind = "ddim" if sampler == "ddim" else "ddpm"
    return Row(name, title, model="mld_1", steps=steps, sampler=kind, paper=paper)


STEPS = Table(
    name="steps",
    title="Time, cost and FID by sampling steps",
    where="tables 7 and 10",
    metrics=("FID", "R@3", "AITS", "GFLOPs", "Parameters"),
    figure="time",
    expects="MDM needs its 1000 steps, and at 50 costs twenty times MLD's FLOPs.",
    rows=(
        Row("real", "Real", "real"),
        *map(_mld, (5, 10, 20, 50, 100, 200)),
        _mld(1000, "ddpm"),
        Row("mdm_50", "MDM, DDIM 50", model="mdm", steps=50, sampler="ddim",
            paper=published.COST["mdm_50"]),
        Row("mdm_ddpm_50", "MDM, DDPM 50", model="mdm", steps=50, sampler="ddpm"),
        Row("mdm_100", "MDM, DDIM 100", model="mdm", steps=100, sampler="ddim"),
        Row("mdm_200", "MDM, DDIM 200", model="mdm", steps=200, sampler="ddim"),
        Row("mdm_1000", "MDM, DDPM 1000", model="mdm", steps=1000, sampler="ddpm",
            paper=published.COST["mdm_1000"]),
    ),
)  # fmt: skip
