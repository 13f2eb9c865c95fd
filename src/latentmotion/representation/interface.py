"""Representation: joint positions ↔ the features that networks learn, and their normalizer.

x' = (x - mean) / std, with std constant inside a block, as in HumanML3D's published statistics.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import Skeleton

# Features of a motion beside others that are longer or shorter.
ClipFeatures = Float[np.ndarray, "_ features"]

# Positions of joints of motions, meters, an array of any library.
Positions = Float[Any, "*batch frames joints 3"]

# Those of one motion.
AnyJoints = Float[Any, "frames joints 3"]

# Features of motions, an array of any library.
Features = Float[Any, "*batch frames features"]


@dataclass(frozen=True, eq=False)
class Representation(ABC):
    """Converts joints to features and back; NumPy and PyTorch arrays alike."""

    name: str  # Its name in files.
    skeleton: Skeleton  # The joints it describes.
    fps: float  # Frames per second of its velocities.

    # Whether networks see its features normalized, or as they are.
    normalized: ClassVar[bool] = True

    @property
    def width(self) -> int:
        """Features per frame."""
        return max(block.stop for block in self.blocks.values())

    @property
    @abstractmethod
    def blocks(self) -> Mapping[str, slice]:
        """The range of each block of features, by name; they cover the width once, in order."""

    @abstractmethod
    def encode(self, joints: AnyJoints) -> Float[Any, "frames_less_one features"]:
        """Returns the features of a clip, whatever its position and heading; one frame less."""

    @abstractmethod
    def decode(self, features: Features) -> Positions:
        """Returns joints that start above the origin; differentiable in PyTorch."""

    @abstractmethod
    def retarget(self, joints: Float[Any, "frames _ 3"]) -> AnyJoints:
        """Gives a body of any size the skeleton's bone lengths."""

    def restart(self, features: Features) -> Features:
        """Returns features cut from a longer clip as those of a clip that begins with them."""
        return features

    def mirror(self, features: Features) -> Features:
        """Swaps left and right: x changes its sign, joints and contacts their side."""
        xp = array_namespace(features)
        order, signs = self._mirror_map
        signs = xp.asarray(signs, dtype=features.dtype, device=device(features))
        return features[..., order] * signs

    @cached_property
    @abstractmethod
    def _mirror_map(self) -> tuple[list[int], Float[np.ndarray, " features"]]:
        """The feature that each one comes from, and its sign."""

    def check(self, joints: AnyJoints) -> None:
        """Checks that joints can be encoded.

        Raises:
            InputError: They do not fit the skeleton, are too few or not finite.
        """
        xp = array_namespace(joints)
        frames, count = joints.shape[:2]
        if count != len(self.skeleton):
            raise InputError(
                f"{count} joints; {self.name} describes {len(self.skeleton)}: map them first"
            )
        if frames < 2:
            raise InputError(f"{frames} frames; velocities need at least 2")
        if not bool(xp.all(xp.isfinite(joints))):
            raise InputError("joints that are not finite; drop or repair these frames first")


# Greatest factor by which the median scale, and any block's, may differ from 1 when normalized.
_TYPICAL, _BLOCK = 3.0, 10.0


@dataclass(frozen=True, eq=False)
class Scale:
    """Mean and deviation of every channel, arrays of the library and on the device of the data."""

    mean: Float[Any, " channels"]  # Mean of each channel, or one for all.
    std: Float[Any, " channels"]  # Deviation of each channel, or one for all.

    def denormalize(self, x: Float[Any, "*batch channels"]) -> Float[Any, "*batch channels"]:
        """Returns x · std + mean: normalized numbers in their own units."""
        return x * self.std + self.mean

    def normalize(self, x: Float[Any, "*batch channels"]) -> Float[Any, "*batch channels"]:
        """Returns (x - mean) / std: numbers in their own units normalized."""
        return (x - self.mean) / self.std


