"""MDM (Tevet et al. 2023), the paper's strongest rival: diffusion on raw frames, which is slow.

Train it with `latentmotion train denoiser --vae none --preset mdm`; there is no first stage.
"""

from __future__ import annotations

from latentmotion.baselines.mdm import mdm_denoiser
from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.loss import DenoiserObjective
from latentmotion.diffusion.prediction import Sample
from latentmotion.diffusion.schedule import Cosine
from latentmotion.experiment import Experiment, LatentSettings
from latentmotion.model.config import Sampling
from latentmotion.model.vae_config import IdentityVAEConfig
from latentmotion.presets.constant_rate import constant_rate
from latentmotion.vae.loss import VAEObjective


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
        denoiser_objective=DenoiserObjective(schedule=Cosine(steps), prediction=Sample()),
        denoiser_training=training,
        sampling=Sampling(steps=steps, guidance=2.5, sampler="ddpm"),
    )


def mdm_50() -> Experiment:
    """The fast form: trained, not only sampled, with 50 steps."""
    return mdm(steps=50)
