"""Model folders: finding one by name, path or hub id, and reading its card, `model.json`.

A hub id is `owner/name`, or `owner/name@revision` for a branch, tag or commit of a repository on
the Hugging Face Hub. Of a repository only the files of a model folder are downloaded, and none of
them is unpickled. `HF_ENDPOINT` names another server than huggingface.co, and `HF_TOKEN` a user;
both as `huggingface_hub` documents them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from latentmotion.diffusion.condition import (
    ActionTask,
    Condition,
    TaskName,
    TextEncoder,
    TextTask,
    UnconditionalTask,
)
from latentmotion.diffusion.parametrization import (
    Denoiser,
    Epsilon,
    ParametrizedDenoiser,
    Sample,
    Velocity,
)
from latentmotion.diffusion.schedule import AnySchedule
from latentmotion.errors import InputError, MissingExtraError, ModelError, hint
from latentmotion.model import config
from latentmotion.storage import limits
from latentmotion.storage.configuration import from_json, read_plain, write_json

FORMAT = 2  # Version of model.json that this code writes and reads.

# JSON Schema of model.json, as this code writes it.
SCHEMA_FILE = Path(__file__).with_name("model.schema.json")

CARD_FILE = "model.json"
README_FILE = "README.md"
TEXT_GRAPH_FILE = "text_encoder.onnx"
TOKENIZER_FILE = "tokenizer.json"
LENGTHS_FILE = "lengths.safetensors"
MOVES_FILE = "moves.index"
# Files of a model folder; those of the text encoder may be in the folder of another model.
ENCODER_FILE = "encoder.onnx"

DEFAULT = "fast"  # The model that generates by default: `starter`, distilled to few steps.

# Patterns of the files of a model folder: card, tokenizer, graphs, weights and documentation.
HUB_FILES = ("*.json", "*.onnx", "*.safetensors", "*.index", "LICENSE*", "README.md")

# Note on rights in every generated motion, beside the license of the weights.
RIGHTS_IN_MOTIONS = (
    "The authors of Latent Motion claim no rights in generated motions: as far as they are "
    "concerned, use them for anything."
)

# Folder of the models inside the package, each a folder.
SHIPPED = Path(__file__).parents[1] / "models"

_HUB_ID = re.compile(r"(?P<repository>\w[\w.-]*/\w[\w.-]*)(@(?P<revision>\w[\w./-]*))?", re.ASCII)

# Precision of matrix products; weights of float32 graphs are kept in 16 bits.
GraphPrecision = Literal["float32", "int8"]


@dataclass(frozen=True)
class Provenance:
    """Origin of the weights: data, terms, commands, code and hardware."""

    data: tuple[str, ...] = ()  # Names and credits of the data sets.
    data_hashes: dict[str, str] = field(default_factory=dict)  # SHA-256 of the data's files.
    license: str = "unknown"  # License of the weights.
    commands: tuple[str, ...] = ()  # The commands that made them, in order.
    commit: str = ""  # Commit of this code.
    machine: str = ""  # Hardware and PyTorch version of the training.
    hours: float = 0.0  # Duration of the training.


@dataclass(frozen=True)
class ModelCard:
    """Description of a trained model."""

    name: str  # Name for users, e.g. `starter`.
    representation: str  # Name of the motion features, e.g. `humanml3d`.
    normalizer_mean: tuple[float, ...]  # Mean of each feature.
    normalizer_std: tuple[float, ...]  # Standard deviation of each feature.
    latents: config.LatentSpace  # Shape and scale of the latents.
    schedule: AnySchedule  # Noise schedule.
    parametrization: Epsilon | Sample | Velocity  # Quantity that the denoiser predicts.
    vae: config.VAEConfig  # Configuration of the VAE.
    # Configuration of the denoiser; None where only the first stage is trained.
    denoiser: config.DenoiserConfig | None
    # Its task: which text encoder, which labels; empty where no denoiser is trained.
    condition: TextTask | ActionTask | UnconditionalTask
    # Default sampling settings.
    sampling: config.Sampling = field(default_factory=lambda: config.Sampling(guidance=1.0))
    frames: tuple[int, int] = (16, 196)  # Shortest and longest motion it was trained on, in frames.
    precision: GraphPrecision = "float32"  # Precision of matrix products in the exported graphs.
    provenance: Provenance = Provenance()  # Where the weights come from.
    figures: dict[str, Any] = field(default_factory=dict)  # Measured figures, by name.
    format: int = FORMAT  # Version of this file.

    @property
    def task(self) -> TaskName:
        """Name of its condition."""
        return self.condition.name

    @property
    def masks_padding(self) -> bool:
        """Whether padding leaves a motion unchanged, so that it is the same in any batch.

        Not where the denoiser attends to padding, nor where its context stands behind it.
        """
        if self.denoiser is None:
            return True
        behind = self.denoiser.positions == "latents_first"
        over_time = self.latents.frames_per_token is not None
        return not (self.denoiser.attends_to_padding or (behind and over_time))

    @property
    def few_step(self) -> config.FewStepConfig | None:
        """Step counts and guidance scales of a distilled model; None for any other."""
        return self.denoiser.few_step if self.denoiser else None

    @property
    def trained_denoiser(self) -> config.DenoiserConfig:
        """Configuration of the denoiser of a model that has both stages.

        Raises:
            ModelError: Only the first stage is trained.
        """
        if self.denoiser is None:
            raise ModelError(f"model {self.name!r} lacks a denoiser; train both stages first")
        return self.denoiser

    def terms(self) -> dict[str, str]:
        """Returns what holds for a motion made with the model, and, apart, for its weights."""
        return {"rights": RIGHTS_IN_MOTIONS, "weights_license": self.provenance.license}

    def parametrized(self, denoiser: Denoiser) -> ParametrizedDenoiser:
        """Returns this model's denoiser, a network or session, with the meaning of its output."""
        return ParametrizedDenoiser(denoiser, self.parametrization, self.schedule)

    def prompt_condition(self, encoder: Callable[[], TextEncoder]) -> Condition:
        """Returns the condition of the model's prompts.

        Args:
            encoder: Returns the text encoder; called if prompts are sentences.
        """
        return self.condition.condition(self.trained_denoiser.condition_width, encoder)

    def write(self, folder: Path) -> None:
        """Writes `model.json` into `folder`."""
        write_json(folder / CARD_FILE, self)


