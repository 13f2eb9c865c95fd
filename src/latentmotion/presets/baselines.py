"""What the paper compares its VAE with (table 4): others, and none; trained as its own is."""

from __future__ import annotations

from dataclasses import replace

from latentmotion.baselines.actor import actor_vae
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.experiment import Experiment
from latentmotion.model.config import Sampling, TransformerConfig
from latentmotion.model.vae_config import IdentityVAEConfig, VPoserTConfig
from latentmotion.presets.mld_humanml3d import mld_humanml3d


def actor() -> Experiment:
    """ACTOR's VAE."""
    return replace(mld_humanml3d(), name="actor", vae=actor_vae(263))


def vposer_t() -> Experiment:
    """VPoser over time."""
    return replace(mld_humanml3d(), name="vposer_t", vae=VPoserTConfig())


def mld_no_vae() -> Experiment:
    """MLD on raw frames, a plain decoder that looks at time and sentence (`--vae none`)."""
    experiment = mld_humanml3d()
    transformer = TransformerConfig(width=512, skips=False)
    denoiser = replace(
        experiment.denoiser,
        latent_width=263,
        transformer=transformer,
        project_latents=True,
        attention="cross",
        places="separate",
    )
    return replace(
        experiment,
        name="mld_no_vae",
        vae=IdentityVAEConfig(),
        latents=replace(experiment.latents, sampled=False),
        denoiser=denoiser,
        denoiser_objective=DenoiserObjective(schedule=ScaledLinear(offset=0, ends_clean=True)),
        sampling=Sampling(steps=1000, guidance=7.5, sampler="ddpm"),
    )
