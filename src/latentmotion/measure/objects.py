"""Objects that a motion needs: the seat under a sitter, steps and boxes under raised feet.

They are read from the motion: where a pelvis rests behind its feet, and where a foot that is the
lowest part of a body stands still above the floor. The sentence decides where both readings are
possible: nobody who squats or sits on the ground gets a chair.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.measure.facts import FPS
from latentmotion.measure.signals import JOINT, MIN_FRAMES, Signals, measure, spans
from latentmotion.measure.whole_body import postures_of

# Meters from a seat up to the pelvis of a sitter, and heights of seats.
_FLESH, _SEATS = 0.09, (0.22, 0.85)

# Seconds that somebody sits at least, and fastest rise or fall of a pelvis that rests, m/s.
_SITS, _RESTS = 0.6, 0.15

# Least height of what a foot stands on, meters, and seconds that it stands: where the sentence
# tells of climbing, and elsewhere.
_CLIMBED, _UNTOLD = (0.08, 0.2), (0.15, 0.4)

# Meters per second of a foot that stands.
_STANDS = 0.35

# Meters by which supports of one object differ in height and along the floor.
_SAME = (0.06, 0.35)

# Width and depth, meters.
_SIZES = {"seat": (0.45, 0.45), "step": (0.8, 0.3), "box": (0.5, 0.5)}

# Acts in whose poses a body may look seated, and those that need a seat all the same.
_SEATLESS = {"squat", "crouch", "kneel", "kneel_down", "lie_down", "floor", "jump", "hop", "crawl"}
_SEATED = {"sit", "stand_up"}
_CLIMBS = {"climb"}


@dataclass(frozen=True)
class ImpliedObject:
    """Something on which a body sits or stands."""

    kind: str  # `seat`, `step` or `box`.
    height: float  # Meters from the floor to its top.
    place: tuple[float, float]  # x and z of the middle of its top, meters.
    degrees: float  # Direction that the body on it faces, from +z toward +x.
    start: float  # Seconds at which it begins to carry the body.
    end: float  # Seconds at which it last does.

    @property
    def name(self) -> str:
        """Its name in files, such as `seat at 0.45 m`."""
        return f"{self.kind} at {self.height:.2f} m"

    @property
    def size(self) -> tuple[float, float]:
        """Usual width and depth of such an object, meters."""
        return _SIZES[self.kind]

    def about(self) -> dict[str, Any]:
        """Returns its fields as JSON holds them."""
        return {**asdict(self), "place": list(self.place), "size": list(self.size)}


def implied_objects(
    joints: Float[np.ndarray, "frames 22 3"], fps: float, told: Set[str] = frozenset()
) -> tuple[ImpliedObject, ...]:
    """Returns the objects that a motion needs, by the time at which they first carry the body.

    Args:
        joints: Positions of HumanML3D's joints, meters, y up, the floor at height 0.
        fps: Frames per second.
        told: Kinds of the acts of its sentence (`language.reading.claims_of`), if it has one.
    """
    frames = np.round(np.arange(0, len(joints), fps / FPS)).astype(int)
    chosen = joints[frames[frames < len(joints)]].astype(np.float64)
    if len(chosen) < MIN_FRAMES:
        return ()
    legs = [JOINT["left_hip"], JOINT["left_knee"], JOINT["left_ankle"]]
    leg = float(np.linalg.norm(np.diff(chosen[:, legs], axis=1), axis=-1).sum(-1).mean())
    scale = max(leg, 1e-3) / _LEG
    signals = measure(chosen / scale)
    objects = [*_seats(signals, told), *_steps(signals, told)]
    objects = [
        replace(
            each, height=each.height * scale, place=(each.place[0] * scale, each.place[1] * scale)
        )
        for each in objects
    ]
    return tuple(sorted(objects, key=lambda each: each.start))


# Meters of thigh and shank of HumanML3D's body.
_LEG = 0.80


def _seats(signals: Signals, told: Set[str]) -> list[ImpliedObject]:
    if told & _SEATLESS and not told & _SEATED:
        return []
    pelvis, seats = signals.joints[:, 0], []
    still = np.abs(np.gradient(pelvis[:, 1])) * FPS < _RESTS
    for sat in postures_of(signals):
        resting = np.flatnonzero(still[sat.start : sat.end]) + sat.start
        if sat.kind != "sit" or len(resting) < _SITS * FPS:
            continue
        height = float(np.median(pelvis[resting, 1])) - _FLESH
        if _SEATS[0] < height < _SEATS[1]:
            seats.append(_object("seat", height, pelvis[resting], resting, signals))
    return seats


def _steps(signals: Signals, told: Set[str]) -> list[ImpliedObject]:
    least, seconds = _CLIMBED if told & _CLIMBS else _UNTOLD
    lowest, supports = signals.joints[..., 1].min(axis=1), []
    for side, other in ((0, 1), (1, 0)):
        ankle, toe = JOINT["left_ankle"] + side, JOINT["left_foot"] + side
        height = signals.feet[:, side]
        speed = np.linalg.norm(np.gradient(signals.joints[:, [ankle, toe]], axis=0), axis=-1) * FPS
        stands = (height > least) & (height < signals.feet[:, other] + 0.03)
        stands &= (speed.min(axis=1) < _STANDS) & (height < lowest + 0.05)
        for start, end in spans(stands, max(1, round(seconds * FPS))):
            frames = np.arange(start, end)
            supports.append((side, float(np.median(height[frames])), frames, toe))
    objects: list[tuple[ImpliedObject, set[int]]] = []
    for side, height, frames, toe in sorted(supports, key=lambda support: support[2][0]):
        step = _object("step", height, signals.joints[frames, toe], frames, signals)
        for number, (earlier, sides) in enumerate(objects):
            apart = np.hypot(*np.subtract(earlier.place, step.place))
            if abs(earlier.height - height) < _SAME[0] and apart < _SAME[1]:
                objects[number] = replace(earlier, end=step.end), sides | {side}
                break
        else:
            objects.append((step, {side}))
    if len(objects) == 1 and len(objects[0][1]) == 2:
        return [replace(objects[0][0], kind="box")]
    return [step for step, _ in objects]


def _object(
    kind: str,
    height: float,
    places: Float[np.ndarray, "some 3"],
    frames: np.ndarray,
    signals: Signals,
) -> ImpliedObject:
    x, _, z = np.median(places, axis=0)
    degrees = float(np.degrees(np.median(signals.heading[frames])))
    start, end = frames[0] / FPS, (frames[-1] + 1) / FPS
    return ImpliedObject(kind, height, (float(x), float(z)), degrees, float(start), float(end))
