"""Where and how PyTorch computes, in the words that users choose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from latentmotion.errors import InputError

Precision = Literal["float32", "bfloat16"]
"""Of matrix products and convolutions, and of what is computed from theirs alone, as activations;
what comes out is float32."""

Launch = Literal["eager", "graph", "compiled"]
"""How work reaches a device: kernel by kernel; as CUDA graphs, one launch for the whole chain; or
fused by torch.compile, and on a GPU as graphs of that. The latter two pay where shapes repeat."""


@dataclass(frozen=True)
class Computing:
    """The place, the precision and the way of launching.

    Raises:
        InputError: They do not go together.
    """

    device: str = "cpu"
    """PyTorch's name, e.g. `cuda` or `cuda:1`."""
    precision: Precision = "float32"
    """Of matrix products and convolutions."""
    launch: Launch = "eager"
    """How work reaches the device."""

    def __post_init__(self) -> None:
        if self.launch == "graph" and not self.on_gpu:
            raise InputError(
                f"launch graph on device {self.device!r}: CUDA graphs need cuda; "
                "use launch eager or compiled"
            )

    def __str__(self) -> str:
        return f"{self.device}, {self.precision}, {self.launch}"

    @property
    def on_gpu(self) -> bool:
        """Whether the device is one of CUDA's."""
        return self.device.partition(":")[0] == "cuda"


ON_CPU = Computing()
"""What is taken where nothing is said."""
