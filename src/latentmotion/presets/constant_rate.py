"""How the paper trains: AdamW at a constant rate of 1e-4, nothing clipped or averaged."""

from __future__ import annotations

from latentmotion.experiment import TrainingSettings


def constant_rate(
    steps: int,
    weight_decay: float = 0.01,
    validate_every: int = 5_000,
    sample_every: int = 20_000,
) -> TrainingSettings:
    """Returns the settings of either stage, in steps of 64."""
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
