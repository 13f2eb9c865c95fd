"""Where a trained model comes from: data, license, commands, hours, machine."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import torch
import torch.distributed

from latentmotion.data.dataset import Dataset
from latentmotion.model.card import Provenance


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
        license=_license([source.license for source in sources]),
        commands=(*before.commands, command_line()),
        commit=commit(),
        machine=describe_machine(),
        hours=round(before.hours + seconds / 3600, 3),
    )


def command_line() -> str:
    """Returns the command that runs, as a shell would take it."""
    program = "latentmotion" if Path(sys.argv[0]).name == "__main__.py" else Path(sys.argv[0]).name
    return shlex.join([program, *sys.argv[1:]])


def describe_machine() -> str:
    """Returns processor, processes with their threads, devices and PyTorch's version."""
    world = torch.distributed.get_world_size() if torch.distributed.is_initialized() else 1
    parts = [_processor(), f"{world} processes of {torch.get_num_threads()} threads"]
    if torch.cuda.is_available():
        parts.append(f"{torch.cuda.device_count()} x {torch.cuda.get_device_name()}")
    return ", ".join([*parts, f"PyTorch {torch.__version__}"])


def _license(licenses: list[str]) -> str:
    return "; ".join(dict.fromkeys(licenses)) or "unknown"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def commit() -> str:
    """Returns the commit of this code; empty where it is not in a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
