"""Feature decoder: latents to features in their own units, for NumPy and PyTorch arrays alike.

latents = z · std + mean          (the denoiser's scale → the VAE's)
features = decoder(latents) · std + mean
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard
from latentmotion.representation.interface import Representation, representation_named
from latentmotion.representation.normalizer import Normalizer, Scale
from latentmotion.representation.smpl import SmplRepresentation


@dataclass(frozen=True)
class FeatureDecoder:
    """A VAE's decoder between the scale of the latents and that of the features."""

    network: Callable[..., Any]
    """`latents`, `mask` → normalized features: a session, or `decode` of a VAE."""
    latents: Scale
    """Scale in which the denoiser sees latents."""
    features: Scale
    """Scale in which the networks see features."""

    @classmethod
    def of(
        cls,
        card: ModelCard,
        network: Callable[..., Any],
        to_device: Callable[[np.ndarray], Any] = np.asarray,
    ) -> FeatureDecoder:
        """Returns the decoder of a model.

        Args:
            card: States the scales of latents and features.
            network: The VAE's decoder.
            to_device: Makes arrays of the network's library, on its device.
        """
        space = card.latents
        rows = space.mean, space.std, card.normalizer_mean, card.normalizer_std
        mean, std, features_mean, features_std = (to_device(np.array(r, np.float32)) for r in rows)
        return cls(network, Scale(mean, std), Scale(features_mean, features_std))

    def __call__(
        self, z: Float[Any, "batch tokens width"], frames: Bool[Any, "batch frames"]
    ) -> Float[Any, "batch frames features"]:
        """Returns the features of latents in the denoiser's scale.

        Args:
            z: Latents at the end of sampling.
            frames: True on real frames; features of other frames are meaningless.
        """
        return self.decode(self.latents.denormalize(z), frames)

    def decode(
        self, latents: Float[Any, "batch tokens width"], frames: Bool[Any, "batch frames"]
    ) -> Float[Any, "batch frames features"]:
        """Returns the features of latents in the VAE's own scale."""
        return self.features.denormalize(self.network(latents=latents, mask=frames))


def normalizer_of(card: ModelCard) -> Normalizer:
    """Returns the normalizer that a model was trained with."""
    mean, std = card.normalizer_mean, card.normalizer_std
    return Normalizer(np.asarray(mean, np.float32), np.asarray(std, np.float32))


def representation_of(card: ModelCard, body: SmplRepresentation | None = None) -> Representation:
    """Returns the representation of a model's features.

    Args:
        card: Names the representation.
        body: A body whose joints the features move, in place of the skeleton that ships.

    Raises:
        InputError: There is a body, but the model's features are not SMPL's poses.
    """
    if body is not None and card.representation != body.name:
        raise InputError(
            f"model {card.name!r} makes features {card.representation!r}, which are "
            "no poses of a SMPL body; leave the body out"
        )
    return body or representation_named(card.representation)
