"""Action to motion (paper, table 3): HumanAct12, UESTC and any labelled data; latents by action."""

from __future__ import annotations

from latentmotion.reproduce import published
from latentmotion.reproduce.table import Row, Table

METRICS = ("FID", "Accuracy", "Diversity", "MultiModality")
EXPECTS = "Generated actions are recognized in more than 95 of 100 cases."

HUMANACT12 = Table(
    name="action_humanact12",
    title="Action to motion on HumanAct12",
    where="table 3 (HumanAct12)",
    metrics=METRICS,
    data="HumanAct12, prepared with latentmotion data prepare humanact12",
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real"),
        Row("mld", "MLD", model="action_mld", paper=published.HUMANACT12["mld"]),
    ),
)

UESTC = Table(
    name="action_uestc",
    title="Action to motion on UESTC",
    where="table 3 (UESTC)",
    metrics=METRICS,
    data="UESTC, prepared with latentmotion data prepare uestc",
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real"),
        Row("mld", "MLD", model="action_mld", paper=published.UESTC["mld"]),
    ),
)

HDM05 = Table(
    name="action",
    title="Action to motion on any labelled data set",
    where="after table 3",
    metrics=METRICS,
    data="labelled clips, e.g. HDM05-11 split by actor",
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real"),
        Row("mld", "MLD", model="action_mld"),
        Row("mld_guidance_1", "MLD without guidance", model="action_mld", guidance=1.0),
        Row("mld_guidance_2_5", "MLD, guidance 2.5", model="action_mld", guidance=2.5),
        Row("raw", "Diffusion on raw frames, 50 steps", model="action_raw"),
    ),
)  # fmt: skip

LATENTS = Table(
    name="latents",
    title="Latents along the reverse process, by action",
    where="figure of the appendix",
    metrics=("Silhouette of noise", "Silhouette of latents"),
    data="labelled clips, e.g. HDM05-11 split by actor",
    figure="tsne",
    rows=(Row("mld", "MLD", "latents", "action_mld"),),
)
