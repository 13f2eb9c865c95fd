"""Motion from text, actions and nothing (paper, tables 1, 2, 3, 6, 7 and 10), and sampling cost."""

from __future__ import annotations

from latentmotion.diffusion.samplers import SamplerName
from latentmotion.reproduce import table as published
from latentmotion.reproduce.table import Row, Table

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

QUALITY = Table(
    name="quality",
    title="Quality, time and training",
    where="table 1 and the figure of FID against time",
    metrics=(
        "R@1",
        "R@3",
        "FID",
        "MM-Dist",
        "Diversity",
        "Processor time",
        "GFLOPs",
        "Training",
        "Crops",
    ),
    figure="time",
    expects=EXPECTS,
    rows=(
        Row("real", "Real", "real"),
        *(
            row
            for equal in ("crops", "FLOPs")
            for row in (
                Row(
                    f"mdm_{equal.lower()}", f"MDM in 50 steps, equal {equal}",
                    model=f"mdm_50_{equal.lower()}",
                ),
                Row(
                    f"no_vae_{equal.lower()}", f"MLD without VAE, of z₀, equal {equal}",
                    model=f"no_vae_{equal.lower()}", steps=50, sampler="ddim",
                ),
            )
        ),
        Row(
            "mdm_scale_3_5", "MDM in 50 steps, equal FLOPs, guidance 3.5", model="mdm_50_flops",
            guidance=3.5,
        ),
        Row("mld_1", "MLD-1 of ε", model="mld_1"),
        Row("mld_1_longer", "MLD-1 of ε, trained longer", model="mld_1_longer"),
        Row("z0", "MLD-1 of z₀", model="z0"),
        Row("z0_scale_3_5", "MLD-1 of z₀, guidance 3.5", model="z0", guidance=3.5),
        Row(
            "z0_5", "MLD-1 of z₀, guidance 3.5, in 5 steps", model="z0", steps=5, guidance=3.5
        ),
        Row("mld_7_z0", "MLD-7 of z₀", model="mld_7_z0"),
        Row("starter", "Our shipped starter (not the paper's)", model="starter"),
        Row("fast", "Our shipped fast (not the paper's)", model="fast_shipped"),
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


UNCONDITIONAL = Table(
    name="unconditional",
    title="Unconditional motion",
    where="table 6",
    metrics=("FID", "KID", "Diversity"),
    expects="One token generates far better than seven.",
    rows=(
        Row("real", "Real", "real"),
        Row("prior_actor", "ACTOR, its prior", "prior", "actor"),
        Row("prior_vposer_t", "VPoser-t, its prior", "prior", "vposer_t"),
        Row("prior_mld_1", "MLD's VAE (1 token), its prior", "prior", "mld_1"),
        *(
            Row(
                f"mld_{tokens}",
                f"MLD ({tokens} token{'s' if tokens > 1 else ''})",
                model=f"unconditional_mld_{tokens}",
                guidance=1.0,
                paper=published.UNCONDITIONAL.get(f"mld_{tokens}", {}),
            )
            for tokens in (1, 2, 5, 7)
        ),
    ),
)


def _sampled(steps: int, sampler: SamplerName = "ddim") -> Row:
    return Row(
        f"mld_{sampler}_{steps}",
        f"MLD, {sampler.upper()} {steps}",
        model="mld_1",
        steps=steps,
        sampler=sampler,
        paper=published.COST.get(f"mld_{steps}", {}),
    )


STEPS = Table(
    name="steps",
    title="Time, cost and FID by sampling steps",
    where="tables 7 and 10",
    metrics=("FID", "R@3", "AITS", "GFLOPs", "Parameters"),
    figure="time",
    expects="MDM needs its 1000 steps, and at 50 costs twenty times MLD's FLOPs.",
    rows=(
        Row("real", "Real", "real"),
        *map(_sampled, (5, 10, 20, 50, 100, 200)),
        _sampled(1000, "ddpm"),
        Row("mdm_50", "MDM, DDIM 50", model="mdm", steps=50, sampler="ddim",
            paper=published.COST["mdm_50"]),
        Row("mdm_ddpm_50", "MDM, DDPM 50", model="mdm", steps=50, sampler="ddpm"),
        Row("mdm_100", "MDM, DDIM 100", model="mdm", steps=100, sampler="ddim"),
        Row("mdm_200", "MDM, DDIM 200", model="mdm", steps=200, sampler="ddim"),
        Row("mdm_1000", "MDM, DDPM 1000", model="mdm", steps=1000, sampler="ddpm",
            paper=published.COST["mdm_1000"]),
    ),
)  # fmt: skip


_ACTION_METRICS = ("FID", "Accuracy", "Diversity", "MultiModality")
_RECOGNIZED = "Generated actions are recognized in more than 95 of 100 cases."

HUMANACT12 = Table(
    name="action_humanact12",
    title="Action to motion on HumanAct12",
    where="table 3 (HumanAct12)",
    metrics=_ACTION_METRICS,
    data="HumanAct12, prepared with latentmotion data prepare humanact12",
    expects=_RECOGNIZED,
    rows=(
        Row("real", "Real", "real"),
        Row("mld", "MLD", model="action_mld", paper=published.HUMANACT12["mld"]),
    ),
)

UESTC = Table(
    name="action_uestc",
    title="Action to motion on UESTC",
    where="table 3 (UESTC)",
    metrics=_ACTION_METRICS,
    data="UESTC, prepared with latentmotion data prepare uestc",
    expects=_RECOGNIZED,
    rows=(
        Row("real", "Real", "real"),
        Row("mld", "MLD", model="action_mld", paper=published.UESTC["mld"]),
    ),
)

HDM05 = Table(
    name="action",
    title="Action to motion on any labelled data set",
    where="after table 3",
    metrics=_ACTION_METRICS,
    data="labelled clips, e.g. HDM05-11 split by actor",
    expects=_RECOGNIZED,
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
