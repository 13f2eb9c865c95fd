"""A model's own motions for prompts with checks, and whether each fulfills its check.

They are what `reinforce` learns from: latents in the denoiser's scale, made once and kept in the
run folder, a file of each rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from safetensors.torch import load_file

from latentmotion.arrays import prefix_mask
from latentmotion.data.instructions import Instruction
from latentmotion.diffusion.guidance import guided
from latentmotion.diffusion.samplers import SeededNoise, sample, sampler_named
from latentmotion.engine.backend import FeatureDecoder, representation_of
from latentmotion.measure.facts import FPS
from latentmotion.measure.scene import describe
from latentmotion.model.config import STRIDE
from latentmotion.networks.checkpoint import LatentModel
from latentmotion.networks.device import autocast
from latentmotion.training.checking import fulfills
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.run_folder import write_tensors
from latentmotion.training.task_conditions import ConditionTable

Blocks = TypeVar("Blocks", bound=Any)

AT_ONCE = 64  # Motions that are made together.

STANDING = 0.05  # Height in meters below which a foot joint that does not rise counts as standing.


DEPTH = 0.05  # Meters below the floor that are as bad as a foot that slides at 1 m/s.


@dataclass(frozen=True)
class TakeSettings:
    """Which motions are made."""

    prompts: int = 1000  # Prompts that are drawn.
    takes: int = 6  # Motions of each.
    guidance: float = 4.0  # Guidance scale.
    steps: int = 10  # Sampling steps of DPM-Solver++.
    # Deviation of the logarithm of lengths, around what is usual for the sentence.
    spread: float = 0.2
    # Cost of feet that slide or sink, for each deviation above the prompt's other takes.
    feet: float = 0.3
    seed: int = 0  # Seed of prompts, lengths and noise.


@dataclass(frozen=True)
class Takes:
    """Motions of a model, by prompt."""

    # Generated latents, in the denoiser's scale.
    latents: Float[torch.Tensor, "takes tokens width"]
    mask: Bool[torch.Tensor, "takes tokens"]  # True on real tokens.
    prompt: torch.Tensor  # Number of each one's prompt.
    obeys: Bool[torch.Tensor, " takes"]  # Whether each fulfills its check.
    # Speed of standing feet, m/s, and the depth of the lowest joint below the floor, 5 cm.
    faults: Float[torch.Tensor, " takes"]

    def weights(self, feet: float) -> Float[torch.Tensor, " takes"]:
        """Returns how much is to be learned of each take, from 0 (avoid it) to 1 (do the like).

        A take is compared with the others of its prompt, so that 0.5 is said of all where all obey
        or none does (Zheng et al. 2025, "DiffusionNFT", eq. 8).

        Args:
            feet: What a deviation more of faults costs, where obeying counts 1.
        """
        better = _centered(-self.faults.clamp(max=1.0), self.prompt)
        better = better / (better.square().mean().sqrt() + 1e-6)  # by the deviation within prompts
        reward = self.obeys.float() + feet * better.clamp(-1.5, 1.5)
        return 0.5 + _centered(reward, self.prompt).clamp(-0.5, 0.5)


@torch.no_grad()
def cached_takes(
    settings: TakeSettings,
    instructions: Sequence[Instruction],
    seconds: Sequence[float],
    model: LatentModel,
    prompts: ConditionTable,
    folder: Path,
    context: DistributedContext,
) -> Takes:
    """Makes and judges takes of all prompts, or reads them from the run folder.

    Args:
        settings: How many, and how.
        instructions: Prompts and checks.
        seconds: Usual length for each prompt.
        model: Makes the motions.
        prompts: Knows the prompts.
        folder: Run folder.
        context: Device and rank; each rank makes its share.
    """
    world, rank, device = context.ranks.world, context.ranks.rank, context.device
    files = [folder / f"takes-{number}-of-{world}.safetensors" for number in range(world)]
    card, generator = model.card, np.random.default_rng(settings.seed)
    model.denoiser.to(device).eval()
    null, scale = prompts([""]), settings.guidance
    denoiser = guided(card.sampling.guidance_rule, card.parametrized(model.denoiser), null, scale)
    sampler = sampler_named("dpm++", card.schedule)
    decode = model.vae.to(device).eval().decode
    decoder = FeatureDecoder.of(card, decode, lambda array: torch.as_tensor(array, device=device))
    usual = np.repeat(seconds, settings.takes)
    frames = drawn_frames(usual, settings.spread, card.frames, generator)
    order = np.argsort(frames, kind="stable")
    blocks = [order[i : i + AT_ONCE] for i in range(0, len(order), AT_ONCE)]
    parts = []
    for number in () if files[rank].exists() else range(rank, len(blocks), world):
        rows = blocks[number]
        requested = [instructions[row // settings.takes] for row in rows]
        tokens = [card.latents.tokens_of(int(frames[row])) for row in rows]
        noise = SeededNoise([settings.seed * 2**20 + int(row) for row in rows], tokens)
        z = torch.from_numpy(noise((len(rows), max(tokens), card.latents.width))).to(device)
        mask = prefix_mask(torch.tensor(tokens)).to(device)
        condition = prompts([item.prompt for item in requested])
        with autocast(device):
            z = sample(denoiser, sampler, z, condition, mask, settings.steps, noise).float()
        real = prefix_mask(torch.tensor(frames[rows])).to(device)
        joints = representation_of(card).decode(decoder(z, real).float().cpu().numpy())
        verdicts = [
            judged(motion[: frames[row]], item)
            for motion, row, item in zip(joints, rows, requested, strict=True)
        ]
        obeys, faults = (torch.tensor(values) for values in zip(*verdicts, strict=True))
        which = torch.from_numpy(rows // settings.takes)
        parts.append(Takes((z * mask[..., None]).cpu(), mask.cpu(), which, obeys, faults))
        if context.is_main and number % 20 == 0:
            share = torch.cat([part.obeys for part in parts]).float().mean()
            print(f"takes: block {number} of {len(blocks)}, {100 * share:.0f} % obey", flush=True)
    if parts:
        write_tensors(files[rank], vars(joined(parts)))
    context.wait()
    return joined([Takes(**load_file(file)) for file in files])


def drawn_frames(
    seconds: np.ndarray, spread: float, limits: tuple[int, int], generator: np.random.Generator
) -> np.ndarray:
    """Returns random lengths in whole tokens, around the usual length of each prompt."""
    drawn = FPS * seconds * np.exp(spread * generator.standard_normal(len(seconds)))
    return (
        np.clip(drawn / STRIDE, -(-limits[0] // STRIDE), limits[1] // STRIDE).round() * STRIDE
    ).astype(int)


def judged(
    joints: Float[np.ndarray, "frames 22 3"], instruction: Instruction
) -> tuple[bool, float]:
    """Returns whether a motion fulfills its instruction, and a penalty for its feet."""
    feet = joints[:, [7, 10, 8, 11]]
    velocity = FPS * np.diff(feet, axis=0)
    stands = (feet[:-1, :, 1] < STANDING) & (np.abs(velocity[..., 1]) < 0.3)
    speed = np.linalg.norm(velocity, axis=-1)
    slides = float(speed[stands].mean()) if stands.any() else 0.0
    depth = float(np.maximum(-joints[..., 1].min(axis=1), 0).mean())
    return fulfills(describe(joints), instruction.check), slides + depth / DEPTH


def joined(parts: Sequence[Blocks]) -> Blocks:
    """Returns the rows of several blocks as one, padded to the longest.

    Args:
        parts: Dataclasses of tensors with a `mask`; the tokens of arrays with more axes than it
            are their last axis but one.
    """
    longest = max(part.mask.shape[1] for part in parts)
    columns = []
    for column in fields(parts[0]):
        tensors = []
        for part in parts:
            tensor, missing = getattr(part, column.name), longest - part.mask.shape[1]
            padding = {1: (), 2: (0, missing)}.get(tensor.ndim, (0, 0, 0, missing))
            tensors.append(torch.nn.functional.pad(tensor, padding))
        columns.append(torch.cat(tensors))
    return type(parts[0])(*columns)


def _centered(values: torch.Tensor, group: torch.Tensor) -> torch.Tensor:
    """Returns values minus the mean of their group."""
    count = torch.zeros(int(group.max()) + 1).index_add(0, group, torch.ones_like(values))
    total = torch.zeros_like(count).index_add(0, group, values)
    return values - (total / count.clamp(min=1))[group]
