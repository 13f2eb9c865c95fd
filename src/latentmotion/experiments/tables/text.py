"""Text to motion (paper, tables 1 and 2): real motions, MDM and MLD."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table

METRICS = (
    "R@1",
    "R@2",
    "R@3",
    "FID",
    "MM-Dist",
    "Diversity",
    "MultiModality",
)

EXPECTS = "MLD leads MDM in FID, R-precision and MM-Dist; MDM is the more various."

HUMANML3D = Table(
    name="text",
    title="Text to motion",
    where="table 1 (HumanML3D)",
    metrics=METRICS,
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real", paper=published.HUMANML3D["real"]),
        Row(
            "mdm", "MDM, 1000 steps", model="mdm", steps=1000, sampler="ddpm",
            paper=published.HUMANML3D["mdm"],
        ),
        Row("mdm_50", "MDM, its 50-step form", model="mdm_50"),
        Row("mld_1", "MLD (1 token)", model="mld_1", paper=published.HUMANML3D["mld"]),
        Row("mld_2", "MLD (2 tokens)", model="mld_2"),
        Row("mld_5", "MLD (5 tokens)", model="mld_5"),
        Row("mld_7", "MLD (7 tokens)", model="mld_7", paper=published.GENERATED_7),
        Row("mld_10", "MLD (10 tokens)", model="mld_10"),
        Row("starter", "Our shipped starter (not the paper's)", model="starter"),
    ),
)  # fmt: skip

KIT = Table(
    name="text_kit",
    title="Text to motion on KIT",
    where="table 2 (KIT)",
    metrics=METRICS,
    data="KIT, prepared with latentmotion data prepare",
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real"),
        Row("mdm", "MDM, 1000 steps", model="mdm", steps=1000, sampler="ddpm",
            paper=published.KIT["mdm"]),
        Row("mld_1", "MLD (1 token)", model="mld_1", paper=published.KIT["mld"]),
    ),
)  # fmt: skip
