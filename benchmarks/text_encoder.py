"""How long the shipped text encoder takes for a sentence, beside its teacher, on one core.

    python benchmarks/text_encoder.py --captions humanml3d/texts.json.xz

Both take turns over the same held-out captions, one sentence at a time; medians are reported.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import torch

from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.text.corpus import is_held_out, read_captions
from latentmotion.condition.text.pretrained import PretrainedTextEncoder
from latentmotion.condition.text.student import StudentTextEncoder
from latentmotion.models import find_model


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captions", type=Path, required=True)
    parser.add_argument("--model", default="starter")
    parser.add_argument("--sentences", type=int, default=200)
    options = parser.parse_args()
    torch.set_num_threads(1)
    encoders: dict[str, TextEncoder] = {
        "ours": StudentTextEncoder.load(find_model(options.model), threads=1),
        "MiniLM, transformers": PretrainedTextEncoder.load("minilm"),
    }
    held_out = [c.text for c in read_captions(options.captions) if is_held_out(c.text)]
    times, pooled = _run(encoders, held_out[: options.sentences])
    cosine = np.mean([a @ b for a, b in zip(*pooled.values(), strict=True)])
    print(f"{platform.machine()}, 1 thread, load {os.getloadavg()[0]:.1f}, ", end="")
    print(f"{options.sentences} held-out captions, mean cosine {cosine:.4f}\n")
    print("| encoder | ms a sentence, median |\n|---|---|")
    for name, values in times.items():
        print(f"| {name} | {statistics.median(values):.2f} |")


def _run(
    encoders: dict[str, TextEncoder], sentences: list[str]
) -> tuple[dict[str, list[float]], dict[str, list[np.ndarray]]]:
    times, pooled = defaultdict(list), defaultdict(list)
    for sentence in sentences:
        for name, encoder in encoders.items():
            start = time.perf_counter()
            pooled[name].append(encoder([sentence]).pooled[0])
            times[name].append((time.perf_counter() - start) * 1e3)
    return times, pooled


if __name__ == "__main__":
    main()
