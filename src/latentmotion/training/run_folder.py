"""Run folders: settings checked when a run is resumed, progress, journal, samples, cards."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file

from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TASKS, Conditioning
from latentmotion.diffusion.parametrization import Estimator
from latentmotion.diffusion.samplers import Sampler, SeededNoise
from latentmotion.engine.backend import Batch, FeatureDecoder, representation_of
from latentmotion.errors import InputError, MissingExtraError, hint
from latentmotion.model.card import CARD_FILE, ModelCard, Provenance
from latentmotion.motion import Motion
from latentmotion.networks.device import describe_machine
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.pipeline import features_from_noise
from latentmotion.plugins import plugin, plugin_names, warn_of
from latentmotion.storage.configuration import from_json, read_plain, to_json, write_json
from latentmotion.storage.files import atomic_file, write_file
from latentmotion.storage.provenance import command_line, commit
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment, differences
from latentmotion.training.task_conditions import TaskConditioning


def provenance_of(dataset: Dataset, seconds: float, before: Provenance | None = None) -> Provenance:
    """Says what the running command makes a model from.

    Args:
        dataset: Training data.
        seconds: Duration of the training.
        before: Provenance of the model that it builds on.
    """
    sources, before = dataset.sources, before or Provenance()
    hashes = {f"{dataset.folder.name}/manifest.json": dataset.fingerprint}
    return replace(
        before,
        data=tuple(f"{source.name}: {source.credit}" for source in sources),
        data_hashes={**before.data_hashes, **hashes},
        license="; ".join(dict.fromkeys(source.license for source in sources)) or "unknown",
        commands=(*before.commands, command_line()),
        commit=commit(),
        machine=describe_machine(),
        hours=round(before.hours + seconds / 3600, 3),
    )


EXPERIMENT_FILE = "experiment.json"

FORMAT = 2  # Version of experiment.json that this code writes and reads.

# Files of other folders of this package.
_OTHERS = ("manifest.json", CARD_FILE, "evaluator.json", "report.json")

# Settings of a training that may differ when a run is resumed.
_MACHINE = ("precision", "parallel")

MODEL = "model"  # Folder of the trained model in a run folder.


@dataclass(frozen=True)
class Run:
    """Settings that a run folder was made with."""

    stage: str  # `vae` or `denoiser`.
    data: str  # Fingerprint of the prepared data.
    parents: dict[str, str]  # Fingerprints of what the run builds on: the VAE, the text encoder.
    experiment: Experiment  # Everything else that decides what the run yields.


def open_run(folder: Path, run: Run | Mapping[str, Any], context: DistributedContext) -> None:
    """Makes the folder, or checks that it was made with the same.

    With more steps than before a finished run goes on; the precision and the way in which ranks
    share the work may be others, too.

    Args:
        folder: The run folder.
        run: A `Run`, or another mapping that says all that decides what the run yields, by `kind`.
        context: The leading rank makes it.

    Raises:
        InputError: It was made with something else (the differing keys are named), or it cannot be
            written.
    """
    path = folder / EXPERIMENT_FILE
    if path.exists():
        # Through text, as the file went: tuples become lists.
        current = json.loads(json.dumps(to_json(run)))
        differing, fixed = list(differences(_plain_run(path), current)), []
        for key, before, after in differing:  # more steps and another precision may be asked for
            part, _, name = key.rpartition(".")
            more = name == "steps" and isinstance(before, int) and after > before
            if not part.endswith("training") or not (more or name in _MACHINE):
                fixed.append(f"{key} ({before!r} → {after!r})")
        if fixed:
            raise InputError(
                f"{folder} holds a run with another configuration; differing: "
                f"{', '.join(fixed)}; use the same, or another folder"
            )
        if differing and context.is_main:
            write_json(path, {"format": FORMAT, **to_json(run)})
    elif context.is_main:
        other = next((name for name in _OTHERS if (folder / name).is_file()), None)
        if other:
            raise InputError(
                f"{folder} holds data or a model ({other}); choose another folder to train in"
            )
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the run folder {folder}: {error.strerror}") from error
        write_json(path, {"format": FORMAT, **to_json(run)})
    context.wait()


def read_run(folder: Path) -> Run:
    """Reads what a run folder was made with.

    Raises:
        InputError: There is none, it is damaged, or it is of another kind or version.
    """
    path = folder / EXPERIMENT_FILE
    try:
        return from_json(Run, _plain_run(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _plain_run(path: Path) -> Any:
    data = read_plain(path)
    version = data.pop("format", None) if isinstance(data, dict) else FORMAT
    if version != FORMAT:
        raise InputError(f"format {version}, expected {FORMAT}; update latentmotion")
    return data


def first_stage_card(
    experiment: Experiment, dataset: Dataset, seconds: float, figures: Mapping[str, float]
) -> ModelCard:
    """Describes a trained VAE; what stage 2 will add is left out."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    return ModelCard(
        name=experiment.name,
        representation=dataset.representation.name,
        normalizer_mean=tuple(dataset.normalizer.mean.tolist()),
        normalizer_std=tuple(dataset.normalizer.std.tolist()),
        latents=experiment.vae.latent_space(),
        schedule=objective.schedule,
        parametrization=objective.parametrization,
        vae=experiment.vae,
        denoiser=None,
        condition=TASKS[experiment.task](),
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds),
        figures={f"vae_{name}": round(value, 3) for name, value in figures.items()},
    )


