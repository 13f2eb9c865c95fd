"""The model that ships: convolutional VAE, and a flow of velocities over its latents."""

from __future__ import annotations

from latentmotion.condition.sentence import SentenceReading
from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.denoiser import DenoiserConfig
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.diffusion.prediction import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.experiment import Experiment, LatentSettings, Sampling, TrainingSettings
from latentmotion.nn.transformer import TransformerConfig
from latentmotion.vae.convolutional import ConvolutionalVAEConfig
from latentmotion.vae.loss import VAEObjective


def starter() -> Experiment:
    """Learns from a few hundred clips on two cores in an hour."""
    return Experiment(
        name="starter",
        vae=ConvolutionalVAEConfig(),
        vae_objective=VAEObjective(joints=1.0, steps=0.1, divergence=1e-3, joints_knee=0.05),
        vae_cropping=Cropping(unit=4, max_frames=64, min_frames=16),
        vae_training=TrainingSettings(
            steps=7_000, batch_size=32, learning_rate=1e-3, precision="bfloat16"
        ),
        latents=LatentSettings(Cropping(unit=4, max_frames=196, min_frames=12), per_item=8),
        denoiser=DenoiserConfig(
            latent_width=16,
            condition_width=384,
            transformer=TransformerConfig(width=256, layers=5, hidden=512, dropout=0.1),
            time_scale=1000.0,
            length_token=True,
        ),
        denoiser_objective=DenoiserObjective(
            schedule=LinearPath(), prediction=Velocity(), times="logit_normal"
        ),
        denoiser_training=TrainingSettings(
            steps=6_000,
            batch_size=64,
            learning_rate=1e-3,
            warm_up=500,
            precision="bfloat16",
        ),
        sampling=Sampling(steps=50, guidance=3.0),
        reading=SentenceReading(pooled=True, words=16),
    )
