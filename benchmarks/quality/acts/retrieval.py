"""Act retrieval: how far up a clip of the act is that a prompt asks for, by a tower of its own.

    rank = 1 + #{240 clips of other acts nearer to the motion than the nearest of 5 of its act}

The tower is that of own-clip retrieval, which nothing trains or ranks by. Prompts are in a user's
words, so it measures understanding as much as motion. Two cosines of `retrieval/doubts.py` were
chosen by this figure, which is a little too good for it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.quality.acts import table
from benchmarks.quality.own_clip.tower import LONGEST, Tower
from latentmotion import MotionPipeline
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.data.store import COMPOSED
from latentmotion.progress import counted

SHORTEST = 30  # Frames of the shortest clip.

# Clips of other acts, and most of the act's own, that a motion is compared with.
OTHERS, OF_ACT = 240, 5


def ranks(model: str, data: Path, seed: int = 0, from_clips: bool = True) -> dict[str, list[int]]:
    """Returns the ranks of all prompts of the table, one take each, by stratum."""
    dataset, tower, generator = Dataset.load(data), Tower.load(), np.random.default_rng(seed)
    pipeline = MotionPipeline.from_pretrained(model)
    items = [
        item
        for item in items_of(dataset.clips("train"))
        if item.frames >= SHORTEST and item.clip.source != COMPOSED
    ]
    texts = [" | ".join(item.captions).lower() for item in items]

    def vectors(rows: Sequence[int]) -> np.ndarray:
        longest = (LONGEST - 4) // 4 * 4
        chosen = [items[row] for row in rows]
        features = [
            dataset.features(i.clip)[i.start : i.start + i.frames][:longest] for i in chosen
        ]
        return tower.embed(features)

    others = generator.choice(len(items), min(5 * OTHERS, len(items)), replace=False).tolist()
    vectors_of_others = vectors(others)
    by_stratum: dict[str, list[int]] = {stratum: [] for stratum in table.STRATA}
    for act in counted(table.read_acts(), "acts"):
        named = [bool(re.search(act.captions, text)) for text in texts]
        if not any(named):
            continue
        of_act = np.flatnonzero(named)
        of_act = generator.choice(of_act, min(OF_ACT, len(of_act)), replace=False).tolist()
        rest = [number for number, row in enumerate(others) if not named[row]][:OTHERS]
        motions = [
            pipeline(prompt, seed=seed + number, from_clips=from_clips)
            for number, prompt in enumerate(act.prompts)
        ]
        encode = dataset.representation.encode
        made = tower.embed([encode(motion.joints.astype(np.float64)) for motion in motions])
        nearest = (made @ vectors(of_act).T).max(axis=1, keepdims=True)
        nearer = (made @ vectors_of_others[rest].T > nearest).sum(axis=1)
        by_stratum[act.stratum] += (1 + nearer).tolist()
    return by_stratum
