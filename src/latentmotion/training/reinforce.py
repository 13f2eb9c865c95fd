"""A model trained on by its own motions: towards those that obey their prompt, away from others.

DiffusionNFT (Zheng et al. 2025, "Online diffusion reinforcement with forward process", eq. 5): with
v the target for a take, v_old the answer of the model that made it and v_new that in training,

    loss = w |(1 - b) v_old + b v_new - v|² + (1 - w) |(1 + b) v_old - b v_new - v|²

where w is 1 for takes to learn and 0 for takes to avoid. Ordinary training on data goes on beside
it, so that motions stay those of people. One run is one round; the next starts from its model.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from latentmotion.data.dataset import Dataset
from latentmotion.data.instructions import Instruction
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.diffusion.parametrization import add_noise
from latentmotion.engine.lengths import LengthFile, LengthModel
from latentmotion.networks.checkpoint import WEIGHTS_FILE, LatentModel, load_model, save_model
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.storage.files import sha256
from latentmotion.training.denoiser import DenoiserStage, LatentData
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.drawn_instructions import drawn_instructions
from latentmotion.training.experiment import Experiment, TrainingSettings, optimization
from latentmotion.training.loop import train
from latentmotion.training.run_folder import MODEL, Previews, open_run, second_stage_card
from latentmotion.training.stages import FirstStage, check_fit, prepare_latents
from latentmotion.training.takes import Takes, TakeSettings, cached_takes
from latentmotion.training.task_conditions import ConditionTable, task_conditioning


@dataclass(frozen=True)
class Reinforcement:
    """Settings of one round."""

    takes: TakeSettings = field(default_factory=TakeSettings)  # Which motions are made and judged.
    weight: float = 2.0  # Weight of the takes' loss beside that of the data.
    # b, how far the model in training stands for the step away from the old one.
    strength: float = 1.0
    # Optimization of the denoiser.
    training: TrainingSettings = field(default_factory=partial(optimization, "reinforce"))


class ReinforceStage(DenoiserStage):
    """The denoiser, data, and takes of the denoiser as it was.

    Args:
        denoiser: The network to train.
        data: Latents and prompts of the data.
        previews: Generates sample motions during training.
        experiment: Settings of the loss.
        context: The device and rank.
        takes: Judged motions of `denoiser` as it is now.
        asked: What they were asked.
        prompts: What the denoiser sees of that.
        settings: How they are weighed.
    """

    def __init__(
        self,
        denoiser: DenoiserNetwork,
        data: LatentData,
        previews: Previews,
        experiment: Experiment,
        context: DistributedContext,
        takes: Takes,
        instructions: list[Instruction],
        prompts: ConditionTable,
        settings: Reinforcement,
    ) -> None:
        super().__init__(denoiser, data, previews, experiment, context)
        self.old = copy.deepcopy(denoiser).eval().requires_grad_(False)
        self._takes, self._asked, self._asked_prompts = takes, instructions, prompts
        self._learned, self._settings = takes.weights(settings.takes.feet), settings

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        of_data, takes = super().forward(step)["total"], self._takes
        objective, training = self._experiment.denoiser_objective, self._settings.training
        # Takes of similar length, each once an epoch.
        size = self._settings.training.batch_size
        order = torch.argsort(takes.mask.sum(dim=1), stable=True)
        count = max(len(order) // size, 1)
        epoch, index = divmod(step, count)
        generator = np.random.default_rng([self._settings.training.seed, epoch])
        offset = int(generator.integers(len(order) - size * count + 1))
        block = int(generator.permutation(count)[index])
        rows = order[offset + block * size : offset + (block + 1) * size]
        ranks, device = self._context.ranks, self._context.device
        chance = StepRandomness(training.seed + 1, step, len(rows), ranks, device)
        shard = rows[ranks.shard(len(rows))]
        longest = int(takes.mask[rows].sum(dim=1).max())
        z0, mask = (x[shard, :longest].to(device) for x in (takes.latents, takes.mask))
        learned = self._learned[shard].to(device)
        epsilon, t = chance.normal(*z0.shape[1:]), objective.time(chance.normal())
        condition = self._asked_prompts(
            [self._asked[n].prompt for n in takes.prompt[shard].tolist()]
        )
        z = add_noise(z0, epsilon, t, objective.schedule)
        target = objective.parametrization.target(z0, epsilon, t, objective.schedule)
        with torch.no_grad():
            old = self.old(z, t, condition, mask).float()
        ahead = self._settings.strength * (self.network(z, t, condition, mask).float() - old)
        share = mask / mask.sum(dim=1, keepdim=True)
        towards, away = (
            ((old + sign * ahead - target).square().mean(dim=2) * share).sum(dim=1)
            for sign in (1, -1)
        )
        of_takes = (learned * towards + (1 - learned) * away).mean()
        total = of_data + self._settings.weight * of_takes
        return {"total": total, "data": of_data, "takes": of_takes}


def reinforce(
    settings: Reinforcement,
    experiment: Experiment,
    data: Path,
    source: Path,
    encoder: TextEncoder,
    lengths: LengthFile | LengthModel,
    folder: Path,
    context: DistributedContext,
) -> Path:
    """Trains one round, or resumes it; returns the model folder.

    Args:
        settings: Takes and training.
        experiment: Objective, cropping and latents of the ordinary training beside it.
        data: Prepared folder.
        source: Model folder to start from, whose motions are judged.
        encoder: Its text encoder.
        lengths: Usual lengths of prompts.
        folder: Run folder to write.
        context: Device and rank.

    Raises:
        DataError: The data cannot be used.
        ModelError: There is no model, or no lengths.
        InputError: The run folder holds another run, or data, model and encoder do not fit.
    """
    dataset, model = Dataset.load(data), load_model(source)
    experiment = replace(  # with the model's own networks and sampling
        experiment,
        vae=model.card.vae,
        denoiser=model.card.trained_denoiser,
        denoiser_training=settings.training,
        sampling=model.card.sampling,
    )
    first = FirstStage(model.vae.requires_grad_(False), model.card, sha256(source / WEIGHTS_FILE))
    conditioning = task_conditioning(experiment, dataset, encoder)
    check_fit(experiment, dataset, first, conditioning)
    parents = {"model": first.fingerprint, **conditioning.task.parents}
    run = {"kind": "ReinforceRun", "data": dataset.fingerprint, "parents": parents}
    open_run(folder, {**run, "settings": settings}, context)
    instructions = drawn_instructions(settings.takes.prompts, settings.takes.seed)
    sentences = [instruction.prompt for instruction in instructions]
    prompts = ConditionTable(conditioning.condition, sentences, context.device)
    usual = lengths.usual(encoder(sentences).pooled)
    takes = cached_takes(settings.takes, instructions, usual, model, prompts, folder, context)
    latents = model.card.latents
    second_stage, space = prepare_latents(
        experiment, dataset, first, conditioning, folder, context, latents
    )
    card = replace(model.card, latents=space)
    torch.manual_seed(settings.training.seed)
    previews = Previews(model.vae, card, experiment.latents.cropping.max_frames // 2)
    stage = ReinforceStage(
        model.denoiser.requires_grad_(True), second_stage, previews, experiment, context,
        takes, instructions, prompts, settings,
    )  # fmt: skip
    denoiser, seconds = train(stage, settings.training, folder, context)
    if context.is_main:
        figures = stage.validate(denoiser) | {"takes_obey": float(takes.obeys.float().mean())}
        trained_card = second_stage_card(experiment, dataset, card, conditioning, seconds, figures)
        save_model(folder / MODEL, LatentModel(trained_card, model.vae.cpu(), denoiser))
    return folder / MODEL
