"""model.json: all that a trained model's folder says of itself, readable without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from latentmotion.configuration import from_json, read_json, write_json
from latentmotion.diffusion.leaps import Leaps
from latentmotion.diffusion.prediction import Epsilon, Sample, Velocity
from latentmotion.diffusion.sampler import SamplerName, Sampling
from latentmotion.diffusion.schedule import Cosine, LinearPath, ScaledLinear
from latentmotion.errors import InputError, ModelError

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
class LatentSpace:
    """Shape and scale of the latents."""

    width: int
    """Numbers per token."""
    tokens: int | None = None
    """Tokens of any motion, for a VAE with a global latent."""
    frames_per_token: int | None = None
    """Frames that one token stands for, for a VAE with latents over time."""
    mean: tuple[float, ...] = (0.0,)
    """Mean per channel; the denoiser sees (latent - mean) / std."""
    std: tuple[float, ...] = (1.0,)
    """Standard deviation per channel."""

    def tokens_of(self, frames: int) -> int:
        """Returns how many tokens a motion of so many frames has."""
        if self.frames_per_token is None:
            return self.tokens or 1
        return -(-frames // self.frames_per_token)


@dataclass(frozen=True)
class ModelCard:
    """What a trained model is."""

    name: str
    """What users call it, e.g. `starter`."""
    task: Literal["text", "action", "unconditional"]
    """What it is conditioned on."""
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
    vae: dict[str, Any]
    """Configuration of the VAE."""
    denoiser: dict[str, Any]
    """Configuration of the denoiser."""
    condition: dict[str, Any]
    """Configuration of the condition, e.g. which text encoder."""
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
    def masks_padding(self) -> bool:
        """Whether a motion is the same in a batch of other lengths as it is alone.

        Not where the denoiser attends to padding, nor where its context stands behind it.
        """
        behind = self.denoiser.get("places") == "latents_first"
        over_time = self.latents.frames_per_token is not None
        return not (self.denoiser.get("sees_padding", False) or (behind and over_time))

    @cached_property
    def leaps(self) -> Leaps | None:
        """What a distilled model, which takes guidance as an input, may be asked for; else None."""
        kept = self.denoiser.get("leaps")
        return from_json(Leaps, kept) if kept else None

    @property
    def sampling(self) -> Sampling:
        """How the model is sampled by default."""
        return Sampling(self.steps, self.guidance, self.sampler)

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
    try:
        card = read_json(ModelCard, path)
    except InputError as error:
        raise ModelError(str(error)) from error
    if card.format != FORMAT:
        raise ModelError(f"{path}: format {card.format}, expected {FORMAT}; update latentmotion")
    return card
