"""Turns sentences into motions and writes each as a file of its own.

python examples/generate.py walks "a person walks forward" "a person kicks with the right leg"

The folder `walks` gets 0.bvh, 1.bvh, … and a page that plays all of them in a browser.
"""

from __future__ import annotations

import sys
from pathlib import Path

from latentmotion import MotionPipeline, save


def main(folder: str, *sentences: str) -> None:
    """Generates a motion for each sentence, the best of several takes, and saves it."""
    generate = MotionPipeline.from_pretrained()
    motions = [generate(sentence) for sentence in sentences]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for number, motion in enumerate(motions):
        motion.save(Path(folder) / f"{number}.bvh")
    save(Path(folder) / "all.html", motions)


if __name__ == "__main__":
    main(*sys.argv[1:])
