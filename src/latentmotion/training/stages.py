"""The two stages of the paper, each a function: data, network, loop, model folder.

Stage 2 builds on a trained VAE, and on the latents that it makes of the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
from safetensors.torch import load_file

from latentmotion.data.dataset import Dataset, Item
from latentmotion.diffusion.condition import SentenceCondition, TextEncoder, TextTask
from latentmotion.engine.backend import normalizer_of
from latentmotion.errors import InputError, ModelError
from latentmotion.kinematics.smpl import SmplModel, load_smpl
from latentmotion.model.card import CARD_FILE, ModelCard, Provenance, read_card
from latentmotion.model.config import IdentityVAEConfig, LatentSpace
from latentmotion.networks import checkpoint
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.storage.files import sha256
from latentmotion.training import denoiser as second_stage
from latentmotion.training import run_folder, task_conditions
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment
from latentmotion.training.loop import train
from latentmotion.training.run_folder import MODEL, Previews, Run, open_run
from latentmotion.training.task_conditions import TaskConditioning, task_conditioning
from latentmotion.training.vae import BatchSampler, FeatureCache, VAEStage

HELD_OUT = 128  # Most held-out crops that a validation looks at.

# Largest distance of a VAE's weights from those that its training started from, as a share of their
# norm; those of unrelated ones are 1.4 apart.
RELATED = 0.9


def train_vae(
    experiment: Experiment,
    data: Path,
    folder: Path,
    context: DistributedContext,
    body: Path | None = None,
    start: Path | None = None,
) -> Path:
    """Trains stage 1, or resumes it; returns the model folder.

    Args:
        experiment: Sizes, losses and training settings.
        data: Prepared folder.
        folder: Run folder to write.
        context: Device and rank.
        body: SMPL model file, which an objective on vertices needs.
        start: Model folder whose VAE the first step starts from; the experiment's may have more
            latent channels.

    Raises:
        DataError: The data cannot be used.
        FileFormatError: The body's file cannot be used.
        InputError: The run folder holds another run, or features, network, body and start do not
            fit.
        ModelError: There is no model to start from.
    """
    dataset, training = Dataset.load(data), experiment.vae_training
    check_first_stage(experiment, dataset)
    smpl = check_body(experiment, dataset, body)
    parents = {"body": smpl.fingerprint} if smpl else {}
    if start:
        parents["start"] = sha256(start / checkpoint.WEIGHTS_FILE)
    open_run(folder, Run("vae", dataset.fingerprint, parents, experiment), context)
    torch.manual_seed(training.seed)
    network = checkpoint.build(experiment.vae)
    if start:
        before = checkpoint.load_stages(start).vae
        checkpoint.start_from(network, before, network.latent_width, before.latent_width)
    stage = VAEStage(network, dataset, experiment, context, smpl.body if smpl else None)
    return train_first_stage(stage, experiment, dataset, folder, context)


def train_first_stage(
    stage: VAEStage,
    experiment: Experiment,
    dataset: Dataset,
    folder: Path,
    context: DistributedContext,
) -> Path:
    """Trains a VAE in an open run folder, or resumes it; returns the model folder."""
    vae, seconds = train(stage, experiment.vae_training, folder, context)
    if context.is_main:
        card = run_folder.first_stage_card(experiment, dataset, seconds, stage.validate(vae))
        checkpoint.save_model(folder / MODEL, checkpoint.FirstStageModel(card, vae))
    return folder / MODEL


def train_denoiser(
    experiment: Experiment,
    data: Path,
    vae: Path | None,
    encoder: TextEncoder | None,
    folder: Path,
    context: DistributedContext,
    start: Path | None = None,
) -> Path:
    """Trains stage 2, or resumes it; returns the model folder, which holds both stages.

    Args:
        experiment: Sizes, losses and training settings.
        data: Prepared folder.
        vae: Run or model folder of stage 1; without it the diffusion is on raw frames.
        encoder: Text encoder, where the task is text.
        folder: Run folder to write.
        context: Device and rank.
        start: Model folder whose denoiser the first step starts from; `vae` must be its VAE, or
            one that was trained on from it, maybe with more latent channels.

    Raises:
        DataError: The data cannot be used.
        ModelError: There is no trained VAE, or no model to start from.
        InputError: The run folder holds another run, or data, VAE, encoder, network and start do
            not fit.
    """
    dataset = Dataset.load(data)
    first = load_first_stage(vae) if vae else frames_as_first_stage(experiment, dataset)
    conditioning = task_conditioning(experiment, dataset, encoder)
    experiment = task_conditions.with_condition_width(experiment, conditioning)
    denoiser = replace(experiment.denoiser, latent_width=first.vae.latent_width)
    if not denoiser.project_latents:
        transformer = replace(denoiser.transformer, width=first.vae.latent_width)
        denoiser = replace(denoiser, transformer=transformer)
    experiment, training = replace(experiment, denoiser=denoiser), experiment.denoiser_training
    check_fit(experiment, dataset, first, conditioning)
    parents = {"vae": first.fingerprint, **conditioning.task.parents}
    before = load_start(start, experiment, first) if start else None
    if start:
        parents["start"] = sha256(start / checkpoint.WEIGHTS_FILE)
    open_run(folder, Run("denoiser", dataset.fingerprint, parents, experiment), context)
    scale = before.card.latents if before and same_vae(before, first) else None
    latents, space = prepare_latents(
        experiment, dataset, first, conditioning, folder, context, scale
    )
    card = replace(first.card, latents=space)
    torch.manual_seed(training.seed)
    previews = Previews(first.vae, card, experiment.latents.cropping.max_frames // 2)
    network = checkpoint.build(experiment.denoiser)
    network.measure_words(latents.prompts.words.cpu())
    if before:
        widths = experiment.denoiser.latent_width, before.card.trained_denoiser.latent_width
        checkpoint.start_from(network, before.denoiser, *widths)
    stage = second_stage.DenoiserStage(network, latents, previews, experiment, context)
    denoiser, seconds = train(stage, training, folder, context)
    if context.is_main:
        figures = stage.validate(denoiser)
        card = run_folder.second_stage_card(
            experiment, dataset, card, conditioning, seconds, figures
        )
        checkpoint.save_model(
            folder / MODEL, checkpoint.LatentModel(card, first.vae.cpu(), denoiser)
        )
    return folder / MODEL


def with_networks_of(start: Path, experiment: Experiment, vae: Path | None = None) -> Experiment:
    """Returns an experiment with the networks of a model that training starts from.

    Args:
        start: Model folder.
        experiment: Everything else.
        vae: Model folder of the VAE of the second stage, which may have more latent channels.

    Raises:
        ModelError: The model is distilled, so it learns only from its teacher.
    """
    card = read_card(start)
    if card.few_step:
        raise ModelError(
            f"--start {start}: {card.name!r} is distilled to few steps; start from its teacher "
            f"({card.figures.get('teacher', 'starter')}) and distill again (latentmotion finetune "
            "does both)"
        )
    experiment = replace(experiment, vae=card.vae)
    if card.denoiser is None:
        return experiment
    objective = experiment.denoiser_objective
    schedule, parametrization = card.schedule, card.parametrization
    width = read_card(vae).latents.width if vae else card.latents.width
    return replace(
        experiment,
        denoiser=replace(card.denoiser, latent_width=width),
        denoiser_objective=replace(objective, schedule=schedule, parametrization=parametrization),
        conditioning=(
            card.condition.conditioning
            if isinstance(card.condition, TextTask)
            else experiment.conditioning
        ),
    )


def load_start(folder: Path, experiment: Experiment, first: FirstStage) -> checkpoint.LatentModel:
    """Loads the model whose denoiser training starts from.

    Raises:
        InputError: It has another denoiser or another VAE.
        ModelError: There is none in the folder.
    """
    before = checkpoint.load_model(folder)
    width = experiment.denoiser.latent_width
    if replace(before.card.trained_denoiser, latent_width=width) != experiment.denoiser:
        raise InputError(
            f"--start {folder}: its denoiser is not that of experiment {experiment.name!r}; use "
            "the preset that it was trained with"
        )
    if not same_vae(before, first, tolerance=RELATED):
        raise InputError(
            f"--start {folder}: --vae is neither its VAE nor one that was trained on from it"
        )
    return before


def same_vae(before: checkpoint.LatentModel, first: FirstStage, tolerance: float = 1e-2) -> bool:
    """Returns whether two VAEs are the same but for rounding, or for more latent channels.

    Args:
        before: A model.
        first: Another VAE.
        tolerance: Largest distance of their weights, as a share of the weights' norm.
    """
    weights, others = (model.state_dict() for model in (before.vae, first.vae))
    if weights.keys() != others.keys():
        return False
    alike = [name for name in weights if weights[name].shape == others[name].shape]
    vector, other = (torch.cat([w[name].flatten() for name in alike]) for w in (weights, others))
    wide = tolerance >= RELATED or len(alike) == len(weights)
    return wide and bool((vector - other).norm() <= tolerance * vector.norm())


def check_first_stage(experiment: Experiment, dataset: Dataset) -> None:
    """Compares experiment and data.

    Raises:
        InputError: There is no VAE to train, it is made for features of another width, or it
            cannot learn from motions so long, or so few at once.
    """
    if not experiment.vae.has_weights:
        raise InputError(
            f"experiment {experiment.name!r} has no VAE, its diffusion is on raw frames; "
            "run latentmotion train denoiser --vae none"
        )
    width, expected = dataset.representation.width, experiment.vae.features
    if width != expected:
        raise InputError(
            f"{dataset.folder} has {width} features a frame ({dataset.representation.name}), the "
            f"experiment's VAE takes {expected}; use --set vae.features={width}"
        )
    croppings = experiment.vae_cropping, experiment.latents.cropping
    longest = max(cropping.max_frames for cropping in croppings)
    experiment.vae.check_training(longest, experiment.vae_training.batch_size)


def check_body(experiment: Experiment, dataset: Dataset, body: Path | None) -> SmplModel | None:
    """Returns the body where the objective compares vertices.

    Raises:
        FileFormatError: Its file cannot be used.
        InputError: It is missing, of no use, or the features are no poses.
    """
    compares = experiment.vae_objective.vertices > 0
    if compares and dataset.representation.name != "smpl":
        raise InputError(
            f"vae_objective.vertices needs SMPL's poses, {dataset.folder} has features "
            f"{dataset.representation.name!r}; use --set vae_objective.vertices=0"
        )
    if compares and body is None:
        raise InputError(
            "vae_objective.vertices needs a SMPL model file, which does not come with this "
            "package: --body SMPL_NEUTRAL.npz (from https://smpl.is.tue.mpg.de), or go without: "
            "--set vae_objective.vertices=0 --set vae_objective.joints=1"
        )
    if body is not None and not compares:
        raise InputError("--body is of no use: vae_objective.vertices is 0; set it to 1")
    return load_smpl(body) if body is not None else None


@dataclass(frozen=True)
class FirstStage:
    """A trained VAE."""

    vae: MotionVAE  # The network, frozen.
    card: ModelCard  # Its description.
    fingerprint: str  # Hash of its weights.


def load_first_stage(folder: Path) -> FirstStage:
    """Loads the VAE that `latentmotion train vae` made, from its run folder or model folder.

    Raises:
        ModelError: There is none, or it is not trained to the end.
    """
    model = folder / MODEL if (folder / MODEL / CARD_FILE).is_file() else folder
    if not (model / CARD_FILE).is_file():
        state = (
            "a run that has not ended"
            if (folder / run_folder.EXPERIMENT_FILE).is_file()
            else "no trained model"
        )
        raise ModelError(
            f"{folder} holds {state}; stage 2 needs a trained VAE: run latentmotion train vae "
            "to its end and pass its run folder"
        )
    trained = checkpoint.load_stages(model)
    vae = trained.vae.eval().requires_grad_(False)
    return FirstStage(vae, trained.card, sha256(model / checkpoint.WEIGHTS_FILE))


def frames_as_first_stage(experiment: Experiment, dataset: Dataset) -> FirstStage:
    """Returns the first stage of a diffusion on raw frames: a VAE that changes nothing.

    Raises:
        InputError: The frames should be normalized as latents, but are already as features.
    """
    if experiment.latents.normalized:
        raise InputError(
            "the frames are normalized as features, by the data set's statistics; without a VAE "
            "use --set latents.normalized=false"
        )
    config = IdentityVAEConfig(dataset.representation.width)
    card = run_folder.first_stage_card(replace(experiment, vae=config), dataset, 0.0, {})
    return FirstStage(checkpoint.build(config), replace(card, provenance=Provenance()), "none")


def check_fit(
    experiment: Experiment, dataset: Dataset, first: FirstStage, conditioning: TaskConditioning
) -> None:
    """Compares the parts of stage 2.

    Raises:
        InputError: Two of them do not fit.
    """
    pairs = {
        "representation of data and VAE": (dataset.representation.name, first.card.representation),
        "denoiser.latent_width and the VAE's": (
            experiment.denoiser.latent_width,
            first.vae.latent_width,
        ),
        "denoiser.condition_width and the text encoder's": (
            experiment.denoiser.condition_width,
            conditioning.width,
        ),
    }
    for name, (first_value, other) in pairs.items():
        if first_value != other:
            raise InputError(
                f"{name}: {first_value} and {other}, expected the same; change one of them"
            )


def prepare_latents(
    experiment: Experiment,
    dataset: Dataset,
    first: FirstStage,
    conditioning: TaskConditioning,
    folder: Path,
    context: DistributedContext,
    space: LatentSpace | None = None,
) -> tuple[second_stage.LatentData, LatentSpace]:
    """Encodes crops and prompts, or reads them from the run folder.

    Latents are scaled as `space` says; by default those of the seen crops are measured.
    """
    settings, training = experiment.latents, experiment.denoiser_training
    clips = dataset.clips("train", mirrored=experiment.mirrored), dataset.clips("val")
    items, held_out = (task_conditions.items_to_learn(conditioning.task, part) for part in clips)
    if isinstance(conditioning.condition, SentenceCondition):
        encoder = conditioning.condition.encoder
        items = experiment.draws.weigh(items, lambda texts: encoder(texts).pooled)
    held_out = held_out[:HELD_OUT]
    unseen = second_stage.keep_crops(held_out, settings.cropping, 1, training.seed).every()
    features = partial(FeatureCache, dataset, [*clips[0], *clips[1]], normalizer_of(first.card))
    if not first.card.vae.has_weights or not settings.per_item:
        if settings.normalized:
            raise InputError(
                "latents.per_item=0 encodes fresh crops, so there are none to measure the latents' "
                "scale on; use --set latents.normalized=false, or keep some crops"
            )
        cropping, space = settings.cropping, space or first.card.latents
        latents = second_stage.FreshLatents(first.vae, features(), context.device)
    else:
        cropping = second_stage.keep_crops(
            items, settings.cropping, settings.per_item, training.seed
        )
        every = [*cropping.every(), *unseen]

        path = folder / "latents.safetensors"
        if context.is_main and not path.exists():
            vae = first.vae.to(context.device)
            encoded = second_stage.encode_crops(vae, features(), every, context)
            run_folder.write_tensors(path, vars(encoded))
        context.wait()
        posteriors = second_stage.Posteriors(**load_file(path))
        if space is None:
            space = first.card.latents
            if settings.normalized:
                space = measured(space, posteriors.take(range(len(every) - len(unseen))))
        posteriors = posteriors.normalized(space.mean, space.std).to(context.device)
        latents = second_stage.LatentCache(every, posteriors)
    prompts = task_conditions.ConditionTable(
        conditioning.condition, captions_of([*items, *held_out]), context.device
    )
    batches = BatchSampler(items, training.batch_size, cropping, training.seed)
    return second_stage.LatentData(batches, tuple(unseen), latents, prompts), space


def measured(space: LatentSpace, posteriors: second_stage.Posteriors) -> LatentSpace:
    """Returns the latent space with mean and deviation per channel as these have them."""
    mean, std = posteriors.channel_statistics()
    return replace(space, mean=tuple(mean), std=tuple(std))


def captions_of(items: list[Item]) -> set[str]:
    """Returns all prompts of some items."""
    return {caption for item in items for caption in item.captions}
