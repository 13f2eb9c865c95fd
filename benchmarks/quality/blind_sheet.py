"""Draws motions of a list of prompts without the prompts, in random order, for a person to name.

    python -m benchmarks.quality.blind_sheet fast benchmarks/quality/sheet_60.txt OUT --seeds 1 2 3

writes OUT/sheet_NN.png (six motions each, numbered) and OUT/key.csv, which says what was asked.
`--best-of 4` draws the best of four takes, `--way` prints how far and where each goes. Name each
movement before the key is opened; then judge it good, half or bad.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from latentmotion import MotionPipeline, formats
from latentmotion.cleanup import CleanUp
from latentmotion.measure.scene import describe
from latentmotion.motion import Motion

PER_SHEET = 6  # Motions of a picture.


@dataclass(frozen=True)
class BlindSheet:
    """What is drawn."""

    model: tyro.conf.Positional[str]  # Name or folder of a model.
    prompts: tyro.conf.Positional[Path]  # A prompt a line.
    out: tyro.conf.Positional[Path]  # Folder for pictures and key.
    # Each prompt is drawn with each.
    seeds: Annotated[tuple[int, ...], tyro.conf.arg(aliases=["-s"])] = (1, 2, 3)
    order: int = 0  # Seed of the order.
    best_of: int = 1  # Takes of each motion, of which the best is drawn.
    way: bool = False  # Print distance, side and turn of each motion, which strips do not show.


def main(sheet: BlindSheet) -> None:
    """Writes pictures and key."""
    generate = MotionPipeline.from_pretrained(sheet.model)
    prompts = [line for line in sheet.prompts.read_text("utf-8").splitlines() if line.strip()]
    asked = [(prompt, seed) for prompt in prompts for seed in sheet.seeds]
    if sheet.best_of > 1:
        takes = sheet.best_of
        motions = [generate(p, seed=s * takes, takes=takes) for p, s in asked]
    else:
        seeds = [seed for _, seed in asked]
        motions = generate.batch([p for p, _ in asked], seeds=seeds, clean_up=CleanUp())
    sheet.out.mkdir(parents=True, exist_ok=True)
    order = np.random.default_rng(sheet.order).permutation(len(asked)).tolist()
    with (sheet.out / "key.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("number", "prompt", "seed", "seconds"))
        for number, index in enumerate(order):
            table.writerow((number, *asked[index], f"{len(motions[index].joints) / 20:.1f}"))
    for start in range(0, len(order), PER_SHEET):
        numbered = [
            _numbered(motions[index], f"{start + place}{_way(motions[index]) if sheet.way else ''}")
            for place, index in enumerate(order[start : start + PER_SHEET])
        ]
        formats.save(sheet.out / f"sheet_{start // PER_SHEET:02d}.png", numbered)


def _way(motion: Motion) -> str:
    path = describe(motion.joints.astype(np.float64)).path
    went = f"{path.ahead:+.1f} m ahead, {path.sideways:+.1f} m left"
    return f": {motion.seconds:.1f} s, {went}, turned {path.turned:+.0f} degrees left"


def _numbered(motion: Motion, caption: str) -> Motion:
    return Motion(motion.joints, motion.fps, motion.skeleton, caption)


if __name__ == "__main__":
    main(tyro.cli(BlindSheet))
