"""The way back from latents: features in their own units, joints, a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.model_card import ModelCard
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation
from latentmotion.representation.known import representation_named
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
        return self.body or representation_named(self.card.representation)

    @cached_property
    def _normalizer(self) -> Normalizer:
        mean, std = self.card.normalizer_mean, self.card.normalizer_std
        return Normalizer(np.array(mean, np.float32), np.array(std, np.float32))
