"""How a model of few steps is made of a trained one: all that decides it but teacher and data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.leaps import Leaps
from latentmotion.experiment import TrainingSettings


@dataclass(frozen=True)
class Regression:
    """The student learns leaps along ways that its teacher has gone: exact, but only so many."""

    ways: int = 4096
    """Ways that the teacher goes; they are kept in the run folder."""


@dataclass(frozen=True)
class PhasedConsistency:
    """Phased consistency (Wang et al. 2024): motions, noise and scales are new at every step.

    From anywhere in a leap's phase the student shall come to where its own average comes to after
    one guided step of the teacher.
    """

    per_item: int = 4
    """Crops kept of each clip, or part of a clip with sentences of its own."""


@dataclass(frozen=True)
class Distillation:
    """Settings of `latentmotion train distill`; the defaults are for two cores and some minutes."""

    name: str = "student"
    """What the model is called."""
    leaps: Leaps = field(default_factory=Leaps)
    """What the student shall be able to do."""
    objective: Regression | PhasedConsistency = field(default_factory=Regression)
    """What it learns from."""
    solver: Literal["dpm++", "ddim"] = "dpm++"
    """The teacher's rule of a step on ways that the student learns from or is compared with.

    `dpm++` is nearer to the exact way; a teacher that is better in coarse steps teaches those.
    """
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=196, min_frames=12))
    """Of what lengths motions are, of those that the teacher makes."""
    knee: float = 1.0
    """Where the loss turns from squares to absolute values; a large one leaves the squares."""
    mirrored: bool = True
    """Whether prompts of mirrored clips are asked too."""
    training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(
            steps=4_000,
            batch_size=64,
            learning_rate=1e-3,
            weight_decay=0.0,
            ema_decay=0.995,
            precision="bfloat16",
        )
    )
    """How the student is optimized; the teacher answers in the same precision."""
