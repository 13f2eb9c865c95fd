"""Metrics of motions (MPJPE, ACCL, APE, AVE, nearest training clip) and of embeddings.

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

Metrics of embeddings: FID, KID, diversity, MultiModality, R-precision, MM-Dist, accuracy.

FID: the Fréchet distance between two sets of features, each taken as one Gaussian.

    |μ₁ − μ₂|² + tr(Σ₁ + Σ₂ − 2 (Σ₁ Σ₂)^½)

Heusel et al. 2017, "GANs trained by a two time-scale update rule", eq. 6; for motion on an
evaluator's features, Guo et al. 2022, section 6.1. Covariances are unbiased (ddof 1).

tr (Σ₁ Σ₂)^½ is the sum of the singular values of Σ₁^½ Σ₂^½: both roots are of symmetric matrices,
so that nothing is complex and covariances of fewer motions than features need no special care.

KID: the squared maximum mean discrepancy of two sets of features, without bias.

    k(x, y) = (x·y / width + 1)³
    mean k(x, x') + mean k(y, y') − 2 mean k(x, y),   x ≠ x' and y ≠ y'

Bińkowski et al. 2018, "Demystifying MMD GANs", section 3. Unlike FID's, its mean does not depend
on the number of motions: the measure for small sets. Around zero it can be negative.

R-precision: how often a caption's own motion is among the k nearest of a group of 32.

For each caption the motions of its group are ranked by their distance to it; top-k is the share of
captions whose own motion is among the first k. Guo et al. 2022, section 6.1.

A motion that is as far as the caption's own ranks after it, as in the authors' stable sort only
if it also comes later; vectors of real numbers have no such ties.

MM-Dist: the mean distance between a caption's vector and that of the motion made from it.

    mean over items of |text − motion|

Guo et al. 2022, section 6.1 (their code calls it matching score).

Accuracy: the share of motions whose label a classifier recognizes.

Guo et al. 2020, "Action2Motion", section 5.

Diversity: the mean distance between two motions of a set, whatever their prompts.

Guo et al. 2020, "Action2Motion", section 5: mean over random pairs of |f_a − f_b|. `diversity` is
what that estimates, the mean over all pairs of different motions; the drawn form is the authors'.

MultiModality: the mean distance between two motions of one caption, or of one label.

    mean over captions c and pairs a ≠ b of its motions of |f_ca − f_cb|

Guo et al. 2020, "Action2Motion", section 5 (labels); Guo et al. 2022, section 6.1 (captions).
`multimodality` is the mean over all pairs of different motions; the drawn forms are the authors'.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from latentmotion.arrays import array_namespace
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import heading, turn

Joints = Float[np.ndarray, "_ joints 3"]
Features = Float[np.ndarray, "_ width"]  # Embeddings, a row for each motion or caption.
Rows = Int[np.ndarray, " pairs"]  # Numbers of rows of features.


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


def joint_errors(predicted: Joints, true: Joints) -> Float[np.ndarray, " frames"]:
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


def _centered(joints: Float[np.ndarray, "*frames joints 3"]) -> Float[np.ndarray, "*frames _ 3"]:
    joints = np.asarray(joints, np.float64)
    return joints - joints.mean(axis=-2, keepdims=True)


def acceleration_errors(predicted: Joints, true: Joints) -> Float[np.ndarray, " inner"]:
    """Returns the mean joint error of each frame but two, in the unit of the joints."""
    apart = np.asarray(predicted, np.float64) - np.asarray(true, np.float64)
    return np.linalg.norm(np.diff(apart, n=2, axis=0), axis=-1).mean(axis=-1)


Parts = Mapping[str, Float[np.ndarray, "_ points axes"]]


def parts_of(joints: Joints, skeleton: Skeleton) -> Parts:
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
    return ape(_variances(predicted), _variances(true))


def _variances(parts: Parts) -> Parts:
    """Returns the unbiased variances of each part, as a single frame; 0 of a single one."""
    return {
        name: part.var(axis=0, ddof=1, keepdims=True) if len(part) > 1 else np.zeros_like(part)
        for name, part in parts.items()
    }


# Frames of a mean.
_SEGMENT = 8


class TrainingClips:
    """Clips that generated motions are compared with.

    Args:
        clips: Root-relative joints of the training clips, facing +z in every frame, meters.
        stride: Frames between the offsets that are tried; a divisor of 8.
    """

    def __init__(self, clips: Sequence[Joints], stride: int = 4) -> None:
        self._clips = [np.asarray(clip, np.float32) for clip in clips]
        self._means = [_segment_means(clip, stride) for clip in self._clips]
        self._stride = stride

    def distance(self, motion: Joints) -> float:
        """Returns the smallest mean joint distance to any stretch of any clip, meters.

        Args:
            motion: Root-relative joints of one motion, facing +z in every frame. A clip that is
                shorter is compared over its own length.
        """
        motion = np.asarray(motion, np.float32)
        means = _segment_means(motion, self._stride)
        candidates, every = [], _SEGMENT // self._stride
        for number, (clip, clip_means) in enumerate(zip(self._clips, self._means, strict=True)):
            longer, shorter = _by_length(clip, motion)
            moving, still = (clip_means, means) if longer is clip else (means, clip_means)
            offsets, segments = (len(longer) - len(shorter)) // self._stride + 1, still[::every]
            # A lower bound of the distance at each offset; what no segment covers counts 0.
            bounds = np.zeros(offsets, np.float32)
            if len(segments):
                rows = np.arange(offsets)[:, None] + every * np.arange(len(segments))
                gaps = np.linalg.norm(moving[rows] - segments, axis=-1).mean(axis=(1, 2))
                bounds = gaps * (_SEGMENT * len(segments) / len(shorter)) - 1e-6
            candidates += [(bound, number, offset) for offset, bound in enumerate(bounds.tolist())]
        best = np.inf
        for bound, number, offset in sorted(candidates):
            if bound >= best:
                break
            longer, shorter = _by_length(self._clips[number], motion)
            start = offset * self._stride
            stretch = longer[start : start + len(shorter)]
            best = min(best, float(np.linalg.norm(stretch - shorter, axis=-1).mean()))
        return best


def _by_length(clip: Joints, motion: Joints) -> tuple[Joints, Joints]:
    """Returns the longer and the shorter; the clip is the longer of two equal ones."""
    return (clip, motion) if len(clip) >= len(motion) else (motion, clip)


def _segment_means(joints: Joints, stride: int) -> Joints:
    """Returns the mean pose of every segment that starts at a multiple of `stride`."""
    if len(joints) < _SEGMENT:
        return joints[:0]
    sums = np.cumsum(np.concatenate([np.zeros_like(joints[:1]), joints]), axis=0, dtype=np.float64)
    return ((sums[_SEGMENT:] - sums[:-_SEGMENT])[::stride] / _SEGMENT).astype(np.float32)


@dataclass(frozen=True)
class Gaussian:
    """Mean and covariance of a set of features."""

    mean: Float[np.ndarray, " width"]  # Mean.
    covariance: Float[np.ndarray, "width width"]  # Unbiased covariance.

    @classmethod
    def of(cls, features: Features, float32_mean: bool = False) -> Gaussian:
        """Measures a set of features.

        Args:
            features: One row per motion.
            float32_mean: Whether the mean is computed in float32, as the authors do.

        Raises:
            InputError: There are fewer than two, or one is not finite.
        """
        if len(features) < 2 or not np.isfinite(features).all():
            raise InputError(f"FID needs two motions or more with finite features: {len(features)}")
        precision = np.float32 if float32_mean else np.float64
        mean = np.asarray(features, precision).mean(axis=0).astype(np.float64)
        covariance = np.cov(np.asarray(features, np.float64), rowvar=False)
        return cls(mean, np.atleast_2d(covariance))


def frechet_distance(first: Gaussian, second: Gaussian) -> float:
    """Returns the Fréchet distance of two Gaussians; zero for equal ones."""
    apart = first.mean - second.mean
    roots = _root(first.covariance) @ _root(second.covariance)
    overlap = np.sum(scipy.linalg.svdvals(roots))
    spread = np.trace(first.covariance) + np.trace(second.covariance)
    return max(0.0, float(apart @ apart + spread - 2 * overlap))


def fid(generated: Features, real: Features) -> float:
    """Returns the FID of two sets of features."""
    return frechet_distance(Gaussian.of(generated), Gaussian.of(real))


def _root(covariance: Float[np.ndarray, "width width"]) -> Float[np.ndarray, "width width"]:
    values, vectors = scipy.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T


def kid(generated: Features, real: Features, paired: bool = False) -> float:
    """Returns the unbiased estimate from all pairs.

    Args:
        generated: One row per generated motion.
        real: One row per real motion.
        paired: Whether row k of both answers the same question. Such rows are near each other for
            that reason alone, and are not compared (Gretton et al. 2012, eq. 4).

    Raises:
        InputError: One of the sets has fewer than two motions.
    """
    if min(len(generated), len(real)) < 2:
        raise InputError(f"KID needs two motions or more: {len(generated)} and {len(real)}")
    x, y = np.asarray(generated, np.float64), np.asarray(real, np.float64)
    across = _off_diagonal(_kernel(x, y)) if paired else float(_kernel(x, y).mean())
    return _within(x) + _within(y) - 2 * across


def drawn_kid(
    generated: Features, real: Features, subsets: int, size: int, generator: np.random.Generator
) -> float:
    """Returns the mean of the estimates from random subsets, as `UncondMetrics` of the authors.

    Args:
        generated: One row per generated motion.
        real: One row per real motion.
        subsets: How many subsets.
        size: Motions of each; no more than there are.
        generator: Source of randomness.
    """
    size = min(size, len(generated), len(real))

    def part(features: Features) -> Features:
        return features[generator.permutation(len(features))[:size]]

    return float(np.mean([kid(part(generated), part(real)) for _ in range(subsets)]))


def _within(features: Features) -> float:
    return _off_diagonal(_kernel(features, features))


def _off_diagonal(kernel: Float[np.ndarray, "items items"]) -> float:
    return float(kernel.sum() - np.trace(kernel)) / (len(kernel) * (len(kernel) - 1))


def _kernel(x: Features, y: Features) -> Float[np.ndarray, "items others"]:
    return (x @ y.T / x.shape[1] + 1) ** 3


def distances(rows: Features, columns: Features) -> Float[np.ndarray, "rows columns"]:
    """Returns the Euclidean distance of each row to each column, in float64.

    By |a − b|² = |a|² − 2 a·b + |b|²; what rounding makes negative is zero.
    """
    a, b = np.asarray(rows, np.float64), np.asarray(columns, np.float64)
    squared = (a**2).sum(1)[:, None] - 2 * a @ b.T + (b**2).sum(1)
    return np.sqrt(np.maximum(squared, 0))


BEST = (1, 2, 3)  # The k that papers report.


def ranks(texts: Features, motions: Features) -> Int[np.ndarray, " group"]:
    """Returns the place, from 0, of each caption's own motion among all motions of a group."""
    apart = distances(texts, motions)
    return (apart < np.diagonal(apart)[:, None]).sum(axis=1)


