"""Opening a foreign checkpoint without running the code that may be inside it."""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from latentmotion.errors import ModelError
from latentmotion.upstream.stand_ins import read_with_stand_ins

PARTS = ("vae", "denoiser")
"""First parts of the names that are taken; all others are foreign networks, losses and metrics."""


def read_checkpoint(path: str | Path) -> dict[str, Tensor]:
    """Returns the tensors of a Lightning file's `state_dict`, or of a plain dictionary of tensors.

    Raises:
        ModelError: The file is missing, damaged, of another kind, or holds code.
    """
    content = read_content(Path(path))
    state = content.get("state_dict", content) if isinstance(content, Mapping) else None
    if not isinstance(state, Mapping) or not any(isinstance(v, Tensor) for v in state.values()):
        raise ModelError(f"{path}: no state_dict of tensors inside; is it an MLD checkpoint?")
    return {str(name): value for name, value in state.items() if isinstance(value, Tensor)}


def split_parts(
    state: Mapping[str, Tensor],
) -> tuple[dict[str, dict[str, Tensor]], dict[str, int]]:
    """Returns the tensors of each of `PARTS` without that prefix, and how many others there are."""
    parts = {
        part: {
            name.removeprefix(f"{part}."): tensor.float()
            for name, tensor in state.items()
            if name.startswith(f"{part}.")
        }
        for part in PARTS
    }
    others = Counter(head for head in (name.split(".")[0] for name in state) if head not in PARTS)
    return parts, dict(others)


def read_content(path: Path) -> Any:
    """Returns whatever a PyTorch file holds, without running code.

    Raises:
        ModelError: The file is missing, damaged, of another kind, or holds code.
    """
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise ModelError(f"{path} does not exist") from error
    except pickle.UnpicklingError as error:
        return _read_carefully(path, error)
    except Exception as error:  # a damaged file fails anywhere inside zip, pickle or torch
        raise ModelError(
            f"{path} is no PyTorch checkpoint, or is damaged ({type(error).__name__}: {error}); "
            "download it again"
        ) from error


def _read_carefully(path: Path, problem: Exception) -> Any:
    """Reads the file once more, with nothing in place of the settings of foreign programs."""
    try:
        return read_with_stand_ins(path)
    except pickle.UnpicklingError as error:
        raise ModelError(_unsafe(path, error)) from error
    except Exception as error:  # a damaged file, or one of PyTorch before 1.6, which is no zip
        raise ModelError(_unsafe(path, problem)) from error


def _unsafe(path: Path, error: Exception) -> str:
    first_line = str(error).strip().splitlines()[0]
    return (
        f"{path} is damaged, or holds more than tensors and was not opened, because that could run "
        f'code ({first_line}). If you trust the file, keep its weights alone: python -c "import '
        f"torch; torch.save({{'state_dict': torch.load('{path}', map_location='cpu', "
        "weights_only=False)['state_dict']}, 'weights.ckpt')\""
    )
