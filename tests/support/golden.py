"""The inputs and weights of the golden runs, by the formulas that made them."""

from __future__ import annotations

import zlib

import numpy as np
import torch
from torch import Tensor


def relative(found: Tensor, expected: np.ndarray) -> float:
    difference = np.linalg.norm(found.detach().numpy() - expected)
    return float(difference / np.linalg.norm(expected))


def prefix_mask(lengths: list[int], frames: int) -> Tensor:
    return torch.arange(frames) < torch.tensor(lengths)[:, None]


def formula(key: str, shape: tuple[int, ...]) -> np.ndarray:
    """Weights that the golden run used; see shared/reference/README.md."""
    seed = zlib.crc32(("public" + key).encode())
    values = np.random.Generator(np.random.PCG64(seed)).standard_normal(shape, dtype=np.float32)
    if len(shape) > 2 and not key.endswith(".pe"):
        return values * np.float32(1 / np.sqrt(np.prod(shape[1:])))
    if len(shape) >= 2:
        return values * np.float32(1 / np.sqrt(shape[-1]))
    kind = key.split(".")[-2] if "." in key else ""
    is_norm = kind.startswith(("norm", "bn")) and key.endswith("weight")
    return 1 + np.float32(0.1) * values if is_norm else np.float32(0.1) * values


def golden_input(name: str, shape: tuple[int, ...]) -> Tensor:
    seed = zlib.crc32(f"publicinput:{name}".encode())
    generator = np.random.Generator(np.random.PCG64(seed))
    return torch.from_numpy(generator.standard_normal(shape, dtype=np.float32))
