"""Ten movements taught by showing: how often each is made before and after, and what it takes.

    python -m benchmarks.quality.teaching fast

Taught are clips of the test split, which no model has seen: the ten whose captions are farthest
from all that the model learned, each with one of its captions. Asked is another caption of the same
clip, with ten seeds. A motion is right if, of all test clips, the tower of `own_clip` finds the
taught one among the three nearest. The last row asks for ten captions of other clips, before and
after.
"""

from __future__ import annotations

import time
import warnings

import numpy as np
import tyro
from tyro.conf import Positional

from benchmarks.quality.own_clip.tower import Tower
from latentmotion import MotionPipeline
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.retrieval.teach import ShownClip

SHORTEST, LONGEST = 40, 196
"""Frames of the clips."""


def main(model: Positional[str] = "fast", clips: int = 10, seeds: int = 10) -> None:
    """Prints the table.

    Args:
        model: Name or folder of a model.
        clips: Movements that are taught.
        seeds: Takes of each.
    """
    warnings.simplefilter("ignore")
    pipeline, tower = MotionPipeline.from_pretrained(model, threads=1), Tower.load()
    dataset = Dataset.load("data/starter.pack")
    starts = pipeline.clip_starts
    assert starts is not None
    items = [
        item
        for item in items_of(dataset.clips("test"))
        if SHORTEST <= item.frames <= LONGEST and len(item.captions) >= 2
    ]
    items.sort(key=lambda item: starts.neighbors(item.captions[0], 1)[0].cosine)
    features = [dataset.features(item.clip)[item.start : item.end] for item in items]
    gallery = tower.embed(features)

    def ranks(pipeline: MotionPipeline, number: int) -> np.ndarray:
        """Returns the rank of an item's clip for each seed of its second caption."""
        motions = pipeline.batch([items[number].captions[1]] * seeds, seeds=range(seeds))
        vectors = tower.embed([dataset.representation.encode(m.joints) for m in motions])
        scores = vectors @ gallery.T
        return 1 + (scores > scores[:, [number]]).sum(axis=1)

    print(
        "| taught | asked | right before | right after | seconds to teach |\n|---|---|---|---|---|"
    )
    shown, sums, others = [], np.zeros(2), list(range(len(items) - clips, len(items)))
    kept = np.array([ranks(pipeline, number) == 1 for number in others]).sum()
    for number, item in enumerate(items[:clips]):
        begun, clip = time.perf_counter(), item.clip
        captions = [c for c in clip.captions if c.text == item.captions[0]][:1]
        shown.append(
            ShownClip(clip.id, clip.source, clip.origin, features[number], tuple(captions))
        )
        index = pipeline.taught(shown[-1:], dataset.sources)
        taught = pipeline.with_moves(index)
        seconds = time.perf_counter() - begun
        right = [int((ranks(one, number) == 1).sum()) for one in (pipeline, taught)]
        sums += right
        texts = " | ".join(text[:60] for text in item.captions[:2])
        print(f"| {texts} | {right[0]} of {seeds} | {right[1]} of {seeds} | {seconds:.1f} |")
    every = pipeline.with_moves(pipeline.taught(shown, dataset.sources))
    after = np.array([ranks(every, number) == 1 for number in others]).sum()
    print(f"| all | | {sums[0]:.0f} of {clips * seeds} | {sums[1]:.0f} | |")
    print(f"| ten other captions, not taught | | {kept} of {clips * seeds} | {after} | |")


if __name__ == "__main__":
    tyro.cli(main)