def second_stage_card(
    experiment: Experiment,
    dataset: Dataset,
    first: ModelCard,
    conditioning: TaskConditioning,
    seconds: float,
    figures: Mapping[str, float],
) -> ModelCard:
    """Describes a finished model, given the card of its VAE with the latents' measured scale."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    rounded = {f"denoiser_{name}": round(value, 4) for name, value in figures.items()}
    return replace(
        first,
        name=experiment.name,
        schedule=objective.schedule,
        parametrization=objective.parametrization,
        denoiser=experiment.denoiser,
        condition=conditioning.task,
        sampling=experiment.sampling.but(guidance=None if conditioning.task.prompted else 1.0),
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds, first.provenance),
        figures={**first.figures, **rounded},
    )


JOURNAL_FILE = "journal.jsonl"

# Environment variable: names of plugins that receive the figures, separated by commas.
LOGGERS = "LATENTMOTION_LOGGERS"


class Journal:
    """Writes figures of a run; lines of steps that a kill undid are removed on opening.

    Args:
        folder: The run folder.
        steps: Steps of the whole run, for the time left.
        done: Steps that the snapshot holds.

    Raises:
        InputError: LATENTMOTION_LOGGERS names a logger that is not installed.
    """

    def __init__(self, folder: Path, steps: int, done: int = 0) -> None:
        self._steps = steps
        self._loggers: dict[str, Any] = {}  # Those that the environment names.
        names = plugin_names("latentmotion.loggers") if os.environ.get(LOGGERS) else ()
        for name in filter(None, os.environ.get(LOGGERS, "").split(",")):
            if name not in names:
                advice = hint(name, names) if names else "no plugin adds one"
                raise InputError(f"{LOGGERS}: no logger {name!r}; {advice}")
            try:
                if (open_logger := plugin("latentmotion.loggers", name)) is not None:
                    self._loggers[name] = open_logger(folder, done)
            except Exception as error:  # of a package that is not ours
                warn_of("latentmotion.loggers", name, error)
        lines = [line for line in read_journal(folder) if line["step"] <= done]
        write_file(folder / JOURNAL_FILE, "".join(json.dumps(line) + "\n" for line in lines))
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise MissingExtraError(
                "the journal of a training run", "tensorboard", "train"
            ) from error
        self._file = (folder / JOURNAL_FILE).open("a", encoding="utf-8")
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=done + 1)

    def close(self) -> None:
        """Ends the files."""
        self._file.close()
        self._board.close()
        self._notify(lambda logger: logger.close())

    def write(self, step: int, kind: str, figures: Mapping[str, float], pace: float = 0.0) -> None:
        """Appends figures (losses, rates, millimeters) of `kind` "train" or "validation".

        They are also printed, with the time left, from the pace in seconds a step.
        """
        rounded = {name: float(f"{value:.6g}") for name, value in figures.items()}
        self._file.write(json.dumps({"step": step, "kind": kind, **rounded}) + "\n")
        self._file.flush()
        for name, value in rounded.items():
            self._board.add_scalar(f"{kind}/{name}", value, step)
        self._notify(lambda logger: logger.write(step, kind, rounded))
        left = readable_time((self._steps - step) * pace)
        values = "  ".join(f"{name} {value:.4g}" for name, value in figures.items())
        line = f"{step}/{self._steps} {kind}  {values}  ({pace:.3f} s a step, {left} left)"
        print(line, file=sys.stderr, flush=True)

    def _notify(self, what: Callable[[Any], object]) -> None:
        """Calls every logger; one that fails is left out from then on."""
        for name in list(self._loggers):
            try:
                what(self._loggers[name])
            except Exception as error:  # of a package that is not ours
                warn_of("latentmotion.loggers", name, error)
                del self._loggers[name]


def readable_time(seconds: float) -> str:
    """Writes a duration as 2 h 05 min, 3 min 20 s or 12 s."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def read_journal(folder: str | Path) -> list[dict[str, Any]]:
    """Returns the lines of a run's journal; a last line cut short by a kill is left out."""
    path = Path(folder) / JOURNAL_FILE
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]


