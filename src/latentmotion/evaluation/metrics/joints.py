"""Metrics of motions: MPJPE, ACCL, APE, AVE, nearest training clip.

MPJPE: how far reconstructed joints are from the true ones.

mean over frames and joints of |p - q|, after the root of each frame is moved to the origin (as the
MLD authors' code has it; the paper says "global"), or, with `align=False`, in the world.

PA-MPJPE: the joint error that is left after each pose is laid over the true one.

Per frame, the similarity (rotation, translation and scale; no reflection) that minimizes the
squared error is applied first: orthogonal Procrustes. Gower 1975; used so by Kanazawa et al. 2018,
"End-to-end recovery of human shape and pose", section 4.

    M = Σ_j (q_j − q̄)(p_j − p̄)ᵀ = U S Vᵀ,   R = U D Vᵀ,   D = diag(1, 1, det U Vᵀ),
    s = tr(S D) / Σ_j |p_j − p̄|²,   error = |s R (p − p̄) − (q − q̄)|

ACCL: the error of the joints' acceleration.

    mean over frames t and joints of |(p_t − 2 p_{t+1} + p_{t+2}) − (q_t − 2 q_{t+1} + q_{t+2})|

in millimeters per squared frame, so that data of different frame rates do not compare. Kanazawa
et al. 2019, "Learning 3D human dynamics from video", section 5; MLD, section 4.1.

APE and AVE: errors of position and of its variance, by part of the motion.

    APE = mean over frames of |p_t − q_t|
    AVE = |σ²(p) − σ²(q)|,   σ² per coordinate over the frames of a motion (unbiased)

of four parts: root, its trajectory on the floor, the pose (joints but the root, root at the
origin, facing +z), and all joints in the world. Ghosh et al. 2021, "Synthesis of compositional
animations from textual descriptions", section 4; TEMOS (Petrovich et al. 2022), section 4. Meters.

Motions start above the origin facing +z, as a representation decodes them. The authors' own
figures on HumanML3D (`TemosMetric`) are in other units, with sides swapped (mld.md §8), and compare
with nobody's.

Two motions are compared pose by pose: root-centered, turned to face the same way (HumanML3D's
root-relative joint positions), over the length of the generated motion, at the offset into the
training clip where they agree best. The distance is the mean over frames and joints, meters.

A joint's mean distance over some frames is at least the distance of its mean positions there
(Jensen's inequality). So means over `_SEGMENT` frames bound the distance from below, and only the
stretches whose bound is below the best distance found are compared frame by frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import heading, turn


def mpjpe(
    predicted: Float[Any, "*batch frames joints 3"],
    true: Float[Any, "*batch frames joints 3"],
    align: bool = True,
) -> float:
    """Returns the mean per-joint position error in millimeters.

    Args:
        predicted: Joint positions, meters.
        true: The positions they should have, meters.
        align: Whether each frame's root is moved to the origin first.
    """
    xp = array_namespace(predicted, true)
    if align:
        predicted, true = predicted - predicted[..., :1, :], true - true[..., :1, :]
    return 1000 * float(xp.mean(xp.sqrt(xp.sum((predicted - true) ** 2, axis=-1))))


def joint_errors(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " frames"]:
    """Returns the mean error of each frame after the root is moved to the origin, in its unit."""
    apart = (predicted - predicted[:, :1]) - (true - true[:, :1])
    return np.linalg.norm(apart, axis=-1).mean(axis=-1)


def pa_errors(
    predicted: Float[np.ndarray, "*frames joints 3"], true: Float[np.ndarray, "*frames joints 3"]
) -> Float[np.ndarray, "*frames"]:
    """Returns the mean joint error of each frame after alignment, in the unit of the joints."""
    p, q = _centered(predicted), _centered(true)
    u, s, vt = np.linalg.svd(np.swapaxes(q, -1, -2) @ p)
    s[..., 2] *= np.sign(np.linalg.det(u @ vt))
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    size = np.maximum((p**2).sum(axis=(-2, -1)), np.finfo(np.float64).tiny)
    scale = (s.sum(axis=-1) / size)[..., None, None]
    laid = scale * (p @ np.swapaxes(u @ vt, -1, -2))
    return np.linalg.norm(laid - q, axis=-1).mean(axis=-1)


def pa_mpjpe(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> float:
    """Returns the mean joint error after alignment in millimeters, for joints in meters."""
    return 1000 * float(pa_errors(predicted, true).mean())


def _centered(joints: Float[np.ndarray, "*frames joints 3"]) -> Float[np.ndarray, "*frames _ 3"]:
    joints = np.asarray(joints, np.float64)
    return joints - joints.mean(axis=-2, keepdims=True)


def acceleration_errors(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " inner"]:
    """Returns the mean joint error of each frame but two, in the unit of the joints."""
    apart = np.asarray(predicted, np.float64) - np.asarray(true, np.float64)
    return np.linalg.norm(np.diff(apart, n=2, axis=0), axis=-1).mean(axis=-1)


def accl(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> float:
    """Returns the mean error in mm/frame², for joints in meters; 0 for fewer than three frames."""
    errors = acceleration_errors(predicted, true)
    return 1000 * float(errors.mean()) if len(errors) else 0.0


Parts = Mapping[str, Float[np.ndarray, "frames points axes"]]


def parts_of(joints: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton) -> Parts:
    """Returns what of a motion is compared, by name."""
    joints = np.asarray(joints, np.float64)
    root = joints[:, :1]
    pose = turn(joints[:, 1:] - root, -heading(joints, skeleton)[:, None])
    return {"root": root, "trajectory": root[..., [0, 2]], "pose": pose, "joints": joints}


def ape(predicted: Parts, true: Parts) -> dict[str, float]:
    """Returns the mean position error of each part, in the unit of the joints."""
    return {
        name: float(np.linalg.norm(predicted[name] - part, axis=-1).mean())
        for name, part in true.items()
    }


def ave(predicted: Parts, true: Parts) -> dict[str, float]:
    """Returns the error of each part's variance over time, in the squared unit of the joints."""
    return {
        name: float(np.linalg.norm(_variance(predicted[name]) - _variance(part), axis=-1).mean())
        for name, part in true.items()
    }


