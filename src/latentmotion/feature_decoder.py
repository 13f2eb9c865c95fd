"""The way back from latents: features in their own units, joints, a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation, representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.runtime.session import Session


@dataclass(frozen=True)
class FeatureDecoder:
    """A VAE's decoder with the scales and the representation of a card.

    Raises:
        InputError: There is a body, but the model's features are not SMPL's poses.
    """

    card: ModelCard
    """What the model is."""
    network: Session
    """Latents, mask → normalized features."""
    body: SmplRepresentation | None = None
    """Whose joints motions have, in place of the skeleton's that ships."""

    def __post_init__(self) -> None:
        if self.body is not None and self.card.representation != self.body.name:
            raise InputError(
                f"model {self.card.name!r} makes features {self.card.representation!r}, which are "
                "no poses of a SMPL body; leave the body out"
            )

    def __call__(
        self, latents: Float[np.ndarray, "batch tokens width"], frames: Sequence[int]
    ) -> Float[np.ndarray, "batch longest features"]:
        """Returns features in their own units; beyond a motion's length they mean nothing."""
        normalized = self.network(latents=latents, mask=prefix_mask(frames))
        return self._normalizer.denormalize(normalized)

    def joints(
        self, features: Float[np.ndarray, "frames features"]
    ) -> Float[np.ndarray, "frames joints 3"]:
        """Returns the joints that features of one motion describe."""
        return self.representation.decode(features)

    def motion(
        self,
        joints: Float[np.ndarray, "frames joints 3"],
        caption: str,
        metadata: Mapping[str, str | int | float],
    ) -> Motion:
        """Returns joints as a motion of the model's."""
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
        return self.body or representation_named(self.card.representation)

    @cached_property
    def _normalizer(self) -> Normalizer:
        mean, std = self.card.normalizer_mean, self.card.normalizer_std
        return Normalizer(np.array(mean, np.float32), np.array(std, np.float32))
