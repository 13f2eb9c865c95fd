"""The pictures of docs/guide/control.md and fit.md: a strip for each way to direct a motion.

python -m benchmarks.quality.directing_pictures docs/pictures --model fast
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from latentmotion import LookAt, Motion, MotionPipeline, Reach, RootPath
from latentmotion.cleanup.loops import unrolled
from latentmotion.control.edit import generate_edited
from latentmotion.control.fit_keypoints import fit_motion
from latentmotion.control.stream import generate_loop
from latentmotion.control.timeline import generate_timeline
from latentmotion.render.strip import write

WIDTH, QUALITY = 660, 40  # Pixels, and WebP's quality.


def path(generate: MotionPipeline) -> list[Motion]:
    wave = [(0.9 * float(np.sin(1.1 * z)), z) for z in np.linspace(0, 5.4, 8).tolist()]
    motion = generate("a person walks forward", 5, 1, goals=[RootPath(wave)], takes=1)
    return [replace(motion, caption="walks forward, along a path")]


def goals(generate: MotionPipeline) -> list[Motion]:
    goals = [Reach("right_hand", 1.6, (-0.3, 1.75, 2.3), 2.4), LookAt(1.6, (-0.3, 1.75, 2.3), 2.4)]
    motion = generate("a person walks forward", 4, 2, goals=goals, takes=1)
    words = "walks; right hand held 1.75 m high from 1.6 to 2.4 s"
    return [replace(motion, caption=words).with_recorded(motion.recorded)]


def edit(generate: MotionPipeline) -> list[Motion]:
    walk = generate("a person walks forward", 5, 0, takes=1)
    jump = generate_edited(generate, walk, "a person jumps", (1.6, 3.0), 3)
    return [replace(jump, caption="walks forward; jumps between 1.6 and 3 s")]


def timeline(generate: MotionPipeline) -> list[Motion]:
    spans = [("a person walks forward", 3), ("a person jumps", 2), ("a person sits down", 3)]
    return [generate_timeline(generate, spans, 2).cleaned()]


def two_tracks(generate: MotionPipeline) -> list[Motion]:
    spans, wave = [("a person walks forward", 5)], "a person waves the right hand"
    motion = generate_timeline(generate, spans, 1, parts=[("right_arm", wave, 1, 4)]).cleaned()
    return [replace(motion, caption="walks forward; right arm: waves from 1 to 4 s")]


def loop(generate: MotionPipeline) -> list[Motion]:
    turn = generate_loop(generate, "a person runs forward", 1.2, 2).cleaned(in_place=True)
    return [replace(unrolled(turn, 0, 1), caption="runs, in place: two turns of 1.2 s")]


def fit(generate: MotionPipeline) -> list[Motion]:
    real = generate("a person walks forward and waves", 3.2, 3, takes=1)
    noise = np.random.default_rng(0).normal(0, 0.05, real.joints.shape)
    noisy = (real.joints + noise).astype(np.float32)
    fitted = fit_motion(generate, noisy).cleaned()
    return [
        replace(Motion(noisy, real.fps), caption="recorded, 5 cm of noise"),
        replace(fitted, caption="fitted"),
    ]


PICTURES: dict[str, Callable[[MotionPipeline], list[Motion]]] = {
    "path": path,
    "goals": goals,
    "edit": edit,
    "timeline": timeline,
    "two_tracks": two_tracks,
    "loop": loop,
    "fit": fit,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--model", default="fast")
    parser.add_argument("--only", nargs="*", default=list(PICTURES))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    generate = MotionPipeline.from_pretrained(options.model, threads=1)
    for name in options.only:
        file = options.folder / f"directing_{name}.png"
        motions, style = PICTURES[name](generate), "path" if name == "path" else "row"
        write(file, motions, style, 11, WIDTH)
        small = file.with_suffix(".webp")
        with Image.open(file) as opened:
            opened.convert("RGB").save(small, quality=QUALITY, method=6)
        file.unlink()
        print(f"{small}: {small.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
