"""Files as version 1 wrote them, made from those of today by the inverse of the reader's table."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import onnx

from latentmotion.condition.task import TASKS
from latentmotion.model.version_1 import INPUTS, KEYS, KINDS

OLD_KINDS = {kind: old for old, kind in KINDS.items()}

OLD_WEIGHTS = {
    r"\bstep_embedding\.step_size\.": "leaps.stride.",
    r"\bstep_embedding\.": "leaps.",
    r"\bpositions\.": "places.",
    r"\bposition\.": "place.",
}
"""Pattern of names of weights → their old names."""


def downgraded(data: Any) -> Any:
    """Returns plain JSON with the names of version 1."""
    if isinstance(data, list):
        return [downgraded(item) for item in data]
    if not isinstance(data, dict):
        return data
    kind = data.get("kind", "")
    keys = {key: old for old, key in KEYS.get(kind, {}).items()}
    fields = {keys.get(key, key): downgraded(value) for key, value in data.items()}
    return fields | {"kind": OLD_KINDS.get(kind, kind)} if kind else fields


def write_version_1_card(folder: Path) -> None:
    """Rewrites a folder's `model.json`."""
    card = downgraded(json.loads((folder / "model.json").read_text()))
    (task,) = (name for name, cls in TASKS.items() if cls.__name__ == card["condition"]["kind"])
    sampling = card.pop("sampling")
    card |= {key: sampling[key] for key in ("steps", "guidance", "sampler")}
    card |= {"task": task, "format": 1, "denoiser": card["denoiser"] or {}}
    condition = {key: value for key, value in card["condition"].items() if key != "kind"}
    if task != "text":
        condition = {"kind": task, **condition}
    card["condition"] = condition if card["denoiser"] else {}
    (folder / "model.json").write_text(json.dumps(card))


def write_version_1_weights(path: Path) -> None:
    """Renames the weights of a file; each stays at its place, where graphs look for it."""
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = {_old_weight(name): entry for name, entry in json.loads(data[8 : 8 + size]).items()}
    # Old names are shorter; spaces after the header are allowed.
    path.write_bytes(
        data[:8] + json.dumps(header, separators=(",", ":")).encode().ljust(size) + data[8 + size :]
    )


def write_version_1_model(folder: Path) -> None:
    """Rewrites a model folder: card, weights, names of graphs and of their inputs."""
    write_version_1_card(folder)
    write_version_1_weights(folder / "weights.safetensors")
    for path in folder.glob("fused_*.onnx"):
        path.rename(folder / path.name.replace("fused", "walk"))
    if (folder / "denoiser.onnx").is_file():
        graph = onnx.load(folder / "denoiser.onnx", load_external_data=False)
        for node in graph.graph.node:
            node.input[:] = [INPUTS.get(name, name) for name in node.input]
        for given in graph.graph.input:
            given.name = INPUTS.get(given.name, given.name)
        onnx.save(graph, folder / "denoiser.onnx")


def write_version_1_run(folder: Path) -> None:
    """Rewrites a run folder's `experiment.json`, snapshot and trajectories."""
    import torch

    path = folder / "experiment.json"
    data = downgraded(json.loads(path.read_text()))
    data.pop("format")
    path.write_text(json.dumps(data))
    if (folder / "snapshot.pt").is_file():
        state = torch.load(folder / "snapshot.pt", weights_only=True)
        for part in ("network", "average"):
            state[part] = {_old_weight(name): value for name, value in state[part].items()}
        torch.save(state, folder / "snapshot.pt")
    if (folder / "trajectories.safetensors").is_file():
        (folder / "trajectories.safetensors").rename(folder / "ways.safetensors")


def _old_weight(name: str) -> str:
    for pattern, old in OLD_WEIGHTS.items():
        name = re.sub(pattern, old, name)
    return name
