"""Budgets: the sizes in which tables are run, those of the paper or small ones for two cores.

They are in `budgets.toml`.

Models of the tables, from `models.toml`: one per row or shared by several.

A model starts from a preset and changes parts of it, in the paper's sizes; a budget then makes the
experiment smaller. The first stage is that of the model itself, or that of another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from latentmotion.evaluation.protocol import Protocol, Repeats
from latentmotion.model import config
from latentmotion.storage.configuration import from_json
from latentmotion.storage.reading import packaged_toml
from latentmotion.training.experiment import Experiment, preset_named, with_changes, with_settings


@dataclass(frozen=True)
class Adjustment:
    """Settings that the pages of tables mention."""

    settings: tuple[str, ...]  # Each `part.key=value`, as on the command line.
    described: str = ""  # Description; by default the settings themselves.

    @property
    def says(self) -> str:
        """Description of the change."""
        return self.described or ", ".join(self.settings)


@dataclass(frozen=True)
class Budget:
    """Sizes in which tables are trained and measured."""

    name: str  # Name on the command line.
    says: str  # Description for the pages of tables.
    settings: tuple[str, ...] = ()  # Changes of every model.
    raw: tuple[str, ...] = ()  # Further changes of models that diffuse raw frames.
    per_item: int = 0  # Kept crops of an item, where a preset has fresh ones; 0 for fresh ones.
    # Width of transformers, of convolutions and of VPoser-t's latent; twice that inside.
    width: int | None = None
    # Layers of transformers by those of the paper.
    layers: Mapping[int, int] = field(default_factory=dict)
    max_frames: int | None = None  # Longest motion that is measured.
    replications: int = 20  # Replications of a measurement.
    slow: int = 20  # Most replications of rows of 1000 steps.
    repeats: Repeats | None = None  # Size of MultiModality; by default that of the protocol.
    # Further changes of every model of a table.
    of_tables: Mapping[str, Adjustment] = field(default_factory=dict)
    # Further changes of single models, which their rows warn of.
    of_models: Mapping[str, Adjustment] = field(default_factory=dict)
    further: tuple[Adjustment, ...] = ()  # Changes of every model after all others.

    def of_table(self, name: str) -> Budget:
        """Returns the budget of a table by name."""
        return self._adjusted(self.of_tables[name]) if name in self.of_tables else self

    def changed(self, settings: Sequence[str]) -> Budget:
        """Returns the budget with further settings of every model, which its description lists.

        Args:
            settings: Each `part.key=value`, as on the command line.
        """
        if not settings:
            return self
        return self._adjusted(Adjustment(tuple(settings)))

    def _adjusted(self, by: Adjustment) -> Budget:
        says = f"{self.says}; changed: {by.says}"
        return replace(self, further=(*self.further, by), says=says)

    def protocol(self, protocol: Protocol) -> Protocol:
        """Returns a protocol in this budget's sizes."""
        repeats = self.repeats or protocol.repeats
        return replace(protocol, max_frames=self.max_frames, repeats=repeats)

    def shrink(self, experiment: Experiment) -> Experiment:
        """Returns the experiment in this budget's sizes."""
        smaller = with_changes(experiment, self.settings)
        if self.per_item and not experiment.latents.per_item:
            smaller = with_changes(smaller, [f"latents.per_item={self.per_item}"])
        if not experiment.vae.has_weights:
            smaller = with_changes(smaller, self.raw)
        if self.width is not None:
            transformer = smaller.denoiser.transformer.scaled(self.width, self.layers)
            smaller = replace(
                smaller,
                vae=smaller.vae.scaled(self.width, self.layers),
                denoiser=replace(smaller.denoiser, transformer=transformer),
            )
        single = self.of_models.get(experiment.name)
        for adjustment in (*([single] if single else []), *self.further):
            smaller = with_changes(smaller, adjustment.settings)
        return smaller


BUDGETS: dict[str, Budget] = {}
for _name, _row in packaged_toml(__file__, "budgets.toml").items():
    _adjusted = {
        part: {key: from_json(Adjustment, each) for key, each in _row.pop(part, {}).items()}
        for part in ("of_tables", "of_models")
    }
    _adjusted["layers"] = {int(n): fewer for n, fewer in _row.pop("layers", {}).items()}
    BUDGETS[_name] = replace(from_json(Budget, {"name": _name, **_row}), **_adjusted)
PAPER, SMALL = BUDGETS["paper"], BUDGETS["small"]


# Parts of an experiment that determine the first stage.
FIRST_STAGE = ("vae", "vae_objective", "vae_cropping", "vae_training", "mirrored")


@dataclass(frozen=True)
class Model:
    """A trained model, which one or several rows measure."""

    name: str  # Folder of its runs.
    preset: str = "mld_humanml3d"  # Preset that it starts from.
    # Settings that differ from the preset's, in the paper's sizes.
    set: dict[str, Any] = field(default_factory=dict)
    task: Literal["text", "action", "unconditional"] = "text"  # Task of the denoiser.
    first: str = ""  # Model whose first stage it uses; empty for its own.
    encoder: str = ""  # Name of its text encoder; empty for the one that the command names.
    shipped: str = ""  # Model that ships, which is taken as it is; empty for one that is trained.
    # What its training has as much of as both stages of MLD-1 of z₀; empty for the budget's steps.
    equal: Literal["", "FLOPs", "crops"] = ""

    @property
    def raw(self) -> bool:
        """Whether it diffuses raw frames, without a first stage."""
        return isinstance(preset_named(self.preset).vae, config.IdentityVAEConfig)

    def experiment(self) -> Experiment:
        """Returns the changed preset, in the paper's sizes."""
        return with_settings(preset_named(self.preset), self.set)

    def first_stage(self, budget: Budget, features: int) -> Experiment:
        """Returns the experiment that trains the VAE; parts of the second stage are the preset's.

        Args:
            budget: Sizes.
            features: Features per frame of the data.
        """
        changed = self.experiment()
        parts = {part: getattr(changed, part) for part in (*FIRST_STAGE, "latents")}
        experiment = replace(preset_named(self.preset), name=self.name, **parts)
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


# Every model of the tables by name.
MODELS = {
    name: from_json(Model, {"name": name, **row})
    for name, row in packaged_toml(__file__, "models.toml").items()
}
