"""Metrics of one replication that joint positions give, without an evaluator.

HumanAct12's classifier sees joints, as metrics of positions do; UESTC's sees rotations alone.
Published figures are those of SMPL's neutral body, whose file only its registered users have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import fmean
from typing import TypeGuard

import numpy as np
from jaxtyping import Float

from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation import metrics
from latentmotion.evaluation.evaluators.action import Recognizer
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration, skating_ratio
from latentmotion.kinematics.smpl import SmplModel
from latentmotion.representation.smpl import SmplRepresentation, representation_of

Motions = Sequence[Float[np.ndarray, "_ features"]]
Joints = Float[np.ndarray, "_ joints 3"]
Scores = dict[str, float]

BATCH = 32
"""Motions that the authors pad together (mld.md §9)."""


@dataclass(frozen=True, eq=False)
class PositionScores:
    """Metrics of the joints of a data set's representation."""

    dataset: Dataset
    """Source of representation, frame rate and training clips."""

    def quality(self, motions: Motions) -> Scores:
        """Returns foot sliding, jitter and floor penetration of motions."""
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

        Poses are compared as the representation has them, root-relative and facing ahead. Empty for
        a representation without such a block.
        """
        if "positions" not in self.dataset.representation.blocks:
            return {}
        poses = [self._poses(motion) for motion in motions]
        return {"Nearest clip": 1000 * fmean(self._training.distance(pose) for pose in poses)}

    def reconstruction(
        self, motions: Motions, real: Motions, padding: Float[np.ndarray, " features"] | None
    ) -> Scores:
        """Returns the errors of reconstructions, as means over all frames of all motions.

        Args:
            motions: The reconstructions.
            real: The real motions, of the same lengths.
            padding: Features that padding decodes from, to sum over it as the authors do; None for
                the clean sums.
        """
        pairs = [(a, b) for a, b in zip(motions, real, strict=True)]
        frames = sum(len(motion) for motion in real)
        inner = max(sum(max(len(motion) - 2, 0) for motion in real), 1)
        if padding is not None:
            # By length, each batch padded to its longest, as the authors' data loader does.
            ordered, pairs = sorted(pairs, key=lambda pair: len(pair[1])), []
            for start in range(0, len(ordered), BATCH):
                batch = ordered[start : start + BATCH]
                longest = max(len(real) for _, real in batch)
                for pair in batch:
                    tail = np.tile(padding, (longest - len(pair[1]), 1)).astype(pair[1].dtype)
                    pairs.append((np.concatenate([pair[0], tail]), np.concatenate([pair[1], tail])))
        bodies = [(self._decode(a), self._decode(b)) for a, b in pairs]
        return {
            "MPJPE": 1000 * sum(metrics.joint_errors(a, b).sum() for a, b in bodies) / frames,
            "PA-MPJPE": 1000 * sum(metrics.pa_errors(a, b).sum() for a, b in bodies) / frames,
            "ACCL": 1000 * sum(metrics.acceleration_errors(a, b).sum() for a, b in bodies) / inner,
        }

    def average_errors(self, motions: Motions, real: Motions) -> Scores:
        """Returns APE and AVE of motions against the real ones of the same lengths."""
        skeleton = self.dataset.representation.skeleton
        if not {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= {*skeleton.names}:
            return {}
        values: dict[str, list[float]] = {}
        for pair in zip(motions, real, strict=True):
            a, b = (metrics.parts_of(self._decode(features), skeleton) for features in pair)
            for metric, errors in (("APE", metrics.ape(a, b)), ("AVE", metrics.ave(a, b))):
                for part, error in errors.items():
                    values.setdefault(f"{metric} {part}", []).append(error)
        return {name: fmean(errors) for name, errors in values.items()}

    def _decode(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        return np.asarray(self.dataset.representation.decode(features), np.float64)

    def _poses(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        positions = features[:, self.dataset.representation.blocks["positions"]]
        return positions.reshape(len(positions), -1, 3)

    @cached_property
    def _training(self) -> metrics.TrainingClips:
        clips = self.dataset.clips("train", mirrored=True)
        return metrics.TrainingClips([self._poses(self.dataset.features(clip)) for clip in clips])


def with_smpl_joints(
    body: SmplModel, dataset: Dataset, evaluator: Evaluator | None
) -> tuple[Dataset, Evaluator | None]:
    """Returns data set and evaluator with the joints of a SMPL model.

    Raises:
        InputError: The features are not SMPL's poses.
    """
    representation, features = representation_of(body), dataset.representation.name
    if features != representation.name:
        raise InputError(
            f"{dataset.folder} has features {features!r}, which are no poses of a SMPL body; "
            "leave --body out"
        )
    if _sees_joints(evaluator):
        evaluator = replace(evaluator, prepare=representation.camera_joints)
    return replace(dataset, representation=representation), evaluator


def body_of(dataset: Dataset) -> str:
    """Returns the hash of the SMPL model whose joints the data has; empty without one."""
    representation = dataset.representation
    return representation.body if isinstance(representation, SmplRepresentation) else ""


def lacks_smpl_joints(dataset: Dataset, evaluator: Evaluator | None) -> bool:
    """Returns whether an evaluator made for SMPL's joints sees the free skeleton's."""
    return _on_free_skeleton(dataset) and _sees_joints(evaluator)


def notes_on_joints(dataset: Dataset, evaluator: Evaluator | None) -> list[str]:
    """Returns a note if joints are not those of published figures."""
    if not _on_free_skeleton(dataset):
        return []
    lacking = lacks_smpl_joints(dataset, evaluator)
    which = "this evaluator's metrics and those" if lacking else "metrics"
    return [
        f"joints are those of the free skeleton: {which} of positions do not compare "
        "with published ones, which are of SMPL's body; give its file by --body"
    ]


def _on_free_skeleton(dataset: Dataset) -> bool:
    return isinstance(dataset.representation, SmplRepresentation) and not body_of(dataset)


def _sees_joints(evaluator: Evaluator | None) -> TypeGuard[Recognizer]:
    return isinstance(evaluator, Recognizer) and evaluator.network.sees_joints