def read_card(folder: Path) -> ModelCard:
    """Reads `model.json` of a model folder.

    Raises:
        ModelError: There is none, it is damaged, or it is of another version.
    """
    path = folder / CARD_FILE
    if not path.is_file():
        raise ModelError(f"{folder} is not a model folder: it has no {CARD_FILE}")
    status = path.stat()
    return _card_at(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _card_at(path: Path, *version: int) -> ModelCard:
    # To open one model, those of its neighbors are looked at several times, at 3 ms each.
    try:
        data = read_plain(path)
    except InputError as error:
        raise ModelError(str(error)) from error
    written = data.get("format") if isinstance(data, Mapping) else FORMAT
    if written != FORMAT:
        raise ModelError(f"{path}: format {written}, expected {FORMAT}; update latentmotion")
    try:
        card = from_json(ModelCard, data)
        # Its parts fit each other.
        shortest, longest = card.frames
        if not 1 <= shortest <= longest <= limits.MOST_TOKENS:
            raise InputError(f"frames {card.frames}: expected the shortest and the longest motion")
        mean, std = card.normalizer_mean, card.normalizer_std
        scales = all(0 < scale < limits.MOST_NUMBER for scale in std)
        if not len(mean) == len(std) == card.vae.features or not scales:
            raise InputError(
                f"a normalizer of {len(mean)} and {len(std)} numbers for {card.vae.features} "
                "features; expected a mean and a positive scale for each"
            )
        needed = card.vae.latent_space()
        for name in ("width", "tokens", "frames_per_token"):
            actual, expected = getattr(card.latents, name), getattr(needed, name)
            if actual != expected:
                raise InputError(f"latents.{name} {actual}: this kind of VAE has {expected}")
        return card
    except InputError as error:
        raise ModelError(f"{path}: {error}") from error


def shipped_models() -> tuple[str, ...]:
    """Returns the names of the models inside the package."""
    # A folder that begins with a dot is still being written.
    return tuple(sorted(c.parent.name for c in SHIPPED.glob(f"[!.]*/{CARD_FILE}")))


def find_model(model: str | Path) -> Path:
    """Returns the folder of a model, given a name such as `starter`, a folder or a run folder.

    Raises:
        ModelError: There is no such model; the message names the nearest.
    """
    if str(model) in shipped_models():
        return SHIPPED / str(model)
    if Path(model).is_dir():
        inside = Path(model) / "model"  # where a training run puts it
        return inside if (inside / CARD_FILE).is_file() else Path(model)
    raise ModelError(
        f"no model {str(model)!r}, neither by name nor as a folder; "
        f"{hint(str(model), shipped_models())}"
    )


def is_hub_id(model: str | Path) -> bool:
    """Returns whether a name looks like `owner/name`, and neither is a folder here."""
    looks_so = isinstance(model, str) and bool(_HUB_ID.fullmatch(model))
    return looks_so and not Path(model).exists() and not Path(model).parent.exists()


def find_or_download(model: str | Path) -> Path:
    """Returns the folder of a model, given what `find_model` takes, or a hub id.

    Raises:
        MissingExtraError: `huggingface_hub` is not installed.
        ModelError: There is no such model.
    """
    return download(str(model)) if is_hub_id(model) else find_model(model)


def download(model: str) -> Path:
    """Downloads a model folder, or finds it in huggingface_hub's cache; returns the folder.

    Args:
        model: Its hub id.

    Raises:
        MissingExtraError: `huggingface_hub` is not installed.
        ModelError: There is no such model on the hub, or the hub cannot be reached.
    """
    try:
        from huggingface_hub import snapshot_download
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"the model {model!r} on the hub", "huggingface_hub", "hub"
        ) from error
    hub_id = _HUB_ID.fullmatch(model)
    assert hub_id is not None  # the caller asked `is_hub_id`
    try:
        folder = snapshot_download(
            hub_id["repository"],
            revision=hub_id["revision"],
            allow_patterns=list(HUB_FILES),
            ignore_patterns="*/*",
            endpoint=os.environ.get("HF_ENDPOINT"),
        )
    except Exception as error:  # huggingface_hub's errors, and those of its HTTP library
        raise ModelError(
            f"no model {model!r}: there is no such folder here, and from the hub it cannot be "
            f"downloaded: {error}"
        ) from error
    return Path(folder)


