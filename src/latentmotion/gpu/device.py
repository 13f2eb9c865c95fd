"""Devices of PyTorch by the names that users type, and a description of the machine."""

from __future__ import annotations

import torch
import torch.distributed

from latentmotion.errors import InputError
from latentmotion.storage.provenance import processor

GPU = torch.cuda.__name__.rpartition(".")[2]
"""PyTorch's name for the type of NVIDIA's GPUs."""


def default_device() -> str:
    """Returns the name of the GPU, if there is one, else of the CPU."""
    return GPU if torch.cuda.is_available() else "cpu"


def device_named(name: str) -> torch.device:
    """Returns a device after checking that it works.

    Raises:
        InputError: There is no such device here.
    """
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"no device {name!r} here: {error}; try --device cpu") from error
    return torch.device(name)


def describe_machine() -> str:
    """Returns processor, processes with their threads, devices and PyTorch's version."""
    world = torch.distributed.get_world_size() if torch.distributed.is_initialized() else 1
    parts = [processor(), f"{world} processes of {torch.get_num_threads()} threads"]
    if torch.cuda.is_available():
        parts.append(f"{torch.cuda.device_count()} x {torch.cuda.get_device_name()}")
    return ", ".join([*parts, f"PyTorch {torch.__version__}"])
