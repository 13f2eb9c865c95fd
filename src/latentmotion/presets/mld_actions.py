"""The paper's models for action labels: ACTOR's VAE and a denoiser of 15 layers (section 4.4).

60 frames of 150 features, which are not normalized; stage 1 compares features and the vertices of
SMPL's body, without the way of its root.
"""

from __future__ import annotations

from latentmotion.baselines.actor import actor_vae
from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.experiment import Experiment, LatentSettings
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.presets.constant_rate import constant_rate
from latentmotion.vae.loss import VAEObjective

FEATURES, FRAMES = 150, 60


def mld_humanact12() -> Experiment:
    """HumanAct12's 12 actions; steps of 64 at a constant 1e-4 (the authors' number is open)."""
    return _mld_actions("mld_humanact12", classes=12)


def mld_uestc() -> Experiment:
    """UESTC's 40 actions, with the settings of HumanAct12: the authors released none."""
    return _mld_actions("mld_uestc", classes=40)


def _mld_actions(name: str, classes: int) -> Experiment:
    cropping = Cropping(unit=FRAMES, max_frames=FRAMES, min_frames=FRAMES)
    training = constant_rate(steps=100_000, validate_every=1_000, sample_every=10_000)
    return Experiment(
        name=name,
        vae=actor_vae(FEATURES),
        vae_objective=VAEObjective(joints=0.0, vertices=1.0),
        vae_cropping=cropping,
        vae_training=training,
        latents=LatentSettings(cropping, per_item=8, normalized=False),
        denoiser=DenoiserConfig(
            latent_width=256,
            condition_width=classes,
            transformer=TransformerConfig(layers=15),
            project_latents=False,
            condition_projection="table",
            places="latents_first",
            sine_width=256,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=Sampling(steps=50, guidance=7.5),
        mirrored=False,
        task="action",
    )
