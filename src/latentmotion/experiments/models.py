"""Every model that some row of a table needs, in the paper's sizes; a budget makes them smaller."""

from __future__ import annotations

from latentmotion.experiments.table import Base, Model

NO_SKIPS = "vae.transformer.skips=false"
TWO_RATES = "vae.decoding=two_rate"
ACTOR = (
    "vae.transformer.layers=6",
    NO_SKIPS,
    "vae.transformer.final_norm=false",
    "vae.position=sine",
)
PAPERS_LOSS = tuple(
    f"vae_objective.{key}" for key in ("steps=0.0", "divergence=1e-4", "joints_knee=1.0")
)


def _tokens(count: int) -> Model:
    return Model(f"mld_{count}", changes=(f"vae.tokens={count}",))


def _vae(name: str, *changes: str) -> Model:
    return Model(name, changes=changes)


def _on_mld_1(name: str, *changes: str, encoder: str = "") -> Model:
    return Model(name, changes=changes, first="mld_1", encoder=encoder)


def _language(name: str, encoder: str, words: int) -> Model:
    """Reads a sentence as one pooled vector, or as its words alone."""
    reading = f"reading.pooled={'false' if words else 'true'}", f"reading.words={words}"
    return _on_mld_1(name, *reading, encoder=encoder)


def _action(name: str, *changes: str, base: Base = "mld") -> Model:
    """Left and right are parts of labels, so mirrored copies would contradict them."""
    return Model(name, base, ("mirrored=false", *changes), task="action")


def _fast(name: str, *changes: str) -> Model:
    return Model(f"fast_{name}", "fast", changes, first="fast")


def _on_papers_schedule(prediction: str) -> tuple[str, ...]:
    return (
        'denoiser_objective.schedule={"kind": "ScaledLinear"}',
        f'denoiser_objective.prediction={{"kind": "{prediction}"}}',
        'denoiser_objective.times="uniform"',
        "denoiser.time_scale=1.0",
    )


EVERY = (
    # VAEs, and the diffusion on them (tables 1, 4, 5 and the appendix).
    Model("mld_1"),
    *map(_tokens, (2, 5, 7, 10)),
    _vae("actor", *ACTOR),
    Model("vposer_t", changes=('vae={"kind": "VPoserTConfig"}',)),
    _vae("mld_1_no_skip", NO_SKIPS),
    *(_vae(f"mld_1_{n}_layers", f"vae.transformer.layers={n}") for n in (7, 11)),
    _vae("mld_1_two_rates", TWO_RATES),
    _vae("mld_1_coarse", TWO_RATES, "vae.fine_layers=0"),
    # Denoisers (table 5).
    _on_mld_1("cross", 'denoiser.attention="cross"'),
    _on_mld_1("cross_no_skip", 'denoiser.attention="cross"', "denoiser.transformer.skips=false"),
    _on_mld_1("denoiser_no_skip", "denoiser.transformer.skips=false"),
    *(_on_mld_1(f"denoiser_{n}_layers", f"denoiser.transformer.layers={n}") for n in (5, 7, 11)),
    # Objective, guidance, batch.
    _on_mld_1("z0", 'denoiser_objective.prediction={"kind": "Sample"}'),
    *(_on_mld_1(f"dropped_{p}", f"denoiser_objective.dropped={p / 100}") for p in (5, 15, 25)),
    *(_on_mld_1(f"batch_{n}", f"denoiser_training.batch_size={n}") for n in (128, 256, 500)),
    # Autoencoder: no divergence, latents are means.
    Model("autoencoder", changes=("vae_objective.divergence=0.0", "latents.sampled=false")),
    # Language models.
    _language("clip_pooled", "clip", 0),
    _language("clip_words", "clip_hidden", 77),
    _language("bert", "distilbert", 77),
    _language("minilm", "minilm", 0),
    # Baselines and other tasks.
    Model("mdm", base="mdm"),
    Model("mdm_50", base="mdm_50"),
    Model("starter", base="starter"),
    _action("action_mld", 'denoiser.condition_projection="table"'),
    _action("action_raw", base="mdm_50"),
    Model("unconditional_mld_1", task="unconditional", first="mld_1"),
    *(Model(f"unconditional_mld_{n}", task="unconditional", first=f"mld_{n}") for n in (2, 5, 7)),
    # The fast family: latent spaces, and one and the same flow on each of them.
    *(_vae(f"narrow_16x{w}", "vae.tokens=16", f"vae.latent_width={w}") for w in (16, 32)),
    Model("conv_paper_loss", "fast", PAPERS_LOSS),
    Model("conv_32", "fast", ("vae.channels=32",)),
    *(
        Model(f"flow_on_{name}", "fast", first=name)
        for name in ("mld_1", "mld_7", "narrow_16x16", "narrow_16x32")
    ),
    # Its recipe, and one change at a time.
    Model("fast", "fast"),
    _fast("seed_1", "denoiser_training.seed=1"),
    _fast("z0_linear", 'denoiser_objective.prediction={"kind": "Sample"}'),
    _fast("uniform", 'denoiser_objective.times="uniform"'),
    _fast("v", *_on_papers_schedule("Velocity")),
    _fast("epsilon", *_on_papers_schedule("Epsilon")),
    _fast("z0", *_on_papers_schedule("Sample")),
    _fast("not_normalized", "latents.normalized=false"),
    _fast("relu", 'denoiser.condition_projection="relu_linear"'),
    _fast("pooled", "reading.words=0"),
    _fast("words", "reading.pooled=false"),
    _fast("cross", 'denoiser.attention="cross"'),
    _fast("no_skips", "denoiser.transformer.skips=false"),
    _fast("no_length", "denoiser.length_token=false"),
)

MODELS = {model.name: model for model in EVERY}
