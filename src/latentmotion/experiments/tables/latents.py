"""t-SNE of latents along the reverse process, by action (paper, appendix)."""

from __future__ import annotations

from latentmotion.experiments.table import Row, Table

LATENTS = Table(
    name="latents",
    title="Latents along the reverse process, by action",
    where="figure of the appendix",
    metrics=("Silhouette of noise", "Silhouette of latents"),
    data="labelled clips, e.g. HDM05-11 split by actor",
    figure="tsne",
    rows=(Row("mld", "MLD", "latents", "action_mld"),),
)
