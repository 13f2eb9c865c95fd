"""Ablations of the denoiser (paper, tables 5, 8, 9 and the appendix)."""

from __future__ import annotations

from latentmotion.reproduce import published
from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.tables.text import METRICS as ALL_METRICS

METRICS = ALL_METRICS[:6]
"""Metrics of text to motion without MultiModality, which takes many more motions."""

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
