"""Distillation: a student that samples in few steps is trained on a trained model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from latentmotion.data.dataset import Cropping, Dataset
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.diffusion.guidance import DistilledGuidance
from latentmotion.diffusion.parametrization import ParametrizedDenoiser
from latentmotion.diffusion.samplers import Sampler, sample
from latentmotion.engine.lengths import LengthFile
from latentmotion.errors import InputError, ModelError
from latentmotion.export.package import figures_of
from latentmotion.model.card import LENGTHS_FILE, ModelCard, file_beside, find_model, read_card
from latentmotion.model.config import DenoiserConfig, Sampling
from latentmotion.motion import Motion
from latentmotion.networks import checkpoint
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.vae.interface import mean_of_real
from latentmotion.pipeline import sampler_of
from latentmotion.storage.files import sha256
from latentmotion.training.denoiser_loss import step_loss
from latentmotion.training.distillation.data import (
    Distillation,
    DistillationData,
    prepare_distillation,
)
from latentmotion.training.distillation.trajectories import nothing
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.loop import Stage, train
from latentmotion.training.run_folder import MODEL, Previews, open_run, provenance_of


class DistillStage(Stage[DenoiserNetwork]):
    """The student, the steps that it learns, and held-out trajectories of its teacher.

    Args:
        student: The network to train.
        card: The card of the student.
        data: Sources of the steps and of the teacher's trajectories.
        previews: Makes motions, to look at samples.
    """

    def __init__(
        self, student: DenoiserNetwork, card: ModelCard, data: DistillationData, previews: Previews
    ) -> None:
        super().__init__()
        self.network = student
        self._card, self._previews = card, previews
        self._source, self._held_out = data.source(), data.comparison()
        self._prompts, self._device = data.teacher.prompts, data.context.device
        self._few_step, self._huber_delta = data.settings.few_step, data.settings.huber_delta

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        batch = self._source(step)
        schedule, parametrization = self._card.schedule, self._card.parametrization
        loss = step_loss(self.network, batch, schedule, parametrization, self._huber_delta)
        return {"total": loss}

    @torch.no_grad()
    def validate(self, network: DenoiserNetwork) -> dict[str, float]:
        """Distance of held-out ends from the teacher's, by steps: root mean square per number."""
        if self._held_out is None:
            return {}
        trajectories = self._held_out.trajectories.to(self._device)
        condition = self._prompts([crop.caption for crop in self._held_out.crops])
        figures = {}
        for steps in self._few_step.steps:
            student = self._student(network, trajectories.guidance, steps)
            noise = trajectories.points[:, 0]
            ends = sample(*student, noise, condition, trajectories.mask, steps, nothing)
            squares = (ends - trajectories.points[:, -1]) ** 2
            figures[f"rms_of_{steps}"] = float(mean_of_real(squares, trajectories.mask)) ** 0.5
        return figures

    @torch.no_grad()
    def sample(self, network: DenoiserNetwork) -> list[Motion]:
        """Motions for the prompts of a few held-out clips, in the most steps that it takes."""
        crops = self._held_out.crops if self._held_out else ()
        captions = [crop.caption for crop in crops][:4]
        if not captions:
            return []
        steps = max(self._few_step.steps)
        student = self._student(network, self._card.sampling.guidance, steps)
        return self._previews.sample(*student, steps, self._prompts(captions), captions)

    def _student(
        self, network: DenoiserNetwork, guidance: float | torch.Tensor, steps: int
    ) -> tuple[ParametrizedDenoiser, Sampler]:
        """Returns the student and its sampler for a number of steps."""
        guided = self._card.parametrized(DistilledGuidance(network, guidance, steps))
        return guided, sampler_of(self._card, Sampling(steps, sampler="ddim"))


