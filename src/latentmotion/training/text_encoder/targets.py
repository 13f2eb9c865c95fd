"""What the teacher says about every sentence, computed once and kept on disk for distillation."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from tokenizers import Tokenizer

from latentmotion.arrays import prefix_mask
from latentmotion.storage.files import atomic_folder

TeacherCall = Callable[
    [torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]
]  # (tokens, mask) → (pooled, states)
BATCH = 64


@dataclass(frozen=True)
class Targets:
    """Teacher's embeddings of many sentences; arrays may lie on disk."""

    pooled: Float[np.ndarray, "sentences width"]
    """Pooled embeddings of unit length."""

    words: Float[np.ndarray, "pieces width"]
    """States of all pieces, sentence after sentence, float16."""

    starts: Int[np.ndarray, " bounds"]
    """Where each sentence's pieces start in `words`, and the end of the last."""


def teacher_targets(
    folder: Path,
    sentences: Sequence[str],
    tokenizer: Tokenizer,
    teacher: TeacherCall,
    report: Callable[[str], None] = lambda line: None,
) -> Targets:
    """Returns the teacher's targets from `folder`, computing them there first if need be."""
    digest = hashlib.sha256("\n".join(sentences).encode()).hexdigest()
    stamp = folder / "sentences.json"
    if not stamp.is_file() or json.loads(stamp.read_text()) != digest:
        with atomic_folder(folder, stamp.name) as temporary:
            _compute(temporary, sentences, tokenizer, teacher, report)
            (temporary / stamp.name).write_text(json.dumps(digest))
    names = ("pooled", "words", "starts")
    return Targets(*(np.load(folder / f"{name}.npy", mmap_mode="r") for name in names))


def padded(ids: Sequence[Sequence[int]]) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns (tokens, mask) of several sentences, filled with zeros at the end."""
    lengths = torch.tensor([len(row) for row in ids])
    mask = prefix_mask(lengths)
    tokens = torch.zeros(mask.shape, dtype=torch.long)
    tokens[mask] = torch.tensor([token for row in ids for token in row])
    return tokens, mask


@torch.no_grad()
def _compute(
    folder: Path,
    sentences: Sequence[str],
    tokenizer: Tokenizer,
    teacher: TeacherCall,
    report: Callable[[str], None],
) -> None:
    ids = [encoding.ids for encoding in tokenizer.encode_batch(list(sentences))]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in ids])])
    width = teacher(*padded(ids[:1]))[0].shape[1]
    pooled = np.empty((len(ids), width), np.float32)
    words = np.empty((starts[-1], width), np.float16)
    by_length = np.argsort([len(row) for row in ids], kind="stable")
    for first in range(0, len(ids), BATCH):
        batch = by_length[first : first + BATCH]
        tokens, mask = padded([ids[place] for place in batch])
        sentence, states = teacher(tokens, mask)
        pooled[batch] = sentence.numpy()
        for place, row, real in zip(batch, states, mask, strict=True):
            words[starts[place] : starts[place + 1]] = row[real].numpy()
        if first // BATCH % 100 == 0:
            report(f"teacher: {first} of {len(ids)} sentences")
    for name, array in (("pooled", pooled), ("words", words), ("starts", starts)):
        np.save(folder / f"{name}.npy", array)
