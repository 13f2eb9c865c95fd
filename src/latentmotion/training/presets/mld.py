"""The paper's models: text on HumanML3D, actions on HumanAct12 and UESTC.

The paper trains with AdamW at a constant rate of 1e-4, without clipping or averaging.
"""

from __future__ import annotations

from latentmotion.data.sampling import Cropping
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import TransformerVAEConfig
from latentmotion.networks.vae.loss import VAEObjective
from latentmotion.training.denoiser_loss import DenoiserObjective
from latentmotion.training.experiment import Experiment, LatentSettings, TrainingSettings


def actor_vae(features: int) -> TransformerVAEConfig:
    """Six layers without skips or final normalization, sine positions, one latent token."""
    return TransformerVAEConfig(
        features=features,
        tokens=1,
        transformer=TransformerConfig(layers=6, skips=False, final_norm=False),
        position="sine",
    )


def constant_rate(
    steps: int,
    weight_decay: float = 0.01,
    validate_every: int = 5_000,
    sample_every: int = 20_000,
) -> TrainingSettings:
    """Returns the settings of either stage, in steps of 64."""
    return TrainingSettings(
        steps=steps,
        batch_size=64,
        learning_rate=1e-4,
        warm_up=0,
        schedule="constant",
        weight_decay=weight_decay,
        gradient_clip=None,
        ema_decay=0.0,
        report_every=100,
        validate_every=validate_every,
        snapshot_every=1_000,
        sample_every=sample_every,
    )


def mld_humanml3d() -> Experiment:
    """AdamW at a constant 1e-4; stage 1 runs 6,000 epochs, stage 2 runs 3,000 (steps of 64)."""
    cropping = Cropping(unit=4, max_frames=196, min_frames=40)
    training = constant_rate(steps=1_100_000)
    return Experiment(
        name="mld_humanml3d",
        vae=TransformerVAEConfig(),
        vae_objective=VAEObjective(),
        vae_cropping=cropping,
        vae_training=training,
        latents=LatentSettings(cropping, normalized=False),
        denoiser=DenoiserConfig(
            latent_width=256,
            condition_width=768,
            transformer=TransformerConfig(),
            project_latents=False,
            condition_projection="relu_linear",
            positions="latents_first",
            sine_width=768,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=Sampling(steps=50, guidance=7.5),
    )


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
            positions="latents_first",
            sine_width=256,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=Sampling(steps=50, guidance=7.5),
        mirrored=False,
        task="action",
    )
