"""Ten movements taught by showing: how often each is made before and after, and what it takes.

    python -m benchmarks.quality.teaching fast

Taught are clips of the test split, which no model has seen: the ten whose captions are farthest
from all that the model learned, each with its first caption. Asked is that caption of another
subject ("she" instead of "a person"), with ten seeds. A motion is right if, of all test clips, the
taught one is nearest to it by the tower of `own_clip`. The last row asks for ten captions of other
clips, before and after.
"""

from __future__ import annotations

import re
import time
import warnings

import numpy as np
import tyro
from tyro.conf import Positional

from benchmarks.quality.own_clip.tower import Tower
from latentmotion import MotionPipeline
from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset, Item, items_of
from latentmotion.retrieval.teach import ShownClip, build_index

SHORTEST, LONGEST = 40, 196  # Frames of the clips.


def asked(item: Item) -> str:
    """Returns an item's first caption of another subject."""
    return re.sub(r"^(a|the|this) \w+|^someone", "she", item.captions[0].lower())


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

    def taught(clips: list[ShownClip]) -> MotionPipeline:
        encoders = pipeline.feature_encoder, pipeline.text_encoder
        index = build_index(clips, dataset.sources, pipeline.card, *encoders)
        return pipeline.with_moves(index.preferred())

    items = [item for item in items_of(dataset.clips("test")) if SHORTEST <= item.frames <= LONGEST]
    items.sort(key=lambda item: starts.chooser.neighbors(item.captions[0], 1)[0].cosine)
    features = [dataset.features(item.clip)[item.start : item.end] for item in items]
    gallery = tower.embed(features)

    def ranks(pipeline: MotionPipeline, number: int) -> np.ndarray:
        """Returns the rank of an item's clip for each seed."""
        motions = pipeline.batch([asked(items[number])] * seeds, seeds=range(seeds))
        vectors = tower.embed([dataset.representation.encode(m.joints) for m in motions])
        scores = vectors @ gallery.T
        return 1 + (scores > scores[:, [number]]).sum(axis=1)

    print("| asked | right before | right after | seconds to teach |\n|---|---|---|---|")
    shown, sums, others = [], np.zeros(2), list(range(len(items) - clips, len(items)))
    kept = np.array([ranks(pipeline, number) == 1 for number in others]).sum()
    for number, item in enumerate(items[:clips]):
        begun, clip = time.perf_counter(), item.clip
        own = features[number]
        captions = (Caption(item.captions[0], 0, len(own)),)
        shown.append(ShownClip(clip.id, clip.source, clip.origin, own, captions))
        after = taught(shown[-1:])
        seconds = time.perf_counter() - begun
        right = [int((ranks(one, number) == 1).sum()) for one in (pipeline, after)]
        sums += right
        cells = asked(item)[:70], *(f"{one} of {seeds}" for one in right), f"{seconds:.1f}"
        print(f"| {' | '.join(cells)} |")
    every = taught(shown)
    after = np.array([ranks(every, number) == 1 for number in others]).sum()
    print(f"| all | {sums[0]:.0f} of {clips * seeds} | {sums[1]:.0f} | |")
    print(f"| ten other captions, not taught | {kept} of {clips * seeds} | {after} | |")


if __name__ == "__main__":
    tyro.cli(main)
