"""Motion VAEs: layers, decoders, latent tokens and training (paper, tables 4, 5 and appendix)."""

from __future__ import annotations

from latentmotion.reproduce import published
from latentmotion.reproduce.table import Row, Table

METRICS = ("MPJPE", "PA-MPJPE", "ACCL", "FID", "Diversity")


def rebuilt(name: str, title: str, paper: bool = True) -> Row:
    """Returns the row of a VAE, by the name of its model."""
    figures = published.RECONSTRUCTION.get(name, {}) if paper else {}
    return Row(name, title, "reconstructed", name, paper=figures)


def _tokens(count: int) -> Row:
    return rebuilt(f"mld_{count}", f"MLD-{count}")


VAE = Table(
    name="vae",
    title="Motion VAEs: ACTOR, VPoser-t and ours by number of latent tokens",
    where="table 4",
    metrics=METRICS,
    expects="ACTOR and VPoser-t rebuild worse than MLD-1, and more tokens rebuild better.",
    rows=(
        Row("real", "Real", "real", paper={"FID": 0.002, "Diversity": 9.503}),
        rebuilt("vposer_t", "VPoser-t"),
        rebuilt("actor", "ACTOR"),
        *map(_tokens, (1, 2, 5, 7, 10)),
        rebuilt("mld_1_no_skip", "MLD-1 without skips"),
    ),
)

LAYERS = Table(
    name="vae_layers",
    title="VAE by layers and skips",
    where="appendix",
    metrics=METRICS,
    rows=(
        Row("real", "Real", "real"),
        rebuilt("mld_1_no_skip", "9 layers, no skips"),
        rebuilt("mld_1_7_layers", "7 layers"),
        rebuilt("mld_1", "9 layers"),
        rebuilt("mld_1_11_layers", "11 layers"),
    ),
)

DECODER = Table(
    name="decoder",
    title="Decoders of MLD-1 at the frame rate and at a quarter of it",
    where="no table of it",
    metrics=(*METRICS, "Parameters", "Training step", "Decoding"),
    rows=(
        Row("real", "Real", "real"),
        rebuilt("mld_1", "every layer at the frame rate", paper=False),
        rebuilt("mld_1_two_rates", "all but the last two at a quarter", paper=False),
        rebuilt("mld_1_coarse", "every layer at a quarter", paper=False),
    ),
)

TOKENS = Table(
    name="tokens",
    title="Latent tokens: rebuilding against generating",
    where="tables 4 and 5",
    metrics=("MPJPE", "FID", "R@3", "Diversity"),
    expects="More tokens rebuild better and generate worse.",
    rows=(
        Row("real", "Real", "real"),
        *map(_tokens, (1, 2, 7)),
        *(
            Row(f"generated_{n}", f"MLD-{n}, generated", model=f"mld_{n}", paper=paper)
            for n, paper in (
                (1, {"FID": 0.473, "R@3": 0.772}),
                (2, {}),
                (7, published.GENERATED_7),
            )
        ),
    ),
)

TRAINING = Table(
    name="training",
    title="Training of the VAE with and without skips",
    where="figure of the appendix",
    metrics=("MPJPE", "PA-MPJPE", "ACCL"),
    figure="training",
    rows=(rebuilt("mld_1", "With skips"), rebuilt("mld_1_no_skip", "Without skips", paper=False)),
)
