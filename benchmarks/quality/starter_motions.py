"""The generated motions that benchmarks measure: 24 prompts and the captions of the test split."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from benchmarks.quality.starter_sheet import PROMPTS
from latentmotion import MotionPipeline
from latentmotion.data.dataset import Dataset


def starter_motions(dataset: Dataset, captions: int = 40) -> list[Float[np.ndarray, "_ joints 3"]]:
    """Returns the joints of motions of the starter model, four seconds each.

    Args:
        dataset: Whose test split has the captions.
        captions: How many of them.
    """
    return [dataset.representation.decode(f) for f in starter_features(dataset, captions)]


def starter_features(dataset: Dataset, captions: int = 40) -> list[Float[np.ndarray, "_ features"]]:
    """Returns the features of these motions, in their own units."""
    generate = MotionPipeline.from_pretrained("starter", threads=1)
    test = [clip.captions[0].text for clip in dataset.clips("test") if clip.captions]
    prompts = [*PROMPTS, *test[:captions]]
    frames = round(4 * dataset.representation.fps)
    return generate.features(prompts, [frames] * len(prompts), range(len(prompts)))
