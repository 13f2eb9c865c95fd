"""Models of the tables: functions from experiment to experiment, one per row or shared by several.

A model starts from a preset and changes parts of it, in the paper's sizes; a budget then makes the
experiment smaller. The first stage is that of the model itself, or that of another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from latentmotion.diffusion.parametrization import Epsilon, Parametrization, Sample, Velocity
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.model import config
from latentmotion.reproduce.budget import Budget, Change
from latentmotion.training.experiment import Experiment
from latentmotion.training.presets import (
    actor_vae,
    fast,
    mdm,
    mdm_50,
    mld_humanact12,
    mld_humanml3d,
    mld_no_vae,
    mld_uestc,
    starter,
)

FIRST_STAGE = ("vae", "vae_objective", "vae_cropping", "vae_training", "mirrored")
"""Parts of an experiment that determine the first stage."""


@dataclass(frozen=True)
class Model:
    """A trained model, which one or several rows measure."""

    name: str
    """Folder of its runs."""
    preset: Callable[[], Experiment] = mld_humanml3d
    """Experiment that the changes start from."""
    changes: tuple[Change, ...] = ()
    """Changes of the preset, in the paper's sizes."""
    task: Literal["text", "action", "unconditional"] = "text"
    """Task of the denoiser."""
    first: str = ""
    """Model whose first stage it uses; empty for its own."""
    encoder: str = ""
    """Name of its text encoder; empty for the one that the command names."""
    shipped: str = ""
    """Model that ships, which is taken as it is; empty for one that is trained."""
    equal: Literal["", "FLOPs", "crops"] = ""
    """What its training has as much of as both stages of MLD-1 of z₀; empty for the budget's
    steps."""

    @property
    def raw(self) -> bool:
        """Whether it diffuses raw frames, without a first stage."""
        return isinstance(self.preset().vae, config.IdentityVAEConfig)

    def experiment(self) -> Experiment:
        """Returns the changed preset, in the paper's sizes."""
        experiment = self.preset()
        for change in self.changes:
            experiment = change(experiment)
        return experiment

    def first_stage(self, budget: Budget, features: int) -> Experiment:
        """Returns the experiment that trains the VAE; parts of the second stage are the preset's.

        Args:
            budget: Sizes.
            features: Features per frame of the data.
        """
        changed = self.experiment()
        parts = {part: getattr(changed, part) for part in (*FIRST_STAGE, "latents")}
        experiment = replace(self.preset(), name=self.name, **parts)
        return _fitted(budget.shrink(experiment), features)

    def second_stage(
        self, first: Experiment, budget: Budget, features: int, condition_width: int | None
    ) -> Experiment:
        """Returns the experiment that trains the denoiser.

        Args:
            first: Experiment of the VAE.
            budget: Sizes.
            features: Features per frame of the data.
            condition_width: Width of the text encoder; None if there is none.
        """
        changed = replace(self.experiment(), name=self.name, task=self.task)
        experiment = _fitted(budget.shrink(changed), features)
        if not self.raw:
            experiment = replace(experiment, **{p: getattr(first, p) for p in FIRST_STAGE})
        width = experiment.vae.latent_space().width
        denoiser = replace(
            experiment.denoiser,
            latent_width=width,
            condition_width=condition_width or experiment.denoiser.condition_width,
        )
        if not denoiser.project_latents:
            denoiser = replace(denoiser, transformer=replace(denoiser.transformer, width=width))
        return replace(experiment, denoiser=denoiser)


def _fitted(experiment: Experiment, features: int) -> Experiment:
    """Fits the VAE to the features of the data and, if its length is fixed, to the longest crop."""
    vae = experiment.vae.for_data(features, experiment.vae_cropping.max_frames)
    return replace(experiment, vae=vae)


def with_vae(vae: config.VAEConfig) -> Change:
    """Returns the change to another VAE."""
    return lambda experiment: replace(experiment, vae=vae)


def with_seven_tokens(**settings: Any) -> Change:
    """Returns the change to MLD-7's VAE with other settings of its transformer."""
    transformer = config.TransformerConfig(**settings)
    return with_vae(config.TransformerVAEConfig(tokens=7, transformer=transformer))


def with_denoiser(**settings: Any) -> Change:
    """Returns a change of settings of the denoiser."""
    return lambda e: replace(e, denoiser=replace(e.denoiser, **settings))


def with_objective(**settings: Any) -> Change:
    """Returns a change of settings of the denoiser's objective."""
    return lambda e: replace(e, denoiser_objective=replace(e.denoiser_objective, **settings))


def with_denoiser_training(**settings: Any) -> Change:
    """Returns a change of how the denoiser is trained."""
    return lambda e: replace(e, denoiser_training=replace(e.denoiser_training, **settings))


