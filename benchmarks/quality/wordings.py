"""Own wordings: whether motions of a user's words are told as often as those of captions.

    python -m benchmarks.quality.wordings fast
    python -m benchmarks.quality.wordings starter --evaluator runs/evaluator --best-of 4

Each line of wordings.tsv is a caption and another wording of the same movement, in groups of 32
different movements. Of each, a motion is generated for every seed, as long as is predicted for the
sentence, and not cleaned up. An evaluator ranks the caption among the 32 of its group by the
distance to the motion; R@3 is how often it is among the first three. The intervals are of a
bootstrap over lines, which draws both sentences of a line together. The scorer that ships chooses
the best of several, so ask another evaluator about those.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float, Int

from benchmarks.harness.contest import table
from latentmotion import MotionPipeline
from latentmotion.data.clip import Caption
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.interface import TextMotionEvaluator, load_evaluator
from latentmotion.evaluation.metrics import ranks
from latentmotion.motion import features_of
from latentmotion.ranking.scorer import shipped_scorer
from latentmotion.storage.reading import read_text

LIST = Path(__file__).with_suffix(".tsv")  # The captions and wordings that are asked.

GROUP = 32  # Captions that are ranked together.

DRAWS = 10_000  # Samples of the bootstrap.


@dataclass(frozen=True)
class Wordings:
    """What is measured."""

    model: tyro.conf.Positional[str]  # Name or folder of a model.
    wordings: Path = LIST  # A caption, a tab and another wording of it a line; groups of 32 lines.
    # Each sentence is generated with each.
    seeds: Annotated[tuple[int, ...], tyro.conf.arg(aliases=["-s"])] = (0, 1, 2, 3, 4)
    best_of: int = 1  # Takes of each motion, of which the best is ranked.
    # The scorer that ships, or the folder of an evaluator that reads HumanML3D's features.
    evaluator: Path = Path("scorer")
    worst: int = 15  # Lines to print whose own wording does worst against their caption.
    out: Path | None = None  # CSV file of the place of each motion's caption, from 1.


@dataclass(frozen=True, eq=False)
class Places:
    """Places of captions among those of their groups, from 0."""

    caption: Int[np.ndarray, "lines seeds"]  # Of motions that were asked for as captions say it.
    own: Int[np.ndarray, "lines seeds"]  # Of motions that were asked for in other words.

    def within(self, first: int) -> Float[np.ndarray, "lines 2"]:
        """Returns the share of seeds with the caption among the first, of caption and wording."""
        return np.stack([(each < first).mean(axis=1) for each in (self.caption, self.own)], axis=1)


def main(asked: Wordings) -> None:
    """Generates, ranks and prints."""
    warnings.simplefilter("ignore")  # words that are unknown to the text encoder
    pairs, evaluator = read_pairs(asked.wordings), load_evaluator(asked.evaluator)
    if not isinstance(evaluator, TextMotionEvaluator):
        raise SystemExit(f"{asked.evaluator} knows actions, not sentences; name another evaluator")
    generate = MotionPipeline.from_pretrained(asked.model, threads=1)
    captions, own = (
        [places_of(generate, evaluator, pairs, side, seed, asked.best_of) for seed in asked.seeds]
        for side in (0, 1)
    )
    places = Places(np.stack(captions, axis=1), np.stack(own, axis=1))
    if asked.out is not None:
        with asked.out.open("w", newline="", encoding="utf-8") as file:
            lines = csv.writer(file)
            names = ("caption", "own")
            lines.writerow(
                ["caption", "own wording", *(f"{n} {s}" for n in names for s in asked.seeds)]
            )
            for pair, ours, theirs in zip(pairs, places.caption, places.own, strict=True):
                lines.writerow([*pair, *(ours + 1), *(theirs + 1)])
    print(f"{asked.model}, best of {asked.best_of}, evaluator {asked.evaluator}")
    print(table(("", "captions", "own words", "own words / captions"), shares(places)))
    print()
    print(table(("caption", "own words", "R@3", "median place"), worst(pairs, places, asked.worst)))


def read_pairs(path: Path) -> list[tuple[str, str]]:
    """Returns captions and other wordings.

    Raises:
        InputError: A line is no pair, or the last group is incomplete.
    """
    pairs = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        caption, _, own = (part.strip() for part in line.partition("\t"))
        if not caption or not own or "\t" in own:
            raise InputError(
                f"{path}, line {number}: {line!r}; expected a caption, a tab, a wording"
            )
        pairs.append((caption, own))
    if not pairs or len(pairs) % GROUP:
        raise InputError(f"{path}: {len(pairs)} lines; expected groups of {GROUP}")
    return pairs


def places_of(
    generate: MotionPipeline,
    evaluator: TextMotionEvaluator,
    pairs: Sequence[tuple[str, str]],
    side: int,
    seed: int,
    best_of: int,
) -> Int[np.ndarray, " lines"]:
    """Returns the place of each caption for the motion of one side of its pair."""
    prompts = [pair[side] for pair in pairs]
    if best_of > 1:
        settings = {"seed": seed * best_of, "takes": best_of, "clean_up": None}
        motions = [generate(prompt, **settings) for prompt in prompts]
    else:
        motions = generate.batch(prompts, seeds=[seed] * len(prompts))
    made = evaluator.motions(
        [features_of(motion, shipped_scorer().representation) for motion in motions]
    )
    texts = evaluator.texts([Caption(caption, 0, 0) for caption, _ in pairs])
    starts = range(0, len(pairs), GROUP)
    return np.concatenate([ranks(made[s : s + GROUP], texts[s : s + GROUP]) for s in starts])


def shares(places: Places) -> list[list[str]]:
    """Returns a row for R@1 and R@3: both shares and their ratio, with 95 % intervals."""
    lines, rows = len(places.own), []
    draws = np.random.default_rng(0).integers(lines, size=(DRAWS, lines))
    for first in (1, 3):
        hits = places.within(first)
        drawn, measured = hits[draws].mean(axis=1), hits.mean(axis=0)
        drawn = np.column_stack([drawn, drawn[:, 1] / np.maximum(drawn[:, 0], 1e-9)])
        low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
        values = (*measured, measured[1] / max(measured[0], 1e-9))
        cells = [f"{v:.3f} ({a:.3f}–{b:.3f})" for v, a, b in zip(values, low, high, strict=True)]
        rows.append([f"R@{first} among {GROUP}", *cells])
    return rows


def worst(pairs: Sequence[tuple[str, str]], places: Places, lines: int) -> list[list[str]]:
    """Returns the lines whose wording loses most: by R@3, then by the median place."""
    hits = places.within(3)
    medians = np.median([places.caption, places.own], axis=2) + 1
    order = np.lexsort((medians[0] - medians[1], hits[:, 1] - hits[:, 0]))
    return [
        [
            *pairs[line],
            " → ".join(f"{hit:.1f}" for hit in hits[line]),
            " → ".join(f"{middle:.0f}" for middle in medians[:, line]),
        ]
        for line in order[:lines].tolist()
    ]


if __name__ == "__main__":
    main(tyro.cli(Wordings))
