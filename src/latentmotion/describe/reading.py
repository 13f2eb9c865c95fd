"""Joints → description and scene: all measurements of one motion, put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.describe.acts import acts_of
from latentmotion.describe.arms import arm_circles_of, claps_of, punches_of, raises_of, waves_of
from latentmotion.describe.facts import FPS, LEFT, RIGHT, Description, Event
from latentmotion.describe.legs import (
    balances_of,
    climbs_of,
    flights_of,
    jumps_of,
    kicks_of,
    knees_of,
    running_of,
    steps_of,
    treading_of,
)
from latentmotion.describe.locomotion import moves_of, path_of, turns_of
from latentmotion.describe.postures import changes_of, dips_of, poses_of, postures_of
from latentmotion.describe.signals import Signals, activity_of, measure, twist_of

_POSES = frozenset({"jack", "crawl", "arms_out", "hands_on_hips", "touch_head"})
"""Poses and exercises that are worth reporting."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything measured about one motion."""

    facts: Description
    """Its description."""
    signals: Signals
    """The curves that the description is measured from."""
    poses: tuple[Event, ...]
    """Poses and exercises of the whole body."""

    def find(self, *kinds: str) -> list[Event]:
        """Returns the events, moves, turns, postures and poses of some kinds, by start."""
        events = [event for kind in kinds for event in self.facts.find(kind)]
        events += [pose for pose in self.poses if pose.kind in kinds]
        return sorted(events, key=lambda event: event.start)


def describe(joints: Float[np.ndarray, "frames joints 3"]) -> Description:
    """Measures what a motion does.

    Args:
        joints: Positions of HumanML3D's 22 joints at 20 frames per second, meters, y up, the
            floor at zero; the body as large as HumanML3D's (pelvis at 0.92 m when it stands).

    Raises:
        InputError: The joints have another shape, fewer than 4 frames, or are not numbers.
    """
    signals = measure(joints)
    flights = flights_of(signals)
    running = running_of(flights, signals)
    turns = turns_of(signals)
    postures = postures_of(signals)
    changes = changes_of(postures)
    kicks = kicks_of(signals)
    events: list[Event] = [
        *jumps_of(signals, flights, running),
        *kicks,
        *knees_of(signals, kicks),
        *balances_of(signals),
        *climbs_of(signals),
        *raises_of(signals),
        *waves_of(signals),
        *punches_of(signals),
        *arm_circles_of(signals),
        *claps_of(signals),
        *changes,
        *dips_of(signals, changes),
    ]
    return Description(
        frames=signals.frames,
        path=path_of(signals, turns),
        moves=moves_of(signals, running, treading_of(signals)),
        turns=turns,
        postures=postures,
        events=tuple(sorted(events, key=lambda event: (event.start, event.kind, event.side))),
        steps=steps_of(signals),
        twist=twist_of(signals),
        activity=activity_of(signals),
    )


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
    """Returns the events that last so many seconds or longer."""
    return [event for event in events if event.frames >= seconds * FPS]


def reportable_kinds(scene: Scene) -> set[str]:
    """Returns the kinds of acts and poses that are worth reporting about a window."""
    kinds = {act.kind for act in acts_of(scene.facts)}
    return kinds | {pose.kind for pose in scene.poses if pose.kind in _POSES and pose.frames >= 10}


def highest_hand(scene: Scene, side: str) -> float:
    """Returns the largest height of a hand above its shoulder, meters; negative is below."""
    signals = scene.signals
    return float((signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"))[:, 1].max())


def in_place(scene: Scene, most: float) -> bool:
    """Whether the pelvis stays within `most` meters of its median position."""
    points = scene.signals.joints[:, 0, ::2]
    return float(np.linalg.norm(points - np.median(points, axis=0), axis=1).max()) <= most


def meters(scene: Scene) -> dict[str, float]:
    """Returns the distance, meters, that the pelvis goes in each direction of the body."""
    left, ahead = scene.signals.velocity.T / FPS
    sideways, forward = np.abs(left) > np.abs(ahead), np.abs(ahead) >= np.abs(left)
    return {
        "forward": float(ahead[forward & (ahead > 0)].sum()),
        "backward": float(-ahead[forward & (ahead < 0)].sum()),
        LEFT: float(left[sideways & (left > 0)].sum()),
        RIGHT: float(-left[sideways & (left < 0)].sum()),
    }