def text_encoder_folder(card: ModelCard, folder: Path) -> Path | None:
    """Returns the folder with a model's text encoder: its own, else a shipped model's, else None.

    Args:
        card: The model's card, which names the text encoder.
        folder: The model's folder.
    """
    if (folder / TEXT_GRAPH_FILE).is_file():
        return folder
    return shipped_text_encoder(card.condition.encoder)


def shipped_text_encoder(name: str | None) -> Path | None:
    """Returns the folder of the shipped model with the text encoder of this name, if any."""
    for model in shipped_models():
        shipped = SHIPPED / model
        if not (shipped / TEXT_GRAPH_FILE).is_file():
            continue
        if read_card(shipped).condition.encoder == name:
            return shipped
    return None


def find_text_encoder(card: ModelCard, folder: Path) -> tuple[Path, Path]:
    """Returns graph and tokenizer of a model's text encoder.

    Raises:
        ModelError: One of them is missing.
    """
    return text_encoder_files(text_encoder_folder(card, folder) or folder)


def text_encoder_files(folder: Path) -> tuple[Path, Path]:
    """Returns graph and tokenizer of the text encoder in a folder.

    Raises:
        ModelError: One of them is missing.
    """
    graph, tokenizer = folder / TEXT_GRAPH_FILE, folder / TOKENIZER_FILE
    for path in (graph, tokenizer):
        if not path.is_file():
            raise ModelError(
                f"{path} is missing; a text encoder needs {TEXT_GRAPH_FILE} and {TOKENIZER_FILE}: "
                "copy the model's folder again or run latentmotion train text-encoder"
            )
    return graph, tokenizer


def moves_files(card: ModelCard, folder: Path) -> tuple[Path, Path] | None:
    """Returns the clips that motions may start from and the VAE encoder's graph, if both are there.

    A student has those of the model with its text encoder, if that has the same latents.

    Args:
        card: The model's card.
        folder: The model's folder.
    """
    clips = file_beside(card, folder, MOVES_FILE)
    encoder = file_beside(card, folder, ENCODER_FILE)
    if clips is None or encoder is None:
        return None
    of_other = clips.parent != folder and read_card(clips.parent).latents != card.latents
    return None if of_other else (clips, encoder)


def file_beside(card: ModelCard, folder: Path, name: str) -> Path | None:
    """Returns a file of a model that reads sentences, or of its text encoder's folder.

    Args:
        card: The model's card.
        folder: The model's folder.
        name: Name of the file, such as `LENGTHS_FILE`.
    """
    if not card.condition.reads_text:
        return None
    folders = folder, text_encoder_folder(card, folder) or folder
    files = (candidate / name for candidate in folders)
    return next((file for file in files if file.is_file()), None)
