"""Where a study's motions come from: a model that generates them, or a folder of saved ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.model.card import CARD_FILE
from latentmotion.model.folder import shipped_models
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import read_lines, sha256


@dataclass(frozen=True)
class Wanted:
    """What both sides of a study have to show."""

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
        wanted: What is to be shown.
        load: Loads a model by name or folder.

    Raises:
        ModelError: There is no such model.
        InputError: The folder lacks a motion.
    """
    folder = Path(source)
    if source in shipped_models() or not folder.is_dir() or (folder / CARD_FILE).is_file():
        return _generated(load(source), wanted)
    return _saved(folder, wanted)


def describe(source: str) -> str:
    """Returns what the key says of a source: its name, and a hash of a model's weights or card."""
    folder = Path(source)
    if (folder / CARD_FILE).is_file():
        return f"{source} ({CARD_FILE} {sha256(folder / CARD_FILE)[:12]})"
    return source


def read_prompts(path: Path) -> tuple[str, ...]:
    """Reads sentences, one a line; empty lines and repetitions are left out.

    Raises:
        InputError: The file cannot be read, or holds none.
    """
    return tuple(dict.fromkeys(read_lines(path, "sentence")))


def _generated(generator: MotionPipeline, wanted: Wanted) -> list[Motion]:
    prompts, seeds = zip(*wanted.rows(), strict=True)
    return generator.batch(prompts, wanted.seconds, seeds)


def _saved(folder: Path, wanted: Wanted) -> list[Motion]:
    takes = _by_prompt(folder)
    return [
        _take(takes, prompt, number, folder)
        for prompt in wanted.prompts
        for number in range(len(wanted.seeds))
    ]


def _by_prompt(folder: Path) -> dict[str, list[Motion]]:
    from latentmotion.formats import load

    found: dict[str, list[Motion]] = {}
    for path in sorted(folder.glob("*.npz")):
        for motion in load(path):
            found.setdefault(_plain(motion.caption), []).append(motion)
    if not found:
        raise InputError(
            f"{folder} is neither a model folder nor one of motions: it has no {CARD_FILE} and no "
            ".npz file; save motions with latentmotion generate ... -o NAME.npz"
        )
    return found


def _take(takes: dict[str, list[Motion]], prompt: str, number: int, folder: Path) -> Motion:
    same = takes.get(_plain(prompt), [])
    if number >= len(same):
        raise InputError(
            f"{folder} has {len(same)} motions for {prompt!r}, the study needs {number + 1}; "
            f"captions there are e.g. {', '.join(map(repr, sorted(takes)[:3]))}"
        )
    return same[number]


def _plain(sentence: str) -> str:
    """Case, spaces and a last full stop do not matter."""
    return " ".join(sentence.split()).rstrip(".").casefold()


def check_lengths(pairs: Sequence[tuple[Motion, Motion]]) -> list[str]:
    """Returns a warning where lengths or frame rates tell the sides apart."""
    lengths = [abs(a.seconds - b.seconds) for a, b in pairs]
    if max(lengths) > 0.25:
        return [
            f"motions of a pair differ in length by up to {max(lengths):.1f} s, which can be seen"
        ]
    return []
