"""Training of the length model: quantile regression on pooled embeddings, a minute on one core.

Pinball loss (Koenker & Bassett 1978) at all quantiles together; the embedding's mean and spread are
folded into the first layer. Besides captions it learns from a model's own motions, since the same
model turns 170° in 2.4 s and a full circle in 4 s: drawn prompts are generated at many lengths and
judged, `best_lengths` fits how likely a prompt is obeyed at each length, and takes the length where
that is highest; of lengths that are about as good, one near those of captions.
"""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.data.clip import TAG_RATE, Split, fit_sentences
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.humanml3d import read_index, read_splits, read_texts, sentences_of
from latentmotion.data.store import COMPOSED
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.lengths import QUANTILES, LengthModel
from latentmotion.errors import DataError, InputError
from latentmotion.measure.scene import describe
from latentmotion.pipeline import MotionPipeline
from latentmotion.progress import counted
from latentmotion.storage.files import write_file
from latentmotion.training.checking import fulfills
from latentmotion.training.drawn_instructions import drawn_instructions

# Sentences that are encoded together.
_AT_ONCE = 256

# Lengths among which the best is chosen.
_LENGTHS = 60


@dataclass(frozen=True)
class LengthRecipe:
    """Settings of the training."""

    hidden: int = 256  # Units of a hidden layer.
    layers: int = 3  # Number of hidden layers.
    passes: int = 20  # Number of passes over the sentences.
    batch: int = 256  # Sentences a step.
    learning_rate: float = 1e-3  # Peak learning rate, of one cycle.
    dropout: float = 0.1  # Dropout rate of inputs and hidden units.
    seed: int = 0  # Seed of first weights, order and dropout.


@dataclass(frozen=True)
class ObedienceRecipe:
    """Settings of the model of obedience by prompt and length."""

    hidden: int = 256  # Units of the hidden layer.
    passes: int = 20  # Number of passes over the motions.
    batch: int = 256  # Motions a step.
    learning_rate: float = 2e-3  # Peak learning rate, of one cycle.
    dropout: float = 0.5  # Dropout rate of inputs and hidden units.
    prompts: int = 20_000  # Drawn prompts whose best length is learned.
    copies: int = 3  # How often each of them stands beside each caption of the data.
    # Weight of the logarithm of the density of captions' lengths beside that of obeying.
    prior: float = 0.2
    seed: int = 0  # Seed of first weights, order, dropout and prompts.


class ObedienceNetwork(nn.Module):
    """The logit of obeying, from a prompt's embedding and the logarithm of a length.

    A sum of bumps over the logarithm, whose heights the embedding decides.

    Args:
        width: Numbers of an embedding.
        recipe: Its size.
    """

    BUMPS = 10  # Number of bumps, from 1 to 9.5 s.

    centers: Tensor

    def __init__(self, width: int, recipe: ObedienceRecipe) -> None:
        super().__init__()
        self.heights = nn.Sequential(
            nn.Dropout(recipe.dropout),
            nn.Linear(width, recipe.hidden),
            nn.GELU(),
            nn.Dropout(recipe.dropout),
            nn.Linear(recipe.hidden, self.BUMPS + 1),
        )
        self.register_buffer("centers", torch.linspace(0.0, math.log(9.5), self.BUMPS))

    def forward(
        self, embeddings: Float[Tensor, "*prompts width"], log_seconds: Float[Tensor, "*prompts"]
    ) -> Float[Tensor, "*prompts"]:
        """Returns the logit of obeying."""
        # Neighboring centers are 0.25 apart in the logarithm, so that bumps of deviation 0.25
        # overlap.
        bumps = torch.exp(-8 * (log_seconds[..., None] - self.centers) ** 2)
        heights = self.heights(embeddings)
        return (heights[..., : self.BUMPS] * bumps).sum(-1) + heights[..., self.BUMPS]


