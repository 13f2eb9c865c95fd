"""Training of a text-motion evaluator by contrast within batches, into an evaluator folder.

Unlike the T2M authors' training, the movement encoder is not pretrained as an autoencoder: all
three networks are trained together. With several ranks each contrasts its own share of a batch.

With hard negatives a batch is groups of alike sentences (other counts, other directions, other
windows of the same act) and the mirror image of each crop, whose sentence has left and right
swapped. A pool of crops of similar length is halved again and again along the main direction of
their sentences' embeddings, until a few alike ones are left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from latentmotion.data.clip import Caption, Clip, mirror_words
from latentmotion.data.dataset import Crop, Cropping, Dataset, items_of
from latentmotion.errors import DataError, InputError, named
from latentmotion.evaluation.evaluators import text_motion
from latentmotion.evaluation.evaluators.text_motion_network import (
    FRAMES,
    InfoNCE,
    Margin,
    TextMotionConfig,
    TextMotionNetworks,
    TowerConfig,
    TowerNetworks,
    squared_distances,
    top_hits,
)
from latentmotion.evaluation.evaluators.words import GloveWords, Sentences, WordVectors
from latentmotion.storage.configuration import from_json
from latentmotion.storage.reading import packaged_toml
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.experiment import Embed, RarityDraws, TrainingSettings
from latentmotion.training.loop import Stage, train
from latentmotion.training.run_folder import MODEL, open_run, provenance_of
from latentmotion.training.vae import BatchSampler, FeatureCache

NetworkConfig = TextMotionConfig | TowerConfig  # Sizes of either kind of networks.

Networks = TextMotionNetworks | TowerNetworks  # Either kind of networks.


@dataclass(frozen=True)
class EvaluatorExperiment:
    """Everything that decides what training an evaluator yields, but data and word vectors."""

    name: str  # Name of the evaluator.
    networks: NetworkConfig  # Sizes; those of features and words are taken from the data.
    objective: InfoNCE | Margin  # The loss.
    training: TrainingSettings  # Optimization.
    # Longest crop, in frames; several take turns by step, so that it judges short crops too.
    longest: tuple[int, ...] = (196,)
    mirrored: bool = True  # Whether mirrored copies of the clips are trained on too.
    # Batches of alike sentences and mirror images; None for random ones.
    hard: HardNegatives | None = None
    draws: RarityDraws = field(default_factory=RarityDraws)  # How often rare sentences are seen.


# Settings of the presets by name.
RECIPES = packaged_toml(__file__, "evaluators.toml")


def recipe_named(name: str) -> EvaluatorExperiment:
    """Returns a preset.

    Raises:
        InputError: There is none of this name; the nearest is named.
    """
    return from_json(EvaluatorExperiment, {"name": name, **named("preset", name, RECIPES)})


LONGEST = 196  # Longest crop of any experiment, in frames.

GROUP = 32  # Motions among which a validation looks for the right one.


class EvaluatorStage(Stage[Networks]):
    """The networks, the crops and sentences they are shown, and those they are measured on.

    Args:
        networks: Networks to train.
        vectors: Sentences to word vectors.
        dataset: Motions and captions.
        experiment: Crops and loss.
        context: The device and rank.

    Raises:
        DataError: The training split has no captions.
    """

    def __init__(
        self,
        networks: Networks,
        vectors: WordVectors,
        dataset: Dataset,
        experiment: EvaluatorExperiment,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = networks
        self._vectors, self._context, self._experiment = vectors, context, experiment
        train = captioned(dataset.clips("train", mirrored=experiment.mirrored))
        if not train:
            raise DataError(f"{dataset.folder} has no captioned clip in its train split")
        held_out = captioned(dataset.clips("val"))
        # One crop for each caption, of the lengths that take turns in training.
        self._held_out: list[Crop] = []
        for clip in held_out:
            for turn, c in enumerate(clip.captions):
                longest = experiment.longest[turn % len(experiment.longest)]
                frames = min(c.end_frame - c.start_frame, longest) // FRAMES * FRAMES
                if frames > 0:
                    self._held_out.append(Crop(clip, c.start_frame, frames, c.text))
        self._captions = {c.text: c for clip in train + held_out for c in clip.captions}
        self._spans_of = {clip.id: spans_of(clip) for clip in train + held_out}
        self._memory = FeatureCache(dataset, [*train, *held_out], dataset.normalizer)
        batch, seed = experiment.training.batch_size, experiment.training.seed
        hard, draws = experiment.hard, experiment.draws
        items = draws.weigh(items_of(train), self._embed) if hard is None else []
        self._batch_samplers = [
            BatchSampler(items, batch, cropping, seed)
            if hard is None
            else HardBatchSampler(train, batch, cropping, hard, seed, self._embed, draws)
            for cropping in (Cropping(FRAMES, frames) for frames in experiment.longest)
        ]

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        turn, number = step % len(self._batch_samplers), step // len(self._batch_samplers)
        crops, ranks = self._batch_samplers[turn](number), self._context.ranks
        # Only dropout is random here; it is seeded by the step.
        StepRandomness(self._experiment.training.seed, step, len(crops), ranks)
        shard = crops[ranks.shard(len(crops))]
        squared = self._distances(self.network, [crop.caption for crop in shard], shard)
        return {"total": self._experiment.objective(squared, self._matches(shard))}

    @torch.no_grad()
    def validate(self, network: Networks) -> dict[str, float]:
        """Loss, and how often one of the right held-out motions is among the nearest 1, 2, 3."""
        crops, figures = self._held_out, []
        # Groups of `GROUP` in a fixed random order; fewer make one group.
        order = np.random.default_rng(0).permutation(len(crops))
        for n in range(max(len(crops) // GROUP, min(len(crops), 1))):
            group = [crops[i] for i in order[n * GROUP : (n + 1) * GROUP]]
            squared = self._distances(network, [crop.caption for crop in group], group)
            matches = self._matches(group)
            loss = float(self._experiment.objective(squared, matches))
            figures.append([loss, *top_hits(squared, matches)])
        names = ("loss", "top_1", "top_2", "top_3")
        means = np.mean(figures, axis=0).tolist() if figures else ()
        # How often a caption with a side is nearer than with left and right swapped.
        crops = [crop for crop in self._held_out if mirror_words(crop.caption) != crop.caption]
        hits = []
        for start in range(0, len(crops), GROUP):
            group = crops[start : start + GROUP]
            distances = self._distances(network, [crop.caption for crop in group], group)
            other = self._distances(network, [mirror_words(crop.caption) for crop in group], group)
            hits += (distances.diagonal() < other.diagonal()).tolist()
        return {
            **dict(zip(names, means, strict=False)),
            **({"sides": float(np.mean(hits))} if hits else {}),
        }

    def _distances(
        self, network: Networks, sentences: Sequence[str], crops: Sequence[Crop]
    ) -> Float[torch.Tensor, "sentences crops"]:
        device = self._context.device
        features, mask = self._memory.batch(crops, max(crop.frames for crop in crops))
        read = self._read(sentences)
        words, parts, words_mask = (
            torch.from_numpy(x) for x in (read.words, read.parts, read.mask)
        )
        motions = network.motions(features.to(device), mask.to(device))
        texts = network.texts(words.to(device), parts.to(device), words_mask.to(device))
        return squared_distances(texts, motions)

    def _read(self, sentences: Sequence[str]) -> Sentences:
        return self._vectors([self._captions.get(s, Caption(s, 0, 0)) for s in sentences])

    def _embed(self, sentences: Sequence[str]) -> Float[np.ndarray, "sentences width"]:
        """Returns the mean of each sentence's words."""
        read = self._read(sentences)
        real = read.mask[..., None]
        return (read.words * real).sum(axis=1) / real.sum(axis=1)

    def _matches(self, crops: Sequence[Crop]) -> Bool[torch.Tensor, "sentences motions"]:
        rows = [
            [_describes(self._spans_of[m.clip.id].get(s.caption, ()), m) for m in crops]
            for s in crops
        ]
        return torch.tensor(rows, device=self._context.device)


