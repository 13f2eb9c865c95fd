"""Joints → description: all measurements of a motion."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from latentmotion.kinematics.skeleton import Joints
from latentmotion.measure import limbs, whole_body
from latentmotion.measure.facts import FPS, LEFT, RIGHT, TABLES, Description, Event, of_kind
from latentmotion.measure.signals import Signals, activity_of, measure, peaks, twist_of


def describe(joints: Joints) -> Measured:
    """Measures what a motion does.

    Args:
        joints: Positions of HumanML3D's 22 joints at 20 frames per second, meters, y up, the
            floor at zero; the body as large as HumanML3D's (pelvis at 0.92 m when it stands).

    Raises:
        InputError: The joints have another shape, fewer than 4 frames, or are not numbers.
    """
    return Measured(measure(joints))


# What is measured by one detector, and the kinds of events that it finds.
_SOURCES = TABLES["sources"]


def _lazy(function: Callable[[Measured], Any]) -> Any:
    """Returns a property that is measured when it is first asked for, in place of a field."""
    return cached_property(function)


def _of_signals(function: Callable[[Signals], Any]) -> Any:
    """Returns such a property that is measured from the signals alone."""
    return _lazy(lambda scene: function(scene.signals))


def _order(event: Event) -> tuple[int, str, str]:
    return event.start, event.kind, event.side


class Measured(Description):
    """A description whose facts are measured when they are first asked for.

    A sentence asks for a few of them, and to measure all takes longer than all networks.

    Args:
        signals: The curves that they are measured from.
    """

    signals: Signals

    def __init__(self, signals: Signals) -> None:
        # The class is frozen, as descriptions are, and lets only cached properties in.
        self.__dict__.update(signals=signals, frames=signals.frames)

    def find(self, kind: str) -> tuple[Event, ...]:
        """Returns the moves, turns, postures and events of a kind, by start."""
        facts = (getattr(self, name) for name, kinds in _SOURCES.items() if kind in kinds)
        return of_kind(chain.from_iterable(sorted(each, key=_order) for each in facts), kind)

    def all_of(self, *kinds: str) -> list[Event]:
        """Returns the events, moves, turns, postures and poses of some kinds, by start."""
        events = [event for kind in kinds for event in self.find(kind)]
        if not whole_body.POSES.isdisjoint(kinds):
            events += [pose for pose in self.poses if pose.kind in kinds]
        return sorted(events, key=lambda event: event.start)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """All that is neither a move nor a turn nor a posture, by start."""
        events = (event for source in list(_SOURCES)[3:] for event in getattr(self, source))
        return tuple(sorted(events, key=_order))

    @cached_property
    def moves(self) -> tuple[Event, ...]:
        """Gaits and pauses, one after another without gaps."""
        return whole_body.moves_of(self.signals, self.running, limbs.treading_of(self.signals))

    running = _lazy(lambda scene: limbs.running_of(scene.flights, scene.signals))
    jumps = _lazy(lambda scene: limbs.jumps_of(scene.signals, scene.flights, scene.running))
    knees = _lazy(lambda scene: limbs.knees_of(scene.signals, scene.kicks))
    changes = _lazy(lambda scene: whole_body.changes_of(scene.postures))
    dips = _lazy(lambda scene: whole_body.dips_of(scene.signals, scene.changes))
    path = _of_signals(whole_body.path_of)
    turns = _of_signals(whole_body.turns_of)
    postures = _of_signals(whole_body.postures_of)
    flights = _of_signals(limbs.flights_of)
    kicks = _of_signals(limbs.kicks_of)
    balances = _of_signals(limbs.balances_of)
    climbs = _of_signals(limbs.climbs_of)
    raises = _of_signals(limbs.raises_of)
    waves = _of_signals(limbs.waves_of)
    punches = _of_signals(limbs.punches_of)
    arm_circles = _of_signals(limbs.arm_circles_of)
    claps = _of_signals(limbs.claps_of)
    steps = _of_signals(lambda signals: len(limbs.strides_of(signals)))
    twist = _of_signals(twist_of)
    activity = _of_signals(activity_of)
    poses = _of_signals(whole_body.poses_of)


def lasting(events: list[Event], seconds: float) -> list[Event]:
    """Returns the events that last so many seconds or longer."""
    return [event for event in events if event.frames >= seconds * FPS]


def in_place(scene: Measured, most: float) -> bool:
    """Whether the pelvis stays within `most` meters of its median position."""
    points = scene.signals.joints[:, 0, ::2]
    return float(np.linalg.norm(points - np.median(points, axis=0), axis=1).max()) <= most


def swings(scene: Measured, degrees: float) -> int:
    """Returns how often the direction of travel swings to a side by so many degrees."""
    left, ahead = scene.signals.velocity.T
    # Radians without jumps, of the frames in which it travels.
    course = np.unwrap(scene.signals.heading + np.arctan2(left, ahead))
    course = np.degrees(course)[scene.signals.speed > 0.3]
    if len(course) < 2:
        return 0
    return sum(len(peaks(curve - curve.min(), 0, degrees)) for curve in (course, -course))


def meters(scene: Measured) -> dict[str, float]:
    """Returns the distance, meters, that the pelvis goes in each direction of the body."""
    left, ahead = scene.signals.velocity.T / FPS
    sideways, forward = np.abs(left) > np.abs(ahead), np.abs(ahead) >= np.abs(left)
    return {
        "forward": float(ahead[forward & (ahead > 0)].sum()),
        "backward": float(-ahead[forward & (ahead < 0)].sum()),
        LEFT: float(left[sideways & (left > 0)].sum()),
        RIGHT: float(-left[sideways & (left < 0)].sum()),
    }
