"""The metrics of one replication that look through an evaluator."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from latentmotion.evaluation.metrics.distribution import Gaussian, drawn_kid, frechet_distance, kid
from latentmotion.evaluation.metrics.diversity import (
    diversity,
    drawn_diversity,
    label_pairs,
    multimodality,
)
from latentmotion.evaluation.metrics.retrieval import BEST, accuracy, mm_dist, r_precision, ranks
from latentmotion.evaluation.observation import View
from latentmotion.evaluation.settings import Protocol

Scores = dict[str, float]


def feature_scores(
    view: View, truth: View, prompted: bool, protocol: Protocol, replication: int
) -> Scores:
    """Returns the figures of a subject's motions.

    Args:
        view: The motions.
        truth: The real ones.
        prompted: Whether the motions have to do with captions and labels.
        protocol: How they are measured.
        replication: Its number.
    """
    scores = _spread(view, protocol, replication, real=False) | _apart(
        view, truth, protocol, replication, paired=True
    )
    return scores | _matches(view, protocol, replication, False) if prompted else scores


def truth_scores(truth: View, protocol: Protocol, replication: int) -> Scores:
    """Returns the figures of the real motions themselves."""
    order = protocol.generator("halves", replication).permutation(len(truth.features))
    half = len(order) // 2
    whole = protocol.quirks.permuted_truth or half < 2
    one, other = (order, slice(None)) if whole else (order[:half], order[half:])
    first, second = View(truth.features[one]), View(truth.features[other])
    return {
        **_apart(first, second, protocol, replication, paired=False),
        **_spread(truth, protocol, replication, real=True),
        **_matches(truth, protocol, replication, real=True),
    }


def groups(
    items: int, size: int, generator: np.random.Generator, drop: bool
) -> Iterator[tuple[Int[np.ndarray, " group"], int]]:
    """Yields random groups of items, and how many of each, from its first, count.

    Args:
        items: How many there are.
        size: Items of a group; fewer items make one group.
        generator: Source of randomness.
        drop: Whether the last group, which is not full, is left out, or filled up with others.
    """
    order, size = generator.permutation(items), min(size, items)
    full = items // size * size
    for start in range(0, full, size):
        yield order[start : start + size], size
    if full < items and not drop:
        rest = order[full:]
        yield np.concatenate([rest, order[: size - len(rest)]]), len(rest)


def _apart(view: View, truth: View, protocol: Protocol, replication: int, paired: bool) -> Scores:
    """FID and KID."""
    pairs, single = protocol.quirks.drawn_pairs, protocol.quirks.float32_means
    seen, real = view.features, truth.features
    distance = frechet_distance(Gaussian.of(seen, single), Gaussian.of(real, single))
    if pairs is None:
        return {"FID": distance, "KID": kid(seen, real, paired)}
    generator = protocol.generator("kid", replication)
    drawn = drawn_kid(seen, real, pairs.kid_subsets, pairs.kid_size, generator)
    return {"FID": distance, "KID": drawn}


def _spread(view: View, protocol: Protocol, replication: int, real: bool) -> Scores:
    """Diversity."""
    pairs = protocol.quirks.drawn_pairs
    if pairs is None:
        return {"Diversity": diversity(view.features)}
    generator, items = protocol.generator("diversity", replication), len(view.features)
    if view.logits is None:
        count = min(pairs.text_diversity, items)
        one, other = (generator.choice(items, count, replace=False) for _ in range(2))
    else:
        count = pairs.true_action_diversity if real else pairs.action_diversity
        one, other = generator.integers(items, size=(2, count))
    return {"Diversity": drawn_diversity(view.features, one, other)}


def _matches(view: View, protocol: Protocol, replication: int, real: bool) -> Scores:
    """R-precision and MM-Dist, or accuracy and MultiModality, whichever can be said."""
    scores: Scores = {}
    if view.texts is not None:
        scores |= _retrieval(view, protocol, replication)
    if view.logits is not None and view.labels is not None:
        scores["Accuracy"] = accuracy(view.logits, view.labels)
        scores["MultiModality"] = _label_multimodality(view, protocol, replication, real)
    return scores


def _retrieval(view: View, protocol: Protocol, replication: int) -> Scores:
    texts, motions = view.texts, view.features
    assert texts is not None
    generator = protocol.generator("groups", replication)
    parts = list(groups(len(motions), protocol.group, generator, protocol.quirks.remainder_dropped))
    places = np.concatenate([ranks(texts[rows], motions[rows])[:own] for rows, own in parts])
    counted = np.concatenate([rows[:own] for rows, own in parts])
    shares = r_precision(places)
    named = {f"R@{k}": share for k, share in zip(BEST, shares, strict=True)}
    return {**named, "MM-Dist": mm_dist(texts[counted], motions[counted])}


def _label_multimodality(view: View, protocol: Protocol, replication: int, real: bool) -> float:
    pairs, labels = protocol.quirks.drawn_pairs, view.labels
    assert labels is not None
    if pairs is None:
        return multimodality([view.features[labels == label] for label in np.unique(labels)])
    quota = pairs.true_action_multimodality if real else pairs.action_multimodality
    generator = protocol.generator("multimodality", replication)
    one, other = label_pairs(labels, quota, lambda items: int(generator.integers(items)))
    return drawn_diversity(view.features, one, other)
