"""A motion as checks see it: the describer's facts and curves, and poses beyond its list."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.describe.facts import FPS, Description, Event
from latentmotion.describe.poses import poses_of
from latentmotion.describe.reading import describe
from latentmotion.describe.signals import Signals, measure


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything measured about one motion."""

    facts: Description
    """What the describer finds."""
    signals: Signals
    """The curves it is found in."""
    poses: tuple[Event, ...]
    """Poses and exercises of the whole body."""

    def find(self, *kinds: str) -> list[Event]:
        """Returns everything of some kinds, by start."""
        found = [event for kind in kinds for event in self.facts.find(kind)]
        found += [pose for pose in self.poses if pose.kind in kinds]
        return sorted(found, key=lambda event: event.start)


def scene_of(joints: Float[np.ndarray, "frames 22 3"]) -> Scene:
    """Measures a motion.

    Args:
        joints: Positions of HumanML3D's joints at 20 frames per second, meters, y up.

    Raises:
        InputError: The joints have another shape, too few frames, or are not numbers.
    """
    signals = measure(joints)
    return Scene(describe(joints), signals, poses_of(signals))


def lasting(events: list[Event], seconds: float) -> list[Event]:
    """Returns the events that are not shorter."""
    return [event for event in events if event.frames >= seconds * FPS]
