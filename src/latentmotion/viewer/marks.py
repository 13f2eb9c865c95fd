"""Marks of a motion on its page: goals, path, keyframes and prompts, by its metadata."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from latentmotion.motion import Motion

_MOST = 500
"""Most marks of one kind that the page draws."""


def marks_of(motion: Motion) -> dict[str, Any]:
    """Returns goals and spans of a motion's metadata for the page; absent kinds are left out.

    Metadata may come from any file: what is not of the expected form is left out, too.

    Returns:
        `goals`: joint, at (seconds) and to (meters); `path`: at and to (x and z) of the points that
        the pelvis passes; `poses`: seconds of keyframes; `spans`: prompt, start and end (seconds),
        and the part of the body if it is of one.
    """
    goals = list(_entries(motion, "goals"))
    poses = sorted({float(g["at"]) for g in goals if "pose" in g and _is_time(g.get("at"), motion)})
    path, points = [], []
    for goal in goals:
        if not _is_goal(goal, motion):
            continue
        (x, y, z), at = goal["to"], float(goal["at"])
        if goal["joint"] == motion.skeleton.names[0] and y is None and None not in (x, z):
            path.append({"at": at, "to": [float(x), float(z)]})
            continue
        joint = motion.skeleton.names.index(_joint(goal))
        current = motion.joints[min(round(at * motion.fps), len(motion) - 1), joint].tolist()
        # A coordinate that is free is where the joint is.
        to = [current[n] if value is None else float(value) for n, value in enumerate((x, y, z))]
        points.append({"joint": _joint(goal), "at": at, "to": [round(v, 4) for v in to]})
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
    kinds = {"goals": points, "path": path, "poses": poses, "spans": spans}
    return {name: marks[:_MOST] for name, marks in kinds.items() if marks}


def _entries(motion: Motion, name: str) -> Iterable[Mapping[str, Any]]:
    entries = motion.metadata.get(name)
    return (
        [entry for entry in entries if isinstance(entry, Mapping)]
        if isinstance(entries, list)
        else []
    )


def _joint(goal: Mapping[str, Any]) -> Any:
    """Returns the joint of a goal; of a hand's it is the wrist."""
    joint = goal.get("joint")
    if not isinstance(joint, str):
        return None
    return joint.replace("_hand", "_wrist").replace("_fingertips", "_wrist")


def _is_goal(goal: Mapping[str, Any], motion: Motion) -> bool:
    at, to = goal.get("at"), goal.get("to")
    return (
        _joint(goal) in motion.skeleton.names
        and "relative_to" not in goal
        and _is_time(at, motion)
        and isinstance(to, list | tuple)
        and len(to) == 3
        and all(value is None or _is_number(value) for value in to)
    )


def _is_time(at: Any, motion: Motion) -> bool:
    return _is_number(at) and 0 <= at <= motion.seconds


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and abs(value) < 1e6
    )
