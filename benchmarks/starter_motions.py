"""The generated motions that benchmarks measure: 24 prompts and the captions of the test split."""

from __future__ import annotations

import sys
from pathlib import Path

from latentmotion import Motion, MotionGenerator
from latentmotion.data.dataset import Dataset

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

from starter_sheet import PROMPTS


def starter_motions(dataset: Dataset, captions: int = 40) -> list[Motion]:
    """Returns motions of the starter model, four seconds each.

    Args:
        dataset: Whose test split has the captions.
        captions: How many of them.
    """
    generate = MotionGenerator.load("starter", threads=1)
    test = [clip.captions[0].text for clip in dataset.clips("test") if clip.captions]
    return generate.batch([*PROMPTS, *test[:captions]], seconds=4)
