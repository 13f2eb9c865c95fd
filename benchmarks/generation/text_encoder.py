"""How long the shipped text encoder takes for a sentence, beside its teacher, on one core.

    python -m benchmarks.generation.text_encoder --captions humanml3d/texts.json.xz

Both take turns over the same held-out captions, one sentence at a time; without captions over made
ones, which are all alike in length.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import torch

from benchmarks.generation.ours import sentences
from benchmarks.harness.contest import Contender, figure, table, take_turns, whole
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.encoder import StudentTextEncoder
from latentmotion.model.card import find_model
from latentmotion.networks.pretrained_text import PretrainedTextEncoder
from latentmotion.training.text_encoder import is_held_out, read_captions


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captions", type=Path)
    parser.add_argument("--model", default="starter")
    parser.add_argument("--turns", type=int, default=200)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    encoders: dict[str, TextEncoder] = {
        "ours": StudentTextEncoder.load(find_model(options.model), threads=1),
        "MiniLM, transformers": PretrainedTextEncoder.load("minilm"),
    }
    asked = _sentences(options.captions, options.turns)
    contenders = {name: _contender(encoder, asked) for name, encoder in encoders.items()}
    times = take_turns(contenders, options.turns)
    ours, theirs = (encoder(asked[:100]).pooled for encoder in encoders.values())
    print(f"{times}; mean cosine {np.mean((ours * theirs).sum(axis=1)):.4f}\n")
    rows = [[name, figure(times.whole(name)), figure(times.processor(name))] for name in encoders]
    print(table(["encoder", "ms a sentence", "processor"], rows))


def _sentences(captions: Path | None, count: int) -> list[str]:
    if captions is None:
        return list(islice(sentences(), count))
    return [c.text for c in read_captions(captions) if is_held_out(c.text)][:count]


def _contender(encoder: TextEncoder, asked: Sequence[str]) -> Contender:
    turn = cycle(asked)
    return whole(lambda: encoder([next(turn)]))


if __name__ == "__main__":
    main()
