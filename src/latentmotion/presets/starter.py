"""The model that ships: convolutional VAE, and a flow of velocities over its latents."""

from __future__ import annotations

from latentmotion.condition.sentence import SentenceReading
from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.diffusion.prediction import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.experiment import Experiment, LatentSettings, TrainingSettings
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import ConvolutionalVAEConfig, QuarterRateDecoder
from latentmotion.vae.loss import VAEObjective

VAE = ConvolutionalVAEConfig(channels=24, decoder=QuarterRateDecoder((9, 3, 1, 3, 1)))
"""24 numbers for 4 frames, and a decoder at a quarter of the frame rate."""


def starter() -> Experiment:
    """Learns from seven hours of motion on two cores in two hours.

    The VAE's loss weighs what the eye sees first: velocities, feet that stand, lengths of bones.
    """
    return Experiment(
        name="starter",
        vae=VAE,
        vae_objective=VAEObjective(
            joints=1.0, steps=0.5, contacts=0.5, bones=1.0, divergence=1e-3, joints_knee=0.01
        ),
        vae_cropping=Cropping(unit=4, max_frames=96, min_frames=16),
        vae_training=TrainingSettings(
            steps=10_000, batch_size=48, learning_rate=7e-4, warm_up=500, precision="bfloat16"
        ),
        latents=LatentSettings(Cropping(unit=4, max_frames=196, min_frames=12), per_item=2),
        denoiser=DenoiserConfig(
            latent_width=24,
            condition_width=384,
            transformer=TransformerConfig(width=256, layers=5, hidden=768, dropout=0.1),
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
        reading=SentenceReading(pooled=True, words=24),
    )
