"""Settings and data of a distillation: prompts and lengths, the teacher's trajectories, motions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate, cycle
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from latentmotion.arrays import prefix_mask
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Crop, Cropping, Dataset, Item
from latentmotion.data.instructions import Instruction, instructions
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.backend import FeatureDecoder, representation_of
from latentmotion.engine.encoder import silent_of_unknown
from latentmotion.engine.lengths import LengthFile
from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.checkpoint import LatentModel
from latentmotion.training.captioning.clauses import read_clauses
from latentmotion.training.captioning.rewording import rewordings, written_wordings
from latentmotion.training.denoiser import keep_crops
from latentmotion.training.distillation.trajectories import (
    TRAJECTORIES_FILE,
    PromptedTrajectories,
    Teacher,
    Trajectories,
    TrajectorySteps,
    cached_trajectories,
    check_stops,
)
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.drawn_instructions import drawn_instructions
from latentmotion.training.experiment import RarityDraws, TrainingSettings, optimization
from latentmotion.training.stages import captions_of
from latentmotion.training.takes import drawn_frames, joined, judged
from latentmotion.training.task_conditions import ConditionTable, items_to_learn, required_encoder
from latentmotion.training.vae import BatchSampler


@dataclass(frozen=True)
class TrajectoryRegression:
    """Regression on trajectories that the teacher computes beforehand: exact, but finitely many."""

    trajectories: int = 4096  # Number of trajectories; they are kept in the run folder.
    # Further trajectories, for prompts whose fulfillment can be measured, none of them of the
    # instruction benchmark; those that fail are not learned from, so that a student may obey more
    # than its teacher. Fine-tuning has them from the model as it was, so that it keeps what it
    # knew.
    asked: int = 0
    # Further trajectories for captions, in turn by verb and by caption with written wordings. The
    # student reads other words than the teacher did, so it learns wordings that its teacher does
    # not know.
    reworded: int = 0
    wordings: int = 1  # Most wordings of each of these captions; the student reads them in turn.


@dataclass(frozen=True)
class Distillation:
    """Settings of `latentmotion train distill`; the defaults are for two cores and some minutes."""

    name: str = "student"  # Name of the model.
    # Step counts and guidance scales that the student learns.
    few_step: FewStepConfig = field(default_factory=FewStepConfig)
    # Its training items.
    objective: TrajectoryRegression = field(default_factory=TrajectoryRegression)
    # Sampler of the teacher's trajectories. `dpm++` is nearer to the exact trajectory; use `ddim`
    # for teachers better in coarse steps.
    solver: Literal["dpm++", "ddim"] = "dpm++"
    # Lengths of motions, within those that the teacher makes.
    cropping: Cropping = field(default_factory=lambda: Cropping(max_frames=196, min_frames=12))
    huber_delta: float = 1.0  # Error at which the loss changes from quadratic to linear (Huber).
    mirrored: bool = True  # Whether prompts of mirrored clips are used too.
    draws: RarityDraws = field(default_factory=RarityDraws)  # How often rare sentences are asked.
    # Optimization of the student; the teacher runs in the same precision.
    training: TrainingSettings = field(default_factory=partial(optimization, "distill"))


HELD_OUT = 64  # Most held-out prompts that a validation looks at.

AT_ONCE = 64  # Motions that the teacher makes together.

FEWEST = 8  # Captions that a verb needs to be one of the reworded.

SPREAD = 0.15  # Deviation of the logarithm of lengths of drawn prompts.


@dataclass(frozen=True)
class DistillationData:
    """A teacher and the settings of its trajectories."""

    model: LatentModel  # The teacher, both its stages.
    teacher: Teacher  # Its denoiser, guided.
    # Model of the drawn prompts' motions: the teacher, or one whose behavior is to be kept.
    former: Teacher
    items: tuple[Item, ...]  # Items to learn from; the teacher generates from their captions.
    held_out: tuple[Crop, ...]  # Crops for evaluation only.
    # Drawn prompts with their checks, as crops of the length to generate.
    drawn: tuple[tuple[Crop, Instruction], ...]
    # Further captions, as crops of the length to generate, each with wordings of it.
    reworded: tuple[tuple[Crop, tuple[str, ...]], ...]
    settings: Distillation  # Numbers of each, and the seed.
    folder: Path  # The run folder, which keeps what takes long to compute.
    context: DistributedContext  # Where to compute.

    def comparison(self) -> PromptedTrajectories | None:
        """Returns the teacher's trajectories for held-out crops."""
        blocks = [list(self.held_out)] if self.held_out else []
        # Seeds of noises that no trajectory of the training has.
        return self._trajectories("held_out.safetensors", blocks, 2**31) if blocks else None

    def source(self) -> TrajectorySteps:
        """Returns what the student learns from."""
        training, cropping = self.settings.training, self.settings.cropping
        batches = BatchSampler(self.items, AT_ONCE, cropping, training.seed)
        blocks = [
            batches(step) for step in range(max(self.settings.objective.trajectories // AT_ONCE, 1))
        ]
        parts = [self._trajectories(TRAJECTORIES_FILE, blocks, 0)]
        if self.drawn:
            blocks = in_blocks(crop for crop, _ in self.drawn)
            parts.append(self._trajectories("asked.safetensors", blocks, 2**30, dict(self.drawn)))
        if self.reworded:
            blocks = in_blocks(crop for crop, _ in self.reworded)
            parts.append(self._trajectories("reworded.safetensors", blocks, 3 << 30))
        learned = PromptedTrajectories(
            tuple(crop for part in parts for crop in part.crops),
            joined([part.trajectories for part in parts]),
            dict(self.reworded),
        )
        teacher = self.teacher
        schedule = teacher.card.schedule
        return TrajectorySteps(
            learned, teacher.prompts, teacher.few_step, schedule, training, self.context
        )

    def _trajectories(
        self,
        file: str,
        blocks: Sequence[Sequence[Crop]],
        seed: int,
        asked: Mapping[Crop, Instruction] | None = None,
    ) -> PromptedTrajectories:
        """Returns trajectories of blocks of crops; with checks, those that fulfill theirs."""
        first = seed + self.settings.training.seed
        starts = [0, *accumulate(map(len, blocks))]

        def compute(number: int) -> Trajectories:
            teacher = self.teacher if asked is None else self.former
            trajectories = teacher.trajectories(blocks[number], first + number)
            if asked is not None:
                trajectories = self._obedient(trajectories, blocks[number], asked)
            return replace(trajectories, rows=trajectories.rows + starts[number])

        trajectories = cached_trajectories(self.folder / file, compute, len(blocks), self.context)
        crops = [crop for block in blocks for crop in block]
        return PromptedTrajectories(
            tuple(crops[row] for row in trajectories.rows.tolist()), trajectories
        )

    @torch.no_grad()
    def _obedient(
        self, trajectories: Trajectories, crops: Sequence[Crop], asked: Mapping[Crop, Instruction]
    ) -> Trajectories:
        """Returns the trajectories whose motions do what was asked."""
        card, device = self.teacher.card, self.context.device
        decoder = FeatureDecoder.of(
            card, self.model.vae.to(device).eval().decode, partial(torch.tensor, device=device)
        )
        frames = prefix_mask(torch.tensor([crop.frames for crop in crops])).to(device)
        features = decoder(trajectories.points[:, -1].to(device), frames).cpu().numpy()
        joints = representation_of(card).decode(features)
        obeys = [
            judged(motion[: crop.frames], asked[crop])[0]
            for motion, crop in zip(joints, crops, strict=True)
        ]
        obedient = torch.tensor(obeys).nonzero()[:, 0].tolist()
        return trajectories.take(obedient, range(len(crops)))


def prepare_distillation(
    settings: Distillation,
    dataset: Dataset,
    model: LatentModel,
    encoder: TextEncoder | None,
    folder: Path,
    context: DistributedContext,
    lengths: LengthFile | None = None,
    former: LatentModel | None = None,
) -> DistillationData:
    """Finds what a teacher may be asked.

    Args:
        settings: How many trajectories of which kind.
        dataset: Prepared data.
        model: The teacher.
        encoder: Its text encoder, where it reads sentences.
        folder: Run folder.
        context: Device and rank.
        lengths: Usual lengths of drawn prompts, where any are asked.
        former: Answers drawn prompts in place of the teacher; it may be an earlier student.

    Raises:
        InputError: There is nothing, there are no lengths for drawn prompts, or the steps of
            `former` are others.
    """
    card, network, training = model.card, model.denoiser, settings.training
    clips = tuple(dataset.clips("train", mirrored=settings.mirrored))
    items, unseen = prompted(card, clips), prompted(card, dataset.clips("val"))[:HELD_OUT]
    if not items:
        raise InputError(
            f"no training clip of {dataset.folder} has a caption or label that model "
            f"{card.name!r} knows; use the data that it was trained on"
        )
    if encoder is not None:
        items = settings.draws.weigh(items, lambda texts: encoder(texts).pooled)
    held_out = keep_crops(unseen, settings.cropping, 1, training.seed).every()
    condition = card.prompt_condition(partial(required_encoder, encoder))
    drawn = drawn_crops(settings, items[0].clip, encoder, lengths)
    reworded = reworded_crops(settings, items)
    captions = captions_of([*items, *unseen]) | {crop.caption for crop, _ in drawn}
    captions |= {text for _, texts in reworded for text in texts}
    prompts = ConditionTable(condition, captions, context.device)
    network.eval().requires_grad_(False).to(context.device)
    few, device = settings.few_step, context.device
    teacher = Teacher(network, card, few, prompts, device, settings.solver, training.precision)
    answering = teacher
    if former is not None:
        check_stops(former.card, settings.few_step)
        frozen = former.denoiser.eval().requires_grad_(False).to(context.device)
        answering = replace(teacher, network=frozen, card=former.card)
    return DistillationData(
        model,
        teacher,
        answering,
        tuple(items),
        tuple(held_out),
        drawn,
        reworded,
        settings,
        folder,
        context,
    )


def drawn_crops(
    settings: Distillation, clip: Clip, encoder: TextEncoder | None, lengths: LengthFile | None
) -> tuple[tuple[Crop, Instruction], ...]:
    """Returns drawn prompts with checks, each with a length around the usual one.

    Args:
        settings: How many, and the seed.
        clip: Stands for the clip that they have not.
        encoder: Reads the prompts.
        lengths: Usual lengths of prompts.

    Raises:
        InputError: There is no text encoder, or no lengths.
    """
    objective, seed = settings.objective, settings.training.seed
    if not objective.asked:
        return ()
    if lengths is None:
        raise InputError(
            "objective.asked: the teacher has no lengths of sentences; export it with --length"
        )
    drawn = drawn_instructions(objective.asked, seed + 1)
    with silent_of_unknown():  # nobody typed these prompts
        usual = lengths.usual(
            required_encoder(encoder)([instruction.prompt for instruction in drawn]).pooled
        )
    limits = settings.cropping.min_frames, settings.cropping.max_frames
    frames = drawn_frames(np.array(usual), SPREAD, limits, np.random.default_rng(seed))
    crops = [
        Crop(clip, 0, n, instruction.prompt)
        for n, instruction in zip(frames.tolist(), drawn, strict=True)
    ]
    return tuple(zip(crops, drawn, strict=True))


def reworded_crops(
    settings: Distillation, items: Sequence[Item]
) -> tuple[tuple[Crop, tuple[str, ...]], ...]:
    """Returns captions of the data with wordings of each.

    In turn of each verb, and of each caption with written wordings; where captions of a verb
    have any, it is one of these captions. No wording is a prompt of the instruction benchmark.

    Args:
        settings: How many, lengths, and the seed.
        items: Items with captions.
    """
    objective = settings.objective
    if not objective.reworded:
        return ()
    shortest = max(settings.cropping.min_frames, settings.cropping.unit)
    verbs, captions = captions_to_reword([row for row in items if row.frames >= shortest])
    refused = {row.prompt for row in instructions()}
    generator = np.random.default_rng([settings.training.seed, 1])
    turns = [cycle(groups) for groups in (verbs, captions) if groups]
    wordings: dict[Crop, tuple[str, ...]] = {}
    for number in range(objective.reworded if turns else 0):
        group = next(turns[number % len(turns)])
        item, caption = group[int(generator.integers(len(group)))]
        texts = rewordings(caption, generator, objective.wordings)
        crop = replace(settings.cropping.crop(item, generator), caption=caption)
        if allowed := tuple(text for text in texts if text not in refused):
            wordings[crop] = allowed
    return tuple(wordings.items())


def captions_to_reword(
    items: Sequence[Item],
) -> tuple[list[list[tuple[Item, str]]], list[list[tuple[Item, str]]]]:
    """Returns captions by verb, of verbs that have enough, and those with written wordings."""
    verbs: dict[str, list[tuple[Item, str]]] = defaultdict(list)
    written_verbs: dict[str, list[tuple[Item, str]]] = defaultdict(list)
    written: dict[str, list[tuple[Item, str]]] = defaultdict(list)
    for item in items:
        for caption in item.captions:
            read, texts = read_clauses(caption), written_wordings(caption)
            if read is not None:
                verbs[read.clauses[0].verb].append((item, caption))
            if read is not None and texts:
                written_verbs[read.clauses[0].verb].append((item, caption))
            if texts:
                written[texts[0]].append((item, caption))
    verbs |= written_verbs
    return [group for group in verbs.values() if len(group) >= FEWEST], list(written.values())


def in_blocks(crops: Iterable[Crop]) -> list[list[Crop]]:
    """Returns crops of similar length in blocks that the teacher generates together."""
    ordered = sorted(crops, key=lambda crop: crop.frames)
    return [ordered[i : i + AT_ONCE] for i in range(0, len(ordered), AT_ONCE)]


def prompted(card: ModelCard, clips: Sequence[Clip]) -> list[Item]:
    """Returns items whose captions are what the model may be asked."""
    items = items_to_learn(card.condition, clips)
    return [item for item in items if item.captions or not card.condition.prompted]
