"""Lengths at which a model obeys: drawn prompts generated at many lengths, and judged.

The same model turns 170° in 2.4 s and a full circle in 4 s: its length decides what a motion shows.
Prompts and lengths are drawn from a seed; a journal keeps a line for each prompt, so that a killed
run is resumed.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.errors import DataError, InputError
from latentmotion.measure.scene import describe
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.storage.files import atomic_file
from latentmotion.training.checking import fulfills
from latentmotion.training.drawn_instructions import drawn_instructions


@dataclass(frozen=True)
class LengthTrials:
    """Which motions are generated."""

    prompts: int = 6000
    """Prompts that are drawn."""
    takes: int = 6
    """Motions of each, their lengths spread evenly on a logarithmic scale."""
    shortest: float = 1.2
    """Shortest length in seconds."""
    longest: float = 8.6
    """Longest length in seconds."""
    seed: int = 1
    """Seed of prompts, lengths and noise."""

    def lengths(self, number: int, fps: float) -> list[float]:
        """Returns the lengths of a prompt's motions in seconds, in whole frames.

        Args:
            number: The prompt's.
            fps: Frames per second.
        """
        drawn = np.random.default_rng([self.seed, number]).random(self.takes)
        share = (np.arange(self.takes) + drawn) / self.takes
        seconds = self.shortest * (self.longest / self.shortest) ** share
        return (np.round(seconds * fps) / fps).tolist()


@dataclass(frozen=True)
class LengthVerdicts:
    """Whether a model did what prompts ask, at some lengths."""

    prompts: tuple[str, ...]
    """A prompt for each motion."""
    seconds: Float[np.ndarray, " motions"]
    """Its length."""
    obeyed: Bool[np.ndarray, " motions"]
    """Whether it did what the prompt asks."""


def judged_lengths(
    model: MotionPipeline,
    trials: LengthTrials,
    journal: Path,
) -> LengthVerdicts:
    """Generates drawn prompts at many lengths and judges the motions.

    Args:
        model: Generates the motions.
        trials: Which motions.
        journal: File that keeps the results, of an earlier run too.

    Raises:
        DataError: The journal is damaged.
        InputError: The journal is of other trials or of another model.
    """
    rows = _read(journal, {"model": model.card.name, **asdict(trials)})
    instructions = drawn_instructions(trials.prompts, trials.seed)
    with journal.open("a", encoding="utf-8") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unknown words show in the result
        left = range(len(rows), len(instructions))
        for number in counted(left, "trials of prompts", done=len(rows)):
            instruction, lengths = (
                instructions[number],
                trials.lengths(number, model.representation.fps),
            )
            first = trials.seed * 2**24 + trials.takes * number
            seeds = [first + take for take in range(trials.takes)]
            motions = model.batch([instruction.prompt] * trials.takes, lengths, seeds)
            verdicts = [fulfills(describe(motion.joints), instruction.check) for motion in motions]
            rows.append((instruction.prompt, list(zip(lengths, verdicts, strict=True))))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    trial = [(prompt, *each) for prompt, every in rows for each in every]
    prompts, seconds, obeyed = zip(*trial, strict=True)
    return LengthVerdicts(prompts, np.array(seconds, np.float32), np.array(obeyed, bool))


def _read(journal: Path, about: dict[str, Any]) -> list[Any]:
    """Returns the rows of a journal, which is begun if there is none."""
    rows = [about]
    if journal.is_file():
        # A killed run may leave a half-written last line.
        whole = journal.read_text(encoding="utf-8").rpartition("\n")[0]
        try:
            rows = [json.loads(line) for line in whole.splitlines()]
        except json.JSONDecodeError as error:
            raise DataError(f"{journal} is damaged ({error}); delete it") from error
        if not rows or rows[0] != about:
            raise InputError(f"{journal} is of other trials than {about}; delete it")
    with atomic_file(journal) as temporary:
        temporary.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    return rows[1:]
