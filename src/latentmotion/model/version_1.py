"""The reader of version 1: names in files that earlier releases wrote, and what they are now.

JSON (`model.json`, `experiment.json`) is upgraded before it is read as dataclasses; files, inputs
of graphs and weights are found by their old names. Delete this module, and the lines that call it,
when nobody has such files any more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from latentmotion.condition.task import TASKS, ActionTask
from latentmotion.errors import InputError
from latentmotion.storage.limits import MOST_WIDTH

Value = TypeVar("Value")

KINDS = {
    "Leaps": "FewStepConfig",
    "SentenceReading": "TextConditioning",
    "Regression": "TrajectoryRegression",
}
"""Old name of a dataclass → its name."""

KEYS: dict[str, dict[str, str]] = {
    "ModelCard": {"prediction": "parametrization"},
    "DenoiserConfig": {
        "places": "positions",
        "sees_padding": "attends_to_padding",
        "leaps": "few_step",
    },
    "FewStepConfig": {"of": "solver_steps"},
    "VAEObjective": {"steps": "velocity", "divergence": "kl", "joints_knee": "joints_huber_delta"},
    "DenoiserObjective": {"prediction": "parametrization"},
    "Experiment": {"reading": "conditioning"},
    "TextTask": {"reading": "conditioning"},
    "Distillation": {"leaps": "few_step", "knee": "huber_delta"},
    "TrajectoryRegression": {"ways": "trajectories"},
}
"""Name of a dataclass → old name of a field → its name."""

SAMPLING = ("steps", "guidance", "sampler", "guidance_rule")
"""Keys of a card that belong to its sampling now."""

FILES = {
    re.compile(r"fused_(\d+)\.onnx"): r"walk_\1.onnx",
    re.compile(r"trajectories\.safetensors"): "ways.safetensors",
}
"""Name of a file → its old name."""

INPUTS = {"step_size": "stride"}
"""Input of a graph → its old name."""

WEIGHTS = {
    r"^(denoiser\.|)leaps\.stride\.": r"\1step_embedding.step_size.",
    r"^(denoiser\.|)leaps\.": r"\1step_embedding.",
    r"^(denoiser\.|)places\.": r"\1positions.",
    r"^(vae\.|)((?:decoder\.)?)place\.": r"\1\2position.",
}
"""Pattern of old names of weights → their names."""


def upgraded(data: Any) -> Any:
    """Returns plain JSON of version 1 with the names of today, at any depth."""
    if isinstance(data, list):
        return [upgraded(item) for item in data]
    if not isinstance(data, Mapping):
        return data
    kind = data.get("kind")
    if not isinstance(kind, str):  # told where it is read as a dataclass
        return {key: upgraded(value) for key, value in data.items()}
    kind = KINDS.get(kind, kind)
    keys = KEYS.get(kind, {})
    fields = {keys.get(key, key): upgraded(value) for key, value in data.items()}
    return fields | {"kind": kind}


def upgraded_card(data: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the content of a version 1 `model.json` with the names and the nesting of today.

    Such cards name the task instead of the condition's class, and keep {} for a missing part.

    Raises:
        InputError: The task is missing or unknown.
    """
    card = upgraded({"kind": "ModelCard", **data})
    if "task" not in card:
        raise InputError("missing key 'task'")
    name = card.pop("task")
    if not isinstance(name, str) or name not in TASKS:
        raise InputError(f"task: expected one of {', '.join(TASKS)}, found {name!r}")
    sampling = {key: card.pop(key) for key in SAMPLING if key in card}
    card |= {"sampling": {"guidance": 1.0, **sampling}, "format": 2}
    if "denoiser" in card:
        denoiser = card["denoiser"] or None
        if isinstance(denoiser, Mapping):
            denoiser = upgraded({**denoiser, "kind": "DenoiserConfig"})
        card["denoiser"] = denoiser
    if card.get("vae") == {} and isinstance(card.get("latents"), Mapping):
        # A converted diffusion on raw frames.
        card["vae"] = {"kind": "IdentityVAEConfig", "features": card["latents"].get("width")}
    if isinstance(card.get("condition"), Mapping):
        task, denoiser = TASKS[name], card.get("denoiser")
        condition = {**card["condition"], "kind": task.__name__}
        if task is ActionTask and isinstance(denoiser, Mapping):
            # Old conversions kept the number of actions, which the denoiser has as well. Actions
            # that were converted without names get numbers.
            condition.pop("classes", None)
            width = denoiser.get("condition_width", 0)
            width = width if isinstance(width, int) and 0 <= width <= MOST_WIDTH else 0
            condition["labels"] = condition.get("labels") or [str(n) for n in range(width)]
        card["condition"] = upgraded(condition)
    return card


def upgraded_setting(path: list[str], value: Any, data: Any) -> tuple[list[str], Any]:
    """Returns the path and the value of a setting, given in old names or in those of today.

    Args:
        path: Keys from the outermost to the value's own.
        value: The value, plain JSON.
        data: The plain JSON that the setting changes.
    """
    current: list[str] = []
    for key in path:
        known = data if isinstance(data, Mapping) else {}
        key = key if key in known else KEYS.get(known.get("kind", ""), {}).get(key, key)
        current.append(key)
        data = known.get(key)
    return current, upgraded(value)


def existing(path: Path) -> Path:
    """Returns a file's path, or that of the file's old name where only it is there."""
    for pattern, old in FILES.items():
        if not path.exists() and pattern.fullmatch(path.name):
            before = path.with_name(pattern.sub(old, path.name))
            return before if before.exists() else path
    return path


def inputs_of(known: Iterable[str], inputs: Mapping[str, Value]) -> dict[str, Value]:
    """Returns inputs by the names that a graph knows."""
    names = set(known)
    return {name if name in names else INPUTS.get(name, name): v for name, v in inputs.items()}


def upgraded_weights(weights: Mapping[str, Value]) -> dict[str, Value]:
    """Returns weights by the names of today."""

    def current(name: str) -> str:
        for pattern, replacement in WEIGHTS.items():
            name = re.sub(pattern, replacement, name)
        return name

    return {current(name): value for name, value in weights.items()}
