"""Experiments ready to train: functions that return one.

The paper trains with AdamW at a constant rate of 1e-4, without clipping or averaging.

MDM (Tevet et al. 2023) diffuses raw frames:

    [time + sentence, frames] + sine positions → 8 post-norm layers, no skips → frames

Two things differ from MDM's code: without a condition it sees the embedding of the empty
sentence, as all our models do, where MDM sees zeros; and attention leaves padding out. Train it
with `latentmotion train denoiser --vae none --preset mdm`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from latentmotion.condition.task import TextConditioning
from latentmotion.data.dataset import Cropping
from latentmotion.diffusion.parametrization import Sample, Velocity
from latentmotion.diffusion.schedule import Cosine, LinearPath, ScaledLinear
from latentmotion.errors import InputError, hint
from latentmotion.model import config
from latentmotion.networks.vae.interface import VAEObjective
from latentmotion.storage.configuration import from_json, read_plain, to_json
from latentmotion.storage.reading import read_text
from latentmotion.training.denoiser_loss import DenoiserObjective
from latentmotion.training.experiment import Experiment, LatentSettings, TrainingSettings


def actor_vae(features: int) -> config.TransformerVAEConfig:
    """Six layers without skips or final normalization, sine positions, one latent token.

    The paper says six heads, which do not divide its width of 256; the authors' code has four.
    """
    return config.TransformerVAEConfig(
        features=features,
        tokens=1,
        transformer=config.TransformerConfig(layers=6, skips=False, final_norm=False),
        position="sine",
    )


def constant_rate(
    steps: int,
    weight_decay: float = 0.01,
    validate_every: int = 5_000,
    sample_every: int = 20_000,
) -> TrainingSettings:
    """Returns the settings of a stage, in steps of 64."""
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
    """AdamW at a constant 1e-4; 6,000 epochs in steps of 128, then 3,000 in steps of 64.

    Stage 2 encodes fresh crops at every step, as the authors do.
    """
    cropping = Cropping(unit=4, max_frames=196, min_frames=40)
    training = constant_rate(steps=1_100_000)
    return Experiment(
        name="mld_humanml3d",
        vae=config.TransformerVAEConfig(),
        vae_objective=VAEObjective(),
        vae_cropping=cropping,
        vae_training=replace(training, batch_size=128),
        latents=LatentSettings(cropping, per_item=0, normalized=False),
        denoiser=config.DenoiserConfig(
            latent_width=256,
            condition_width=768,
            transformer=config.TransformerConfig(),
            project_latents=False,
            condition_projection="relu_linear",
            positions="latents_first",
            sine_width=768,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=config.Sampling(steps=50, guidance=7.5),
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
        latents=LatentSettings(cropping, per_item=0, normalized=False),
        denoiser=config.DenoiserConfig(
            latent_width=256,
            condition_width=classes,
            transformer=config.TransformerConfig(layers=15),
            project_latents=False,
            condition_projection="table",
            positions="latents_first",
            sine_width=256,
        ),
        denoiser_objective=DenoiserObjective(),
        denoiser_training=training,
        sampling=config.Sampling(steps=50, guidance=7.5),
        mirrored=False,
        task="action",
    )


VAE = config.ConvolutionalVAEConfig(channels=32, decoder=config.QuarterRateDecoder((9, 3, 1, 3, 1)))
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
            steps=10_000, batch_size=48, learning_rate=7e-4, warm_up=500, precision="auto"
        ),
        latents=LatentSettings(Cropping(unit=4, max_frames=196, min_frames=12), per_item=2),
        denoiser=config.DenoiserConfig(
            latent_width=32,
            condition_width=384,
            transformer=config.TransformerConfig(width=256, layers=5, hidden=768, dropout=0.1),
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
            precision="auto",
        ),
        sampling=config.Sampling(steps=50, guidance=6.0, guidance_rule="projected"),
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
        precision="auto",
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
        denoiser=replace(small.denoiser, transformer=config.TransformerConfig()),
        denoiser_training=training,
        sampling=config.Sampling(steps=10, guidance=small.sampling.guidance, sampler="dpm++"),
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
        vae=config.TransformerVAEConfig(tokens=16, latent_width=32),
        vae_objective=VAEObjective(),
        vae_cropping=_MOTIONS,
        denoiser=replace(flow.denoiser, latent_width=32),
    )


def mdm_denoiser(features: int, condition_width: int) -> config.DenoiserConfig:
    """The network for HumanML3D has 17.9 million weights."""
    return config.DenoiserConfig(
        latent_width=features,
        condition_width=condition_width,
        transformer=config.TransformerConfig(
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
    return replace(mld_humanml3d(), name="vposer_t", vae=config.VPoserTConfig())


def mld_no_vae() -> Experiment:
    """MLD on raw frames, a plain decoder that looks at time and sentence (`--vae none`)."""
    experiment = mld_humanml3d()
    transformer = config.TransformerConfig(width=512, skips=False)
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
        vae=config.IdentityVAEConfig(),
        latents=replace(experiment.latents, sampled=False),
        denoiser=denoiser,
        denoiser_objective=DenoiserObjective(schedule=ScaledLinear(offset=0, ends_clean=True)),
        sampling=config.Sampling(steps=1000, guidance=7.5, sampler="ddpm"),
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
        vae=config.IdentityVAEConfig(),
        vae_objective=VAEObjective(),
        vae_cropping=cropping,
        vae_training=training,
        latents=LatentSettings(cropping, normalized=False, sampled=False),
        denoiser=mdm_denoiser(263, condition_width=512),
        denoiser_objective=DenoiserObjective(schedule=Cosine(steps), parametrization=Sample()),
        denoiser_training=training,
        sampling=config.Sampling(steps=steps, guidance=2.5, sampler="ddpm"),
    )


def mdm_50() -> Experiment:
    """The fast form: trained, not only sampled, with 50 steps."""
    return mdm(steps=50)


PRESETS: dict[str, Callable[[], Experiment]] = {
    "starter": starter,
    "fast": fast,
    "fast_tokens": fast_tokens,
    "mld_humanml3d": mld_humanml3d,
    "mld_humanact12": mld_humanact12,
    "mld_uestc": mld_uestc,
    "actor": actor,
    "vposer_t": vposer_t,
    "mld_no_vae": mld_no_vae,
    "mdm": mdm,
    "mdm_50": mdm_50,
}


def preset_named(name: str) -> Experiment:
    """Returns a preset, or what a file of settings says.

    Args:
        name: Name of a preset; or a file that ends with .json or .toml: the settings that differ
            from those of a preset, which it names as `preset` (by default starter). The
            `experiment.json` of a run folder is such a file.

    Raises:
        InputError: There is none of this name; the nearest is named. Or the file cannot be read,
            or does not fit.
    """
    if not name.lower().endswith((".json", ".toml")):
        if name not in PRESETS:
            raise InputError(f"unknown preset {name!r}; {hint(name, PRESETS)}")
        return PRESETS[name]()
    path = Path(name)
    if path.suffix.lower() == ".json":
        data = read_plain(path)
    else:
        try:
            data = tomllib.loads(read_text(path))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path}: {error}") from error
    if isinstance(data, dict) and isinstance(data.get("experiment"), dict):
        data = data["experiment"]  # of a run folder
    if not isinstance(data, dict):
        raise InputError(f'{path}: expected an object of settings, e.g. {{"mirrored": false}}')
    base = preset_named(str(data.pop("preset", "starter")))
    try:
        return from_json(Experiment, _changed(to_json(base), data))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _changed(before: Any, after: Any) -> Any:
    """Returns settings with those of another object in their place; other kinds replace them."""
    parts = isinstance(before, dict) and isinstance(after, dict)
    if not parts or after.get("kind", before.get("kind")) != before.get("kind"):
        return after
    return before | {key: _changed(before.get(key), value) for key, value in after.items()}
