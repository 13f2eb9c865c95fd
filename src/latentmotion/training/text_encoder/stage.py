"""Distillation of a small text encoder from a large one: the losses and the training loop.

For a batch of sentences with teacher embeddings p (unit length) and states h, and the student's
p̂ and ĥ:

    loss = 20 · mean ‖p̂ − p‖²  +  mean ‖ĥ − h‖² / ‖h‖²  +  20 · mean (p̂ p̂ᵀ − p pᵀ)²

The last term keeps the distances between sentences (relational distillation, Park et al. 2019),
which decide what the nearest caption is. States are compared only where both tokenizers cut a
sentence alike.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from latentmotion.networks.text_encoder import StudentNetwork
from latentmotion.storage.files import atomic_file
from latentmotion.training.text_encoder.targets import Targets, padded

POOLED_WEIGHT = 20.0
RELATION_WEIGHT = 20.0
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Batch:
    """Sentences of similar length with what the teacher says of them."""

    tokens: Int[torch.Tensor, "batch words"]
    mask: Bool[torch.Tensor, "batch words"]
    pooled: Float[torch.Tensor, "batch width"]
    aligned: Bool[torch.Tensor, "batch words"]
    """True on pieces that the teacher has too."""

    words: Float[torch.Tensor, "pieces width"]
    """The teacher's states of the aligned pieces, in their order."""

    def to(self, device: torch.device) -> Batch:
        """Returns the batch on a device."""
        parts = (self.tokens, self.mask, self.pooled, self.aligned, self.words)
        return Batch(*(part.to(device) for part in parts))


@dataclass(frozen=True)
class TrainingSet:
    """Sentences in the student's pieces and the teacher's targets."""

    ids: Sequence[Sequence[int]]
    aligned: Sequence[bool]
    """Whether student and teacher cut the sentence alike."""

    targets: Targets

    def batch(self, rows: Int[np.ndarray, " batch"]) -> Batch:
        """Returns the sentences at these rows."""
        tokens, mask = padded([self.ids[row] for row in rows])
        alike = torch.tensor([self.aligned[row] for row in rows])
        starts = self.targets.starts
        words = [
            self.targets.words[starts[row] : starts[row + 1]] for row in rows if self.aligned[row]
        ]
        width = self.targets.words.shape[1]
        states = np.concatenate([np.zeros((0, width), np.float16), *words]).astype(np.float32)
        pooled = torch.from_numpy(self.targets.pooled[rows])
        return Batch(tokens, mask, pooled, mask & alike[:, None], torch.from_numpy(states))


@dataclass(frozen=True)
class Schedule:
    """Length and pace of a distillation run."""

    steps: int
    """Optimizer steps in all."""

    batch: int = 64
    """Sentences a step."""

    learning_rate: float = 4e-4
    """Peak of the rate, reached after `warmup` steps, then falling to 0 along a cosine."""

    warmup: int = 200
    """Steps of linear rise."""

    seed: int = 0
    """Seed of the order of sentences."""

    def rate(self, step: int) -> float:
        """The learning rate at a step."""
        rise = min(1.0, (step + 1) / self.warmup)
        return rise * self.learning_rate * 0.5 * (1 + math.cos(math.pi * step / self.steps))


def distillation_loss(
    pooled: Float[torch.Tensor, "batch width"],
    states: Float[torch.Tensor, "batch words width"],
    batch: Batch,
) -> Float[torch.Tensor, ""]:
    """The loss of one batch, see the head of this file."""
    sentence = (pooled - batch.pooled).square().sum(1).mean()
    relation = (pooled @ pooled.T - batch.pooled @ batch.pooled.T).square().mean()
    error = (states.float()[batch.aligned] - batch.words).square().sum(1)
    words = (error / batch.words.square().sum(1)).sum() / max(1, len(batch.words))
    return POOLED_WEIGHT * sentence + words + RELATION_WEIGHT * relation