def _variance(
    part: Float[np.ndarray, "frames points axes"],
) -> Float[np.ndarray, "points axes"]:
    return part.var(axis=0, ddof=1) if len(part) > 1 else np.zeros(part.shape[1:])


# Frames of a mean.
_SEGMENT = 8


class TrainingClips:
    """Clips that generated motions are compared with.

    Args:
        clips: Root-relative joints of the training clips, facing +z in every frame, meters.
        stride: Frames between the offsets that are tried; a divisor of 8.
    """

    def __init__(self, clips: Sequence[Float[np.ndarray, "_ joints 3"]], stride: int = 4) -> None:
        self._clips = [np.asarray(clip, np.float32) for clip in clips]
        self._means = [_segment_means(clip, stride) for clip in self._clips]
        self._stride = stride

    def distance(self, motion: Float[np.ndarray, "frames joints 3"]) -> float:
        """Returns the smallest mean joint distance to any stretch of any clip, meters.

        Args:
            motion: Root-relative joints of one motion, facing +z in every frame. A clip that is
                shorter is compared over its own length.
        """
        motion = np.asarray(motion, np.float32)
        means = _segment_means(motion, self._stride)
        candidates = [
            (float(bound), number, offset)
            for number, clip in enumerate(self._clips)
            for offset, bound in enumerate(self._bounds(motion, means, clip, self._means[number]))
        ]
        best = np.inf
        for bound, number, offset in sorted(candidates):
            if bound >= best:
                break
            longer, shorter = _by_length(self._clips[number], motion)
            start = offset * self._stride
            stretch = longer[start : start + len(shorter)]
            best = min(best, float(np.linalg.norm(stretch - shorter, axis=-1).mean()))
        return best

    def _bounds(
        self,
        motion: Float[np.ndarray, "frames joints 3"],
        means: Float[np.ndarray, "starts joints 3"],
        clip: Float[np.ndarray, "_ joints 3"],
        clip_means: Float[np.ndarray, "_ joints 3"],
    ) -> Float[np.ndarray, " offsets"]:
        """Returns a lower bound of the distance at each offset; what no segment covers counts 0."""
        longer, shorter = _by_length(clip, motion)
        moving, still = (clip_means, means) if longer is clip else (means, clip_means)
        offsets = (len(longer) - len(shorter)) // self._stride + 1
        every = _SEGMENT // self._stride
        segments = still[::every]
        if not len(segments):
            return np.zeros(offsets, np.float32)
        rows = np.arange(offsets)[:, None] + every * np.arange(len(segments))
        gaps = np.linalg.norm(moving[rows] - segments, axis=-1).mean(axis=(1, 2))
        return gaps * (_SEGMENT * len(segments) / len(shorter)) - 1e-6


def _by_length(
    clip: Float[np.ndarray, "_ joints 3"], motion: Float[np.ndarray, "frames joints 3"]
) -> tuple[Float[np.ndarray, "_ joints 3"], Float[np.ndarray, "_ joints 3"]]:
    """Returns the longer and the shorter; the clip is the longer of two equal ones."""
    return (clip, motion) if len(clip) >= len(motion) else (motion, clip)


def _segment_means(
    joints: Float[np.ndarray, "frames joints 3"], stride: int
) -> Float[np.ndarray, "starts joints 3"]:
    """Returns the mean pose of every segment that starts at a multiple of `stride`."""
    if len(joints) < _SEGMENT:
        return joints[:0]
    sums = np.cumsum(np.concatenate([np.zeros_like(joints[:1]), joints]), axis=0, dtype=np.float64)
    means = (sums[_SEGMENT:] - sums[:-_SEGMENT])[::stride] / _SEGMENT
    return means.astype(np.float32)
