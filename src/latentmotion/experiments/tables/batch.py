"""Batch size of stage 2 (paper, appendix)."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS


def _batch(size: int) -> Row:
    paper = published.HUMANML3D["mld"] if size == 64 else {}
    model = "mld_1" if size == 64 else f"batch_{size}"
    return Row(f"batch_{size}", f"{size} motions a step", model=model, paper=paper)


BATCH = Table(
    name="batch",
    title="Batch size of the diffusion's training",
    where="appendix",
    metrics=METRICS[:6],
    rows=(Row("real", "Real", "real"), *map(_batch, (64, 128, 256, 500))),
)
