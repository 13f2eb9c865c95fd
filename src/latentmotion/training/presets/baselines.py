"""The paper's baselines: ACTOR's VAE, VPoser over time, MLD without a VAE, and MDM.

MDM (Tevet et al. 2023) diffuses raw frames:

    [time + sentence, frames] + sine positions → 8 post-norm layers, no skips → frames

Two things differ from MDM's code: without a condition it sees the embedding of the empty
sentence, as all our models do, where MDM sees zeros; and attention leaves padding out. Train it
with `latentmotion train denoiser --vae none --preset mdm`.
"""

from __future__ import annotations

from dataclasses import replace

from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.parametrization import Sample
from latentmotion.diffusion.schedule import Cosine, ScaledLinear
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import IdentityVAEConfig, VPoserTConfig
from latentmotion.networks.vae.loss import VAEObjective
from latentmotion.training.denoiser_loss import DenoiserObjective
from latentmotion.training.experiment import Experiment, LatentSettings
from latentmotion.training.presets.mld import actor_vae, constant_rate, mld_humanml3d


def mdm_denoiser(features: int, condition_width: int) -> DenoiserConfig:
    """The network for HumanML3D has 17.9 million weights."""
    return DenoiserConfig(
        latent_width=features,
        condition_width=condition_width,
        transformer=TransformerConfig(
            width=512, layers=8, heads=4, hidden=1024, skips=False, final_norm=False
        ),
        words="added_to_time",
        positions="context_first",
        position="sine",
        sine_width=512,
    )


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
        positions="separate",
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


def mdm(steps: int = 1000) -> Experiment:
    """Predicts the clean frames; AdamW at 1e-4 without decay, 600,000 steps of 64.

    Args:
        steps: Steps of the diffusion, in training as in sampling. The text width is that of
            CLIP ViT-B/32, which MDM uses.
    """
    cropping = Cropping(unit=4, max_frames=196, min_frames=40)
    training = constant_rate(steps=600_000, weight_decay=0.0)
    return Experiment(
        name="mdm" if steps == 1000 else f"mdm_{steps}",
        vae=IdentityVAEConfig(),
        vae_objective=VAEObjective(),
        vae_cropping=cropping,
        vae_training=training,
        latents=LatentSettings(cropping, normalized=False, sampled=False),
        denoiser=mdm_denoiser(263, condition_width=512),
        denoiser_objective=DenoiserObjective(schedule=Cosine(steps), parametrization=Sample()),
        denoiser_training=training,
        sampling=Sampling(steps=steps, guidance=2.5, sampler="ddpm"),
    )


def mdm_50() -> Experiment:
    """The fast form: trained, not only sampled, with 50 steps."""
    return mdm(steps=50)