def captioned(clips: Sequence[Clip]) -> list[Clip]:
    """Returns the clips that have captions and a movement to look at."""
    return [clip for clip in clips if clip.captions and clip.frames >= FRAMES]


# First and one past the last frame of what each sentence describes.
Spans = Mapping[str, tuple[tuple[int, int], ...]]


def spans_of(clip: Clip) -> Spans:
    """Returns what each of a clip's sentences describes."""
    spans: dict[str, tuple[tuple[int, int], ...]] = {}
    for caption in clip.captions:
        span = caption.start_frame, caption.end_frame
        spans[caption.text] = (*spans.get(caption.text, ()), span)
    return spans


def _describes(spans: Sequence[tuple[int, int]], crop: Crop) -> bool:
    """Returns whether one of the spans and a crop are mostly the same part of a clip."""
    end = crop.start + crop.frames
    shared = ((min(last, end) - max(first, crop.start), last - first) for first, last in spans)
    # A crop of a long span is as long as crops can be.
    return any(2 * both > max(crop.frames, min(span, LONGEST)) for both, span in shared)


def train_evaluator(
    experiment: EvaluatorExperiment,
    data: Path,
    vectors: WordVectors,
    folder: Path,
    context: DistributedContext,
    encoder: Path | None = None,
) -> Path:
    """Trains an evaluator, or resumes its training; returns the evaluator folder.

    Args:
        experiment: Sizes and training.
        data: Folder that `latentmotion data prepare` made.
        vectors: Sentences to word vectors.
        folder: The run folder.
        context: The device and rank.
        encoder: Folder of the small text encoder behind `vectors`, copied into the result.

    Raises:
        DataError: The data cannot be used.
        InputError: The run folder holds another run.
    """
    dataset, settings = Dataset.load(data), experiment.training
    fitted = fit_to(experiment.networks, dataset, vectors)
    experiment = replace(experiment, networks=fitted)
    run = {"kind": "EvaluatorRun", "stage": "evaluator", "data": dataset.fingerprint}
    open_run(folder, {**run, "words": vectors.name, "experiment": experiment}, context)
    torch.manual_seed(settings.seed)
    stage = EvaluatorStage(fitted.build(), vectors, dataset, experiment, context)
    networks, seconds = train(stage, settings, folder, context)
    if context.is_main:
        figures = stage.validate(networks)
        card = text_motion.TextMotionCard(
            name=experiment.name,
            representation=dataset.representation.name,
            networks=experiment.networks,
            words=vectors.name,
            vocabulary=vectors.words if isinstance(vectors, GloveWords) else (),
            provenance=provenance_of(dataset, seconds),
            figures={f"val_{name}": round(value, 4) for name, value in figures.items()},
        )
        evaluator = text_motion.T2MEvaluator(card, networks.cpu(), dataset.normalizer, vectors)
        text_motion.save_text_motion(folder / MODEL, evaluator, encoder)
    return folder / MODEL


