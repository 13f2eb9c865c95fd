"""Flows over convolutional latents: the shipped model, and the same at full size."""

from __future__ import annotations

from dataclasses import replace

from latentmotion.condition.task import TextConditioning
from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.model.config import DenoiserConfig, Sampling, TransformerConfig
from latentmotion.model.vae_config import (
    ConvolutionalVAEConfig,
    QuarterRateDecoder,
    TransformerVAEConfig,
)
from latentmotion.networks.vae.loss import VAEObjective
from latentmotion.training.denoiser_loss import DenoiserObjective
from latentmotion.training.experiment import Experiment, LatentSettings, TrainingSettings

VAE = ConvolutionalVAEConfig(channels=32, decoder=QuarterRateDecoder((9, 3, 1, 3, 1)))
"""32 numbers for 4 frames, and a decoder at a quarter of the frame rate."""


def starter() -> Experiment:
    """Learns from seven hours of motion on two cores in two hours.

    The VAE's loss weighs what the eye sees first: velocities, quick limbs, feet that stand,
    lengths of bones.
    """
    return Experiment(
        name="starter",
        vae=VAE,
        vae_objective=VAEObjective(
            joints=1.0,
            velocity=0.5,
            limbs=4.0,
            contacts=1.5,
            bones=1.0,
            kl=5e-4,
            joints_huber_delta=0.01,
        ),
        vae_cropping=Cropping(unit=4, max_frames=96, min_frames=16),
        vae_training=TrainingSettings(
            steps=10_000, batch_size=48, learning_rate=7e-4, warm_up=500, precision="bfloat16"
        ),
        latents=LatentSettings(Cropping(unit=4, max_frames=196, min_frames=12), per_item=2),
        denoiser=DenoiserConfig(
            latent_width=32,
            condition_width=384,
            transformer=TransformerConfig(width=256, layers=5, hidden=768, dropout=0.1),
            time_scale=1000.0,
            length_token=True,
        ),
        denoiser_objective=DenoiserObjective(
            schedule=LinearPath(), parametrization=Velocity(), times="logit_normal"
        ),
        denoiser_training=TrainingSettings(
            steps=6_000,
            batch_size=64,
            learning_rate=1e-3,
            warm_up=500,
            precision="bfloat16",
        ),
        sampling=Sampling(steps=50, guidance=6.0, guidance_rule="projected"),
        conditioning=TextConditioning(pooled=True, words=24),
    )


_MOTIONS = Cropping(unit=4, max_frames=196, min_frames=40)
"""HumanML3D's lengths."""


def fast() -> Experiment:
    """Convolutional latents, T/4 × 32, and a flow of nine layers over them.

    * VAE: 512 wide with dilations 1, 3 and 9, as T2M-GPT's and MoMask's convolutions are; 32
      numbers per four frames (MoLingo has 16 or 32); windows of 64 frames, 128 a step, at 2e-4
      with 1,000 steps of warm-up (MLD++); the starter's loss.
    * Denoiser: MLD's nine layers of 256, which FlashMo's comparison of depths favors too.
    * Training: batches of 128 at 2e-4 (MotionLCM), weights averaged over some 10,000 steps. That
      200,000 steps are enough, a fifth of the paper's, is a guess.
    * Sampling: ten steps (FlashMo); the sampler is the one nearest to the exact flow at ten steps.
    """
    small = starter()
    training = TrainingSettings(
        steps=200_000,
        batch_size=128,
        learning_rate=2e-4,
        warm_up=1_000,
        ema_decay=0.9999,
        precision="bfloat16",
        report_every=100,
        validate_every=5_000,
        snapshot_every=1_000,
        sample_every=20_000,
    )
    return replace(
        small,
        name="fast",
        vae=replace(VAE, width=512),
        vae_cropping=Cropping(unit=4, max_frames=64, min_frames=40),
        vae_training=training,
        latents=LatentSettings(_MOTIONS, per_item=8),
        denoiser=replace(small.denoiser, transformer=TransformerConfig()),
        denoiser_training=training,
        sampling=Sampling(steps=10, guidance=small.sampling.guidance, sampler="dpm++"),
    )


def fast_tokens() -> Experiment:
    """The same flow over MLD++'s latents: 16 tokens of 32 numbers through linear adapters.

    The VAE is MLD's transformer with the authors' loss, and sees whole motions: its learned
    positions and tokens know no length that they were not trained with.
    """
    flow = fast()
    return replace(
        flow,
        name="fast_tokens",
        vae=TransformerVAEConfig(tokens=16, latent_width=32),
        vae_objective=VAEObjective(),
        vae_cropping=_MOTIONS,
        denoiser=replace(flow.denoiser, latent_width=32),
    )
