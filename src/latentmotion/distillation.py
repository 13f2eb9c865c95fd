"""How a model of few steps is made of a trained one: all that decides it but teacher and data."""

from __future__ import annotations

from dataclasses import dataclass, field

from latentmotion.data.sampling import Cropping
from latentmotion.diffusion.leaps import Leaps
from latentmotion.experiment import TrainingSettings


@dataclass(frozen=True)
class Distillation:
    """Settings of `latentmotion train distill`; the defaults are for two cores and some minutes."""

    name: str = "student"
    """What the model is called."""
    leaps: Leaps = field(default_factory=Leaps)
    """What the student shall be able to do."""
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=196, min_frames=12))
    """Of what lengths the teacher is asked for motions."""
    ways: int = 4096
    """Motions that it is asked for; they are kept in the run folder."""
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
    """How the student is optimized."""
