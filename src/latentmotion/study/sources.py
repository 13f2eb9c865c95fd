"""Sources of a study's motions: a model that generates them, or a folder of saved ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.model.card import CARD_FILE, shipped_models
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import read_lines, sha256


@dataclass(frozen=True)
class Wanted:
    """Prompts, seeds and length that both sides of a study show."""

    prompts: tuple[str, ...]
    """The sentences."""
    seeds: tuple[int, ...]
    """One pair per sentence and seed."""
    seconds: float
    """Length of generated motions."""

    def rows(self) -> list[tuple[str, int]]:
        """Returns each sentence with each seed."""
        return [(prompt, seed) for prompt in self.prompts for seed in self.seeds]


def motions_of(
    source: str,
    wanted: Wanted,
    load: Callable[[str], MotionPipeline] = MotionPipeline.from_pretrained,
) -> list[Motion]:
    """Returns a motion for each of `wanted.rows()`.

    Args:
        source: Name or folder of a model; or a folder of .npz files, found by their captions.
        wanted: Prompts, seeds and length.
        load: Loads a model by name or folder.

    Raises:
        ModelError: There is no such model.
        InputError: The folder lacks a motion.
    """
    folder = Path(source)
    if source in shipped_models() or not folder.is_dir() or (folder / CARD_FILE).is_file():
        prompts, seeds = zip(*wanted.rows(), strict=True)
        return load(source).batch(prompts, wanted.seconds, seeds)
    from latentmotion.formats import load as load_motions

    takes: dict[str, list[Motion]] = {}
    for path in sorted(folder.glob("*.npz")):
        for motion in load_motions(path):
            takes.setdefault(_plain(motion.caption), []).append(motion)
    if not takes:
        raise InputError(
            f"{folder} is neither a model folder nor one of motions: it has no {CARD_FILE} and no "
            ".npz file; save motions with latentmotion generate ... -o NAME.npz"
        )
    motions = []
    for prompt in wanted.prompts:
        same = takes.get(_plain(prompt), [])[: len(wanted.seeds)]
        if len(same) < len(wanted.seeds):
            raise InputError(
                f"{folder} has {len(same)} motions for {prompt!r}, the study needs "
                f"{len(same) + 1}; captions there are e.g. "
                f"{', '.join(map(repr, sorted(takes)[:3]))}"
            )
        motions += same
    return motions


def describe(source: str) -> str:
    """Returns the description of a source for the key: its name, and a hash of a model's card."""
    folder = Path(source)
    if (folder / CARD_FILE).is_file():
        return f"{source} ({CARD_FILE} {sha256(folder / CARD_FILE)[:12]})"
    return source


def read_prompts(path: Path) -> tuple[str, ...]:
    """Reads sentences, one per line, without empty lines and repetitions.

    Raises:
        InputError: The file cannot be read, or holds none.
    """
    return tuple(dict.fromkeys(read_lines(path, "sentence")))


def _plain(sentence: str) -> str:
    """Returns a sentence without case, extra spaces and final period, for comparison."""
    return " ".join(sentence.split()).rstrip(".").casefold()


def check_lengths(pairs: Sequence[tuple[Motion, Motion]]) -> list[str]:
    """Returns a warning if the lengths of motions give the sides away."""
    lengths = [abs(a.seconds - b.seconds) for a, b in pairs]
    if max(lengths) > 0.25:
        return [
            f"motions of a pair differ in length by up to {max(lengths):.1f} s, which can be seen"
        ]
    return []
