"""Trains both stages on a folder of captioned motion capture, then generates with the result.

python examples/train_on_own_mocap.py takes out

`takes` holds walk.bvh, kick.bvh, … and beside each a file of sentences, walk.txt, kick.txt. Further
arguments go to both stages, for example `--set denoiser_training.steps=2000`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from latentmotion import MotionPipeline
from latentmotion.cli.main import main as latentmotion


def main(takes: str, out: str, *settings: str) -> None:
    """Runs the commands that docs/guide/training.md explains, one after another."""
    folder = Path(out)
    data, vae, denoiser, model = (
        str(folder / name) for name in ("data", "vae", "denoiser", "model")
    )
    encoder = ["--text-encoder", "starter"]
    latentmotion(["data", "prepare", "own", takes, "-o", data])
    latentmotion(["train", "vae", "--data", data, "-o", vae, *settings])
    second = ["--data", data, "--vae", vae, *encoder, "-o", denoiser]
    latentmotion(["train", "denoiser", *second, *settings])
    latentmotion(["export", denoiser, *encoder, "-o", model])
    generate = MotionPipeline.from_pretrained(model)
    generate("a person walks", seconds=2).save(folder / "walk.bvh")


if __name__ == "__main__":
    main(*sys.argv[1:])
