"""Backends: the sessions that run a pipeline's networks, padding, and the decoder of features.

The pipeline is the same for every backend. ONNX Runtime and OpenVINO take NumPy arrays as they are;
PyTorch has its arrays on a device and, where it records or compiles, pads batches to few shapes.

latents = z · std + mean          (the denoiser's scale → the VAE's)
features = decoder(latents) · std + mean
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.diffusion.condition import Conditioning
from latentmotion.engine.session import (
    PULLBACK_FILE,
    LazySession,
    Runtime,
    Session,
    fused_sampler_file,
    open_decoder,
)
from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard
from latentmotion.representation import representation_named
from latentmotion.representation.interface import Normalizer, Representation, Scale
from latentmotion.representation.smpl import SmplRepresentation


class Padding:
    """The sizes to which a batch is padded; here it stays as large as it is."""

    def sizes(self, rows: int, words: int, frames: int) -> tuple[int, int, int]:
        """Returns the numbers of motions, of words of the condition and of frames."""
        return rows, words, frames


# Records functions of arrays, and replays them from then on: takes a name, equal for functions that
# compute the same, the function, and its arrays; returns the function's output.
Launcher = Callable[..., Any]


@dataclass(frozen=True)
class Batch:
    """Inputs of a backend's networks for one batch: arrays of its library, on its device."""

    noise: Float[Any, "batch tokens width"]  # Latents from which sampling starts.
    tokens: Bool[Any, "batch tokens"]  # True on real latent tokens.
    words: Float[Any, "batch words channels"]  # The condition.
    words_mask: Bool[Any, "batch words"]  # True on real words.
    frames: Bool[Any, "batch frames"]  # True on real frames.
    # Latents of the clips that sampling starts from; None for pure noise.
    start: Float[Any, "batch tokens width"] | None = None
    start_share: Float[Any, "batch tokens 1"] | None = None  # Share of them in the result.

    @property
    def condition(self) -> Conditioning:
        """The condition with its mask."""
        return Conditioning(self.words, self.words_mask)


@dataclass(frozen=True)
class Backend:
    """Sessions that take and return arrays of one library on one device."""

    denoiser: Session  # Network: z, t, words, words_mask, mask → prediction.
    decoder: Session  # Network: latents, mask → normalized features.
    # Fused samplers, from noise to features in one graph, by number of steps.
    fused: Mapping[int, Session] = field(default_factory=dict)
    # Network: latents, mask, gradient of features → gradient of latents; None where there is none,
    # so that motions cannot be directed.
    pullback: Session | None = None
    padding: Padding = field(default_factory=Padding)  # The sizes to which batches are padded.
    # Records functions of arrays and replays them; None calls them as they are.
    launch: Launcher | None = None
    # Turns a NumPy array into an array of the sessions' library, on their device.
    to_device: Callable[[np.ndarray], Any] = np.asarray
    # Turns an array of the sessions into a NumPy array.
    to_host: Callable[[Any], np.ndarray] = np.asarray

    @classmethod
    def of_folder(
        cls, card: ModelCard, folder: Path, runtime: Runtime = "auto", threads: int | None = None
    ) -> Backend:
        """Opens the graphs of a model folder; each is loaded when it is first needed.

        A fused sampler is one graph from noise to features: noise, words, words_mask, mask, frames,
        guidance → features in their own units. Python and the engine are called once instead of
        once per step.

        Raises:
            MissingExtraError: OpenVINO is requested and not installed.
            ModelError: Denoiser or decoder is missing.
        """
        few_steps = card.few_step.steps if card.few_step else ()
        fused = {steps: folder / fused_sampler_file(steps) for steps in few_steps}
        pullback = folder / PULLBACK_FILE
        return cls(
            LazySession(folder / "denoiser.onnx", runtime, threads),
            open_decoder(card, folder, runtime, threads),
            {n: LazySession(path, runtime, threads) for n, path in fused.items() if path.is_file()},
            LazySession(pullback, runtime, threads) if pullback.is_file() else None,
        )


# Precision of matrix products and convolutions, and of the activations computed from them alone;
# the output is float32.
Precision = Literal["float32", "bfloat16"]

# How work reaches a device: kernel by kernel; as CUDA graphs, one launch for the whole chain; or
# fused by torch.compile, on a GPU as graphs of that. The latter two pay off where shapes repeat.
Launch = Literal["eager", "graph", "compiled"]