def r_precision(places: Int[np.ndarray, " captions"], best: Sequence[int] = BEST) -> list[float]:
    """Returns the share of captions whose motion is among the first k, for each k.

    Args:
        places: What `ranks` returned, of all groups.
        best: The k.
    """
    return [float((places < k).mean()) for k in best]


def mm_dist(texts: Features, motions: Features) -> float:
    """Returns the mean distance of the pairs, row by row."""
    apart = np.asarray(texts, np.float64) - np.asarray(motions, np.float64)
    return float(np.linalg.norm(apart, axis=1).mean())


def accuracy(logits: Float[np.ndarray, "items labels"], labels: Int[np.ndarray, " items"]) -> float:
    """Returns the share of rows whose greatest logit is at their label."""
    return float((logits.argmax(axis=1) == labels).mean())


_ROWS = 1024


def diversity(features: Features) -> float:
    """Returns the mean distance over all pairs of different items; 0 for a single one."""
    items = len(features)
    starts = range(0, items, _ROWS)
    total = sum(distances(features[s : s + _ROWS], features).sum() for s in starts)
    return float(total) / (items * (items - 1)) if items > 1 else 0.0


def drawn_diversity(
    features: Float[np.ndarray, "*groups _ width"], first: Rows, second: Rows
) -> float:
    """Returns the mean distance of the given pairs; of several groups, the same pairs of each.

    Args:
        features: One row per motion, or the rows of the motions of each caption.
        first: First item of each pair.
        second: Second item of each pair; the authors' draws let it be the same.
    """
    apart = features[..., first, :] - features[..., second, :]
    return float(np.linalg.norm(apart, axis=-1).mean())


def multimodality(groups: Sequence[Features]) -> float:
    """Returns the mean distance over all pairs of a group, averaged over the groups.

    Args:
        groups: Features of the motions of each caption or label; those of one motion are left out.
    """
    return fmean([diversity(group) for group in groups if len(group) > 1] or [0.0])


def label_pairs(
    labels: Int[np.ndarray, " items"], quota: int, draw: Callable[[int], int]
) -> tuple[Rows, Rows]:
    """Draws pairs of the same label as the authors do; `drawn_diversity` of them is theirs.

    An item is drawn, and another if its label has all its pairs; then second items are drawn until
    one has the same label, which can be the first again.

    Args:
        labels: Label of each item.
        quota: Pairs of each label that occurs.
        draw: Returns a random number below its argument.
    """
    left = {int(label): quota for label in np.unique(labels)}
    pairs: list[tuple[int, int]] = []
    while any(left.values()):
        row = draw(len(labels))
        label = int(labels[row])
        if left[label]:
            left[label] -= 1
            while labels[partner := draw(len(labels))] != label:
                pass
            pairs.append((row, partner))
    first, second = np.array(pairs).T
    return first, second
