"""Ablations of VAEs and the denoiser (paper, tables 4, 5, 8, 9 and the appendix)."""

from __future__ import annotations

from latentmotion.reproduce import table as published
from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.tables.tasks import METRICS as ALL_METRICS

METRICS = ALL_METRICS

MLD = published.HUMANML3D["mld"]

DENOISER = Table(
    name="denoiser",
    title="Denoiser by attention, skips and layers",
    where="table 5",
    metrics=METRICS,
    expects="Five layers have the best FID.",
    rows=(
        Row("real", "Real", "real"),
        Row("cross_no_skip", "Cross-attention, no skips", model="cross_no_skip"),
        Row("cross", "Cross-attention, skips", model="cross"),
        Row("no_skip", "In one sequence, no skips", model="denoiser_no_skip"),
        Row("layers_5", "In one sequence, skips, 5 layers", model="denoiser_5_layers",
            paper=published.FIVE_LAYERS),
        Row("layers_7", "In one sequence, skips, 7 layers", model="denoiser_7_layers"),
        Row("layers_9", "In one sequence, skips, 9 layers", model="mld_1", paper=MLD),
        Row("layers_11", "In one sequence, skips, 11 layers", model="denoiser_11_layers"),
    ),
)  # fmt: skip


LANGUAGE = Table(
    name="language",
    title="Language models",
    where="appendix",
    metrics=METRICS,
    data="any text-motion data set; encoders from the hub, or from folders with --text-encoders",
    rows=(
        Row("real", "Real", "real"),
        Row("clip", "CLIP, pooled", model="clip_pooled", paper=MLD),
        Row("clip_words", "CLIP, words", model="clip_words"),
        Row("bert", "DistilBERT, words", model="bert"),
        Row("minilm", "MiniLM, pooled", model="minilm"),
        Row("ours", "The encoder that is named, pooled", model="mld_1"),
    ),
)


AUTOENCODER = Table(
    name="autoencoder",
    title="Autoencoder or VAE",
    where="table 8",
    metrics=METRICS,
    expects="Diffusion on a plain autoencoder's latents is far worse.",
    rows=(
        Row("real", "Real", "real"),
        Row("autoencoder", "MLD on an autoencoder", model="autoencoder",
            paper=published.AUTOENCODER["without"]),
        Row("vae", "MLD on a VAE", model="mld_1", paper=published.AUTOENCODER["with"]),
    ),
)  # fmt: skip


PREDICTION = Table(
    name="prediction",
    title="Noise or clean latents",
    where="table 9",
    metrics=METRICS,
    expects="Predicting the noise is slightly better.",
    rows=(
        Row("real", "Real", "real"),
        Row("z0", "MLD, predicts z₀", model="z0", paper=published.PREDICTION["sample"]),
        Row("epsilon", "MLD, predicts ε", model="mld_1", paper=published.PREDICTION["epsilon"]),
        Row("z0_standardized", "z₀, sentences in unit scale", model="z0_standardized"),
        Row("epsilon_standardized", "ε, sentences in unit scale", model="epsilon_standardized"),
        Row("epsilon_min_snr", "ε, the same, min-SNR weights", model="epsilon_min_snr"),
        Row(
            "velocity_standardized",
            "velocity, sentences in unit scale",
            model="velocity_standardized",
        ),
    ),
)


GUIDANCE = Table(
    name="guidance",
    title="Guidance scale",
    where="appendix",
    metrics=METRICS,
    figure="guidance",
    rows=(
        Row("real", "Real", "real"),
        *(
            Row(
                f"scale_{scale:g}".replace(".", "_"),
                f"s = {scale:g}",
                model="mld_1",
                guidance=scale,
                paper=MLD if scale == 7.5 else {},
            )
            for scale in (1.0, 1.5, 2.5, 3.5, 5.5, 7.5, 9.5)
        ),
    ),
)

DROPPED = Table(
    name="guidance_dropout",
    title="Share of conditions dropped in training",
    where="appendix",
    metrics=METRICS,
    expects="Dropping a quarter halves the FID of dropping a tenth.",
    rows=(
        Row("real", "Real", "real"),
        Row("dropped_5", "p = 0.05", model="dropped_5"),
        Row("dropped_10", "p = 0.1", model="mld_1", paper=MLD),
        Row("dropped_15", "p = 0.15", model="dropped_15"),
        Row("dropped_25", "p = 0.25", model="dropped_25", paper=published.DROPPED_25),
    ),
)


BATCH = Table(
    name="batch",
    title="Batch size of the diffusion's training",
    where="appendix",
    metrics=METRICS,
    rows=(
        Row("real", "Real", "real"),
        Row("batch_64", "64 motions a step", model="mld_1", paper=MLD),
        *(Row(f"batch_{n}", f"{n} motions a step", model=f"batch_{n}") for n in (128, 256, 500)),
    ),
)


_VAE_METRICS = ("MPJPE", "PA-MPJPE", "ACCL", "FID", "Diversity")


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
    metrics=_VAE_METRICS,
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
    metrics=_VAE_METRICS,
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
    metrics=(*_VAE_METRICS, "Parameters", "Training step", "Decoding"),
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