@dataclass(frozen=True)
class ExecutionOptions:
    """Device, precision and launch mode of a pipeline on PyTorch.

    Raises:
        InputError: They exclude each other.
    """

    device: str = "cpu"
    """PyTorch's name, e.g. `cuda` or `cuda:1`."""
    precision: Precision = "float32"
    """Precision of matrix products and convolutions."""
    launch: Launch = "eager"
    """Launch mode: the way work reaches the device."""

    def __post_init__(self) -> None:
        if self.launch == "graph" and self.device_type == "cpu":
            raise InputError(
                f"launch graph on device {self.device!r}: CUDA graphs need cuda; "
                "use launch eager or compiled"
            )

    def __str__(self) -> str:
        return f"{self.device}, {self.precision}, {self.launch}"

    @property
    def device_type(self) -> str:
        """PyTorch's name of the device without its number."""
        return self.device.partition(":")[0]


ON_CPU = ExecutionOptions()  # The options by default.


Half = TypeVar("Half", bound="_Scaled")


@dataclass(frozen=True)
class _Scaled:
    """A half of a VAE, with the scales at both of its ends."""

    network: Callable[..., Any]  # The half: a session, or a method of a VAE.
    latents: Scale  # Scale in which the denoiser sees latents.
    features: Scale  # Scale in which the networks see features.

    @classmethod
    def of(
        cls: type[Half],
        card: ModelCard,
        network: Callable[..., Any],
        to_device: Callable[[np.ndarray], Any] = np.asarray,
    ) -> Half:
        """Returns that of a model.

        Args:
            card: States the scales of latents and features.
            network: The VAE's decoder or encoder.
            to_device: Converts to arrays of the network's library, on its device.
        """
        space = card.latents
        rows = space.mean, space.std, card.normalizer_mean, card.normalizer_std
        mean, std, features_mean, features_std = (to_device(np.array(r, np.float32)) for r in rows)
        return cls(network, Scale(mean, std), Scale(features_mean, features_std))


@dataclass(frozen=True)
class FeatureDecoder(_Scaled):
    """A VAE's decoder, `latents`, `mask` → normalized features, between both scales."""

    def __call__(
        self, z: Float[Any, "batch tokens width"], frames: Bool[Any, "batch frames"]
    ) -> Float[Any, "batch frames features"]:
        """Returns the features of latents in the denoiser's scale.

        Args:
            z: Latents at the end of sampling.
            frames: True on real frames; features of other frames are meaningless.
        """
        return self.decode(self.latents.denormalize(z), frames)

    def decode(
        self, latents: Float[Any, "batch tokens width"], frames: Bool[Any, "batch frames"]
    ) -> Float[Any, "batch frames features"]:
        """Returns the features of latents in the VAE's own scale."""
        return self.features.denormalize(self.network(latents=latents, mask=frames))


@dataclass(frozen=True)
class FeatureEncoder(_Scaled):
    """A VAE's encoder, `features`, `mask` → mean of the posterior, between both scales."""

    def __call__(self, features: Float[np.ndarray, "frames features"]) -> np.ndarray:
        """Returns the latents of one motion, (tokens, width).

        Args:
            features: In their own units.
        """
        normalized = self.features.normalize(features[None].astype(np.float32))
        mask = np.ones(normalized.shape[:2], bool)
        return self.latents.normalize(self.network(features=normalized, mask=mask)[0])


def normalizer_of(card: ModelCard) -> Normalizer:
    """Returns the normalizer that a model was trained with."""
    mean, std = card.normalizer_mean, card.normalizer_std
    return Normalizer(np.asarray(mean, np.float32), np.asarray(std, np.float32))


def representation_of(card: ModelCard, body: SmplRepresentation | None = None) -> Representation:
    """Returns the representation of a model's features.

    Args:
        card: Names the representation.
        body: A body whose joints the features move, in place of the skeleton that ships.

    Raises:
        InputError: There is a body, but the model's features are not SMPL's poses.
    """
    if body is not None and card.representation != body.name:
        raise InputError(
            f"model {card.name!r} makes features {card.representation!r}, which are "
            "no poses of a SMPL body; leave the body out"
        )
    return body or representation_named(card.representation)
