"""Where a trained model comes from: data, license, commands, hours, machine."""

from __future__ import annotations

from dataclasses import replace

import torch
import torch.distributed

from latentmotion.data.dataset import Dataset
from latentmotion.model_card import Provenance
from latentmotion.storage.provenance import command_line, commit, processor


def provenance_of(dataset: Dataset, seconds: float, before: Provenance | None = None) -> Provenance:
    """Says what the running command makes a model from.

    Args:
        dataset: What it was trained on.
        seconds: How long that took.
        before: Provenance of the model that it builds on.
    """
    sources, before = dataset.sources, before or Provenance()
    hashes = {f"{dataset.folder.name}/manifest.json": dataset.fingerprint}
    return replace(
        before,
        data=tuple(f"{source.name}: {source.credit}" for source in sources),
        data_hashes={**before.data_hashes, **hashes},
        license="; ".join(dict.fromkeys(source.license for source in sources)) or "unknown",
        commands=(*before.commands, command_line()),
        commit=commit(),
        machine=describe_machine(),
        hours=round(before.hours + seconds / 3600, 3),
    )


def describe_machine() -> str:
    """Returns processor, processes with their threads, devices and PyTorch's version."""
    world = torch.distributed.get_world_size() if torch.distributed.is_initialized() else 1
    parts = [processor(), f"{world} processes of {torch.get_num_threads()} threads"]
    if torch.cuda.is_available():
        parts.append(f"{torch.cuda.device_count()} x {torch.cuda.get_device_name()}")
    return ", ".join([*parts, f"PyTorch {torch.__version__}"])
