"""Snapshots: all that a killed run needs to go on, in one file that is whole or absent.

Weights, their average, the optimizer's moments and the number of steps done. The position in the
data and the state of every random generator follow from that number (`randomness.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

from latentmotion.errors import ModelError
from latentmotion.storage.files import atomic_file
from latentmotion.training.ema import ExponentialMovingAverage

NAME = "snapshot.pt"


def save_snapshot(
    folder: Path,
    step: int,
    network: nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
    seconds: float,
) -> None:
    """Writes the snapshot of `folder` after `step` steps and `seconds` of training."""
    state = {
        "step": step,
        "seconds": seconds,
        "network": network.state_dict(),
        "average": average.network.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    with atomic_file(folder / NAME) as temporary:
        torch.save(state, temporary)


def load_snapshot(
    folder: Path,
    network: nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
) -> tuple[int, float]:
    """Restores what `save_snapshot` wrote; returns (steps, seconds) done, zeros without one.

    Raises:
        ModelError: The file is damaged or belongs to other networks.
    """
    path = folder / NAME
    if not path.exists():
        return 0, 0.0
    state = _read(path)
    try:
        network.load_state_dict(state["network"])
        average.network.load_state_dict(state["average"])
        optimizer.load_state_dict(state["optimizer"])
    except (KeyError, RuntimeError, ValueError) as error:
        raise ModelError(
            f"{path} does not fit this network: {error}; use another folder"
        ) from error
    return state["step"], state["seconds"]


def _read(path: Path) -> dict[str, Any]:
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise ModelError(f"{path} is damaged: {error}; delete it to start afresh") from error