def fit_to(config: NetworkConfig, dataset: Dataset, vectors: WordVectors) -> NetworkConfig:
    """Returns the sizes with those that data and word vectors dictate."""
    blocks = dataset.representation.blocks
    contacts = blocks.get("contacts", slice(0, 0))
    fitted = replace(
        config,
        features=dataset.representation.width,
        left_out=contacts.stop - contacts.start,
        word_width=vectors.width,
    )
    if not isinstance(fitted, TowerConfig):
        return fitted
    if not {"rotations", "contacts"} <= set(blocks):
        raise DataError(
            f"features {dataset.representation.name!r} have no positions; preset scorer needs "
            "HumanML3D's or KIT's"
        )
    return replace(fitted, rotations=(blocks["rotations"].start, blocks["rotations"].stop))


@dataclass(frozen=True)
class HardNegatives:
    """Hardness of the contrasts of a batch."""

    alike: int = 16  # Crops of a group with alike sentences.
    pool: int = 8  # Batches among whose crops alike sentences are looked for.


class HardBatchSampler:
    """Which crops each step shows; the second half of a batch mirrors the first.

    Args:
        clips: Clips with captions, and the mirrored copy of each.
        batch_size: Crops of a step, mirror images included.
        cropping: Lengths of crops.
        hard: Similarity of the crops of a group.
        seed: Changes order and crops.
        embed: Sentences to embeddings.
        draws: Weights of rare sentences.

    Raises:
        InputError: There are no mirrored copies.
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        batch_size: int,
        cropping: Cropping,
        hard: HardNegatives,
        seed: int,
        embed: Embed,
        draws: RarityDraws,
    ) -> None:
        self._twins = {clip.id.removeprefix("M"): clip for clip in clips if clip.mirrored}
        if not self._twins:
            raise InputError("hard negatives are mirror images; leave mirrored=false out")
        items = draws.weigh(items_of(clip for clip in clips if not clip.mirrored), embed)
        self._half, self._hard, self._seed, self._embed = batch_size // 2, hard, seed, embed
        self._pools = BatchSampler(items, hard.pool * self._half, cropping, seed)
        self._ordered = lru_cache(maxsize=1)(self._order)

    def __call__(self, step: int) -> list[Crop]:
        """Returns the crops of step number `step`."""
        number, part = divmod(step, self._hard.pool)
        crops = self._ordered(number)
        # A small data set's pool is one batch or less.
        parts = max(len(crops) // self._half, 1)
        chosen = crops[part % parts * self._half :][: self._half]
        twins = []
        for crop in chosen:
            twin, mirrored = self._twins[crop.clip.id], mirror_words(crop.caption)
            numbers = [n for n, c in enumerate(crop.clip.captions) if c.text == crop.caption]
            texts = [caption.text for caption in twin.captions]
            # Official mirrored captions are the data set's own.
            caption = mirrored if mirrored in texts else texts[numbers[0] % len(texts)]
            twins.append(Crop(twin, crop.start, crop.frames, caption))
        return [*chosen, *twins]

    def _order(self, number: int) -> list[Crop]:
        """Returns the crops of a pool, alike ones next to each other."""
        crops = self._pools(number)
        groups = alike_groups(self._embed([crop.caption for crop in crops]), self._hard.alike)
        order = np.random.default_rng([self._seed, number]).permutation(len(groups))
        return [crops[row] for group in order for row in groups[group]]


def alike_groups(
    embeddings: Float[np.ndarray, "rows width"], most: int
) -> list[Int[np.ndarray, " _"]]:
    """Returns the rows in groups of at most `most` that lie close together."""
    groups = [np.arange(len(embeddings))]
    while max(map(len, groups)) > most:
        halves = []
        for rows in groups:
            centered = embeddings[rows] - embeddings[rows].mean(axis=0)
            direction = np.linalg.eigh(centered.T @ centered)[1][:, -1]
            ordered = rows[np.argsort(centered @ direction, kind="stable")]
            halves += [ordered[: len(rows) // 2], ordered[len(rows) // 2 :]]
        groups = halves
    return groups