def write_tensors(
    path: Path, tensors: Mapping[str, torch.Tensor], about: dict[str, str] | None = None
) -> None:
    """Writes tensors of any device, with a text or two about them; the file is whole or absent."""
    with atomic_file(path) as temporary:
        each = {name: tensor.cpu().contiguous() for name, tensor in tensors.items()}
        save_file(each, temporary, about)


def write_strip(path: Path, motions: Sequence[Motion]) -> None:
    """Writes `motions` as a picture, a row each; does nothing without Pillow or motions."""
    try:
        from latentmotion.render.strip import write
    except MissingExtraError:
        return
    if motions:
        write(path, motions)


class Previews:
    """The pipeline from noise to motions, for the networks in training.

    Args:
        vae: The trained VAE.
        card: Its scales and representation.
        frames: Length of the motions.
    """

    def __init__(self, vae: MotionVAE, card: ModelCard, frames: int) -> None:
        self._vae, self._card, self._frames = vae, card, frames

    def sample(
        self,
        guided: Estimator,
        sampler: Sampler,
        steps: int,
        condition: Conditioning,
        captions: Sequence[str],
    ) -> list[Motion]:
        """Returns a motion for each caption, with the seeds 0, 1, 2, ….

        Args:
            guided: The denoiser with its guidance, and the meaning of its output.
            sampler: The rule of a step.
            steps: Number of steps.
            condition: That of the captions; says on which device all is computed.
            captions: What the motions are called.
        """
        device, noise = condition.tokens.device, SeededNoise(range(len(captions)))
        frames = torch.ones(len(captions), self._frames, dtype=torch.bool)
        tokens = self._vae.latent_mask(frames).to(device)
        z = torch.from_numpy(noise((*tokens.shape, self._card.latents.width))).to(device)
        batch = Batch(z, tokens, condition.tokens, condition.mask, frames.to(device))
        # Distillation, and a resumed stage 2, need the VAE for nothing else.
        decode = self._vae.to(device).decode
        decoder = FeatureDecoder.of(self._card, decode, partial(torch.tensor, device=device))
        features = features_from_noise(batch, guided, sampler, steps, noise, decoder)
        part = representation_of(self._card)
        joints = part.decode(features.cpu().numpy())
        return [
            Motion(each, part.fps, part.skeleton, caption)
            for each, caption in zip(joints, captions, strict=True)
        ]
