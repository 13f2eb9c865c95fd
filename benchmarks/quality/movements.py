"""Drawn movements by prompts: how many start from the movement that they ask for.

    python -m benchmarks.quality.movements fast

600 prompts for 300 drawn movements, by a language model that saw the movements' names alone
(November 27, 2026); no index is fitted to them. The margin of recordings, and rank and thresholds
of the classifier, were chosen by them, a point or two.

`--prompts benchmarks/quality/terse.tsv.xz`: 600 prompts in a few words, drawn at random from those
that ten language models wrote for 196 acts (November 28, 2026). The others are fitted.
"""

from __future__ import annotations

import csv
import lzma
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from benchmarks.harness.contest import table
from latentmotion import MotionPipeline
from latentmotion.errors import InputError
from latentmotion.retrieval.doubts import SURE
from latentmotion.retrieval.index import DRAWN
from latentmotion.retrieval.wordings import embedded

LIST = Path(__file__).with_suffix(".tsv.xz")  # The name of a movement, a tab and a prompt a line.


@dataclass(frozen=True)
class Movements:
    """What is measured."""

    model: tyro.conf.Positional[str]  # Name or folder of a model.
    prompts: Path = LIST  # The prompts.

    def run(self) -> None:
        """Prints the shares."""
        pipeline = MotionPipeline.from_pretrained(self.model)
        if pipeline.clip_starts is None:
            raise InputError(f"{self.model} starts from no clips")
        chooser = pipeline.clip_starts.chooser
        index = chooser.index
        name_of = {clip: index.captions[rows[0]].text for clip, rows in index.captions_of.items()}
        with lzma.open(self.prompts, "rt", encoding="utf-8") as file:
            names, prompts = zip(*csv.reader(file, delimiter="\t"), strict=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of words and doubts
            starts = [chooser.choices(pipeline.read(prompt)) for prompt in prompts]
            vectors = embedded(prompts, pipeline.text_encoder)
        started = [
            any(
                near.caption.support == DRAWN and name_of[near.caption.clip] == name
                for choice in choices
                for near in choice.neighbors[:1]
            )
            for name, choices in zip(names, starts, strict=True)
        ]
        classified = [index.classified(vector[None]) for vector in vectors]
        pairs = zip(names, classified, strict=True)
        right = np.array([bool(m) and m.caption.text == name for name, m in pairs])
        sure = np.array([bool(m) and m.probability >= SURE for m in classified])
        rows = [
            ("start from their movement", len(started), np.mean(started)),
            ("classified rightly, by the whole prompt alone", len(right), right.mean()),
            (f"the same where the probability is {SURE:g} or more", sure.sum(), right[sure].mean()),
        ]
        cells = [[name, str(count), f"{100 * share:.0f} %"] for name, count, share in rows]
        print(table(["prompts", "of", self.model], cells))


if __name__ == "__main__":
    tyro.cli(Movements).run()
