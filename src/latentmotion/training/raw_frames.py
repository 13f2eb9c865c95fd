"""Stage 2 without stage 1: diffusion on the normalized frames themselves (`--vae none`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop
from latentmotion.errors import InputError
from latentmotion.experiment import Experiment
from latentmotion.model.card import ModelCard, Provenance
from latentmotion.model.vae_config import IdentityVAEConfig
from latentmotion.training.cards import first_stage_card
from latentmotion.training.crops import FeatureMemory
from latentmotion.training.latents import Posteriors


class FrameMemory:
    """Answers like a `LatentMemory`: the latents of a crop are its frames.

    They are cut when they are asked for, so there is no limit to the crops of a motion.

    Args:
        memory: Normalized features.
        device: Where they are wanted.
    """

    def __init__(self, memory: FeatureMemory, device: torch.device) -> None:
        self._memory, self._device = memory, device

    def batch(self, crops: Sequence[Crop], among: Sequence[Crop]) -> Posteriors:
        """Returns the frames of `crops`, padded to the longest of `among`."""
        features, mask = self._memory.batch(crops, max(crop.frames for crop in among))
        return Posteriors(features, torch.zeros_like(features), mask).to(self._device)


def frames_card(experiment: Experiment, dataset: Dataset) -> tuple[IdentityVAEConfig, ModelCard]:
    """Describes the data's frames as if a VAE had made them.

    Raises:
        InputError: They should be normalized as latents, but are already as features.
    """
    if experiment.latents.normalized:
        raise InputError(
            "the frames are normalized as features, by the data set's statistics; without a VAE "
            "use --set latents.normalized=false"
        )
    config = IdentityVAEConfig(dataset.representation.width)
    card = first_stage_card(replace(experiment, vae=config), dataset, 0.0, {})
    return config, replace(card, provenance=Provenance())
