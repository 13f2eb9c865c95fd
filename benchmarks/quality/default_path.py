"""A motion as `latentmotion generate` makes it."""

from __future__ import annotations

from typing import Any

from latentmotion import Motion, MotionPipeline
from latentmotion.ranking.best import usual_takes


def default_motion(
    pipeline: MotionPipeline, prompt: str, seed: int, takes: int | None = None, **settings: Any
) -> Motion:
    """Returns the best of several takes, cleaned up.

    Args:
        pipeline: The model.
        prompt: A sentence.
        seed: Takes of different seeds have no noise in common.
        takes: Number of takes; by default as many as the command makes.
        settings: As for the pipeline, such as `seconds`.
    """
    takes = takes or usual_takes(pipeline.card, prompt)
    return pipeline(prompt, seed=seed * takes, takes=takes, **settings)
