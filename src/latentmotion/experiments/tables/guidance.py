"""Classifier-free guidance (paper, appendix): its scale, and how often conditions are dropped."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS

MLD = published.HUMANML3D["mld"]


def _scale(scale: float) -> Row:
    paper = MLD if scale == 7.5 else {}
    name = f"scale_{scale:g}".replace(".", "_")
    return Row(name, f"s = {scale:g}", model="mld_1", guidance=scale, paper=paper)


def _dropped(percent: int) -> Row:
    model = "mld_1" if percent == 10 else f"dropped_{percent}"
    paper = {10: MLD, 25: published.DROPPED_25}.get(percent, {})
    return Row(f"dropped_{percent}", f"p = {percent / 100:g}", model=model, paper=paper)


GUIDANCE = Table(
    name="guidance",
    title="Guidance scale",
    where="appendix",
    metrics=METRICS[:6],
    figure="guidance",
    rows=(
        Row("real", "Real", "real"),
        *map(_scale, (1.0, 1.5, 2.5, 3.5, 5.5, 7.5, 9.5)),
    ),
)

DROPPED = Table(
    name="guidance_dropout",
    title="Share of conditions dropped in training",
    where="appendix",
    metrics=METRICS[:6],
    expects="Dropping a quarter halves the FID of dropping a tenth.",
    rows=(Row("real", "Real", "real"), *map(_dropped, (5, 10, 15, 25))),
)
