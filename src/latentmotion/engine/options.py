"""Execution options: device, precision and launch mode of a pipeline on PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from latentmotion.errors import InputError

Precision = Literal["float32", "bfloat16"]
"""Precision of matrix products and convolutions, and of the activations computed from them alone;
the output is float32."""

Launch = Literal["eager", "graph", "compiled"]
"""How work reaches a device: kernel by kernel; as CUDA graphs, one launch for the whole chain; or
fused by torch.compile, on a GPU as graphs of that. The latter two pay off where shapes repeat."""


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
    """How work reaches the device."""

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


ON_CPU = ExecutionOptions()
"""The options by default."""
