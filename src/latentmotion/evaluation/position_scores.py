"""The metrics of one replication that look at joints alone; they need no evaluator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import fmean

import numpy as np
from jaxtyping import Float

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.metrics.nearest_clip import TrainingClips
from latentmotion.evaluation.metrics.physical import (
    foot_sliding,
    jitter,
    penetration,
    skating_ratio,
)
from latentmotion.evaluation.metrics.reconstruction import (
    acceleration_errors,
    ape,
    ave,
    joint_errors,
    pa_errors,
    parts_of,
)

Motions = Sequence[Float[np.ndarray, "_ features"]]
Joints = Float[np.ndarray, "_ joints 3"]
Scores = dict[str, float]

BATCH = 32
"""Motions that the authors pad together (spec 11.3)."""


@dataclass(frozen=True, eq=False)
class PositionScores:
    """Metrics on the joints of a data set's representation."""

    dataset: Dataset
    """Tells representation, frame rate and training clips."""

    def quality(self, motions: Motions) -> Scores:
        """Returns what motions are like: feet, jitter and floor."""
        fps, skeleton = self.dataset.representation.fps, self.dataset.representation.skeleton
        bodies = [self._decode(motion) for motion in motions]
        scores = {
            "Jitter": fmean(jitter(body, fps) for body in bodies),
            "Penetration": 1000 * fmean(penetration(body) for body in bodies),
        }
        if skeleton.left_foot and skeleton.right_foot:
            scores["Foot sliding"] = fmean(foot_sliding(body, fps, skeleton) for body in bodies)
            scores["Skating"] = fmean(skating_ratio(body, fps, skeleton) for body in bodies)
        return scores

    def nearest(self, motions: Motions) -> Scores:
        """Returns the mean distance to the nearest training clip, mirrored ones too.

        Poses are compared as the representation has them, root-relative and facing ahead; nothing
        for one that has no such block.
        """
        if "positions" not in self.dataset.representation.blocks:
            return {}
        poses = [self._poses(motion) for motion in motions]
        return {"Nearest clip": 1000 * fmean(self._training.distance(pose) for pose in poses)}

    def repeated(
        self, motions: Motions, truth: Motions, padding: Float[np.ndarray, " features"] | None
    ) -> Scores:
        """Returns how far repeated motions are from the true ones, over all frames of all.

        Args:
            motions: The repeated motions.
            truth: The true ones, of the same lengths.
            padding: The features that padding decodes from, to sum over it as the authors do;
                none for the clean sums.
        """
        pairs = [(a, b) for a, b in zip(motions, truth, strict=True)]
        frames = sum(len(true) for true in truth)
        inner = max(sum(max(len(true) - 2, 0) for true in truth), 1)
        if padding is not None:
            pairs = _padded(pairs, padding)
        bodies = [(self._decode(a), self._decode(b)) for a, b in pairs]
        return {
            "MPJPE": 1000 * sum(joint_errors(a, b).sum() for a, b in bodies) / frames,
            "PA-MPJPE": 1000 * sum(pa_errors(a, b).sum() for a, b in bodies) / frames,
            "ACCL": 1000 * sum(acceleration_errors(a, b).sum() for a, b in bodies) / inner,
        }

    def compared(self, motions: Motions, truth: Motions) -> Scores:
        """Returns APE and AVE of motions against the true ones of the same lengths."""
        skeleton = self.dataset.representation.skeleton
        if not {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= {*skeleton.names}:
            return {}
        found: dict[str, list[float]] = {}
        for motion, true in zip(motions, truth, strict=True):
            a, b = (parts_of(self._decode(features), skeleton) for features in (motion, true))
            for metric, errors in (("APE", ape(a, b)), ("AVE", ave(a, b))):
                for part, error in errors.items():
                    found.setdefault(f"{metric} {part}", []).append(error)
        return {name: fmean(errors) for name, errors in found.items()}

    def _decode(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        return np.asarray(self.dataset.representation.decode(features), np.float64)

    def _poses(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        positions = features[:, self.dataset.representation.blocks["positions"]]
        return positions.reshape(len(positions), -1, 3)

    @cached_property
    def _training(self) -> TrainingClips:
        clips = self.dataset.clips("train", mirrored=True)
        return TrainingClips([self._poses(self.dataset.features(clip)) for clip in clips])


def _padded(
    pairs: list[tuple[np.ndarray, np.ndarray]], padding: Float[np.ndarray, " features"]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sorts by length, and pads each batch to its longest."""
    pairs = sorted(pairs, key=lambda pair: len(pair[1]))
    found = []
    for start in range(0, len(pairs), BATCH):
        batch = pairs[start : start + BATCH]
        longest = max(len(true) for _, true in batch)
        for motion, true in batch:
            tail = np.tile(padding, (longest - len(true), 1)).astype(true.dtype)
            found.append((np.concatenate([motion, tail]), np.concatenate([true, tail])))
    return found
