"""The workspace of the tables: each stage is trained once for all rows; the cost of VAEs.

    FOLDER/MODEL/vae       first stage, a run folder of `latentmotion train vae`
    FOLDER/MODEL/denoiser  second stage, a run folder of `latentmotion train denoiser`
    VAES/MODEL/vae         first stage that was trained already, in another folder

A finished stage is used as it is if it was trained with the same data and settings; an interrupted
one resumes.

Times are CPU time, which other work on the machine affects less than wall-clock time.

Cost of training: floating-point operations and crops of both stages of a row.

FLOPs are those of one step, forward and backward, times the steps. Every crop counts as the longest
one; the loss, the optimizer and the latents that stage 2 reads are left out.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Literal

import torch
from safetensors.torch import load_file

from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TASKS, Conditioning, TextEncoder
from latentmotion.errors import InputError
from latentmotion.evaluation.cost import flops, parameters
from latentmotion.evaluation.report import Figure
from latentmotion.model.card import CARD_FILE, find_model
from latentmotion.networks.checkpoint import build, load_model, load_weights, save_model
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.reproduce.budget import FIRST_STAGE, MODELS, Budget, Model
from latentmotion.storage.configuration import to_json
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment, differing_keys
from latentmotion.training.loop import kept_weights, read_progress
from latentmotion.training.run_folder import MODEL, read_run
from latentmotion.training.stages import train_denoiser, train_vae
from latentmotion.training.task_conditions import task_conditioning, with_condition_width

# Parts of an experiment that determine the second stage.
SECOND_STAGE = (
    *FIRST_STAGE,
    "task",
    "latents",
    "denoiser",
    "denoiser_objective",
    "denoiser_training",
    "conditioning",
)

EQUALS = "z0"  # Model whose training others have as much of: MLD-1 of z₀.


@dataclass(frozen=True)
class Workspace:
    """Data set, sizes and folder that all rows of a run share."""

    dataset: Dataset  # Data set for training and measuring.
    folder: Path  # Folder of runs and results.
    budget: Budget  # Sizes.
    context: DistributedContext  # Device and rank.
    encoders: Callable[[str], TextEncoder]  # Text encoder by name.
    encoder: str = "starter"  # Text encoder of models that name none.
    models: Mapping[str, Model] = field(default_factory=lambda: MODELS)  # Models by name.
    # Folder of trained VAEs, which are taken as they are; by default they are trained here.
    vaes: Path | None = None
    # SMPL model file of the loss on vertices; without it action models compare joints instead.
    body: Path | None = None
    tell: Callable[[str], None] = print  # Receives lines of progress.

    def encoder_of(self, model: Model) -> TextEncoder | None:
        """Returns the text encoder of a model; None if its task reads no text."""
        if not TASKS[model.task].reads_text:
            return None
        return self.encoders(model.encoder or self.encoder)

    def first_stage(self, name: str) -> Path:
        """Trains the VAE of a model if there is none yet; returns its model folder.

        Raises:
            InputError: The folder holds another run, or that of trained VAEs has none of this name.
        """
        experiment = self._first_stage(name)
        if self.vaes:
            return self.vaes / name / "vae" / MODEL
        folder = self.folder / name / "vae"
        if not self._is_trained(folder, experiment, FIRST_STAGE):
            self.tell(f"{folder}: training a VAE, {experiment.vae_training.steps} steps")
            body = self.body if experiment.vae_objective.vertices else None
            train_vae(experiment, self.dataset.folder, folder, self.context, body)
        return folder / MODEL

    def both_stages(self, name: str) -> Path:
        """Trains the missing stages of a model; returns its model folder.

        Raises:
            InputError: A folder holds another run.
        """
        model = self.models[name]
        if model.shipped:
            return find_model(model.shipped)
        vae = None if model.raw else self.first_stage(model.first or name)
        encoder, width = self.encoder_of(model), self.dataset.representation.width
        experiment = model.second_stage(
            self._first_stage(model.first or name),
            self.budget,
            width,
            encoder.width if encoder else None,
        )
        if model.equal:  # as much training as both stages of MLD-1 of z₀
            reference = self.models[EQUALS]
            reader = self.encoder_of(reference)
            assert reader is not None
            reference_vae = self.first_stage(reference.first).parent
            planned = reference.second_stage(
                self._first_stage(reference.first), self.budget, width, reader.width
            )
            steps = equal_steps(model.equal, reference_vae, planned, experiment)
            training = replace(experiment.denoiser_training, steps=steps)
            experiment = replace(experiment, denoiser_training=training)
        conditioning = task_conditioning(experiment, self.dataset, encoder)
        experiment = with_condition_width(experiment, conditioning)
        folder = self.folder / name / "denoiser"
        if not self._is_trained(folder, experiment, SECOND_STAGE):
            self.tell(f"{folder}: training a denoiser, {experiment.denoiser_training.steps} steps")
            train_denoiser(experiment, self.dataset.folder, vae, encoder, folder, self.context)
        return folder / MODEL

    def kept(self, name: str, share: float) -> Path:
        """Returns the model folder of a denoiser after a share of its training.

        Raises:
            InputError: A folder holds another run, or no weights of that time were kept.
        """
        model, percent = self.both_stages(name), round(100 * share)
        weights, folder = kept_weights(model.parent, percent), model.parent / f"model_{percent}"
        if not weights.is_file():
            raise InputError(
                f"{weights} is missing; remove {model.parent} to train it again, with "
                "denoiser_training.keep=5"
            )
        if not (folder / CARD_FILE).is_file():
            trained = load_model(model)
            load_weights(trained.denoiser, load_file(weights), str(weights))
            save_model(folder, trained)
        return folder

    def run_folders(self, name: str) -> tuple[Path | None, Path]:
        """Returns the run folders of a model's stages; no first one if it diffuses raw frames."""
        model = self.models[name]
        vae = None if model.raw else (self.vaes or self.folder) / (model.first or name) / "vae"
        return vae, self.folder / name / "denoiser"

    def _first_stage(self, name: str) -> Experiment:
        model = self.models[name]
        if self.vaes is None or model.raw:
            experiment = model.first_stage(self.budget, self.dataset.representation.width)
            if experiment.vae_objective.vertices and self.body is None:
                objective = replace(experiment.vae_objective, vertices=0.0, joints=1.0)
                return replace(experiment, vae_objective=objective)
            return experiment
        folder = self.vaes / name / "vae"
        if not (folder / MODEL / CARD_FILE).is_file():
            raise InputError(
                f"{folder} holds no trained VAE; train it by latentmotion experiment run vae "
                f"--rows {name} -o {self.vaes}, or leave out --vaes"
            )
        run = read_run(folder)
        if run.data != self.dataset.fingerprint:
            raise InputError(
                f"{folder} was trained on other data than {self.dataset.folder}; leave out --vaes"
            )
        return run.experiment

    def _is_trained(self, folder: Path, wanted: Experiment, parts: Sequence[str]) -> bool:
        if not (folder / MODEL / CARD_FILE).is_file():
            return False
        run = read_run(folder)
        differing = [] if run.data == self.dataset.fingerprint else ["data"]
        for part in parts:
            # Through text, as the run folder's settings went: tuples become lists.
            trained, planned = (
                json.loads(json.dumps(to_json(getattr(experiment, part))))
                for experiment in (run.experiment, wanted)
            )
            differing += differing_keys(trained, planned, part)
        if differing:
            raise InputError(
                f"{folder} holds a run with other settings: {', '.join(differing)}; remove it, or "
                "use another output folder"
            )
        return True


