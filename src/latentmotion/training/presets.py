"""Experiments ready to train, which `presets.toml` holds, and those of files of settings."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from latentmotion.errors import InputError, hint
from latentmotion.storage.configuration import from_json, read_plain, to_json
from latentmotion.storage.reading import read_text
from latentmotion.training.experiment import Experiment

_TABLE = tomllib.loads(Path(__file__).with_name("presets.toml").read_text(encoding="utf-8"))

PRESETS = tuple(_TABLE)
"""Names of the presets."""


def preset_named(name: str) -> Experiment:
    """Returns a preset, or what a file of settings says.

    Args:
        name: Name of a preset; or a file that ends with .json or .toml: the settings that differ
            from those of a preset, which it names as `preset` (by default starter). The
            `experiment.json` of a run folder is such a file.

    Raises:
        InputError: There is none of this name; the nearest is named. Or the file cannot be read,
            or does not fit.
    """
    if not name.lower().endswith((".json", ".toml")):
        if name not in _TABLE:
            raise InputError(f"unknown preset {name!r}; {hint(name, PRESETS)}")
        return _with_base({"name": name, **_TABLE[name]})
    path = Path(name)
    if path.suffix.lower() == ".json":
        data = read_plain(path)
    else:
        try:
            data = tomllib.loads(read_text(path))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path}: {error}") from error
    if isinstance(data, dict) and isinstance(data.get("experiment"), dict):
        data = data["experiment"]  # of a run folder
    if not isinstance(data, dict):
        raise InputError(f'{path}: expected an object of settings, e.g. {{"mirrored": false}}')
    preset_named(str(data.setdefault("preset", "starter")))  # its errors do not name this file
    try:
        return _with_base(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def with_settings(experiment: Experiment, settings: Mapping[str, Any]) -> Experiment:
    """Returns an experiment with those of nested settings in the place of its own.

    Raises:
        InputError: A key is unknown (the nearest is named) or a value is not of its kind.
    """
    return from_json(Experiment, _changed(to_json(experiment), settings))


def _with_base(data: Mapping[str, Any]) -> Experiment:
    settings = {key: value for key, value in data.items() if key != "preset"}
    if "preset" in data:
        return with_settings(preset_named(str(data["preset"])), settings)
    return from_json(Experiment, _changed({}, settings))


def _changed(before: Any, after: Any) -> Any:
    """Returns settings with those of another object in their place; other kinds replace them."""
    if not isinstance(after, Mapping):
        return None if after == "null" else after  # TOML has no null
    base = dict(before) if isinstance(before, Mapping) else {}
    if after.get("kind", base.get("kind")) != base.get("kind"):
        base = {}
    return base | {key: _changed(base.get(key), value) for key, value in after.items()}
