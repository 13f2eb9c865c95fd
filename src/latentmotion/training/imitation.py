"""Generated latents and a decoder to imitate on them.

A decoder that only ever saw latents of real motions is at a loss where a denoiser's lie off them.
The ends of a teacher's ways, which distillation keeps, are such latents; what the decoder makes of
them that they were generated for is what another one shall make of them (knowledge distillation).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.checkpoint import WEIGHTS_FILE, FirstStageModel, load_stages
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.exchange import check_latents
from latentmotion.experiment import Experiment
from latentmotion.model.vae_config import LatentSpace
from latentmotion.representation.normalizer import Scale
from latentmotion.storage.files import sha256
from latentmotion.training.devices import Place
from latentmotion.training.run_folder import MODEL
from latentmotion.training.trajectories import WAYS_FILE, ends_of
from latentmotion.training.vae_stage import VAEStage
from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.loss import feature_losses, weighted_sum


@dataclass(frozen=True)
class Imitation:
    """Latents, the shortest first, and the decoder that answers to them."""

    latents: Float[torch.Tensor, "motions tokens width"]
    """Latents in the VAE's own scale."""
    mask: Bool[torch.Tensor, "motions tokens"]
    """True on real tokens."""
    frames_per_token: int
    """Frames that each stands for."""
    vae: MotionVAE
    """Whose answers are learned; it trains no more."""
    fingerprint: str
    """Hash of the latents and of its weights."""

    def rows(self, step: int, batch: int, seed: int) -> range:
        """Returns the rows of step number `step`: neighbors, so of similar length."""
        last = max(len(self.mask) - batch, 0)
        first = int(np.random.default_rng([seed, step]).integers(last + 1))
        return range(first, min(first + batch, len(self.mask)))

    def batch(
        self, rows: range, frames: int
    ) -> tuple[Float[torch.Tensor, "batch tokens width"], Bool[torch.Tensor, "batch frames"]]:
        """Returns latents for at most so many frames, and the mask of the frames."""
        mask = self.mask[list(rows)]
        tokens = min(int(mask.sum(dim=1).max()), frames // self.frames_per_token)
        frame_mask = mask[:, :tokens].repeat_interleave(self.frames_per_token, dim=1)
        return self.latents[list(rows), :tokens], frame_mask


class ImitatingStage(VAEStage):
    """A VAE that learns from motions and, as much, from another decoder on generated latents.

    Args:
        vae: The network to train.
        dataset: Motions.
        experiment: Which crops, which objective.
        place: The device and rank.
        imitation: Generated latents and who decodes them.
    """

    def __init__(
        self,
        vae: MotionVAE,
        dataset: Dataset,
        experiment: Experiment,
        place: Place,
        imitation: Imitation,
    ) -> None:
        super().__init__(vae, dataset, experiment, place)
        self._imitation = imitation
        imitation.vae.to(place.device)
        self._most = experiment.vae_cropping.max_frames

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`; "imitated" is that on generated latents."""
        losses = super().forward(step)
        imitated = self._imitated(step)
        return {**losses, "total": losses["total"] + imitated, "imitated": imitated}

    def _imitated(self, step: int) -> torch.Tensor:
        settings, place = self._settings, self._place
        rows = self._imitation.rows(step, settings.batch_size, settings.seed)
        batch = self._imitation.batch(rows[place.ranks.share(len(rows))], self._most)
        latents, mask = (part.to(place.device) for part in batch)
        with torch.no_grad(), torch.autocast(place.device.type, enabled=False):
            true = self._imitation.vae.decode(latents, mask)
        found = self.network.decode(latents, mask).float()
        fps, objective = self._dataset.representation.fps, self._objective
        losses = feature_losses(found, true, mask, self._joints, fps, objective, self.skeleton)
        return weighted_sum(losses, objective)


def load_imitation(run: Path, model: FirstStageModel) -> Imitation:
    """Reads what a distillation generated, and the decoder that its model has.

    Args:
        run: Run folder of a distillation that ended.
        model: The model for whose latents a decoder is trained.

    Raises:
        ModelError: The run has made no model.
        InputError: It keeps no ways, or its latents are others, or have no time axis.
    """
    student = load_stages(run / MODEL)
    check_latents(model, student)
    ways, space = run / WAYS_FILE, student.card.latents
    if not ways.is_file() or space.frames_per_token is None:
        raise InputError(
            f"{run}: expected latents over time in {WAYS_FILE}; pass the run folder of a "
            "distillation by Regression of a model that has such"
        )
    latents, mask = _sorted(*ends_of(ways), space)
    vae = student.vae.eval().requires_grad_(False)
    fingerprint = sha256(ways) + sha256(run / MODEL / WEIGHTS_FILE)
    return Imitation(latents, mask, space.frames_per_token, vae, fingerprint)


def _sorted(
    ends: torch.Tensor, mask: torch.Tensor, space: LatentSpace
) -> tuple[torch.Tensor, torch.Tensor]:
    order = mask.sum(dim=1).argsort(stable=True)
    scale = Scale(torch.tensor(space.mean), torch.tensor(space.std))
    return scale.denormalize(ends)[order], mask[order]
