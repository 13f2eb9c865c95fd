"""Marks of a motion on its page: goals, path, keyframes and prompts, by its metadata."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from latentmotion.motion import Motion

_MOST = 500
"""Most marks of one kind that the page draws."""

_POSE = 12
"""Goals at one time from which on they count as a whole pose."""


def marks_of(motion: Motion) -> dict[str, Any]:
    """Returns goals and spans of a motion's metadata for the page; absent kinds are left out.

    Metadata may come from any file: what is not of the expected form is left out, too.

    Returns:
        `goals`: joint, at (seconds) and to (meters); `path`: at and to (x and z) of the points that
        the pelvis passes; `poses`: seconds of keyframes; `spans`: prompt, start and end (seconds),
        and the part of the body if it is of one.
    """
    goals = [goal for goal in _entries(motion, "goals") if _is_goal(goal, motion)]
    times = [goal["at"] for goal in goals]
    poses = sorted({at for at in times if times.count(at) >= _POSE})
    path, points = [], []
    for goal in goals:
        (x, y, z), at = goal["to"], float(goal["at"])
        if at in poses:
            continue
        if goal["joint"] == motion.skeleton.names[0] and y is None and None not in (x, z):
            path.append({"at": at, "to": [float(x), float(z)]})
            continue
        joint = motion.skeleton.names.index(goal["joint"])
        current = motion.joints[min(round(at * motion.fps), len(motion) - 1), joint].tolist()
        # A coordinate that is free is where the joint is.
        to = [current[n] if value is None else float(value) for n, value in enumerate((x, y, z))]
        points.append({"joint": goal["joint"], "at": at, "to": [round(v, 4) for v in to]})
    if path and path[0]["at"] > 0:
        path.insert(0, {"at": 0.0, "to": [round(float(v), 4) for v in motion.joints[0, 0, ::2]]})
    spans = [
        {"prompt": span["prompt"], "start": float(span["start"]), "end": float(span["end"])}
        | ({"part": span["part"]} if isinstance(span.get("part"), str) else {})
        for span in _entries(motion, "spans")
        if isinstance(span.get("prompt"), str)
        and _is_number(span.get("start"))
        and _is_number(span.get("end"))
        and 0 <= span["start"] < span["end"] <= motion.seconds + 1
    ]
    kinds = {"goals": points, "path": path, "poses": [float(at) for at in poses], "spans": spans}
    return {name: marks[:_MOST] for name, marks in kinds.items() if marks}


def _entries(motion: Motion, name: str) -> Iterable[Mapping[str, Any]]:
    entries = motion.metadata.get(name)
    return (
        [entry for entry in entries if isinstance(entry, Mapping)]
        if isinstance(entries, list)
        else []
    )


def _is_goal(goal: Mapping[str, Any], motion: Motion) -> bool:
    at, to = goal.get("at"), goal.get("to")
    return (
        goal.get("joint") in motion.skeleton.names
        and _is_number(at)
        and 0 <= float(at or 0) <= motion.seconds
        and isinstance(to, list | tuple)
        and len(to) == 3
        and all(value is None or _is_number(value) for value in to)
    )


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and abs(value) < 1e6
    )
