"""The teacher's guided ways from noise to latents: what leaps are compared with, or learned from.

    noise, prompt, guidance w → the teacher's solver, guided → latents at the stops of all leaps

They are those that the student will walk itself, not noised data, which guidance leaves. They are
computed once and kept in the run folder, as latents are for stage 2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from latentmotion.arrays import prefix_mask
from latentmotion.condition.interface import Conditioning
from latentmotion.data.sampling import Crop
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.guidance import ClassifierFreeGuidance
from latentmotion.diffusion.leaps import Leaps
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.sampler import SamplerName, sample, sampler_named
from latentmotion.experiment import Precision
from latentmotion.model.card import ModelCard
from latentmotion.storage.files import atomic_file
from latentmotion.training.devices import Place
from latentmotion.training.steering import PromptTable

WAYS_FILE = "ways.safetensors"
"""Where in a distillation's run folder the ways that it learns from are kept."""


@dataclass(frozen=True)
class Trajectories:
    """Ways of the teacher, padded to the longest motion."""

    points: Float[torch.Tensor, "paths stops tokens width"]
    """Latents at every stop, noise first."""
    mask: Bool[torch.Tensor, "paths tokens"]
    """True on real tokens."""
    guidance: Float[torch.Tensor, " paths"]
    """Guidance scale of each."""

    def take(self, rows: Sequence[int], among: Sequence[int]) -> Trajectories:
        """Returns some of them, cut to the longest of `among`."""
        longest = int(self.mask[list(among)].sum(dim=1).max())
        own = list(rows)
        return Trajectories(
            self.points[own, :, :longest], self.mask[own, :longest], self.guidance[own]
        )

    def to(self, device: torch.device) -> Trajectories:
        """Returns them on a device."""
        parts = (part.to(device) for part in (self.points, self.mask, self.guidance))
        return Trajectories(*parts)


@dataclass(frozen=True)
class Guide:
    """A trained model that shows the way."""

    network: Denoiser
    """Its denoiser, which trains no more."""
    card: ModelCard
    """What it is."""
    leaps: Leaps
    """Where its ways are looked at."""
    prompts: PromptTable
    """What it sees of prompts."""
    device: torch.device
    """Where it computes."""
    solver: SamplerName
    """Its rule of a step, of one pass."""
    precision: Precision = "float32"
    """Of the network's arithmetic; the ways stay in float32."""

    @torch.no_grad()
    def show(self, crops: Sequence[Crop], seed: int) -> Trajectories:
        """Returns ways for motions like some crops: of their lengths, by their prompts."""
        generator = np.random.default_rng(seed)
        guidance = generator.uniform(*self.leaps.guidance, len(crops)).astype(np.float32)
        tokens = [self.card.latents.tokens_of(crop.frames) for crop in crops]
        seeds = generator.integers(2**32, size=len(crops)).tolist()
        z = SeededNoise(seeds, tokens)((len(crops), max(tokens), self.card.latents.width))
        mask = prefix_mask(torch.tensor(tokens))
        scale = torch.from_numpy(guidance)
        condition = self.prompts([crop.caption for crop in crops])
        moved = (part.to(self.device) for part in (torch.from_numpy(z), mask, scale))
        return Trajectories(self._points(condition, *moved), mask.to(self.device), scale).to(
            torch.device("cpu")
        )

    def guided(self, scale: Float[torch.Tensor, " batch"]) -> ClassifierFreeGuidance:
        """Returns the teacher's denoiser, guided by a scale for each item."""
        return ClassifierFreeGuidance(self.network, self.prompts([""]), scale)

    def _points(
        self, condition: Conditioning, z: torch.Tensor, mask: torch.Tensor, scale: torch.Tensor
    ) -> torch.Tensor:
        guided = self.guided(scale)
        states: list[torch.Tensor] = []

        def watched(z: Any, t: Any, condition: Conditioning, mask: Any) -> Any:
            states.append(z)
            return guided(z, t, condition, mask)

        sampler = sampler_named(self.solver, self.card.schedule, self.card.prediction)
        with torch.autocast(self.device.type, torch.bfloat16, self.precision == "bfloat16"):
            last = sample(watched, sampler, z, condition, mask, self.leaps.of, nothing)
        return torch.stack([[*states, last][stop] for stop in self.leaps.stops], dim=1)


def remembered_trajectories(
    path: Path, compute: Callable[[], list[Trajectories]], place: Place
) -> Trajectories:
    """Reads ways from `path`, which the leading rank computes first where it is missing."""
    if place.leads and not path.exists():
        joined = _joined(compute())
        tensors = {"points": joined.points, "mask": joined.mask, "guidance": joined.guidance}
        with atomic_file(path) as temporary:
            save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, temporary)
    place.wait()
    return Trajectories(**load_file(path))


def ends_of(
    path: Path,
) -> tuple[Float[torch.Tensor, "paths tokens width"], Bool[torch.Tensor, "paths tokens"]]:
    """Reads from a file of ways only where each ended, in the denoiser's scale, and the masks."""
    with safe_open(path, "pt") as file:
        points = file.get_slice("points")
        last = points.get_shape()[1] - 1
        return points[:, last], file.get_tensor("mask")


def _joined(parts: Sequence[Trajectories]) -> Trajectories:
    longest = max(part.mask.shape[1] for part in parts)
    points, masks = [], []
    for part in parts:
        missing = longest - part.mask.shape[1]
        points.append(torch.nn.functional.pad(part.points, (0, 0, 0, missing)))
        masks.append(torch.nn.functional.pad(part.mask, (0, missing)))
    guidance = torch.cat([part.guidance for part in parts])
    return Trajectories(torch.cat(points), torch.cat(masks), guidance)


def nothing(shape: tuple[int, ...]) -> np.ndarray:
    """Stands for noise where none is drawn."""
    raise AssertionError(f"this solver draws no noise, asked for {shape}")
