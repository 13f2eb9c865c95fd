"""Settings of a distillation: everything that decides its result but teacher and data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.few_step import FewStepConfig
from latentmotion.training.experiment import TrainingSettings


@dataclass(frozen=True)
class TrajectoryRegression:
    """Regression on trajectories that the teacher computes beforehand: exact, but finitely many."""

    trajectories: int = 4096
    """Number of trajectories; they are kept in the run folder."""
    asked: int = 0
    """Further trajectories, for prompts whose fulfillment can be measured, none of them of the
    instruction benchmark; those that fail are not learned from, so that a student may obey more
    than its teacher."""


@dataclass(frozen=True)
class PhasedConsistency:
    """Phased consistency (Wang et al. 2024): motions, noise and scales are new at every step.

    From anywhere in a phase the student is trained to arrive where its own average arrives after
    one guided step of the teacher.
    """

    per_item: int = 4
    """Crops kept of each clip, or part of a clip with sentences of its own."""


@dataclass(frozen=True)
class Distillation:
    """Settings of `latentmotion train distill`; the defaults are for two cores and some minutes."""

    name: str = "student"
    """What the model is called."""
    few_step: FewStepConfig = field(default_factory=FewStepConfig)
    """Step counts and guidance scales that the student learns."""
    objective: TrajectoryRegression | PhasedConsistency = field(
        default_factory=TrajectoryRegression
    )
    """What it learns from."""
    solver: Literal["dpm++", "ddim"] = "dpm++"
    """Sampler of the teacher's trajectories.

    `dpm++` is nearer to the exact trajectory; use `ddim` for teachers better in coarse steps.
    """
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=196, min_frames=12))
    """Lengths of motions, within those that the teacher makes."""
    huber_delta: float = 1.0
    """Error at which the loss changes from quadratic to linear (Huber)."""
    mirrored: bool = True
    """Whether prompts of mirrored clips are used too."""
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
