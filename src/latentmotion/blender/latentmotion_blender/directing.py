"""Directing: empties, a curve and markers of a Blender scene as a scene file of the command.

    empty named right_wrist, or with a property "joint"  a goal at each keyframe of its place, or at
                                                         the frame of its property "frame"
    curve named path                                     the path of the pelvis
    markers                                              prompts of a timeline, each until the next

Functions here take plain values; what Blender has is read by `read_goals` and its kin from any
objects with the same attributes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

# Joints that may have goals.
JOINTS = frozenset(
    ["pelvis", "spine1", "spine2", "spine3", "neck", "head"]
    + [
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")
    ]
)

# Points of a path between two points of a Bézier curve.
_BETWEEN = 4


@dataclass(frozen=True)
class Place:
    """Where and when the motion begins in the Blender scene."""

    origin: tuple[float, float, float]  # Point of the world above which it begins, meters; z is up.
    heading: float  # Rotation of the figure about z, radians.
    start: int  # Frame of its first frame.
    fps: float  # Frames per second.

    def inside(self, point: Sequence[float]) -> tuple[float, float, float]:
        """Returns a point of the world as the motion has it: y up, from its start, facing +z."""
        x, y, z = (float(a) - b for a, b in zip(point, self.origin, strict=True))
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        ahead, up, side = -(cosine * y - sine * x), z, cosine * x + sine * y
        return round(side, 5), round(up, 5), round(ahead, 5)

    def seconds(self, frame: float) -> float:
        """Returns the time of a frame."""
        return round((frame - self.start) / self.fps, 5)


@dataclass(frozen=True)
class Goal:
    """A joint at a point of the world in a frame."""

    joint: str  # Name of the joint.
    frame: float  # The frame.
    point: tuple[float, float, float]  # The point, meters; z is up.


def goal_scene(
    prompt: str,
    seconds: float,
    goals: Iterable[Goal],
    path: Sequence[Sequence[float]],
    origin: Place,
) -> dict[str, Any]:
    """Returns the scene file of a prompt with goals.

    Args:
        prompt: What the person does.
        seconds: Length of the motion.
        goals: Places of joints.
        path: Points of the world that the pelvis passes; none without a path.
        origin: Place, heading and frame at which the motion begins.

    Raises:
        ValueError: There is neither goal nor path, or a goal is before the start.
    """
    entries = []
    for goal in sorted(goals, key=lambda goal: goal.frame):
        if goal.frame < origin.start:
            raise ValueError(
                f"{goal.joint} has a goal in frame {goal.frame:g}, before the scene's first, "
                f"{origin.start}: move its key or the scene's start"
            )
        at, to = origin.seconds(goal.frame), list(origin.inside(goal.point))
        entries.append({"joint": goal.joint, "at": at, "to": to})
    scene: dict[str, Any] = {"format": 1, "prompt": prompt, "seconds": seconds, "goals": entries}
    if len(path):
        points = [origin.inside(point) for point in path]
        scene["path"] = {"points": [[x, z] for x, _, z in points]}
    elif not entries:
        raise ValueError(
            "no goals: name an empty after a joint, such as right_wrist, and key its location, or "
            "name a curve path"
        )
    return scene


def marker_scene(
    prompt: str, markers: Iterable[tuple[str, int]], origin: Place, end: int
) -> dict[str, Any]:
    """Returns the scene file of a timeline.

    Args:
        prompt: What the person does before the first marker.
        markers: Prompt and frame of each.
        origin: Place, heading and frame at which the motion begins.
        end: Frame at which the last prompt ends; without frames left it is as long as its sentence
            takes.

    Raises:
        ValueError: There are no prompts, or two at one frame.
    """
    prompts = sorted((max(frame, origin.start), name.strip()) for name, frame in markers)
    # Blender calls a marker F_12 until it is named.
    prompts = [(frame, name) for frame, name in prompts if name and not name.startswith("F_")]
    if not prompts:
        raise ValueError(
            "no markers: add some (M) and name them what the person does from there on"
        )
    if prompts[0][0] > origin.start and prompt.strip():
        prompts.insert(0, (origin.start, prompt.strip()))
    spans = []
    for (frame, name), (after, other) in zip(prompts, [*prompts[1:], (end + 1, "")], strict=True):
        if other and after == frame:
            raise ValueError(f"the markers {name!r} and {other!r} are at one frame: move one")
        lasts = {"seconds": round((after - frame) / origin.fps, 5)} if after > frame else {}
        spans.append({"prompt": name, **lasts})
    return {"format": 1, "timeline": spans}


def write_scene(scene: dict[str, Any], path: Path) -> None:
    """Writes a scene file."""
    path.write_text(json.dumps(scene, indent=1), encoding="utf-8")


def joint_of(empty: Any) -> str | None:
    """Returns the joint whose goal an empty is, by its property `joint` or its name.

    Raises:
        ValueError: The property names no joint.
    """
    if empty.type != "EMPTY":
        return None
    joint = empty.get("joint")
    if joint is None:
        name = empty.name.partition(".")[0]
        return name if name in JOINTS else None
    if joint not in JOINTS:
        raise ValueError(
            f"{empty.name} has the joint {joint!r}; known are {', '.join(sorted(JOINTS))}"
        )
    return str(joint)


def frames_of(empty: Any, curves: Iterable[Any]) -> list[float]:
    """Returns the frames of an empty's goals: of its property, or of the keys of its location.

    Args:
        empty: The empty.
        curves: Its animation curves.

    Raises:
        ValueError: It has neither.
    """
    if empty.get("frame") is not None:
        return [float(empty["frame"])]
    keys = {
        float(key.co[0])
        for curve in curves
        if curve.data_path == "location"
        for key in curve.keyframe_points
    }
    if not keys:
        raise ValueError(
            f"{empty.name} has no time: key its location, or give it a custom property frame"
        )
    return sorted(keys)


def path_points(splines: Sequence[Any]) -> list[tuple[float, float, float]]:
    """Returns points along the spline of a curve, in the curve's own space.

    Raises:
        ValueError: There is not exactly one, or it is of a kind whose points are not on it.
    """
    if len(splines) != 1:
        raise ValueError(f"the curve path has {len(splines)} splines: it needs one")
    (spline,) = splines
    if spline.type == "POLY":
        return [tuple(float(value) for value in point.co[:3]) for point in spline.points]
    if spline.type != "BEZIER":
        raise ValueError(f"the curve path is of type {spline.type}: make it Bezier or Poly")
    points = list(spline.bezier_points)
    curve = [np.array(points[0].co, float)]
    for start, end in pairwise(points):
        a, b, c, d = (
            np.array(each, float)
            for each in (start.co, start.handle_right, end.handle_left, end.co)
        )
        for t in np.linspace(0, 1, _BETWEEN + 2)[1:]:
            u = 1 - t
            curve.append(u**3 * a + 3 * u * u * t * b + 3 * u * t * t * c + t**3 * d)
    return [tuple(point.tolist()) for point in curve]
