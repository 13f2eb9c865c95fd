"""Where a trained model comes from: data, license, commands, hours, machine."""

from __future__ import annotations

from dataclasses import replace

from latentmotion.data.dataset import Dataset
from latentmotion.model.card import Provenance
from latentmotion.runtime.device import describe_machine
from latentmotion.storage.provenance import command_line, commit


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