@dataclass(frozen=True, eq=False)
class Normalizer:
    """Mean and scale of every feature over a data set.

    Raises:
        InputError: A value is not finite, or a scale not above 0.
    """

    mean: Float[np.ndarray, " features"]  # Mean over all frames.
    std: Float[np.ndarray, " features"]  # Scale; equal inside a block.

    def __post_init__(self) -> None:
        finite = np.isfinite(self.mean).all() and np.isfinite(self.std).all()
        if not finite or self.std.min() <= 0:
            raise InputError("a mean or std that is not finite, or a std that is not above 0")

    @classmethod
    def identity(cls, width: int) -> Normalizer:
        """Returns one that changes nothing, for data that networks see as they are."""
        return cls(np.zeros(width, np.float32), np.ones(width, np.float32))

    @classmethod
    def fit(cls, features: Sequence[ClipFeatures], blocks: Mapping[str, slice]) -> Normalizer:
        """Measures a data set; a block's scale is the mean of its features' deviations.

        Args:
            features: One array per clip.
            blocks: Features that share a scale (`Representation.blocks`). A block that never
                changes gets the scale 1.

        Raises:
            InputError: There is no frame.
        """
        frames = sum(len(clip) for clip in features)
        if not frames:
            raise InputError("no frames to measure; check that the data set has training clips")
        mean = np.sum([clip.sum(axis=0, dtype=np.float64) for clip in features], axis=0) / frames
        square = np.sum([((clip - mean) ** 2).sum(axis=0) for clip in features], axis=0) / frames
        std = np.ones_like(mean)
        for block in blocks.values():
            std[block] = np.sqrt(square[block]).mean() or 1.0
        return cls(mean.astype(np.float32), std.astype(np.float32))

    def normalize(self, features: Float[Any, "*batch features"]) -> Float[Any, "*batch features"]:
        """Returns features as networks see them."""
        return Scale(*self._like(features)).normalize(features)

    def denormalize(self, features: Float[Any, "*batch features"]) -> Float[Any, "*batch features"]:
        """Returns a network's output as features of the representation."""
        return Scale(*self._like(features)).denormalize(features)

    def check(self, features: Float[Any, "frames features"], blocks: Mapping[str, slice]) -> None:
        """Raises if a data set was not normalized, or twice, or with other statistics.

        Args:
            features: Frames of many clips, as they go into training; padding left out.
            blocks: Features that share a scale.

        Raises:
            InputError: The deviation inside the blocks is far from 1, or a value is not finite.
        """
        xp = array_namespace(features)
        if not bool(xp.all(xp.isfinite(features))):
            raise InputError("features that are not finite; run `latentmotion data check`")
        deviation = xp.std(features, axis=0)
        scales = {name: float(xp.mean(deviation[block])) for name, block in blocks.items()}
        # A block that never changes says nothing about its scale.
        scales = {name: scale for name, scale in scales.items() if scale > 1e-6}
        typical = median(scales.values()) if scales else 1.0
        wrong = [name for name, scale in scales.items() if not 1 / _BLOCK < scale < _BLOCK]
        if wrong or not 1 / _TYPICAL < typical < _TYPICAL:
            stds = {name: float(np.mean(self.std[blocks[name]])) for name in scales}
            if all(1 / 3 < scales[name] / stds[name] < 3 for name in scales):
                diagnosis = "they were not normalized; call Normalizer.normalize first"
            elif all(1 / 3 < scales[name] * stds[name] < 3 for name in scales):
                diagnosis = "they were normalized twice"
            else:
                diagnosis = "they were normalized with the statistics of other data"
            listed = ", ".join(f"{name} {scale:.3g}" for name, scale in scales.items())
            raise InputError(
                f"features with deviations {listed}; normalized ones are near 1: {diagnosis}"
            )

    def _like(self, features: Float[Any, "*batch features"]) -> tuple[Any, Any]:
        xp = array_namespace(features)
        kind = {"dtype": features.dtype, "device": device(features)}
        # Copies, because PyTorch warns of memory that cannot be written.
        return xp.asarray(self.mean.copy(), **kind), xp.asarray(self.std.copy(), **kind)
