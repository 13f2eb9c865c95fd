"""Nearest clips of the training data: what a motion may have been learned from.

A scorer's folder may hold the vectors of its training clips, 8 bits a number, and the names of
recordings, but no motions; of other data the vectors are computed from the prepared folder.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED
from latentmotion.errors import DataError, InputError, ModelError
from latentmotion.motion import Motion
from latentmotion.ranking.scorer import CLIPS_FILE, UNIT, Scorer
from latentmotion.storage.files import atomic_file


@dataclass(frozen=True)
class KnownClip:
    """A training clip as a report names it."""

    id: str
    """Its name."""
    source: str
    """Name of its source."""
    origin: str
    """The recording and the frames."""


@dataclass(frozen=True, eq=False)
class TrainingVectors:
    """Vectors of training clips."""

    clips: tuple[KnownClip, ...]
    """The clips."""
    vectors: Float[np.ndarray, "clips width"]
    """A vector for each."""

    def nearest(
        self, vector: Float[np.ndarray, " width"], count: int
    ) -> list[tuple[KnownClip, float]]:
        """Returns the clips nearest to a vector, with their cosines, the nearest first.

        Raises:
            InputError: `count` is below 1.
        """
        if count < 1:
            raise InputError(f"{count} clips: expected 1 or more")
        cosines = self.vectors @ vector
        order = np.argsort(-cosines, kind="stable")[:count]
        return [(self.clips[row], float(cosines[row])) for row in order]

    def share_nearer(self, similarity: float) -> float:
        """Returns the share of training clips with another recording's clip at least as near.

        Args:
            similarity: A cosine.
        """
        recordings = np.array([clip.origin.partition("[")[0] for clip in self.clips])
        sample = np.random.default_rng(0).permutation(len(self.clips))[:500]
        nearest = []
        for row in sample:
            others = recordings != recordings[row]
            nearest.append(float((self.vectors[others] @ self.vectors[row]).max(initial=-1.0)))
        return float(np.mean(np.array(nearest) >= similarity)) if nearest else 0.0

    def write(self, path: Path) -> None:
        """Writes the vectors, 8 bits a number.

        Raises:
            InputError: The folder cannot be written.
        """
        scales = np.abs(self.vectors).max(axis=1, keepdims=True).clip(1e-6) / 127
        arrays = {
            "vectors": np.round(self.vectors / scales).astype(np.int8),
            "scales": scales[:, 0].astype(np.float32),
        }
        names = json.dumps([[c.id, c.source, c.origin] for c in self.clips], separators=(",", ":"))
        with atomic_file(path) as temporary:
            save_file(arrays, temporary, {"clips": names})


def read_training_vectors(scorer: Scorer) -> TrainingVectors:
    """Reads the vectors in a scorer's folder.

    Raises:
        InputError: There are none; they can be computed from the data.
        ModelError: The file is damaged.
    """
    path = scorer.folder / CLIPS_FILE
    if not path.is_file():
        raise InputError(
            f"{scorer.folder} has no {CLIPS_FILE}; name the prepared training data by --data"
        )
    try:
        with safe_open(path, "numpy") as opened:
            names = json.loads((opened.metadata() or {})["clips"])
            vectors = opened.get_tensor("vectors").astype(np.float32)
            vectors = vectors * opened.get_tensor("scales")[:, None]
        clips = tuple(KnownClip(*map(str, row)) for row in names)
        if vectors.shape != (len(clips), scorer.card.width) or not np.isfinite(vectors).all():
            raise ValueError(f"{len(clips)} clips with vectors of shape {vectors.shape}")
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path} is damaged ({error}); copy the folder again") from error
    return TrainingVectors(clips, vectors)


def training_vectors(data: Dataset, scorer: Scorer) -> TrainingVectors:
    """Computes the vectors of the recorded clips of the split `train`.

    Args:
        data: Prepared data of the scorer's features.
        scorer: Makes the vectors.

    Raises:
        DataError: There are no such clips, or the features are of another kind.
    """
    if data.representation.name != scorer.card.representation:
        raise DataError(
            f"{data.folder} has features {data.representation.name!r}, the scorer reads "
            f"{scorer.card.representation!r}"
        )
    clips = [
        clip for clip in data.clips("train") if clip.source != COMPOSED and clip.frames >= UNIT
    ]
    if not clips:
        raise DataError(f"{data.folder} has no recorded clip in its train split")
    names = tuple(KnownClip(clip.id, clip.source, clip.origin) for clip in clips)
    starts = range(0, len(clips), 256)
    rows = [scorer.embed([data.features(c) for c in clips[n : n + 256]]) for n in starts]
    return TrainingVectors(names, np.concatenate(rows))


def nearest_clips(
    motion: Motion, scorer: Scorer, training: TrainingVectors, count: int
) -> list[dict[str, str | float | bool]]:
    """Returns the training clips nearest to a motion or to its mirror image, as JSON can hold them.

    Raises:
        InputError: The motion has another skeleton or is too short, or `count` is below 1.
    """
    features = scorer.features_of(motion)
    sides = scorer.embed([features, scorer.representation.mirror(features)])
    neighbors = [
        (cosine, mirrored, clip)
        for mirrored, vector in zip((False, True), sides, strict=True)
        for clip, cosine in training.nearest(vector, count)
    ]
    return [
        {
            "clip": clip.id,
            "mirrored": mirrored,
            "source": clip.source,
            "origin": clip.origin,
            "similarity": round(cosine, 4),
        }
        for cosine, mirrored, clip in sorted(neighbors, key=lambda one: -one[0])[:count]
    ]
