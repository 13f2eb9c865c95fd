from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from latentmotion.cli.main import main
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.model.config import ConvolutionalVAEConfig
from latentmotion.networks.checkpoint import build, load_model
from latentmotion.reproduce.budget import MODELS, PAPER, SMALL
from latentmotion.reproduce.workspace import vae_cost
from latentmotion.storage.configuration import to_json
from latentmotion.training.experiment import differing_keys, preset_named

STACK = '{"width": 16, "layers": 3, "heads": 2, "hidden": 16}'
TINY = [
    change
    for stage in ("vae", "denoiser")
    for change in (
        f"{stage}_training.steps=1",
        f"{stage}_training.batch_size=4",
        f"{stage}_training.sample_every=0",
    )
] + [
    f"denoiser.transformer={STACK}",
    "vae_cropping.min_frames=24",
    "latents.cropping.min_frames=24",
]
SMALLER = {
    "fast": ["vae.width=16", "vae.dilations=[1]"],
    "fast_tokens": [f"vae.transformer={STACK}"],
}


@pytest.mark.parametrize("name", ["fast", "fast_tokens"])
def test_both_stages_are_trained_by_command(name: str, figures: Path, tmp_path: Path) -> None:
    shared = ["--preset", name, "--data", str(figures), "--device", "cpu"]
    shared += [word for change in (*TINY, *SMALLER[name]) for word in ("--set", change)]
    vae, denoiser = tmp_path / "vae", tmp_path / "denoiser"
    main(["train", "vae", *shared, "-o", str(vae)])
    main(["train", "denoiser", *shared, "--vae", str(vae), "-o", str(denoiser)])
    model = load_model(denoiser / "model")
    latents = model.card.latents
    assert (latents.width, latents.tokens, latents.frames_per_token) == (
        (32, None, 4) if name == "fast" else (32, 16, None)
    )
    assert len(set(latents.std)) == latents.width  # normalized per channel
    assert (model.card.sampling.steps, model.card.sampling.sampler) == (10, "dpm++")
    cost = {key: figure.mean for key, figure in vae_cost(model.vae, 263, 20).items()}
    assert cost["Latent numbers"] == (20 * 32 if name == "fast" else 16 * 32)
    assert cost["Parameters"] == sum(p.numel() for p in model.vae.parameters()) / 1e6
    assert cost["Decoding"] > 0 and cost["Training step"] > 0


def test_the_family_differs_from_the_starter_in_size_alone() -> None:
    starter, fast = preset_named("starter"), preset_named("fast")
    sizes = {"name", "vae_cropping", "vae_training", "latents", "denoiser_training", "sampling"}
    found = set(differing_keys(to_json(starter), to_json(fast)))
    parts = {key.split(" ")[0] for key in found if key.split(".")[0].split(" ")[0] not in sizes}
    assert parts == {"vae.width", "denoiser.transformer.layers", "denoiser.transformer.hidden"}
    tokens = preset_named("fast_tokens")
    assert tokens.denoiser == replace(fast.denoiser, latent_width=32)
    for experiment in (fast, tokens):
        assert experiment.denoiser.latent_width == build(experiment.vae).latent_width
        assert experiment.denoiser_objective.parametrization == Velocity()
        assert experiment.denoiser_objective.schedule == LinearPath()


def test_each_row_changes_one_thing() -> None:
    budget = SMALL.of_table("fast")

    def second(name: str) -> dict[str, object]:
        model = MODELS[name]
        first = MODELS[model.first or name].first_stage(budget, 263)
        return to_json(model.second_stage(first, budget, 263, 384))

    rows = [name for name, model in MODELS.items() if model.first == "fast"]
    changed = {
        name: {key.split(".")[0] for key in differing_keys(second("fast"), second(name))}
        for name in rows
    }
    on_papers_schedule = {"fast_v", "fast_epsilon", "fast_z0"}
    for name, parts in changed.items():
        parts = {part.split(" ")[0] for part in parts} - {"name"}
        assert len(parts) == (2 if name in on_papers_schedule else 1), (name, parts)


def test_a_budget_may_shorten_single_tables() -> None:
    assert PAPER.of_table("fast") == PAPER and SMALL.of_table("vae") == SMALL
    shorter = SMALL.of_table("fast_vae")
    assert "changed: denoiser_training.steps=" in shorter.says
    fast = MODELS["fast"].first_stage(shorter, 263).vae
    assert isinstance(fast, ConvolutionalVAEConfig) and fast.width == SMALL.width
    assert MODELS["fast"].first_stage(PAPER, 263).vae == preset_named("fast").vae
