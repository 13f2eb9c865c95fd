"""The way back from latents: features in their own units, joints, a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.model_card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation
from latentmotion.representation.known import representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.runtime.session import Session


@dataclass(frozen=True)
class FeatureDecoder:
    """A VAE's decoder with the scales and the representation of a card."""

    card: ModelCard
    """What the model is."""
    network: Session
    """Latents, mask → normalized features."""

    def __call__(
        self, latents: Float[np.ndarray, "batch tokens width"], frames: Sequence[int]
    ) -> Float[np.ndarray, "batch longest features"]:
        """Returns features in their own units; beyond a motion's length they mean nothing."""
        mask = np.arange(max(frames)) < np.array(frames)[:, None]
        return self._normalizer.denormalize(self.network(latents=latents, mask=mask))

    def motion(
        self,
        features: Float[np.ndarray, "frames features"],
        caption: str,
        metadata: Mapping[str, str | int | float],
    ) -> Motion:
        """Returns features as the motion that they describe."""
        joints = self.representation.decode(features)  #         (frames, joints, 3)
        return Motion(
            joints=np.asarray(joints, dtype=np.float32),
            fps=self.representation.fps,
            skeleton=self.representation.skeleton,
            caption=caption,
            metadata=dict(metadata),
        )

    @cached_property
    def representation(self) -> Representation:
        """What the features mean."""
        return representation_named(self.card.representation)

    @cached_property
    def _normalizer(self) -> Normalizer:
        mean, std = self.card.normalizer_mean, self.card.normalizer_std
        return Normalizer(np.array(mean, np.float32), np.array(std, np.float32))
