"""Sentences: lengths predicted from them, and clips found by them."""

from __future__ import annotations

import re

import numpy as np

from benchmarks.directing.bench import Bench, Rows
from latentmotion.data.dataset import items_of
from latentmotion.errors import ModelError


def length_rows(bench: Bench) -> Rows:
    """Measures predicted lengths of test clips beside one length for all."""
    items = [item for item in items_of(bench.data.clips("test")) if item.captions]
    fps = bench.data.representation.fps
    shortest, longest = (frames / fps for frames in bench.generate.card.frames)
    real = np.clip([item.frames / fps for item in items], shortest, longest)
    known = [item.frames / fps for item in items_of(bench.data.clips("train")) if item.captions]
    predicted = bench.generate.usual_seconds([item.captions[0] for item in items])
    if predicted is None:
        raise ModelError(f"model {bench.generate.card.name!r} predicts no lengths; take another")
    found = np.clip(predicted, shortest, longest)
    middle = float(np.clip(np.median(known), shortest, longest))
    return {
        "predicted": {
            "Off, s": np.abs(found - real),
            "Longer than real": found > real,
            "Correlation": np.stack([found, real], axis=1),
        },
        f"always {middle:.1f} s": {
            "Off, s": np.abs(middle - real),
            "Longer than real": middle > real,
        },
    }


def search_rows(bench: Bench) -> Rows:
    """Measures how often a test clip is found by one of its sentences.

    Words alone find it by the sentences of the others of its own clip, as file names would.
    """
    clips = [clip for clip in bench.data.clips("test") if clip.captions and clip.frames >= 8]
    texts = [[caption.text for caption in clip.captions] for clip in clips]
    asked = [(number, own[0]) for number, own in enumerate(texts)]
    told = np.array([[text in own for own in texts] for _, text in asked])
    motions = bench.towers.embed([bench.data.features(clip) for clip in clips])
    near = bench.towers.texts([text for _, text in asked]) @ motions.T
    words = np.array([[_overlap(text, own, text) for own in texts] for _, text in asked])
    several = [number for number, own in enumerate(texts) if len(set(own)) > 1]
    return {
        "towers": _found(near, told),
        "towers, clips with several sentences": _found(near[several], told[several]),
        "words, clips with several sentences": _found(words[several], told[several]),
        "at random": _found(np.random.default_rng(5).random(near.shape), told),
    }


def _overlap(text: str, sentences: list[str], but: str) -> float:
    """Returns the greatest share of common words with sentences other than one."""
    own = set(re.findall(r"\w+", text.lower()))
    shares = [0.0]
    for other in sentences:
        words = set(re.findall(r"\w+", other.lower()))
        if other != but and words | own:
            shares.append(len(words & own) / len(words | own))
    return max(shares)


def _found(near: np.ndarray, told: np.ndarray) -> dict[str, np.ndarray]:
    """Returns whether a right clip is among the nearest 1, 5 and 10."""
    best = np.where(told, near, -np.inf).max(axis=1)
    # Wrong clips that are as near count as before it.
    before = ((near >= best[:, None]) & ~told).sum(axis=1)
    return {f"R@{k}": before < k for k in (1, 5, 10)}