@dataclass(frozen=True)
class LengthFigures:
    """Accuracy of predicted lengths."""

    sentences: int  # Number of sentences.
    mae: float  # Mean absolute error of the median in seconds.
    # The same, where every sentence gets the median of those that were learned from.
    constant_mae: float
    inside: float  # Share of motions between the first and the last quantile; 0.8 would be right.


def train_lengths(
    captions: CaptionLengths, encoder: TextEncoder, recipe: LengthRecipe = LengthRecipe()
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
        widths = [x.shape[1], *[recipe.hidden] * recipe.layers]
        hidden = [
            (nn.Dropout(recipe.dropout), nn.Linear(into, out), nn.ReLU())
            for into, out in pairwise(widths)
        ]
        last = nn.Linear(widths[-1], len(QUANTILES))
        with torch.no_grad():
            last.bias.copy_(torch.tensor(np.quantile(captions.seconds, QUANTILES)))
        network = nn.Sequential(*chain(*hidden), nn.Dropout(recipe.dropout), last)
        shares = torch.tensor(QUANTILES)

        def pinball(rows: Tensor) -> Tensor:
            missing = y[rows, None] - network((x[rows] - mean) / std)
            return torch.maximum(shares * missing, (shares - 1) * missing).mean()

        _minimize(network, pinball, len(y), recipe)
    linear = [layer for layer in network if isinstance(layer, nn.Linear)]
    with torch.no_grad():
        first = linear[0]
        first.bias.sub_(first.weight @ (mean / std))
        first.weight.div_(std)
    weights, biases = (
        tuple(getattr(layer, part).detach().numpy() for layer in linear)
        for part in ("weight", "bias")
    )
    return LengthModel(encoder.name, weights, biases)


def best_lengths(
    verdicts: LengthVerdicts,
    usual: LengthModel,
    encoder: TextEncoder,
    recipe: ObedienceRecipe = ObedienceRecipe(),
) -> CaptionLengths:
    """Returns drawn prompts with the lengths at which a model most likely obeys them.

    Args:
        verdicts: Motions of the model, of other prompts and many lengths.
        usual: Trained on captions alone; it decides between lengths that are about as good.
        encoder: Whose embeddings are read.
        recipe: The settings.
    """
    prompts = [item.prompt for item in drawn_instructions(recipe.prompts, recipe.seed)]
    train, drawn = (
        torch.tensor(pooled_embeddings(encoder, some)) for some in (verdicts.prompts, prompts)
    )
    mean, std = train.mean(0), train.std(0) + 1e-3
    log_seconds, obeyed = torch.tensor(verdicts.seconds).log(), torch.tensor(verdicts.obeyed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(recipe.seed)
        network = ObedienceNetwork(train.shape[1], recipe)
        _minimize(
            network,
            lambda rows: F.binary_cross_entropy_with_logits(
                network((train[rows] - mean) / std, log_seconds[rows]), obeyed[rows].float()
            ),
            len(obeyed),
            recipe,
        )
    network.eval()
    lengths = torch.linspace(float(log_seconds.min()), float(log_seconds.max()), _LENGTHS)
    # The logarithm of a log-normal density, up to a constant, with the quartiles that are usual;
    # the interquartile range of a normal distribution is 1.349 deviations.
    quartiles = usual(drawn.numpy())[:, [QUANTILES.index(share) for share in (0.25, 0.5, 0.75)]]
    low, middle, high = np.log(quartiles.clip(0.5)).T[..., None]
    spread = np.maximum((high - low) / 1.349, 0.15)
    priors = torch.tensor((-0.5 * ((lengths.numpy() - middle) / spread) ** 2).astype(np.float32))
    best = []
    with torch.no_grad():
        for row, prior in zip((drawn - mean) / std, priors, strict=True):
            obeys = F.logsigmoid(network(row.expand(_LENGTHS, -1), lengths))
            best.append(lengths[(obeys + recipe.prior * prior).argmax()])
    seconds = torch.stack(best).exp().numpy()
    return CaptionLengths(tuple(prompts) * recipe.copies, np.tile(seconds, recipe.copies))


def kept_lengths(
    earlier: LengthModel, encoder: TextEncoder, recipe: ObedienceRecipe = ObedienceRecipe()
) -> CaptionLengths:
    """Returns drawn prompts with the lengths that an earlier model predicts for them.

    Args:
        earlier: The model, which may have learned them from motions.
        encoder: Whose embeddings it reads.
        recipe: Number of prompts and copies, and the seed.
    """
    prompts = [item.prompt for item in drawn_instructions(recipe.prompts, recipe.seed)]
    seconds = np.array(earlier.usual(pooled_embeddings(encoder, prompts)), np.float32)
    return CaptionLengths(tuple(prompts) * recipe.copies, np.tile(seconds, recipe.copies))


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
    predicted, true = model(pooled_embeddings(encoder, captions.sentences)), captions.seconds
    return LengthFigures(
        sentences=len(true),
        mae=float(np.abs(predicted[:, QUANTILES.index(0.5)] - true).mean()),
        constant_mae=float(np.abs(constant - true).mean()),
        inside=float(((predicted[:, 0] - near <= true) & (true <= predicted[:, -1] + near)).mean()),
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


def _minimize(
    network: nn.Module,
    loss_of: Callable[[Tensor], Tensor],
    count: int,
    recipe: LengthRecipe | ObedienceRecipe,
) -> None:
    """Minimizes the loss of rows, given by their numbers, with AdamW in one cycle."""
    optimizer = torch.optim.AdamW(network.parameters(), recipe.learning_rate, weight_decay=0.01)
    steps = recipe.passes * -(-count // recipe.batch)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimizer, recipe.learning_rate, steps)
    for _ in range(recipe.passes):
        for rows in torch.randperm(count).split(recipe.batch):
            loss = loss_of(rows)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            cycle.step()


@dataclass(frozen=True)
class LengthTrials:
    """Which motions are generated."""

    prompts: int = 6000  # Prompts that are drawn.
    takes: int = 6  # Motions of each, their lengths spread evenly on a logarithmic scale.
    shortest: float = 1.2  # Shortest length in seconds.
    longest: float = 8.6  # Longest length in seconds.
    seed: int = 1  # Seed of prompts, lengths and noise.

    def lengths(self, number: int, fps: float) -> list[float]:
        """Returns the lengths of a prompt's motions in seconds, in whole frames.

        Args:
            number: The prompt's.
            fps: Frames per second.
        """
        drawn = np.random.default_rng([self.seed, number]).random(self.takes)
        share = (np.arange(self.takes) + drawn) / self.takes
        seconds = self.shortest * (self.longest / self.shortest) ** share
        return (np.round(seconds * fps) / fps).tolist()


@dataclass(frozen=True)
class LengthVerdicts:
    """Whether a model did what prompts ask, at some lengths."""

    prompts: tuple[str, ...]  # A prompt for each motion.
    seconds: Float[np.ndarray, " motions"]  # Its length.
    obeyed: Bool[np.ndarray, " motions"]  # Whether it did what the prompt asks.


def judged_lengths(model: MotionPipeline, trials: LengthTrials, journal: Path) -> LengthVerdicts:
    """Generates drawn prompts at many lengths and judges the motions.

    Args:
        model: Generates the motions.
        trials: Which motions.
        journal: File that keeps the results, of an earlier run too.

    Raises:
        DataError: The journal is damaged.
        InputError: The journal is of other trials or of another model.
    """
    about = {"model": model.card.name, **asdict(trials)}
    rows: list[Any] = [about]
    if journal.is_file():
        # A killed run may leave a half-written last line.
        complete = journal.read_text(encoding="utf-8").rpartition("\n")[0]
        try:
            rows = [json.loads(line) for line in complete.splitlines()]
        except json.JSONDecodeError as error:
            raise DataError(f"{journal} is damaged ({error}); delete it") from error
        if not rows or rows[0] != about:
            raise InputError(f"{journal} is of other trials than {about}; delete it")
    write_file(journal, "".join(json.dumps(row) + "\n" for row in rows))
    rows = rows[1:]
    instructions = drawn_instructions(trials.prompts, trials.seed)
    with journal.open("a", encoding="utf-8") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unknown words show in the result
        left = range(len(rows), len(instructions))
        for number in counted(left, "trials of prompts", done=len(rows)):
            instruction = instructions[number]
            lengths = trials.lengths(number, model.representation.fps)
            first = trials.seed * 2**24 + trials.takes * number
            seeds = [first + take for take in range(trials.takes)]
            motions = model.batch([instruction.prompt] * trials.takes, lengths, seeds)
            verdicts = [fulfills(describe(motion.joints), instruction.check) for motion in motions]
            rows.append((instruction.prompt, list(zip(lengths, verdicts, strict=True))))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    trial = [(prompt, *each) for prompt, every in rows for each in every]
    prompts, seconds, obeyed = zip(*trial, strict=True)
    return LengthVerdicts(prompts, np.array(seconds, np.float32), np.array(obeyed, bool))


# Frames of HumanML3D's items: left out below the first, from the second on; cut to the third.
SHORTEST, TOO_LONG, LONGEST = 40, 200, 196

# Seconds of the shortest act of a prepared folder; clips may be cut close to what happens.
SHORTEST_ACT = 1.6


@dataclass(frozen=True)
class CaptionLengths:
    """Sentences with the lengths of their motions."""

    sentences: tuple[str, ...]  # The sentences; several may describe one motion.
    seconds: Float[np.ndarray, " sentences"]  # Lengths of their motions, seconds.


def read_caption_lengths(folder: Path, split: Split) -> CaptionLengths:
    """Reads the sentences of a split with lengths, unmirrored.

    Args:
        folder: HumanML3D's folder with texts, train.txt, val.txt, test.txt and index.csv.
        split: Name of the split.

    Raises:
        DataError: A file is missing or damaged, or the split has no sentence.
    """
    splits, texts = read_splits(folder), read_texts(folder)
    sentences: list[str] = []
    seconds: list[float] = []
    for row in read_index(folder):
        frames = max(row.end - row.start - 1, 0)
        if row.end < 0 and (span := re.search(r"F(\d+)T(\d+)", row.path)):  # HumanAct12's names
            frames = max(int(span[2]) - int(span[1]), 0)
        if splits.get(row.id) != split or not frames:
            continue
        for caption in fit_sentences(sentences_of(texts, row.id), frames)[0]:
            length = caption.end_frame - caption.start_frame
            if SHORTEST <= length < TOO_LONG:
                sentences.append(caption.text)
                seconds.append(min(length, LONGEST) / TAG_RATE)
    if not sentences:
        raise DataError(f"{folder}: no sentence of the split {split} has a length in index.csv")
    return CaptionLengths(tuple(sentences), np.array(seconds, np.float32))


def prepared_caption_lengths(dataset: Dataset, split: Split) -> CaptionLengths:
    """Returns the sentences of a prepared folder that describe whole clips, with their lengths.

    Spans inside a clip are cut where a describer saw something, at any length, and composed clips
    are as long as what was put together: neither tells how long people do it.

    Args:
        dataset: The prepared folder.
        split: Name of the split.

    Raises:
        DataError: The split has no such sentence.
    """
    fps = dataset.representation.fps
    rows = [
        (caption.text, max(clip.frames / fps, SHORTEST_ACT))
        for clip in dataset.clips(split)
        for caption in clip.captions
        if clip.source != COMPOSED and caption.end_frame - caption.start_frame == clip.frames
    ]
    if not rows:
        raise DataError(f"{dataset.folder}: no caption of the split {split} tells of a whole clip")
    sentences, seconds = zip(*rows, strict=True)
    return CaptionLengths(sentences, np.array(seconds, np.float32))


def joined(sets: Sequence[CaptionLengths]) -> CaptionLengths:
    """Returns several sets as one."""
    sentences = tuple(sentence for lengths in sets for sentence in lengths.sentences)
    return CaptionLengths(sentences, np.concatenate([lengths.seconds for lengths in sets]))
