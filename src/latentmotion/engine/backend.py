"""Backends: the sessions that run a pipeline's networks, and the padding of their batches.

The pipeline is the same for every backend. ONNX Runtime and OpenVINO take NumPy arrays as they are;
PyTorch has its arrays on a device and, where it records or compiles, pads batches to few shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Conditioning
from latentmotion.engine.session import Session
from latentmotion.model.config import Sampling


@runtime_checkable
class Padding(Protocol):
    """The sizes to which a batch is padded."""

    def rows(self, count: int) -> int:
        """Returns the number of motions after padding."""
        ...

    def words(self, count: int) -> int:
        """Returns the number of words of the condition after padding."""
        ...

    def frames(self, longest: int) -> int:
        """Returns the number of frames after padding."""
        ...


class NoPadding:
    """Keeps a batch as large as it is."""

    def rows(self, count: int) -> int:
        """Returns the count as it is."""
        return count

    def words(self, count: int) -> int:
        """Returns the count as it is."""
        return count

    def frames(self, longest: int) -> int:
        """Returns the length as it is."""
        return longest


@runtime_checkable
class Launcher(Protocol):
    """Records functions of arrays, and replays them from then on."""

    def __call__(self, name: Hashable, function: Callable[..., Any], *inputs: Any) -> Any:
        """Returns the function's output.

        Args:
            name: Equal for functions that compute the same.
            function: The function to run.
            inputs: Its arrays.
        """
        ...


@dataclass(frozen=True)
class Batch:
    """Inputs of a backend's networks for one batch: arrays of its library, on its device."""

    noise: Float[Any, "batch tokens width"]
    """Latents from which sampling starts."""
    tokens: Bool[Any, "batch tokens"]
    """True on real latent tokens."""
    words: Float[Any, "batch words channels"]
    """The condition."""
    words_mask: Bool[Any, "batch words"]
    """True on real words."""
    frames: Bool[Any, "batch frames"]
    """True on real frames."""

    @property
    def condition(self) -> Conditioning:
        """The condition with its mask."""
        return Conditioning(self.words, self.words_mask)


@dataclass(frozen=True)
class Backend:
    """Sessions that take and return arrays of one library on one device."""

    denoiser: Session
    """Network: z, t, words, words_mask, mask → prediction."""
    decoder: Session
    """Network: latents, mask → normalized features."""
    fused: Mapping[int, Session] = field(default_factory=dict)
    """Fused samplers, from noise to features in one graph, by number of steps."""
    pullback: Session | None = None
    """Network: latents, mask, gradient of features → gradient of latents; None where there is none,
    so that motions cannot be directed."""
    padding: Padding = field(default_factory=NoPadding)
    """The sizes to which batches are padded."""
    launch: Launcher | None = None
    """Records functions of arrays and replays them; None calls them as they are."""
    to_device: Callable[[np.ndarray], Any] = np.asarray
    """Turns a NumPy array into an array of the sessions' library, on their device."""
    to_host: Callable[[Any], np.ndarray] = np.asarray
    """Turns an array of the sessions into a NumPy array."""

    def run_fused(self, batch: Batch, sampling: Sampling) -> Float[Any, "batch frames features"]:
        """Generates features by the fused sampler for this number of steps."""
        guidance = np.full(len(batch.noise), sampling.guidance, np.float32)
        return self.fused[sampling.steps](
            noise=batch.noise,
            words=batch.words,
            words_mask=batch.words_mask,
            mask=batch.tokens,
            frames=batch.frames,
            guidance=self.to_device(guidance),
        )
