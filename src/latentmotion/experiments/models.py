"""Every model that some row of a table needs, in the paper's sizes; a budget makes them smaller."""

from __future__ import annotations

from latentmotion.experiments.table import Base, Model

NO_SKIPS = "vae.transformer.skips=false"
ACTOR = (
    "vae.transformer.layers=6",
    NO_SKIPS,
    "vae.transformer.final_norm=false",
    "vae.position=sine",
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


EVERY = (
    # VAEs, and the diffusion on them (tables 1, 4, 5 and the appendix).
    Model("mld_1"),
    *map(_tokens, (2, 5, 7, 10)),
    _vae("actor", *ACTOR),
    Model("vposer_t", changes=('vae={"kind": "VPoserTConfig"}',)),
    _vae("mld_1_no_skip", NO_SKIPS),
    *(_vae(f"mld_1_{n}_layers", f"vae.transformer.layers={n}") for n in (7, 11)),
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
)

MODELS = {model.name: model for model in EVERY}
