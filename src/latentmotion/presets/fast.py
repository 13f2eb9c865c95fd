"""The fast family at the size of HumanML3D: the starter's recipe, wider, deeper and trained longer.

Nothing here was trained on HumanML3D yet: where a size comes from is said beside it, and
docs/results.md shows what each part of the recipe does on little data.
"""

from __future__ import annotations

from dataclasses import replace

from latentmotion.data.sampling import Cropping
from latentmotion.experiment import Experiment, LatentSettings, TrainingSettings
from latentmotion.model.config import Sampling, TransformerConfig
from latentmotion.model.vae_config import TransformerVAEConfig
from latentmotion.presets.starter import VAE, starter
from latentmotion.vae.loss import VAEObjective

_MOTIONS = Cropping(unit=4, max_frames=196, min_frames=40)
"""HumanML3D's lengths."""


def fast() -> Experiment:
    """Convolutional latents, T/4 × 24, and a flow of nine layers over them.

    * VAE: 512 wide with dilations 1, 3 and 9, as T2M-GPT's and MoMask's convolutions are; 24
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
