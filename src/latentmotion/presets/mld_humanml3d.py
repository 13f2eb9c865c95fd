"""The paper's model for HumanML3D: MLD-1, trained as the authors' code trains it (section 4)."""

from __future__ import annotations

from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.experiment import Experiment, LatentSettings
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import TransformerVAEConfig
from latentmotion.presets.constant_rate import constant_rate
from latentmotion.vae.loss import VAEObjective


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
            places="latents_first",
            sine_width=768,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=Sampling(steps=50, guidance=7.5),
    )
