"""The fast family, one change at a time; and, on its latents, the samplers.

The full recipe: velocity on the linear path, logit-normal times, latents normalized per channel,
pooled sentence and 16 words as tokens, no ReLU before them, one sequence.
"""

from __future__ import annotations

from latentmotion.experiments.table import Row, Table

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
"""Models that differ from the full recipe, and how."""


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