SECONDS = 4  # Length of the motion that is decoded.

BATCH, FRAMES = 32, 64  # Motions of the training step, and their length.

TIMED = 10  # Repetitions of each measurement; the first half warms up.


def vae_cost(vae: MotionVAE, features: int, fps: float) -> dict[str, Figure]:
    """Measures a VAE on PyTorch, on the CPU, in float32.

    Args:
        vae: The network.
        features: Numbers per frame.
        fps: Frames per second of its motions.
    """
    mask = torch.ones(1, round(SECONDS * fps), dtype=torch.bool)
    tokens = int(vae.latent_mask(mask).sum())
    latents = torch.zeros(1, tokens, vae.latent_width)
    batch = torch.zeros(BATCH, FRAMES, features)

    def train() -> None:
        """Forward and backward, without the optimizer."""
        real = torch.ones(batch.shape[:2], dtype=torch.bool)
        vae.decode(vae.encode(batch, real).mean, real).square().mean().backward()
        vae.zero_grad()

    return {
        "Parameters": Figure(parameters(vae) / 1e6),
        "Latent numbers": Figure(tokens * vae.latent_width),
        "Training step": Figure(_seconds(train)),
        "Decoding": Figure(1000 * _seconds(torch.no_grad()(lambda: vae.decode(latents, mask)))),
    }


