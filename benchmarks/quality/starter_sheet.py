"""Draws 24 prompts that cover what the shipped models know, for a person to judge.

    python -m benchmarks.quality.starter_sheet docs/pictures fast

writes three pictures of eight rows, and a moving one.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from PIL import Image

from latentmotion import MotionPipeline, formats
from latentmotion.model.card import DEFAULT
from latentmotion.render import video

PROMPTS = (
    "a person walks forward",
    "a person walks backwards",
    "a person runs",
    "a person jumps forward",
    "a person walks and turns around",
    "a person walks in a circle",
    "a person climbs stairs",
    "a person kicks with the left leg",
    "a person punches like a boxer",
    "a person squats",
    "a person lies down on the floor",
    "a person dances",
    "a person dances ballet",
    "a person dribbles a basketball",
    "a person throws a basketball",
    "a person picks something up from the floor",
    "a person sneaks forward",
    "a person washes something",
    "a person drinks from a glass",
    "a person sits down",
    "a person rotates both arms backwards",
    "a person touches the left elbow with the right knee",
    "a person hops on both legs",
    "a person jogs in a circle to the left",
)
# Prompts of the moving picture, and what is written below.
MOVING = {3: "jumps forward", 7: "kicks", 19: "sits down", 10: "lies down"}

SEED = 0
# Of the pictures and of the moving one, which stay small so that the repository does.
WIDTH, COLORS, FPS = 760, 22, 10


def main(folder: Path, model: str = DEFAULT) -> None:
    """Writes the pictures."""
    generate = MotionPipeline.from_pretrained(model)
    motions = generate.batch(PROMPTS, seconds=4, seeds=[SEED] * len(PROMPTS))
    for sheet in range(3):
        path = folder / f"{generate.card.name}_{sheet + 1}.png"
        formats.save(path, motions[8 * sheet : 8 * sheet + 8])
        picture = Image.open(path).convert("RGB")
        picture.thumbnail((WIDTH, picture.height))
        picture.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
    moving = [
        replace(motions[number].cleaned().resampled(FPS), caption=caption)
        for number, caption in MOVING.items()
    ]
    video.write(folder / f"{generate.card.name}.gif", moving, size=180, view="still")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]), *sys.argv[2:])
