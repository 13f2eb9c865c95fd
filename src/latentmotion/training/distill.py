"""The third stage: a model of few steps from any trained one of ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from latentmotion.checkpoint import (
    WEIGHTS_FILE,
    TrainedModel,
    describe,
    load_model,
    read_networks,
    save_model,
)
from latentmotion.condition.interface import TextEncoder
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Item, items_of
from latentmotion.diffusion.denoiser import Denoiser, DenoiserConfig
from latentmotion.distillation import Distillation
from latentmotion.errors import InputError, ModelError
from latentmotion.files import sha256
from latentmotion.model_card import CARD_FILE, ModelCard
from latentmotion.runtime.conditions import build_condition, labels_of
from latentmotion.training.crops import Plan
from latentmotion.training.devices import Place
from latentmotion.training.distill_stage import DistillStage, Ways
from latentmotion.training.latent_decoder import LatentDecoder
from latentmotion.training.latents import keep_crops
from latentmotion.training.loop import train
from latentmotion.training.provenance import provenance_of
from latentmotion.training.run_folder import MODEL, open_run
from latentmotion.training.steering import PromptTable
from latentmotion.training.trajectories import Guide, remembered_trajectories

HELD_OUT = 64
"""Most held-out prompts that a validation looks at."""

AT_ONCE = 64
"""Motions that the teacher makes together."""


@dataclass(frozen=True)
class DistillRun:
    """What a run folder was made with."""

    data: str
    """Fingerprint of the prepared data."""
    teacher: str
    """Hash of the teacher's weights."""
    settings: Distillation
    """Everything else."""


def distill(
    settings: Distillation,
    data: Path,
    teacher: Path,
    encoder: TextEncoder | None,
    folder: Path,
    place: Place,
) -> Path:
    """Makes a model of few steps, or goes on with it; returns its folder, with the same VAE.

    `encoder` is the teacher's, where it reads sentences.

    Raises:
        DataError: The data cannot be used.
        ModelError: The teacher is missing, or cannot teach.
        InputError: The run folder holds another run, or data and teacher do not fit.
    """
    dataset, source = Dataset.load(data), model_folder(teacher)
    model = load_model(source)
    card, network = check_teacher(model, dataset), model.denoiser
    assert network is not None  # checked
    run = DistillRun(dataset.fingerprint, sha256(source / WEIGHTS_FILE), settings)
    open_run(folder, run, place)
    ways = prepare_ways(settings, dataset, model, encoder, folder, place)
    torch.manual_seed(settings.training.seed)
    config = student_config(card, settings)
    student = student_of(network, config)
    decoder = LatentDecoder(model.vae, card, settings.cropping.max_frames // 2)  # type: ignore
    stage = DistillStage(student, card, ways, decoder, settings, place)
    student, seconds = train(stage, settings.training, folder, place)
    if place.leads:
        figures = stage.validate(student)
        made = student_card(card, config, settings, dataset, seconds, figures)
        save_model(folder / MODEL, TrainedModel(made, model.vae, student))
    return folder / MODEL


def model_folder(folder: Path) -> Path:
    """Returns the model folder in a run folder, or the folder itself."""
    return folder / MODEL if (folder / MODEL / CARD_FILE).is_file() else folder


def check_teacher(model: TrainedModel, dataset: Dataset) -> ModelCard:
    """Returns the card of a model that can teach.

    Raises:
        ModelError: It has no denoiser, no VAE, or was distilled itself.
        InputError: It makes other features than the data has.
    """
    card = model.card
    if model.denoiser is None or model.vae is None:
        raise ModelError(f"model {card.name!r} lacks a network; train both stages first")
    if card.leaps:
        raise ModelError(f"model {card.name!r} is distilled already; pass the model it is of")
    if card.representation != dataset.representation.name:
        raise InputError(
            f"{dataset.folder} has features {dataset.representation.name!r}, model {card.name!r} "
            f"makes {card.representation!r}; use the data that it was trained on"
        )
    return card


def prepare_ways(
    settings: Distillation,
    dataset: Dataset,
    model: TrainedModel,
    encoder: TextEncoder | None,
    folder: Path,
    place: Place,
) -> Ways:
    """Lets the teacher show its ways, or reads them from the run folder."""
    card, network, seed = model.card, model.denoiser, settings.training.seed
    assert network is not None  # checked before
    seen = prompted(card, dataset.clips("train", mirrored=settings.mirrored))
    unseen = prompted(card, dataset.clips("val"))[:HELD_OUT]
    plan = Plan(seen, AT_ONCE, settings.cropping, seed)
    shown = [plan(step) for step in range(max(settings.ways // AT_ONCE, 1))]
    held_out = keep_crops(unseen, settings.cropping, 1, seed).every()
    blocks = [block for block in (*shown, held_out) if block]
    crops = tuple(crop for block in blocks for crop in block)
    # Only a text encoder can be missing, and the command has looked for it.
    condition = build_condition(card, lambda: encoder)  # type: ignore[arg-type, return-value]
    prompts = PromptTable(condition, {crop.caption for crop in crops}, place.device)
    network.eval().requires_grad_(False).to(place.device)
    guide = Guide(network, card, settings.leaps, prompts, place.device)
    ways = remembered_trajectories(
        folder / "ways.safetensors",
        lambda: [guide.show(block, seed + number) for number, block in enumerate(blocks)],
        place,
    )
    return Ways(crops, ways, len(held_out), prompts)


def prompted(card: ModelCard, clips: Sequence[Clip]) -> list[Item]:
    """Returns items whose captions are what the model may be asked."""
    if card.task == "text":
        return [item for item in items_of(clips) if item.captions]
    if card.task == "unconditional":
        return [Item(clip, 0, clip.frames, ()) for clip in clips]
    known = labels_of(card)
    return [Item(c, 0, c.frames, (c.action,)) for c in clips if c.action and c.action in known]


def student_config(card: ModelCard, settings: Distillation) -> DenoiserConfig:
    """Returns the teacher's network, told of leaps, without dropout: there is but one answer."""
    config = read_networks(card).denoiser
    assert config is not None  # checked before
    transformer = replace(config.transformer, dropout=0.0, attention_dropout=0.0)
    return replace(config, transformer=transformer, leaps=settings.leaps)


def student_of(teacher: Denoiser, config: DenoiserConfig) -> Denoiser:
    """Returns a student that answers as its teacher does without guidance, whatever it is told."""
    student = config.build()
    student.load_state_dict({**student.state_dict(), **teacher.state_dict()})
    return student


def student_card(
    teacher: ModelCard,
    config: DenoiserConfig,
    settings: Distillation,
    dataset: Dataset,
    seconds: float,
    figures: dict[str, float],
) -> ModelCard:
    """Describes a finished student."""
    kept = {name: value for name, value in teacher.figures.items() if name.startswith("vae_")}
    rounded = {f"student_{name}": round(value, 4) for name, value in figures.items()}
    least, most = settings.leaps.guidance
    shortest, longest = settings.cropping.min_frames, settings.cropping.max_frames
    return replace(
        teacher,
        name=settings.name,
        denoiser=describe(config),
        steps=max(settings.leaps.steps),
        guidance=min(max(teacher.guidance, least), most),
        sampler="ddim",
        frames=(max(shortest, teacher.frames[0]), min(longest, teacher.frames[1])),
        provenance=provenance_of(dataset, seconds, teacher.provenance),
        figures={**kept, **rounded, "teacher": teacher.name},
    )
