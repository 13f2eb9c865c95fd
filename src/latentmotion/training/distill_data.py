"""What distillation needs of the data: prompts and lengths, ways of the teacher, or motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from latentmotion.checkpoint import LatentModel
from latentmotion.condition.interface import TextEncoder
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop, Item
from latentmotion.distillation import Distillation, PhasedConsistency, Regression
from latentmotion.errors import InputError
from latentmotion.feature_decoder import normalizer_of
from latentmotion.model.card import ModelCard
from latentmotion.runtime.conditions import build_condition
from latentmotion.training.consistency import WithinPhases
from latentmotion.training.crops import FeatureMemory, Plan
from latentmotion.training.devices import Place
from latentmotion.training.first_stage import captions_of
from latentmotion.training.latents import (
    LatentMemory,
    encode_crops,
    keep_crops,
    remembered_posteriors,
)
from latentmotion.training.leap_sources import AlongWays, LeapSource, Ways
from latentmotion.training.raw_frames import FrameMemory
from latentmotion.training.steering import PromptTable, items_to_learn, required_encoder
from latentmotion.training.trajectories import WAYS_FILE, Guide, remembered_trajectories

HELD_OUT = 64
"""Most held-out prompts that a validation looks at."""

AT_ONCE = 64
"""Motions that the teacher makes together."""


@dataclass(frozen=True)
class Lessons:
    """A teacher, and what it is asked."""

    model: LatentModel
    """The teacher, both its stages."""
    guide: Guide
    """Its denoiser, guided."""
    dataset: Dataset
    """Where motions are."""
    clips: tuple[Clip, ...]
    """Those to learn from."""
    seen: tuple[Item, ...]
    """Their items, whose captions the teacher may be asked."""
    held_out: tuple[Crop, ...]
    """What it is asked to be compared with alone."""
    settings: Distillation
    """How many of each, and the seed."""
    folder: Path
    """The run folder, which keeps what takes long to compute."""
    place: Place
    """Where to compute."""

    def comparison(self) -> Ways | None:
        """Returns the teacher's ways for held-out crops."""
        blocks = [list(self.held_out)] if self.held_out else []
        # Noises that no way has which is learned from.
        return self._ways("held_out.safetensors", blocks, 2**31) if blocks else None

    def source(self) -> LeapSource:
        """Returns what the student learns from."""
        match self.settings.objective:
            case Regression(ways):
                return self._along_ways(ways)
            case PhasedConsistency(per_item):
                return self._within_phases(per_item)

    def _along_ways(self, count: int) -> AlongWays:
        settings, training = self.settings, self.settings.training
        plan = Plan(self.seen, AT_ONCE, settings.cropping, training.seed)
        blocks = [plan(step) for step in range(max(count // AT_ONCE, 1))]
        ways = self._ways(WAYS_FILE, blocks, 0)
        guide = self.guide
        schedule = guide.card.schedule
        return AlongWays(ways, guide.prompts, guide.leaps, schedule, training, self.place)

    def _ways(self, file: str, blocks: Sequence[Sequence[Crop]], seed: int) -> Ways:
        first = seed + self.settings.training.seed
        ways = remembered_trajectories(
            self.folder / file,
            lambda: [self.guide.show(block, first + at) for at, block in enumerate(blocks)],
            self.place,
        )
        return Ways(tuple(crop for block in blocks for crop in block), ways)

    def _within_phases(self, per_item: int) -> WithinPhases:
        settings, training = self.settings, self.settings.training
        memory = FeatureMemory(self.dataset, self.clips, normalizer_of(self.guide.card))
        cropping, latents = settings.cropping, FrameMemory(memory, self.place.device)
        if self.model.card.vae.has_weights:
            cropping = keep_crops(self.seen, cropping, per_item, training.seed)
            latents = self._latents(memory, cropping.every())
        plan = Plan(self.seen, training.batch_size, cropping, training.seed)
        return WithinPhases(self.guide, plan, latents, training, self.place)

    def _latents(self, memory: FeatureMemory, crops: list[Crop]) -> LatentMemory:
        space, device, vae = self.guide.card.latents, self.place.device, self.model.vae
        posteriors = remembered_posteriors(
            self.folder / "latents.safetensors",
            lambda: encode_crops(vae.to(device), memory, crops, self.place),
            self.place,
        )
        return LatentMemory(crops, posteriors.normalized(space.mean, space.std).to(device))


def prepare_lessons(
    settings: Distillation,
    dataset: Dataset,
    model: LatentModel,
    encoder: TextEncoder | None,
    folder: Path,
    place: Place,
) -> Lessons:
    """Finds what a teacher may be asked; `encoder` is its own, where it reads sentences.

    Raises:
        InputError: There is nothing.
    """
    card, network, training = model.card, model.denoiser, settings.training
    clips = tuple(dataset.clips("train", mirrored=settings.mirrored))
    seen, unseen = prompted(card, clips), prompted(card, dataset.clips("val"))[:HELD_OUT]
    if not seen:
        raise InputError(
            f"no training clip of {dataset.folder} has a caption or label that model "
            f"{card.name!r} knows; use the data that it was trained on"
        )
    held_out = keep_crops(unseen, settings.cropping, 1, training.seed).every()
    condition = build_condition(card, partial(required_encoder, encoder))
    prompts = PromptTable(condition, captions_of([*seen, *unseen]), place.device)
    network.eval().requires_grad_(False).to(place.device)
    guide = Guide(
        network, card, settings.leaps, prompts, place.device, settings.solver, training.precision
    )
    return Lessons(
        model, guide, dataset, clips, tuple(seen), tuple(held_out), settings, folder, place
    )


def prompted(card: ModelCard, clips: Sequence[Clip]) -> list[Item]:
    """Returns items whose captions are what the model may be asked."""
    items = items_to_learn(card.condition, clips)
    return [item for item in items if item.captions or not card.condition.prompted]
