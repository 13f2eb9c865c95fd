"""What runs a pipeline's networks: sessions, padding, and the way onto a device and back.

The pipeline is the same for every backend: ONNX Runtime and OpenVINO take NumPy arrays as they
are, PyTorch has them on a device, filled up to few shapes where it records or compiles.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Conditioning
from latentmotion.model.config import Sampling
from latentmotion.runtime.session import Session


@runtime_checkable
class Padding(Protocol):
    """The sizes to which a batch is filled."""

    def rows(self, count: int) -> int:
        """Returns the motions of a batch."""
        ...

    def words(self, count: int) -> int:
        """Returns the words of its condition."""
        ...

    def frames(self, longest: int) -> int:
        """Returns its frames."""
        ...


class Exact:
    """A batch stays as large as it is."""

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
    """Runs functions of arrays."""

    def __call__(self, name: Hashable, function: Callable[..., Any], *inputs: Any) -> Any:
        """Returns the function's output.

        Args:
            name: Equal for functions that do the same.
            function: What is run.
            inputs: Its inputs.
        """
        ...


def directly(name: Hashable, function: Callable[..., Any], *inputs: Any) -> Any:
    """Runs a function as any other."""
    return function(*inputs)


@dataclass(frozen=True)
class Batch:
    """What a backend's networks are given for one batch: arrays of its library, on its device."""

    noise: Float[Any, "batch tokens width"]
    """Where sampling starts."""
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
        """What steers the motions."""
        return Conditioning(self.words, self.words_mask)


@dataclass(frozen=True)
class Backend:
    """Sessions that take and give arrays of one library on one device."""

    denoiser: Session
    """Network: z, t, words, words_mask, mask → prediction."""
    decoder: Session
    """Network: latents, mask → normalized features."""
    fused: Mapping[int, Session] = field(default_factory=dict)
    """Fused samplers, from noise to features in one graph, by number of steps."""
    padding: Padding = field(default_factory=Exact)
    """The sizes to which batches are filled."""
    launch: Launcher = directly
    """Runs functions of arrays."""
    place: Callable[[np.ndarray], Any] = np.asarray
    """Host array to an array of the sessions'."""
    fetch: Callable[[Any], np.ndarray] = np.asarray
    """Array of the sessions' to a host array."""

    def run_fused(self, batch: Batch, sampling: Sampling) -> Float[Any, "batch frames features"]:
        """Generates features by the fused sampler for so many steps."""
        guidance = np.full(len(batch.noise), sampling.guidance, np.float32)
        return self.fused[sampling.steps](
            noise=batch.noise,
            words=batch.words,
            words_mask=batch.words_mask,
            mask=batch.tokens,
            frames=batch.frames,
            guidance=self.place(guidance),
        )
