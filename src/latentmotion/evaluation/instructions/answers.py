"""The motions a model of this package makes of the prompts."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.data.resampling import interpolate
from latentmotion.describe.facts import FPS
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.instructions.prompts import Instruction
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.model.config import Sampling
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline

Joints = Float[np.ndarray, "_ 22 3"]


@dataclass(frozen=True)
class Asking:
    """How a model is asked."""

    takes: int = 5
    """Motions of each prompt."""
    clean: bool = True
    """Whether motions are cleaned, as users get them."""
    sampling: Sampling | None = None
    """Steps, guidance scale and sampler; by default the model's own."""


def answers(
    model: MotionPipeline, instructions: Sequence[Instruction], asking: Asking
) -> list[list[Joints]]:
    """Returns the motions of every prompt at 20 frames per second.

    Raises:
        InputError: There are no takes.
        ModelError: The model takes no sentences, or moves another skeleton.
    """
    if asking.takes < 1:
        raise InputError(f"--takes {asking.takes}: expected 1 or more")
    if not model.card.condition.reads_text:
        raise ModelError(f"model {model.card.name!r} takes no sentences; instructions are such")
    own = [one for one in instructions if one.seconds is None]
    timed = [one for one in instructions if one.seconds is not None]
    with warnings.catch_warnings():
        # Of unknown words and bones of odd lengths: the figures tell.
        warnings.simplefilter("ignore")
        found = _made(model, own, asking) | _made(model, timed, asking, _lengths(model, timed))
    return [found[one.id] for one in instructions]


def _made(
    model: MotionPipeline,
    instructions: Sequence[Instruction],
    asking: Asking,
    lengths: list[float] | None = None,
) -> dict[str, list[Joints]]:
    if not instructions:
        return {}
    takes = asking.takes
    motions = model.batch(
        [one.prompt for one in instructions for _ in range(takes)],
        None if lengths is None else [length for length in lengths for _ in range(takes)],
        [seed for one in instructions for seed in one.seeds(takes)],
        **vars(asking.sampling or model.card.sampling),
    )
    joints = [_seen(motion.cleaned() if asking.clean else motion) for motion in motions]
    return {one.id: joints[n * takes :][:takes] for n, one in enumerate(instructions)}


def _lengths(model: MotionPipeline, instructions: Sequence[Instruction]) -> list[float]:
    """Returns the lengths that prompts ask for, as far as the model makes them."""
    shortest, longest = (frames / model.representation.fps for frames in model.card.frames)
    return [min(max(one.seconds or 0.0, shortest), longest) for one in instructions]


def _seen(motion: Motion) -> Joints:
    if motion.skeleton.names != HUMANML3D.names:
        raise ModelError(
            f"motions have skeleton {motion.skeleton.name!r}; expected {HUMANML3D.name!r}"
        )
    joints = motion.joints.astype(np.float64)
    return joints if motion.fps == FPS else interpolate(joints, motion.fps / FPS)
