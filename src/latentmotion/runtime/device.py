"""Where PyTorch computes, by the name that users know."""

from __future__ import annotations

import torch

from latentmotion.errors import InputError


def device_named(name: str) -> torch.device:
    """Returns a device, after asking it for a number.

    Raises:
        InputError: It is not here.
    """
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"no device {name!r} here: {error}; try --device cpu") from error
    return torch.device(name)
