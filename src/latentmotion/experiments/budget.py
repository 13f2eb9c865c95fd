"""How large a table is run: as in the paper, or small enough for two cores.

The small budget keeps every difference between rows. It halves the width, turns the paper's 5, 7, 9
and 11 layers into 1, 3, 5 and 7, shortens motions to 64 frames and training to a few thousand
steps at a higher rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from latentmotion.errors import InputError, hint
from latentmotion.evaluation.settings import Protocol, Repeats
from latentmotion.experiment import Experiment, with_changes

LAYERS = {5: 1, 6: 5, 7: 3, 8: 5, 9: 5, 11: 7, 15: 5}
"""The small budget's layers by the paper's; ACTOR's 6 and MDM's 8 become 5 as MLD's 9 do."""


@dataclass(frozen=True)
class Budget:
    """What is made smaller."""

    name: str
    """What the command line calls it."""
    says: str
    """What the report says of it."""
    changes: tuple[str, ...] = ()
    """Changes of every model."""
    raw: tuple[str, ...] = ()
    """Further changes of diffusion on raw frames."""
    width: int | None = None
    """Width of transformers, of convolutions and of VPoser-t's latent; twice that inside."""
    layers: Mapping[int, int] = field(default_factory=dict)
    """Layers of transformers by the paper's."""
    max_frames: int | None = None
    """Longest motion that is measured."""
    replications: int = 20
    """Repetitions of a measurement."""
    slow: int = 20
    """Most repetitions of rows of 1000 steps."""
    repeats: Repeats | None = None
    """How much MultiModality asks for; by default as the protocol has it."""
    of_tables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Further changes of every model of a table."""
    of_models: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Further changes of single models, which their rows warn of."""
    further: tuple[str, ...] = ()
    """Changes of every model after all others."""

    def of_table(self, name: str) -> Budget:
        """Returns the budget of a table by name."""
        return self.changed(self.of_tables.get(name, ()))

    def changed(self, changes: Sequence[str]) -> Budget:
        """Returns the budget with further changes of every model, which its text tells of."""
        says = f"{self.says}; changed: {', '.join(changes)}" if changes else self.says
        return replace(self, further=(*self.further, *changes), says=says)

    def protocol(self, protocol: Protocol) -> Protocol:
        """Returns how much is measured in this budget."""
        most = self.repeats or protocol.repeats
        return replace(protocol, max_frames=self.max_frames, repeats=most)

    def shrink(self, experiment: Experiment) -> Experiment:
        """Returns the experiment in this budget's sizes."""
        raw = () if experiment.vae.has_weights else self.raw
        smaller = with_changes(experiment, [*self.changes, *raw])
        smaller = self._scaled(smaller)
        return with_changes(smaller, [*self.of_models.get(experiment.name, ()), *self.further])

    def _scaled(self, experiment: Experiment) -> Experiment:
        if self.width is None:
            return experiment
        transformer = experiment.denoiser.transformer.scaled(self.width, self.layers)
        return replace(
            experiment,
            vae=experiment.vae.scaled(self.width, self.layers),
            denoiser=replace(experiment.denoiser, transformer=transformer),
        )


def _training(stage: str, *changes: str) -> tuple[str, ...]:
    shared = (
        "learning_rate=5e-4",
        "warm_up=200",
        "schedule=cosine",
        "gradient_clip=1.0",
        "ema_decay=0.999",
        "report_every=100",
        "validate_every=500",
        "sample_every=0",
    )
    return tuple(f"{stage}_training.{change}" for change in (*shared, *changes))


_CROPS = tuple(
    f"{part}.{key}"
    for part in ("vae_cropping", "latents.cropping")
    for key in ("max_frames=64", "min_frames=16")
)

_SHORT_FLOW = tuple(
    f"denoiser_training.{change}"
    for change in ("steps=700", "batch_size=32", "learning_rate=1e-3", "warm_up=100")
)

PAPER = Budget("paper", "sizes and steps of the paper")

SMALL = Budget(
    "small",
    "width 128 instead of 256, hidden 256 instead of 1024, 5 layers for 9 (1, 3, 7 for 5, 7, 11), "
    "no dropout in VAEs, motions of 16 to 64 frames; VAE: 2,500 steps of 32; diffusion on latents: "
    "4,000 steps of 64; on raw frames: 2,500 steps of 32; rates fall from 5e-4 as a cosine, "
    "weights are averaged",
    changes=(
        *_CROPS,
        *_training("vae", "steps=2500", "batch_size=32", "precision=bfloat16",
                   "snapshot_every=100"),
        *_training("denoiser", "steps=4000", "snapshot_every=500"),
    ),
    raw=("denoiser_training.steps=2500", "denoiser_training.batch_size=32"),
    width=128,
    layers=LAYERS,
    of_tables=dict.fromkeys(("fast", "fast_vae"), _SHORT_FLOW),
    of_models=dict.fromkeys(("narrow_16x16", "narrow_16x32"), ("vae_training.steps=1000",)),
    max_frames=64,
    replications=5,
    slow=1,
    repeats=Repeats(texts=20, samples=10, replications=1),
)  # fmt: skip

BUDGETS = {budget.name: budget for budget in (PAPER, SMALL)}


def budget_named(name: str) -> Budget:
    """Returns a budget.

    Raises:
        InputError: There is none of this name; the nearest is named.
    """
    if name not in BUDGETS:
        raise InputError(f"unknown budget {name!r}; {hint(name, BUDGETS)}")
    return BUDGETS[name]
