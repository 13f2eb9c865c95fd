"""What the paper compares its VAE with (table 4), trained as the paper's own is."""

from __future__ import annotations

from dataclasses import replace

from latentmotion.baselines.actor import actor_vae
from latentmotion.baselines.vposer_t import VPoserTConfig
from latentmotion.experiment import Experiment
from latentmotion.presets.mld_humanml3d import mld_humanml3d


def actor() -> Experiment:
    """ACTOR's VAE."""
    return replace(mld_humanml3d(), name="actor", vae=actor_vae(263))


def vposer_t() -> Experiment:
    """VPoser over time."""
    return replace(mld_humanml3d(), name="vposer_t", vae=VPoserTConfig())
