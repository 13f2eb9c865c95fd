"""Graphs that hold the whole way from noise to features, one for each number of a student's steps.

They say what the generator's chain says, but Python and the engine are called once instead of once
per step; the decoder and both scales are inside.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from latentmotion.model.card import ModelCard
from latentmotion.runtime.session import OpenedWhenCalled, Runtime, Session

Walks = Mapping[int, Session]
"""By number of steps: noise, words, words_mask, mask, frames, guidance → features."""


def walk_file(steps: int) -> str:
    """Returns the name of a graph in a model's folder."""
    return f"walk_{steps}.onnx"


def open_walks(card: ModelCard, folder: Path, runtime: Runtime, threads: int | None) -> Walks:
    """Finds the graphs of a model folder; each is loaded when it is first called."""
    known = card.leaps.steps if card.leaps else ()
    return {
        steps: OpenedWhenCalled(folder / walk_file(steps), runtime, threads)
        for steps in known
        if (folder / walk_file(steps)).is_file()
    }