def batches(
    lengths: Int[np.ndarray, " sentences"], size: int, seed: int, step: int
) -> Iterator[Int[np.ndarray, " batch"]]:
    """Yields the rows of each batch from a step on, forever; the order depends on no state."""
    count = len(lengths) // size
    for epoch in range(step // count, 2**31):
        order = np.random.default_rng((seed, epoch)).permutation(len(lengths))[: count * size]
        yield from _by_length(order, lengths, size, (seed, epoch))[step % count :]
        step = 0


def _by_length(
    order: Int[np.ndarray, " rows"],
    lengths: Int[np.ndarray, " sentences"],
    size: int,
    seed: tuple[int, int],
) -> list[Int[np.ndarray, " batch"]]:
    """Sorts a shuffled order by length in windows of 50 batches, so that padding stays small."""
    window = 50 * size
    parts = [order[first : first + window] for first in range(0, len(order), window)]
    rows = [row for part in parts for row in _rows(part[np.argsort(lengths[part])], size)]
    shuffled = np.random.default_rng((*seed, 1)).permutation(len(rows))
    return [rows[row] for row in shuffled]


def _rows(rows: np.ndarray, size: int) -> list[np.ndarray]:
    return np.split(rows, len(rows) // size)


def distill(
    network: StudentNetwork,
    data: TrainingSet,
    schedule: Schedule,
    checkpoint: Path,
    report: Callable[[str], None] = print,
    save_every: int = 500,
    device: torch.device = CPU,
) -> None:
    """Trains `network` in place, resuming from `checkpoint` if there is one.

    On one machine an interrupted and resumed run ends with the very numbers of an unbroken one.

    Args:
        network: The student.
        data: What it learns.
        schedule: Steps, batch, rate, seed.
        checkpoint: File for weights, optimizer and step.
        report: Called with a line of progress every 100 steps.
        save_every: Steps between checkpoints.
        device: Where the network and its batches are; the network stays there.
    """
    network.to(device)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=0.01, betas=(0.9, 0.98))
    first = _resume(checkpoint, network, optimizer)
    lengths = np.array([len(row) for row in data.ids])
    order = batches(lengths, schedule.batch, schedule.seed, first)
    started, total = time.monotonic(), 0.0
    for step, rows in zip(range(first, schedule.steps), order, strict=False):
        total += _step(network, optimizer, data.batch(rows).to(device), schedule.rate(step))
        if (step + 1) % 100 == 0:
            pace = (time.monotonic() - started) / (step + 1 - first)
            left = pace * (schedule.steps - step - 1) / 60
            report(f"step {step + 1} loss {total / 100:.4f} {pace:.3f} s/step {left:.1f} min left")
            total = 0.0
        if (step + 1) % save_every == 0 or step + 1 == schedule.steps:
            _save(checkpoint, network, optimizer, step + 1)


def _step(
    network: StudentNetwork, optimizer: torch.optim.Optimizer, batch: Batch, rate: float
) -> float:
    for group in optimizer.param_groups:
        group["lr"] = rate
    with torch.autocast(batch.tokens.device.type, torch.bfloat16):
        pooled, states = network(batch.tokens, batch.mask)
    loss = distillation_loss(pooled, states, batch)
    optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    return float(loss.detach())


def _save(path: Path, network: StudentNetwork, optimizer: torch.optim.Optimizer, step: int) -> None:
    state = {"network": network.state_dict(), "optimizer": optimizer.state_dict(), "step": step}
    with atomic_file(path) as temporary:
        torch.save(state, temporary)


def _resume(path: Path, network: StudentNetwork, optimizer: torch.optim.Optimizer) -> int:
    if not path.is_file():
        return 0
    state = torch.load(path, map_location="cpu", weights_only=True)
    network.load_state_dict(state["network"])
    optimizer.load_state_dict(state["optimizer"])
    return int(state["step"])
