"""Training of the length model: quantile regression on pooled embeddings, a minute on one core.

Pinball loss (Koenker & Bassett 1978) at all quantiles together; the embedding's mean and spread are
folded into the first layer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion.condition.interface import TextEncoder
from latentmotion.data.captions import TAG_RATE
from latentmotion.data.lengths import CaptionLengths
from latentmotion.text.lengths import QUANTILES, LengthModel

_AT_ONCE = 256
"""Sentences that are encoded together."""


@dataclass(frozen=True)
class LengthRecipe:
    """Settings of the training."""

    hidden: int = 192
    """Units of the hidden layer."""
    passes: int = 20
    """How often each sentence is seen."""
    batch: int = 256
    """Sentences a step."""
    learning_rate: float = 2e-3
    """Peak learning rate, of one cycle."""
    dropout: float = 0.2
    """Of inputs and hidden units."""
    seed: int = 0
    """Seed of first weights, order and dropout."""


@dataclass(frozen=True)
class LengthFigures:
    """Accuracy of predicted lengths."""

    sentences: int
    """Number of sentences."""
    mae: float
    """Mean absolute error of the median in seconds."""
    constant_mae: float
    """The same, where every sentence gets the median of those that were learned from."""
    inside: float
    """Share of motions between the first and the last quantile; 0.8 would be right."""


def train_lengths(
    captions: CaptionLengths,
    encoder: TextEncoder,
    recipe: LengthRecipe = LengthRecipe(),
) -> LengthModel:
    """Returns a model trained on the sentences; the same seed gives the same model.

    Args:
        captions: Sentences and lengths to learn from.
        encoder: Whose embeddings it reads.
        recipe: The settings.
    """
    x = torch.tensor(pooled_embeddings(encoder, captions.sentences))
    y = torch.tensor(captions.seconds)
    mean, std = x.mean(0), x.std(0, correction=0)
    std = std.clamp(min=0.1 * float(std.mean()) + 1e-6)  # some numbers are nearly constant
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(recipe.seed)
        network = _network(x.shape[1], recipe, captions.seconds)
        _fit(network, (x - mean) / std, y, recipe)
    first, last = network[1], network[4]
    assert isinstance(first, nn.Linear) and isinstance(last, nn.Linear)
    with torch.no_grad():
        weight = first.weight / std
        arrays = weight, first.bias - weight @ mean, last.weight, last.bias
    return LengthModel(encoder.name, *(array.detach().numpy() for array in arrays))


def measured(
    model: LengthModel, captions: CaptionLengths, encoder: TextEncoder, constant: float
) -> LengthFigures:
    """Returns how accurately a model predicts the lengths of sentences.

    Args:
        model: The model.
        captions: Sentences with their true lengths.
        encoder: The text encoder.
        constant: The length in seconds that it is compared with.
    """
    near = 0.5 / TAG_RATE  # a third of all lengths is the longest
    found, true = model(pooled_embeddings(encoder, captions.sentences)), captions.seconds
    return LengthFigures(
        sentences=len(true),
        mae=float(np.abs(found[:, QUANTILES.index(0.5)] - true).mean()),
        constant_mae=float(np.abs(constant - true).mean()),
        inside=float(((found[:, 0] - near <= true) & (true <= found[:, -1] + near)).mean()),
    )


def pooled_embeddings(
    encoder: TextEncoder, sentences: Sequence[str]
) -> Float[np.ndarray, "sentences width"]:
    """Returns the sentences' embeddings; a sentence that comes again is read once."""
    each = list(dict.fromkeys(sentences))
    starts = range(0, len(each), _AT_ONCE)
    rows = np.concatenate([encoder(each[start : start + _AT_ONCE]).pooled for start in starts])
    rows_of = {sentence: number for number, sentence in enumerate(each)}
    return rows[[rows_of[sentence] for sentence in sentences]]


def _network(
    width: int, recipe: LengthRecipe, seconds: Float[np.ndarray, " sentences"]
) -> nn.Sequential:
    network = nn.Sequential(
        nn.Dropout(recipe.dropout),
        nn.Linear(width, recipe.hidden),
        nn.ReLU(),
        nn.Dropout(recipe.dropout),
        last := nn.Linear(recipe.hidden, len(QUANTILES)),
    )
    with torch.no_grad():
        last.bias.copy_(torch.tensor(np.quantile(seconds, QUANTILES)))
    return network


def _fit(
    network: nn.Sequential,
    x: Float[Tensor, "sentences width"],
    y: Float[Tensor, " sentences"],
    recipe: LengthRecipe,
) -> None:
    optimizer = torch.optim.AdamW(network.parameters(), recipe.learning_rate, weight_decay=0.01)
    steps = recipe.passes * -(-len(y) // recipe.batch)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimizer, recipe.learning_rate, steps)
    for rows in _batches(len(y), recipe):
        loss = _pinball(network(x[rows]), y[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        cycle.step()


def _batches(count: int, recipe: LengthRecipe) -> Iterator[Tensor]:
    for _ in range(recipe.passes):
        yield from torch.randperm(count).split(recipe.batch)


def _pinball(
    found: Float[Tensor, "batch quantiles"], true: Float[Tensor, " batch"]
) -> Float[Tensor, ""]:
    missing, shares = true[:, None] - found, found.new_tensor(QUANTILES)
    return torch.maximum(shares * missing, (shares - 1) * missing).mean()
