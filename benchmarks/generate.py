"""How long a sentence takes: warm call by part, whole command from a cold start, by runtime.

    python benchmarks/generate.py            # the table in docs/performance.md

Engines take turns in one run; medians are reported. The warm call includes text, 50 guided steps,
decoding and joints; the cold start is the whole process, files included.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from latentmotion.feature_decoder import FeatureDecoder
from latentmotion.generator import MotionGenerator
from latentmotion.order import Order

CAPTION = "a person walks forward and kicks"
PARTS = ("text", "diffusion", "decoder", "joints")


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="starter")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=20)
    options = parser.parse_args()
    runtimes = ["onnxruntime", *(["openvino"] if find_spec("openvino") else [])]
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, ", end="")
    print(
        f"{options.threads} threads, load {os.getloadavg()[0]:.1f}, {options.seconds:g} s, ", end=""
    )
    print(f"{options.steps} guided steps, median of {options.repeats}, ms\n")
    _warm(options, runtimes)
    _cold(options, runtimes)


def _warm(options: argparse.Namespace, runtimes: list[str]) -> None:
    generators = {r: MotionGenerator.load(options.model, r, options.threads) for r in runtimes}
    for generator in generators.values():
        _call(generator, options)
    times: dict[str, list[dict[str, float]]] = defaultdict(list)
    for _ in range(options.repeats):
        for runtime, generator in generators.items():
            times[runtime].append(_call(generator, options))
    print(f"| warm call | {' | '.join(PARTS)} | in all |")
    print("|---" * (len(PARTS) + 2) + "|")
    for runtime, rows in times.items():
        parts = [statistics.median(row[part] for row in rows) for part in PARTS]
        whole = statistics.median(sum(row.values()) for row in rows)
        print(f"| {runtime} | {' | '.join(f'{ms:.1f}' for ms in parts)} | **{whole:.1f}** |")


def _call(generator: MotionGenerator, options: argparse.Namespace) -> dict[str, float]:
    """Runs the chain of `MotionGenerator` part by part, with a clock between the parts."""
    frames = round(options.seconds * generator.representation.fps)
    card, decode = generator.card, FeatureDecoder(generator.card, generator.decoder)
    order = Order((CAPTION,), (frames,), (0,), options.steps, card.guidance, card.sampler)
    condition, text = _timed(lambda: generator.condition(order.prompts))
    latents, diffusion = _timed(lambda: generator.latents(condition, order))
    features, decoder = _timed(lambda: decode(latents, order.frames))
    joints, rest = _timed(lambda: generator.representation.decode(features))
    assert np.isfinite(joints).all()
    return dict(zip(PARTS, (text, diffusion, decoder, rest), strict=True))


def _timed(part: Callable[[], object]) -> tuple:
    start = time.perf_counter()
    result = part()
    return result, (time.perf_counter() - start) * 1e3


def _cold(options: argparse.Namespace, runtimes: list[str]) -> None:
    print("\n| whole command, cold start | seconds |\n|---|---|")
    times: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(5):
            for runtime in runtimes:
                times[runtime].append(_command(options, runtime, Path(folder)))
    for runtime, seconds in times.items():
        print(f"| {runtime}, .bvh and .html | **{statistics.median(seconds):.2f}** |")


def _command(options: argparse.Namespace, runtime: str, folder: Path) -> float:
    outputs = [str(folder / name) for name in ("a.bvh", "a.html")]
    words = [CAPTION, "--seconds", str(options.seconds), "--steps", str(options.steps)]
    flags = ["--model", options.model, "--runtime", runtime, "--threads", str(options.threads)]
    start = time.perf_counter()
    command = [sys.executable, "-m", "latentmotion", "generate", *words, *flags, "-o", *outputs]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
