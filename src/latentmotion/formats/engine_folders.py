"""Folders that Godot 4 and Unity import without a click: settings and a script beside the figure.

Godot reads `.import` files beside its assets, so loops are loops at once; the scene moves by the
root motion. Unity asks the scripts of a project how a model is imported, when they are compiled.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from latentmotion.storage.files import atomic_file

Clip = Mapping[str, Any]
"""An entry of a set's table: state, loop, seconds, events."""

_TEMPLATES = Path(__file__).with_name("engine_templates")


def write_godot(figure: Path, clips: Sequence[Clip], root: str, fps: float) -> list[Path]:
    """Writes what Godot 4 needs beside a `.glb`: import settings, a scene, its script.

    Args:
        figure: The `.glb`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
        fps: Frames per second of the clips.
    """
    loops = {clip["state"]: {"settings/loop_mode": 1} for clip in clips if clip["loop"]}
    events = {
        clip["state"]: [[round(event["time"], 4), event["event"]] for event in clip["events"]]
        for clip in clips
    }
    script = figure.with_suffix(".gd")
    return [
        _written(
            figure.with_name(figure.name + ".import"),
            "godot.import",
            FPS=f"{fps:g}",
            SETTINGS=json.dumps({"animations": loops}, indent=0),
        ),
        _written(
            script,
            "godot.gd",
            NAME=figure.stem,
            ROOT=json.dumps(root),
            EVENTS=json.dumps(events),
            FIRST=json.dumps(clips[0]["state"]),
        ),
        _written(
            figure.with_suffix(".tscn"),
            "godot.tscn",
            SCRIPT=json.dumps(script.name),
            FIGURE=json.dumps(figure.name),
            NAME=json.dumps(figure.stem),
        ),
    ]


def write_unity(figure: Path, clips: Sequence[Clip], root: str) -> list[Path]:
    """Writes what Unity needs beside an `.fbx`: a script of the editor that sets its import.

    Args:
        figure: The `.fbx`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
    """
    rows = []
    for clip in clips:
        times = ", ".join(f"{event['time'] / clip['seconds']:.5f}f" for event in clip["events"])
        what = ", ".join(json.dumps(event["event"]) for event in clip["events"])
        name, loops = json.dumps(clip["state"][:40].strip()), str(clip["loop"]).lower()
        rows.append(
            f"        new Known {{ name = {name}, loops = {loops}, times = new float[] "
            f"{{ {times} }}, what = new string[] {{ {what} }} }},"
        )
    return [
        _written(
            figure.parent / "Editor" / f"{figure.stem}Import.cs",
            "unity.cs",
            NAME=figure.stem,
            CLASS=re.sub(r"\W", "_", f"Import_{figure.stem}"),
            CLIPS="\n".join(rows),
            FILE=json.dumps(figure.name),
            ROOT=json.dumps(root or "-"),
        )
    ]


def _written(path: Path, name: str, **values: str) -> Path:
    """Writes a template, of which the dollar words are replaced."""
    template = (_TEMPLATES / name).read_text(encoding="utf-8")
    text = re.sub(r"\$([A-Z]+)\b", lambda match: values[match[1]], template)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path
