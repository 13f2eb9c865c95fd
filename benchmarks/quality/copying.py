"""How close motions that start from a clip are to it, by the share of the steps that are left.

    python -m benchmarks.quality.copying fast --captions 40

Captions of rare movements of the index that ships, drawn at random, at their clips' own lengths.
Distance: mean distance of the joints from the clip's, seen from the pelvis and its heading, frame
by frame. The clip itself is what the decoder makes of its latents.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Annotated

import numpy as np
import tyro
from tyro.conf import Positional

from latentmotion import MotionPipeline
from latentmotion.engine.request import GenerationRequest, Start
from latentmotion.representation.interface import Representation

# Shares of the steps that are left, and of the clip that is kept in the result.
SHARES = ((0.25, 0.7), (0.25, 0.0), (0.5, 0.0), (0.75, 0.0), (1.0, 0.0))


def placed(representation: Representation, features: np.ndarray) -> np.ndarray:
    """Returns joints seen from the pelvis and its heading: the features' own positions."""
    standing = features.copy()
    standing[:, :3] = 0  # neither turns nor walks
    joints = representation.decode(standing)
    return joints - joints[:, :1]


def main(
    model: Positional[str] = "fast",
    captions: int = 40,
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"])] = 0,
) -> None:
    """Prints the table.

    Args:
        model: Name or folder of a model.
        captions: How many are drawn.
        seed: Of the draw.
    """
    warnings.simplefilter("ignore")
    pipeline = MotionPipeline.from_pretrained(model, threads=1)
    clips = pipeline.clip_starts
    assert clips is not None
    rare = [
        one
        for one in clips.chooser.index.captions
        if one.support <= 20 and one.end - one.start >= 5
    ]
    rows = np.random.default_rng(seed).permutation(len(rare))[:captions]
    sampling, distances = pipeline.card.sampling, {share: [] for share in SHARES}
    if sampling.steps > 16:
        sampling = replace(sampling, steps=16, sampler="dpm++")
    for row in rows.tolist():
        caption = rare[row]
        latents = clips.chooser.index.latents_of(caption)[:49]
        frames = 4 * len(latents)
        clip = placed(
            pipeline.representation, clips.decode(latents[None], np.ones((1, frames), bool))[0]
        )
        for share, kept in SHARES:
            starts = () if share == 1 else (Start(latents, share, kept),)
            request = GenerationRequest((caption.text,), (frames,), (row,), sampling, starts)
            (features,) = pipeline.generate(request)
            gap = placed(pipeline.representation, features) - clip
            distances[share, kept].append(1e3 * np.linalg.norm(gap, axis=-1).mean())
    print(f"{model}, {sampling.steps} steps, {captions} captions, draw {seed}\n")
    print("| steps left | distance from the clip, mm: median | 10 % | 90 % |\n|---|---|---|---|")
    for (share, kept), values in distances.items():
        low, middle, high = np.percentile(values, [10, 50, 90])
        name = "100 %, noise" if share == 1 else f"{100 * share:.0f} %"
        name += f", {100 * kept:.0f} % of the clip kept" if kept else ""
        print(f"| {name} | {middle:.0f} | {low:.0f} | {high:.0f} |")


if __name__ == "__main__":
    tyro.cli(main)
