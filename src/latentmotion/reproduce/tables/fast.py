"""The fast family: its recipe, one change at a time, and its latent spaces against others.

Recipe: velocity on the linear path, logit-normal timesteps, latents normalized per channel, pooled
sentence and 24 words as tokens without a ReLU before them, one sequence.

Latent spaces: the paper's tokens are as wide as its transformer, narrow tokens have linear adapters
(MLD++), and convolutional latents keep the time axis at a quarter of the frame rate.
"""

from __future__ import annotations

from latentmotion.reproduce.table import Row, Table
from latentmotion.reproduce.tables.ablations import rebuilt

METRICS = ("R@1", "R@3", "FID", "MM-Dist", "APE joints", "Foot sliding", "Jitter", "Penetration")

CHANGED = {
    "fast_seed_1": "Full recipe, another seed",
    "fast_z0_linear": "z₀ instead of the velocity",
    "fast_uniform": "Uniform times",
    "fast_v": "The paper's schedule, uniform times: v",
    "fast_epsilon": "The same: ε",
    "fast_z0": "The same: z₀",
    "fast_not_normalized": "Latents not normalized",
    "fast_relu": "ReLU before the text",
    "fast_pooled": "Pooled sentence alone",
    "fast_words": "Words alone",
    "fast_cross": "Cross-attention",
    "fast_no_skips": "No long skips",
    "fast_no_length": "No token of the length",
}
"""Models that differ from the full recipe, each with its title."""


FAST = Table(
    name="fast",
    title="The fast family, one change at a time",
    where="no table of it",
    metrics=METRICS,
    rows=(
        Row("real", "Real", "real"),
        Row("full", "Full recipe (DPM-Solver++, 10 steps, guidance 3)", model="fast"),
        *(Row(name.removeprefix("fast_"), title, model=name) for name, title in CHANGED.items()),
        Row("epsilon_50", "ε, sampled in 50 steps", model="fast_epsilon", steps=50),
        Row("euler_10", "Euler, 10 steps", model="fast", steps=10, sampler="euler"),
        Row("heun_5", "Heun, 5 steps (9 passes)", model="fast", steps=5, sampler="heun"),
        Row("heun_10", "Heun, 10 steps (19 passes)", model="fast", steps=10, sampler="heun"),
        Row("euler_50", "Euler, 50 steps", model="fast", steps=50, sampler="euler"),
        Row("guidance_1", "Guidance 1", model="fast", guidance=1.0),
        Row("guidance_2", "Guidance 2", model="fast", guidance=2.0),
        Row("guidance_5", "Guidance 5", model="fast", guidance=5.0),
    ),
)  # fmt: skip

LATENT_SPACE_METRICS = (
    "MPJPE",
    "PA-MPJPE",
    "ACCL",
    "FID",
    "R@3",
    "Foot sliding",
    "Parameters",
    "Latent numbers",
    "Training step",
    "Decoding",
)

SPACES = {
    "mld_1": "one token",
    "mld_7": "7 tokens",
    "narrow_16x16": "16 narrow tokens of 16",
    "narrow_16x32": "16 narrow tokens of 32",
    "fast": "convolutional, T/4 × 16",
    "conv_32": "convolutional, T/4 × 32",
}
"""Latent spaces of the flows, by the model of the first stage."""


FAST_VAE = Table(
    name="fast_vae",
    title="Latent spaces: rebuilding against generating",
    where="no table of it",
    metrics=LATENT_SPACE_METRICS,
    rows=(
        Row("real", "Real", "real"),
        *(rebuilt(name, f"Rebuilt: {title}", paper=False) for name, title in SPACES.items()),
        rebuilt(
            "conv_paper_loss", "Rebuilt: convolutional, T/4 × 16, the paper's loss", paper=False
        ),
        *(
            Row(
                f"generated_{name}",
                f"Generated: {title}",
                model=name if name in ("fast", "conv_32") else f"flow_on_{name}",
            )
            for name, title in SPACES.items()
        ),
    ),
)