def _seconds(action: Callable[[], object]) -> float:
    """Returns the median CPU time."""
    times = []
    for _ in range(TIMED):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return median(times[TIMED // 2 :])


Quantity = Literal["FLOPs", "crops"]  # What training is counted in.

# An experiment to the crops of a stage's step, its planned steps, and a step's forward and
# backward.
Step = Callable[[Experiment], tuple[int, int, Callable[[], object]]]


def training_cost(vae: Path | None, denoiser: Path) -> dict[str, Figure]:
    """Returns the FLOPs of training, 10¹², and the crops that were seen, 10³.

    Args:
        vae: Run folder of the first stage; None for diffusion on raw frames.
        denoiser: Run folder of the second stage.

    Raises:
        InputError: A folder holds no run.
    """
    stages = [_run_cost(denoiser, denoiser_step)] + ([_run_cost(vae, vae_step)] if vae else [])
    total = {quantity: sum(cost[quantity] for cost in stages) for quantity in stages[0]}
    return {"Training": Figure(total["FLOPs"] / 1e12), "Crops": Figure(total["crops"] / 1e3)}


def equal_steps(quantity: Quantity, vae: Path, planned: Experiment, other: Experiment) -> int:
    """Returns the steps in which a denoiser has as much training as both stages of a model.

    Args:
        quantity: What is to be equal.
        vae: Run folder of the model's first stage.
        planned: Second stage of the model.
        other: The denoiser to train.

    Raises:
        InputError: The folder holds no run.
    """
    total = _run_cost(vae, vae_step)[quantity] + _cost(planned, denoiser_step)[quantity]
    return round(total / _cost(other, denoiser_step, steps=1)[quantity])


def _run_cost(folder: Path, step: Step) -> dict[Quantity, int]:
    return _cost(read_run(folder).experiment, step, read_progress(folder).step)


def _cost(experiment: Experiment, step: Step, steps: int = 0) -> dict[Quantity, int]:
    """Returns the cost of so many steps, by default of those that are planned."""
    size, planned, action = step(experiment)
    return {"FLOPs": (steps or planned) * flops(action), "crops": (steps or planned) * size}


def vae_step(experiment: Experiment) -> tuple[int, int, Callable[[], object]]:
    """Returns the crops of a step of stage 1, its steps, and a step's forward and backward."""
    vae, training = build(experiment.vae), experiment.vae_training
    size, steps = training.batch_size, training.steps
    features = torch.zeros(size, experiment.vae_cropping.max_frames, experiment.vae.features)
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    return size, steps, lambda: vae.decode(vae.encode(features, mask).mean, mask).sum().backward()


def denoiser_step(experiment: Experiment) -> tuple[int, int, Callable[[], object]]:
    """Returns the crops of a step of stage 2, its steps, and a step's forward and backward."""
    denoiser, training = build(experiment.denoiser), experiment.denoiser_training
    size, steps = training.batch_size, training.steps
    frames = torch.ones(size, experiment.latents.cropping.max_frames, dtype=torch.bool)
    mask = build(experiment.vae).latent_mask(frames)
    latents = torch.zeros(*mask.shape, experiment.denoiser.latent_width)
    tokens = max(1, experiment.conditioning.pooled + experiment.conditioning.words)
    words = torch.zeros(size, tokens, experiment.denoiser.condition_width)
    condition = Conditioning(words, torch.ones(words.shape[:2], dtype=torch.bool))
    return (
        size,
        steps,
        lambda: denoiser(latents, torch.ones(size), condition, mask).sum().backward(),
    )
