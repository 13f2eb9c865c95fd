"""A motion as checks see it: the describer's facts and curves, and poses beyond its list."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.describe.acts import acts_of
from latentmotion.describe.facts import FPS, LEFT, RIGHT, Description, Event
from latentmotion.describe.poses import poses_of
from latentmotion.describe.reading import describe
from latentmotion.describe.signals import Signals, measure

_POSES = frozenset({"jack", "crawl", "arms_out", "hands_on_hips", "touch_head"})
"""Poses and exercises that are worth telling."""


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


def told_kinds(scene: Scene) -> set[str]:
    """Returns the kinds of what is worth telling of a window."""
    told = {act.kind for act in acts_of(scene.facts)}
    return told | {pose.kind for pose in scene.poses if pose.kind in _POSES and pose.frames >= 10}


def highest_hand(scene: Scene, side: str) -> float:
    """Meters by which a hand gets above its shoulder; negative is below."""
    signals = scene.signals
    return float((signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"))[:, 1].max())


def in_place(scene: Scene, most: float) -> bool:
    """Whether the pelvis stays within so many meters of its middle."""
    way = scene.signals.joints[:, 0, ::2]
    return float(np.linalg.norm(way - np.median(way, axis=0), axis=1).max()) <= most


def meters(scene: Scene) -> dict[str, float]:
    """Returns how far the pelvis goes to each side of the body."""
    left, ahead = scene.signals.velocity.T / FPS
    sideways, forward = np.abs(left) > np.abs(ahead), np.abs(ahead) >= np.abs(left)
    return {
        "forward": float(ahead[forward & (ahead > 0)].sum()),
        "backward": float(-ahead[forward & (ahead < 0)].sum()),
        LEFT: float(left[sideways & (left > 0)].sum()),
        RIGHT: float(-left[sideways & (left < 0)].sum()),
    }
