"""model.json: all that a trained model's folder says of itself, typed, readable without PyTorch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from latentmotion.condition.task import (
    TASKS,
    ActionTask,
    Task,
    TaskName,
    TextTask,
    UnconditionalTask,
)
from latentmotion.diffusion.leaps import Leaps
from latentmotion.diffusion.prediction import Epsilon, Sample, Velocity
from latentmotion.diffusion.sampler import SamplerName
from latentmotion.diffusion.schedule import Cosine, LinearPath, ScaledLinear
from latentmotion.errors import InputError, ModelError
from latentmotion.model.config import DenoiserConfig, Sampling
from latentmotion.model.vae_config import LatentSpace, VAEConfig
from latentmotion.storage.configuration import from_json, read_plain, to_json, write_json

FORMAT = 1
"""Version of model.json that this code writes and reads."""

CARD_FILE = "model.json"

GraphPrecision = Literal["float32", "int8"]
"""Precision of matrix products; weights of float32 graphs are kept in 16 bits."""


@dataclass(frozen=True)
class Provenance:
    """Where the weights come from: what a company's lawyer and a scientist ask first."""

    data: tuple[str, ...] = ()
    """Names and credits of the data sets."""
    data_hashes: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the data's files."""
    license: str = "unknown"
    """License of the weights."""
    commands: tuple[str, ...] = ()
    """The commands that made them, in order."""
    commit: str = ""
    """Commit of this code."""
    machine: str = ""
    """What computed them, and with which PyTorch."""
    hours: float = 0.0
    """How long that took."""


@dataclass(frozen=True)
class ModelCard:
    """What a trained model is."""

    name: str
    """What users call it, e.g. `starter`."""
    representation: str
    """Name of the motion features, e.g. `humanml3d`."""
    normalizer_mean: tuple[float, ...]
    """Mean of each feature."""
    normalizer_std: tuple[float, ...]
    """Standard deviation of each feature."""
    latents: LatentSpace
    """Shape and scale of the latents."""
    schedule: ScaledLinear | Cosine | LinearPath
    """Noise schedule."""
    prediction: Epsilon | Sample | Velocity
    """What the denoiser predicts."""
    vae: VAEConfig
    """Configuration of the VAE."""
    denoiser: DenoiserConfig | None
    """Configuration of the denoiser; None where only the first stage is trained."""
    condition: TextTask | ActionTask | UnconditionalTask
    """Its task: which text encoder, which labels; empty where no denoiser is trained."""
    steps: int = 50
    """Default number of sampling steps."""
    guidance: float = 1.0
    """Default guidance scale."""
    sampler: SamplerName = "ddim"
    """Default sampler."""
    frames: tuple[int, int] = (16, 196)
    """Shortest and longest motion it was trained on, in frames."""
    precision: GraphPrecision = "float32"
    """Of the graphs' matrix products, where the model was exported."""
    provenance: Provenance = Provenance()
    """Where the weights come from."""
    figures: dict[str, Any] = field(default_factory=dict)
    """Measured figures, by name."""
    format: int = FORMAT
    """Version of this file."""

    @property
    def task(self) -> TaskName:
        """What it is conditioned on, by name."""
        return self.condition.name

    @property
    def masks_padding(self) -> bool:
        """Whether a motion is the same in a batch of other lengths as it is alone.

        Not where the denoiser attends to padding, nor where its context stands behind it.
        """
        if self.denoiser is None:
            return True
        behind = self.denoiser.places == "latents_first"
        over_time = self.latents.frames_per_token is not None
        return not (self.denoiser.sees_padding or (behind and over_time))

    @property
    def leaps(self) -> Leaps | None:
        """What a distilled model, which takes guidance as an input, may be asked for; else None."""
        return self.denoiser.leaps if self.denoiser else None

    @property
    def sampling(self) -> Sampling:
        """How it is sampled where nothing else is asked."""
        return Sampling(self.steps, self.guidance, self.sampler)

    @property
    def trained_denoiser(self) -> DenoiserConfig:
        """Configuration of the denoiser of a model that has both stages.

        Raises:
            ModelError: Only the first stage is trained.
        """
        if self.denoiser is None:
            raise ModelError(f"model {self.name!r} lacks a denoiser; train both stages first")
        return self.denoiser

    def write(self, folder: Path) -> None:
        """Writes `model.json` into `folder`."""
        write_json(folder / CARD_FILE, _in_version_1(self))


def read_card(folder: Path) -> ModelCard:
    """Reads `model.json` of a model folder.

    Raises:
        ModelError: There is none, it is damaged, or it is of another version.
    """
    path = folder / CARD_FILE
    if not path.is_file():
        raise ModelError(f"{folder} is not a model folder: it has no {CARD_FILE}")
    try:
        data = read_plain(path)
    except InputError as error:
        raise ModelError(str(error)) from error
    try:
        card = from_json(ModelCard, _from_version_1(data))
    except InputError as error:
        raise ModelError(f"{path}: {error}") from error
    if card.format != FORMAT:
        raise ModelError(f"{path}: format {card.format}, expected {FORMAT}; update latentmotion")
    return card


def _in_version_1(card: ModelCard) -> dict[str, Any]:
    """Returns a card as its file has it: conditions are told by words, an untrained part is {}."""
    data = to_json(card)
    data = {"kind": data.pop("kind"), "name": data.pop("name"), "task": card.task, **data}
    if card.denoiser is None:
        return {**data, "denoiser": {}, "condition": {}}
    condition = {key: value for key, value in data["condition"].items() if key != "kind"}
    if not card.condition.reads_text:
        condition = {"kind": card.task, **condition}
    return {**data, "condition": condition}


def _from_version_1(data: Any) -> Any:
    """Returns a file's content with the classes named that it leaves out.

    Raises:
        InputError: The task is missing or unknown.
    """
    if not isinstance(data, Mapping):
        return data
    read = dict(data)
    if "task" not in read:
        raise InputError("missing key 'task'")
    task = read.pop("task")
    if task not in TASKS:
        raise InputError(f"task: expected one of {', '.join(TASKS)}, found {task!r}")
    if read.get("denoiser") == {}:
        read["denoiser"] = None
    if read.get("vae") == {} and isinstance(read.get("latents"), Mapping):
        # A converted diffusion on raw frames.
        read["vae"] = {"kind": "IdentityVAEConfig", "features": read["latents"].get("width")}
    if isinstance(read.get("condition"), Mapping):
        read["condition"] = _condition_from_version_1(TASKS[task], read)
    return read


def _condition_from_version_1(task: type[Task], read: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the condition with its class; actions that were converted without names get numbers.

    Old conversions kept the number of actions, which the denoiser has as well.
    """
    condition = {**read["condition"], "kind": task.__name__}
    denoiser = read.get("denoiser")
    if task is ActionTask and isinstance(denoiser, Mapping):
        condition.pop("classes", None)
        width = denoiser.get("condition_width", 0)
        condition["labels"] = condition.get("labels") or [str(n) for n in range(width)]
    return condition
