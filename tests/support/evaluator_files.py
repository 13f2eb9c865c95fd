"""The files of the authors' T2M evaluator, tiny and of random weights."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import torch

from latentmotion.evaluation.evaluators.text_motion_network import TextMotionConfig

TINY = TextMotionConfig(263, 4, 300, 8, 6, 6, 5)
WORDS = ["sos", "eos", "unk", "a", "man", "walk", "fast", "zebra"]


def write_glove(folder: Path, words: list[str] = WORDS, width: int = 300) -> Path:
    """The three official files, with the vectors in another order than the words."""
    folder.mkdir(exist_ok=True)
    numbers = {word: len(words) - 1 - place for place, word in enumerate(words)}
    vectors = np.random.default_rng(0).normal(size=(len(words), width))
    np.save(folder / "our_vab_data.npy", vectors)
    (folder / "our_vab_words.pkl").write_bytes(pickle.dumps(words, 3))
    (folder / "our_vab_idx.pkl").write_bytes(pickle.dumps(numbers, 3))
    return folder


def write_checkpoint(path: Path, config: TextMotionConfig = TINY) -> Path:
    """A file in the layout of finest.tar, optimizer and counters included."""
    torch.manual_seed(0)
    networks = config.build()
    parts = {
        name: getattr(networks, name).state_dict()
        for name in ("text_encoder", "movement_encoder", "motion_encoder")
    }
    torch.save({**parts, "opt_text_encoder": {"state": {}}, "epoch": 7}, path)
    return path


def write_statistics(folder: Path, features: int = 263) -> Path:
    folder.mkdir(exist_ok=True)
    np.save(folder / "mean.npy", np.linspace(-1, 1, features))
    np.save(folder / "std.npy", np.linspace(0.5, 2, features))
    return folder