def distill(
    settings: Distillation,
    data: Path,
    teacher: Path,
    encoder: TextEncoder | None,
    folder: Path,
    context: DistributedContext,
    start: Path | None = None,
    former: Path | None = None,
) -> Path:
    """Trains a few-step model, or resumes its training; returns its folder, with the same VAE.

    Args:
        settings: How.
        data: Prepared folder, whose captions the teacher is asked.
        teacher: Run folder or model folder.
        encoder: The teacher's, where it reads sentences.
        folder: Run folder to write.
        context: Device and rank.
        start: An earlier student of the teacher.
        former: A model whose answers to drawn prompts are learned in place of the teacher's, which
            keeps them; it may be an earlier student.

    Raises:
        DataError: The data cannot be used.
        ModelError: The teacher is missing or cannot teach, or `start` is no student of it.
        InputError: The run folder holds another run, or data and teacher do not fit.
    """
    dataset, source = Dataset.load(data), find_model(teacher)
    model = checkpoint.load_model(source)
    check_teacher(model, dataset)
    settings = replace(settings, cropping=within(settings.cropping, model.card))
    card = student_card(model.card, settings)
    torch.manual_seed(settings.training.seed)
    student = first_student(model, card, start)
    run = {"kind": "DistillRun", "data": dataset.fingerprint, "settings": settings}
    run |= {"text": encoder.name if encoder else None, "teacher": fingerprint(source)}
    run |= {"start": fingerprint(start), "former": fingerprint(former)}
    open_run(folder, run, context)
    path = file_beside(model.card, source, LENGTHS_FILE)
    lengths = path and LengthFile(path, model.card.condition.encoder)
    earlier = checkpoint.load_model(former) if former else None
    distillation_data = prepare_distillation(
        settings, dataset, model, encoder, folder, context, lengths, earlier
    )
    previews = Previews(model.vae, card, settings.cropping.max_frames // 2)
    stage = DistillStage(student, card, distillation_data, previews)
    student, seconds = train(stage, settings.training, folder, context)
    if context.is_main:
        before = read_card(start) if start else model.card
        provenance = provenance_of(dataset, seconds, before.provenance)
        of_vae = figures_of(model.card, ("vae_",))
        figures = {f"student_{k}": round(v, 4) for k, v in stage.validate(student).items()}
        figures |= {**of_vae, "teacher": model.card.name}
        card = replace(card, provenance=provenance, figures=figures)
        checkpoint.save_model(folder / MODEL, checkpoint.LatentModel(card, model.vae, student))
    return folder / MODEL


def fingerprint(folder: Path | None) -> str | None:
    """Returns the hash of a model's weights; None for none."""
    return sha256(folder / checkpoint.WEIGHTS_FILE) if folder else None


def check_teacher(model: checkpoint.LatentModel, dataset: Dataset) -> None:
    """Checks that a model can teach.

    Raises:
        ModelError: It was distilled itself.
        InputError: It makes other features than the data has.
    """
    card = model.card
    if card.few_step:
        raise ModelError(f"model {card.name!r} is distilled already; pass the model it is of")
    if card.representation != dataset.representation.name:
        raise InputError(
            f"{dataset.folder} has features {dataset.representation.name!r}, model {card.name!r} "
            f"makes {card.representation!r}; use the data that it was trained on"
        )


def within(cropping: Cropping, card: ModelCard) -> Cropping:
    """Returns the cropping without lengths that a model does not make.

    Raises:
        InputError: None is left.
    """
    (least, most), limits = card.frames, (cropping.min_frames, cropping.max_frames)
    shortest, longest = max(limits[0], least), min(limits[1], most)
    if shortest > longest:
        raise InputError(
            f"model {card.name!r} makes {least} to {most} frames, cropping asks for "
            f"{limits[0]} to {limits[1]}; change cropping.min_frames or cropping.max_frames"
        )
    return replace(cropping, min_frames=shortest, max_frames=longest)


def student_card(teacher: ModelCard, settings: Distillation) -> ModelCard:
    """Describes a student: the teacher's network with a step embedding and without dropout."""
    config = teacher.trained_denoiser
    transformer = replace(config.transformer, dropout=0.0, attention_dropout=0.0)
    config = replace(config, transformer=transformer, few_step=settings.few_step)
    least, most = settings.few_step.guidance
    return replace(
        teacher,
        name=settings.name,
        denoiser=config,
        sampling=Sampling(
            steps=max(settings.few_step.steps),
            guidance=min(max(teacher.sampling.guidance, least), most),
        ),
        frames=(settings.cropping.min_frames, settings.cropping.max_frames),
    )


def first_student(
    teacher: checkpoint.LatentModel, card: ModelCard, start: Path | None
) -> DenoiserNetwork:
    """Returns what training begins with: the teacher's weights, or those of an earlier student.

    Raises:
        ModelError: `start` is not distilled, or answers or is shaped otherwise.
    """
    config = card.trained_denoiser
    if start is None:
        return student_of(teacher.denoiser, config)
    model = checkpoint.load_model(start)
    if model.card.few_step is None:
        raise ModelError(f"{start} is not distilled; pass a student of the same teacher")
    for name in ("parametrization", "schedule", "latents"):
        actual, expected = getattr(model.card, name), getattr(card, name)
        if actual != expected:
            raise ModelError(f"{start}: {name} {actual}, expected {expected}: of another teacher")
    student = checkpoint.build(config)
    checkpoint.load_weights(student, model.denoiser.state_dict(), str(start))
    return student


def student_of(teacher: DenoiserNetwork, config: DenoiserConfig) -> DenoiserNetwork:
    """Returns a student whose output is its teacher's without guidance at any step condition."""
    student = checkpoint.build(config)
    student.load_state_dict({**student.state_dict(), **teacher.state_dict()})
    return student