def with_batches_of(size: int) -> Change:
    """Returns the change to another batch size of the denoiser, for as many epochs."""

    def change(experiment: Experiment) -> Experiment:
        training = experiment.denoiser_training
        steps = round(training.steps * training.batch_size / size)
        return with_denoiser_training(batch_size=size, steps=steps)(experiment)

    return change


def with_four_times_the_steps(experiment: Experiment) -> Experiment:
    """Trains the denoiser for four times the steps."""
    steps = 4 * experiment.denoiser_training.steps
    return with_denoiser_training(steps=steps)(experiment)


def with_kept_models(experiment: Experiment) -> Experiment:
    """Keeps the denoiser at every fifth of its training."""
    return with_denoiser_training(keep=5)(experiment)


def with_latents(**settings: Any) -> Change:
    """Returns a change of how latents are kept for the denoiser."""
    return lambda e: replace(e, latents=replace(e.latents, **settings))


def with_text(**settings: Any) -> Change:
    """Returns a change of which tokens the denoiser gets from a sentence."""
    return lambda e: replace(e, conditioning=replace(e.conditioning, **settings))


def with_papers_loss(experiment: Experiment) -> Experiment:
    """Trains a VAE of the fast family with the loss terms of the paper."""
    objective = replace(experiment.vae_objective, velocity=0.0, kl=1e-4, joints_huber_delta=1.0)
    return replace(experiment, vae_objective=objective)


def with_papers_schedule(parametrization: Parametrization) -> Change:
    """Returns the change to the paper's noise schedule and uniform timesteps."""

    def change(experiment: Experiment) -> Experiment:
        objective = replace(
            experiment.denoiser_objective,
            schedule=ScaledLinear(),
            parametrization=parametrization,
            times="uniform",
        )
        return with_denoiser(time_scale=1.0)(replace(experiment, denoiser_objective=objective))

    return change


def as_autoencoder(experiment: Experiment) -> Experiment:
    """Trains the VAE without KL term and the denoiser on the posterior's means."""
    objective = replace(experiment.vae_objective, kl=0.0)
    return with_latents(sampled=False)(replace(experiment, vae_objective=objective))


def without_mirrored(experiment: Experiment) -> Experiment:
    """Leaves out mirrored clips, which contradict labels that name left or right."""
    return replace(experiment, mirrored=False)


def _mld(name: str, *changes: Change, encoder: str = "") -> Model:
    """A denoiser on the latents of MLD-1."""
    return Model(name, changes=changes, first="mld_1", encoder=encoder)


def _fast(name: str, *changes: Change) -> Model:
    """A denoiser on the latents of the fast family's VAE."""
    return Model(f"fast_{name}", fast, changes, first="fast")


NO_SKIPS = config.TransformerConfig(skips=False)

OF_Z0 = with_objective(parametrization=Sample())
"""The change to a denoiser that predicts the clean latents."""

STANDARDIZED = with_denoiser(condition_projection="standardized")
"""The change to sentences in unit scale, without the ReLU that was made for CLIP's."""

VAES = (
    Model("mld_1", changes=(with_kept_models,)),
    *(
        Model(f"mld_{n}", changes=(with_vae(config.TransformerVAEConfig(tokens=n)),))
        for n in (2, 5, 7, 10)
    ),
    Model("actor", changes=(with_vae(actor_vae(263)),)),
    Model("vposer_t", changes=(with_vae(config.VPoserTConfig()),)),
    Model("mld_7_no_skip", changes=(with_seven_tokens(skips=False),)),
    *(Model(f"mld_7_{n}_layers", changes=(with_seven_tokens(layers=n),)) for n in (7, 11)),
    Model("mld_1_two_rates", changes=(with_vae(config.TransformerVAEConfig(decoding="two_rate")),)),
    Model(
        "mld_1_coarse",
        changes=(with_vae(config.TransformerVAEConfig(decoding="two_rate", fine_layers=0)),),
    ),
    Model("autoencoder", changes=(as_autoencoder,)),
    Model("autoencoder_7", changes=(as_autoencoder, with_seven_tokens())),
)
"""VAEs, and denoisers on their latents (tables 1, 4, 5, 8 and the appendix)."""

