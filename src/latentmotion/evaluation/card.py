"""The figures of a model card: how well the VAE repeats, and what generated motion is like.

Reconstruction is from the posterior's mean, on whole clips, per split. Generated motions answer
captions of the test split at the length of the clip they belong to; every figure stands beside
that of the real clips.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
import torch
from jaxtyping import Float

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.metrics.foot_sliding import foot_sliding
from latentmotion.evaluation.metrics.jitter import jitter
from latentmotion.evaluation.metrics.mpjpe import mpjpe
from latentmotion.evaluation.metrics.nearest_clip import nearest_clip_distance
from latentmotion.evaluation.metrics.penetration import penetration
from latentmotion.generator import MotionGenerator
from latentmotion.vae.interface import MotionVAE

Joints = Float[np.ndarray, "_ joints 3"]


@dataclass(frozen=True)
class MotionFigures:
    """Means over a set of motions."""

    motions: int
    """How many."""
    nearest_clip_mm: float
    """Distance to the nearest training clip, mean joint distance in millimeters."""
    foot_sliding: float
    """As `metrics.foot_sliding` defines it."""
    jitter: float
    """As `metrics.jitter` defines it."""
    penetration_mm: float
    """As `metrics.penetration` defines it, millimeters."""


def reconstruction(vae: MotionVAE, dataset: Dataset, split: str) -> float:
    """Returns the mean MPJPE of a split's captioned clips in millimeters, root-aligned."""
    return fmean(_reconstruction_error(vae, dataset, clip) for clip in _captioned(dataset, split))


def real_figures(dataset: Dataset, split: str) -> MotionFigures:
    """Returns the figures of a split's own clips."""
    decode = dataset.representation.decode
    clips = [decode(dataset.features(clip)) for clip in _captioned(dataset, split)]
    return measure(clips, dataset)


def generated_figures(generator: MotionGenerator, dataset: Dataset, split: str) -> MotionFigures:
    """Returns the figures of motions generated from a split's captions at their lengths."""
    shortest, longest = generator.card.frames
    motions = []
    for seed, clip in enumerate(_captioned(dataset, split)):
        frames = min(max(clip.frames, shortest), longest)
        seconds = frames / dataset.representation.fps
        motions.append(generator(clip.captions[0].text, seconds, seed).joints)
    return measure(motions, dataset)


def measure(motions: Sequence[Joints], dataset: Dataset) -> MotionFigures:
    """Returns the figures of joint positions."""
    fps = dataset.representation.fps
    training = [
        _facing_ahead(dataset, dataset.representation.decode(dataset.features(clip)))
        for clip in dataset.clips("train", mirrored=True)
    ]

    def nearest(joints: Joints) -> float:
        return 1000 * nearest_clip_distance(_facing_ahead(dataset, joints), training)

    def mean(metric: Callable[[Joints], float]) -> float:
        return fmean(metric(joints) for joints in motions)

    return MotionFigures(
        motions=len(motions),
        nearest_clip_mm=mean(nearest),
        foot_sliding=mean(lambda joints: foot_sliding(joints, fps)),
        jitter=mean(lambda joints: jitter(joints, fps)),
        penetration_mm=1000 * mean(lambda joints: penetration(joints)),
    )


def _captioned(dataset: Dataset, split: str) -> list[Clip]:
    clips = [clip for clip in dataset.clips(split) if clip.captions]
    if not clips:
        raise DataError(f"{dataset.folder} has no captioned clip in its {split} split")
    return clips


def _reconstruction_error(vae: MotionVAE, dataset: Dataset, clip: Clip) -> float:
    features = torch.from_numpy(dataset.normalizer.normalize(dataset.features(clip)))[None]
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    with torch.no_grad():
        repeated = vae.decode(vae.encode(features, mask).mean, mask)
    pair = dataset.normalizer.denormalize(torch.cat([repeated, features]))
    predicted, true = dataset.representation.decode(pair)
    return mpjpe(predicted, true)


def _facing_ahead(dataset: Dataset, joints: Joints) -> Float[np.ndarray, "_ _ 3"]:
    """Returns all joints but the root, relative to it, each pose turned to face +z."""
    features = dataset.representation.encode(joints)
    positions = features[:, dataset.representation.blocks["positions"]]
    return positions.reshape(len(positions), -1, 3)
