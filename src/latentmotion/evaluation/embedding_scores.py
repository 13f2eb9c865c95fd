"""Metrics of one replication that an evaluator's embeddings give."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.embedding_cache import EmbeddingCache, Embeddings
from latentmotion.evaluation.metrics.distribution import Gaussian, drawn_kid, frechet_distance, kid
from latentmotion.evaluation.metrics.diversity import (
    diversity,
    drawn_diversity,
    label_pairs,
    multimodality,
    shared_pairs_multimodality,
)
from latentmotion.evaluation.metrics.retrieval import BEST, accuracy, mm_dist, r_precision, ranks
from latentmotion.evaluation.protocol import Protocol
from latentmotion.evaluation.test_set import Replication

Scores = dict[str, float]


def embedding_scores(
    embeddings: Embeddings, real: Embeddings, prompted: bool, protocol: Protocol, replication: int
) -> Scores:
    """Returns the figures of a candidate's motions.

    Args:
        embeddings: The candidate's motions.
        real: The real motions.
        prompted: Whether the motions depend on captions or labels.
        protocol: Rules of the evaluation.
        replication: Number of the replication.
    """
    scores = {
        "Diversity": _diversity(embeddings, protocol, replication, real=False),
        **_distances(embeddings, real, protocol, replication, paired=True),
    }
    if prompted:
        scores |= _prompt_scores(embeddings, protocol, replication, real=False)
    return scores


def ground_truth_scores(real: Embeddings, protocol: Protocol, replication: int) -> Scores:
    """Returns the figures of the real motions; FID and KID are those of two random halves."""
    order = protocol.generator("halves", replication).permutation(len(real.motions))
    half = len(order) // 2
    whole = protocol.quirks.permuted_truth or half < 2
    one, other = (order, slice(None)) if whole else (order[:half], order[half:])
    first, second = Embeddings(real.motions[one]), Embeddings(real.motions[other])
    return {
        **_distances(first, second, protocol, replication, paired=False),
        "Diversity": _diversity(real, protocol, replication, real=True),
        **_prompt_scores(real, protocol, replication, real=True),
    }


def measures_multimodality(candidate: Generated, protocol: Protocol, replication: int) -> bool:
    """Returns whether a replication measures MultiModality of captions."""
    repeats = protocol.repeats
    wanted = repeats.texts > 0 and repeats.samples > 1
    return wanted and candidate.card.condition.reads_text and replication < repeats.replications


def caption_multimodality(
    candidate: Generated, replication: Replication, cache: EmbeddingCache, protocol: Protocol
) -> float:
    """Generates many motions for some captions and returns their MultiModality."""
    repeats, number = protocol.repeats, replication.number
    generator = protocol.generator("repeats", number)
    count = min(repeats.texts, len(replication.prompts))
    rows = generator.choice(len(replication.prompts), count, replace=False)
    prompts = [replication.prompts[row] for row in rows for _ in range(repeats.samples)]
    seeds = [
        seed
        for row in rows
        for seed in protocol.seeds("repeats", number, repeats.samples, int(row))
    ]
    motions = candidate.generate(prompts, seeds)
    embeddings = np.asarray(cache.motions(motions)).reshape(count, repeats.samples, -1)
    if repeats.pairs is None:
        return multimodality(list(embeddings))
    pairs = min(repeats.pairs, repeats.samples)
    one, other = (generator.choice(repeats.samples, pairs, replace=False) for _ in range(2))
    return shared_pairs_multimodality(embeddings, one, other)


def groups(
    items: int, size: int, generator: np.random.Generator, drop: bool
) -> Iterator[tuple[Int[np.ndarray, " group"], int]]:
    """Yields random groups of items, each with the number of its first items that count.

    Args:
        items: Number of items.
        size: Items of a group; fewer items make one group.
        generator: Source of randomness.
        drop: Whether an incomplete last group is left out, or filled up with other items.
    """
    order, size = generator.permutation(items), min(size, items)
    full = items // size * size
    for start in range(0, full, size):
        yield order[start : start + size], size
    if full < items and not drop:
        rest = order[full:]
        yield np.concatenate([rest, order[: size - len(rest)]]), len(rest)


def _distances(
    one: Embeddings, other: Embeddings, protocol: Protocol, replication: int, paired: bool
) -> Scores:
    """FID and KID."""
    pairs, single = protocol.quirks.drawn_pairs, protocol.quirks.float32_means
    x, y = one.motions, other.motions
    distance = frechet_distance(Gaussian.of(x, single), Gaussian.of(y, single))
    if pairs is None:
        return {"FID": distance, "KID": kid(x, y, paired)}
    generator = protocol.generator("kid", replication)
    drawn = drawn_kid(x, y, pairs.kid_subsets, pairs.kid_size, generator)
    return {"FID": distance, "KID": drawn}


def _diversity(embeddings: Embeddings, protocol: Protocol, replication: int, real: bool) -> float:
    pairs = protocol.quirks.drawn_pairs
    if pairs is None:
        return diversity(embeddings.motions)
    generator, items = protocol.generator("diversity", replication), len(embeddings.motions)
    if embeddings.logits is None:
        count = min(pairs.text_diversity, items)
        one, other = (generator.choice(items, count, replace=False) for _ in range(2))
    else:
        count = pairs.true_action_diversity if real else pairs.action_diversity
        one, other = generator.integers(items, size=(2, count))
    return drawn_diversity(embeddings.motions, one, other)


def _prompt_scores(
    embeddings: Embeddings, protocol: Protocol, replication: int, real: bool
) -> Scores:
    """R-precision and MM-Dist of captions; accuracy and MultiModality of labels."""
    scores: Scores = {}
    motions, texts, labels = embeddings.motions, embeddings.texts, embeddings.labels
    if texts is not None:
        generator = protocol.generator("groups", replication)
        drop = protocol.quirks.remainder_dropped
        drawn = list(groups(len(motions), protocol.group, generator, drop))
        places = np.concatenate([ranks(texts[rows], motions[rows])[:own] for rows, own in drawn])
        counted = np.concatenate([rows[:own] for rows, own in drawn])
        shares = r_precision(places)
        scores |= {f"R@{k}": share for k, share in zip(BEST, shares, strict=True)}
        scores["MM-Dist"] = mm_dist(texts[counted], motions[counted])
    if embeddings.logits is not None and labels is not None:
        scores["Accuracy"] = accuracy(embeddings.logits, labels)
        scores["MultiModality"] = _label_multimodality(
            embeddings, labels, protocol, replication, real
        )
    return scores


def _label_multimodality(
    embeddings: Embeddings,
    labels: Int[np.ndarray, " items"],
    protocol: Protocol,
    replication: int,
    real: bool,
) -> float:
    """MultiModality of the motions of each label, from all pairs or from drawn ones."""
    pairs = protocol.quirks.drawn_pairs
    if pairs is None:
        return multimodality([embeddings.motions[labels == label] for label in np.unique(labels)])
    quota = pairs.true_action_multimodality if real else pairs.action_multimodality
    generator = protocol.generator("multimodality", replication)
    one, other = label_pairs(labels, quota, lambda items: int(generator.integers(items)))
    return drawn_diversity(embeddings.motions, one, other)