DENOISERS = (
    _mld("cross", with_denoiser(attention="cross")),
    _mld("cross_no_skip", with_denoiser(attention="cross", transformer=NO_SKIPS)),
    _mld("denoiser_no_skip", with_denoiser(transformer=NO_SKIPS), with_kept_models),
    *(
        _mld(f"denoiser_{n}_layers", with_denoiser(transformer=config.TransformerConfig(layers=n)))
        for n in (5, 7, 11)
    ),
    _mld("z0", OF_Z0),
    _mld("epsilon_standardized", STANDARDIZED),
    _mld("epsilon_min_snr", STANDARDIZED, with_objective(snr_gamma=0.2)),
    _mld("z0_standardized", OF_Z0, STANDARDIZED),
    _mld("velocity_standardized", with_objective(parametrization=Velocity()), STANDARDIZED),
    Model("mld_7_z0", changes=(OF_Z0,), first="mld_7"),
    _mld("mld_1_longer", with_four_times_the_steps),
    *(_mld(f"dropped_{p}", with_objective(dropped=p / 100)) for p in (5, 15, 20, 25, 30)),
    *(_mld(f"batch_{n}", with_batches_of(n)) for n in (32, 128, 256, 512)),
)
"""Denoisers by shape, objective, guidance dropout and batch size (tables 5, 9 and the appendix)."""

_LANGUAGE = (with_batches_of(500),)

TEXT_ENCODERS = (
    _mld("clip_pooled", with_text(pooled=True, words=0), *_LANGUAGE, encoder="clip"),
    _mld("clip_words", with_text(pooled=False, words=77), *_LANGUAGE, encoder="clip_hidden"),
    _mld("bert", with_text(pooled=False, words=77), *_LANGUAGE, encoder="distilbert"),
    # MiniLM's sentences have length 1, so the comparison would be one of scales.
    _mld("minilm", with_text(pooled=True, words=0), STANDARDIZED, *_LANGUAGE, encoder="minilm"),
)
"""Text encoders, read as one pooled vector or as words (appendix)."""

BASELINES_AND_TASKS = (
    Model("mdm", mdm),
    Model("mdm_50", mdm_50),
    *(
        model
        for equal in ("crops", "FLOPs")
        for model in (
            Model(f"mdm_50_{equal.lower()}", mdm_50, equal=equal),
            Model(f"no_vae_{equal.lower()}", mld_no_vae, (OF_Z0,), equal=equal),
        )
    ),
    Model("starter", starter, shipped="starter"),
    Model("fast_shipped", fast, shipped="fast"),
    Model(
        "action_mld",
        changes=(without_mirrored, with_denoiser(condition_projection="table")),
        task="action",
    ),
    Model("action_raw", mdm_50, (without_mirrored,), task="action"),
    Model("action_humanact12", mld_humanact12, task="action"),
    Model("action_uestc", mld_uestc, task="action"),
    Model("action_mdm", mdm, (without_mirrored,), task="action"),
    Model("unconditional_mdm", mdm, task="unconditional"),
    Model(
        "unconditional_no_skip",
        changes=(with_denoiser(transformer=NO_SKIPS),),
        task="unconditional",
        first="mld_1",
    ),
    *(
        Model(f"unconditional_mld_{n}", task="unconditional", first=f"mld_{n}")
        for n in (1, 2, 5, 7, 10)
    ),
)
"""Baselines, and models of action labels and of no condition (tables 1, 3 and 6)."""

LATENT_SPACES = (
    *(
        Model(
            f"narrow_16x{width}",
            changes=(with_vae(config.TransformerVAEConfig(tokens=16, latent_width=width)),),
        )
        for width in (16, 32)
    ),
    Model("conv_paper_loss", fast, (with_papers_loss,)),
    Model("conv_32", fast, (lambda e: replace(e, vae=replace(e.vae, channels=32)),)),
    *(
        Model(f"flow_on_{name}", fast, first=name)
        for name in ("mld_1", "mld_7", "narrow_16x16", "narrow_16x32")
    ),
)
"""Latent spaces, and the fast family's flow on each of them."""

FAST = (
    Model("fast", fast),
    _fast("seed_1", with_denoiser_training(seed=1)),
    _fast("z0_linear", with_objective(parametrization=Sample())),
    _fast("uniform", with_objective(times="uniform")),
    _fast("v", with_papers_schedule(Velocity())),
    _fast("epsilon", with_papers_schedule(Epsilon())),
    _fast("z0", with_papers_schedule(Sample())),
    _fast("not_normalized", with_latents(normalized=False)),
    _fast("relu", with_denoiser(condition_projection="relu_linear")),
    _fast("pooled", with_text(words=0)),
    _fast("words", with_text(pooled=False)),
    _fast("cross", with_denoiser(attention="cross")),
    _fast("no_skips", with_denoiser(transformer=NO_SKIPS)),
    _fast("no_length", with_denoiser(length_token=False)),
)
"""The fast family's recipe, and one change of it at a time."""

MODELS = {
    model.name: model
    for model in (
        *VAES,
        *DENOISERS,
        *TEXT_ENCODERS,
        *BASELINES_AND_TASKS,
        *LATENT_SPACES,
        *FAST,
    )
}
"""Every model of the tables by name."""
