"""A study: sources, order and sides of its pairs of motions, the key, the page for raters.

Sides are balanced (each model is on the left in half of the pairs, or one more) and shuffled, and
so is the order. The page knows pairs by opaque names only; the key is a file of its own. The page
is one self-contained HTML file, without server, request or name of a model. Its script is the
viewer's.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np

from latentmotion.errors import InputError
from latentmotion.model.card import CARD_FILE, shipped_models
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.storage.files import sha256
from latentmotion.viewer.page import json_in_html, packed_script, payload

Model = Literal["A", "B"]

# Questions to raters, by name; the second only for pairs with a text.
QUESTIONS = {
    "realism": "Which motion is more realistic?",
    "text": "Which motion fits the text better?",
}


@dataclass(frozen=True)
class KeyPair:
    """One pair in the key."""

    id: str  # Its opaque name.
    prompt: str  # The sentence.
    seed: int  # Seed of both motions, or the number of the take.
    left: Model  # The model whose motion is on the left.


@dataclass(frozen=True)
class StudyKey:
    """The secret key of a study: `study.key.json`."""

    format: str  # Version of the format.
    study: str  # Name of the study, which its answers carry.
    a: str  # Description of A.
    b: str  # Description of B.
    seed: int  # Seed of order and sides.
    questions: dict[str, str]  # The questions, by name.
    pairs: tuple[KeyPair, ...]  # All pairs, in the order of the page.


KEY_FORMAT = "latentmotion study key 1"


@dataclass(frozen=True, eq=False)
class Pair:
    """Two motions for one sentence."""

    prompt: str  # The sentence; empty for motion without words.
    seed: int  # Seed of both, or the number of the take.
    a: Motion  # A's motion.
    b: Motion  # B's motion.


@dataclass(frozen=True, eq=False)
class Study:
    """A study, ready to be written."""

    key: StudyKey  # The secret key.
    # Left and right of each pair, in the order of the key.
    motions: tuple[tuple[Motion, Motion], ...]


def design(pairs: Sequence[Pair], a: str, b: str, seed: int) -> Study:
    """Shuffles pairs and sides.

    Args:
        pairs: The pairs of motions to compare.
        a: Description of A, for the key.
        b: Description of B, for the key.
        seed: Seed of order, sides and names.

    Raises:
        InputError: There is no pair.
    """
    if not pairs:
        raise InputError("no pair to show; give at least one sentence")
    generator = np.random.default_rng(seed)
    order = generator.permutation(len(pairs))
    a_left = generator.permutation(np.arange(len(pairs)) % 2 == 0)
    names = [generator.bytes(6).hex() for _ in pairs]
    shown = [pairs[index] for index in order]
    rows = [
        KeyPair(name, pair.prompt, pair.seed, "A" if left else "B")
        for name, pair, left in zip(names, shown, a_left, strict=True)
    ]
    questions = {k: v for k, v in QUESTIONS.items() if k != "text" or any(p.prompt for p in pairs)}
    # The study's name is a hash of all that is shown, so that answers to anything else are noticed.
    digest = hashlib.sha256()
    for row, pair in zip(rows, shown, strict=True):
        digest.update(f"{row.id} {row.prompt} {row.left}".encode())
        digest.update(pair.a.joints.tobytes() + pair.b.joints.tobytes())
    key = StudyKey(KEY_FORMAT, digest.hexdigest()[:16], a, b, seed, questions, tuple(rows))
    sides = [
        (p.a, p.b) if row.left == "A" else (p.b, p.a) for p, row in zip(shown, rows, strict=True)
    ]
    return Study(key, tuple(sides))


def asked(prompt: str, questions: Sequence[str]) -> list[str]:
    """Returns the names of the questions that a pair with this prompt gets."""
    return [name for name in questions if name != "text" or prompt]


def study_html(study: Study) -> str:
    """Returns the page."""
    key = study.key
    motions = [
        replace(motion, caption=row.prompt, metadata={})
        for row, sides in zip(key.pairs, study.motions, strict=True)
        for motion in sides
    ]
    pairs = [
        {"id": row.id, "prompt": row.prompt, "questions": asked(row.prompt, list(key.questions))}
        for row in key.pairs
    ]
    content = {"study": key.study, "questions": key.questions, "pairs": pairs, **payload(motions)}
    fields = {"study": json_in_html(content), "script": packed_script()}
    template = resources.files("latentmotion.study").joinpath("template.html")
    text = template.read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda field: fields[field[1]], text)


@dataclass(frozen=True)
class StudyPlan:
    """Prompts, seeds and length that both sides of a study show."""

    prompts: tuple[str, ...]  # The sentences.
    seeds: tuple[int, ...]  # One pair per sentence and seed.
    seconds: float  # Length of generated motions.

    def rows(self) -> list[tuple[str, int]]:
        """Returns each sentence with each seed."""
        return [(prompt, seed) for prompt in self.prompts for seed in self.seeds]


def motions_of(
    source: str,
    plan: StudyPlan,
    load: Callable[[str], MotionPipeline] = MotionPipeline.from_pretrained,
) -> list[Motion]:
    """Returns a motion for each of `plan.rows()`.

    Args:
        source: Name or folder of a model; or a folder of .npz files, found by their captions.
        plan: Prompts, seeds and length.
        load: Loads a model by name or folder.

    Raises:
        ModelError: There is no such model.
        InputError: The folder lacks a motion.
    """
    folder = Path(source)
    if source in shipped_models() or not folder.is_dir() or (folder / CARD_FILE).is_file():
        prompts, seeds = zip(*plan.rows(), strict=True)
        return load(source).batch(prompts, plan.seconds, seeds)
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
    for prompt in plan.prompts:
        same = takes.get(_plain(prompt), [])[: len(plan.seeds)]
        if len(same) < len(plan.seeds):
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


def _plain(sentence: str) -> str:
    """Returns a sentence without case, extra spaces and final period, for comparison."""
    return " ".join(sentence.split()).rstrip(".").casefold()


def check_lengths(pairs: Sequence[tuple[Motion, Motion]]) -> list[str]:
    """Returns a warning if the lengths of motions give the sides away."""
    lengths = [abs(a.seconds - b.seconds) for a, b in pairs]
    # A quarter second is seen at once, and tells raters which model it is.
    if max(lengths) > 0.25:
        return [
            f"motions of a pair differ in length by up to {max(lengths):.1f} s, which can be seen"
        ]
    return []
