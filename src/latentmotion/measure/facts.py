"""Facts about a motion: moves, turns, postures, events and single actions, each with its frames.

Every fact is an `Event`, an action in a window a `SingleAction`. Sides are the body's own. Frames
are counted at 20 per second.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from latentmotion.storage.reading import packaged_toml

FPS = 20.0  # Frames per second of every motion that is described.

LEFT, RIGHT, BOTH = "left", "right", "both"
SIDES = (LEFT, RIGHT)

TABLES = packaged_toml(__file__, "events.toml")  # Kinds of events, and what is part of what.


@dataclass(frozen=True)
class Event:
    """An event or a state that lasts from one frame to another."""

    kind: str  # Name of what happens, e.g. `walk`, `turn`, `sit`, `kick`.
    start: int  # First frame.
    end: int  # One past the last frame.
    # `left`, `right` or `both`: the side of a turn, or of the hand, foot or knee that acts.
    side: str = ""
    # Direction in the body frame (`forward`, `backward`, `left`, `right`, `up`, `place`).
    direction: str = ""
    # Degrees of a turn, meters per second of a move, meters of height of everything else.
    amount: float = 0.0
    count: int = 1  # Number of repetitions, e.g. swings of a waving hand.

    @property
    def frames(self) -> int:
        """Duration in frames."""
        return self.end - self.start

    @property
    def seconds(self) -> float:
        """Duration in seconds."""
        return self.frames / FPS

    def overlap(self, other: Event, margin: int = 0) -> int:
        """Returns the number of frames shared with another event, widened by a margin."""
        start, end = max(self.start, other.start - margin), min(self.end, other.end + margin)
        return max(end - start, 0)


@dataclass(frozen=True)
class FloorPath:
    """The path of the pelvis over the floor."""

    length: float  # Meters walked, small sways left out.
    # Displacement, meters, in the direction faced at the start; negative is backward.
    forward: float
    left: float  # Displacement, meters, to the left of the direction faced at the start.
    # Sum of the meters moved in the direction faced at the time; negative is backward.
    ahead: float
    sideways: float  # Sum of the meters moved to the left of the direction faced at the time.
    # Degrees by which the heading changed from start to end, turns added up; left is positive.
    turned: float
    closed: bool  # Whether a long path ends near its start.


@dataclass(frozen=True)
class Description:
    """The facts of one motion."""

    frames: int  # Its length.
    path: FloorPath  # Its path over the floor.
    # `stand`, `walk`, `jog` and `run`, one after another without gaps, by direction and speed.
    moves: tuple[Event, ...]
    # `turn` by degrees to a side; direction `walking` or `place`; may overlap moves.
    turns: tuple[Event, ...]
    # `stand`, `crouch`, `bend`, `kneel`, `sit`, `floor` (sitting on it), `lie`, without gaps.
    postures: tuple[Event, ...]
    # All else, by start: jump, hop, kick, knee, balance, climb, raise, wave, punch, arm_circle,
    # clap, squat, bow, pick_up, sit_down, stand_up, lie_down, get_up, kneel_down.
    events: tuple[Event, ...]
    steps: int  # Number of steps of both feet.
    # Largest turn, degrees, of the shoulders to the left and right of the hips.
    twist: tuple[float, float] = (0.0, 0.0)
    # Mean speed of hands, feet and head, m/s; below 0.12 the body is nearly still.
    activity: float = 1.0

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.frames / FPS

    def count(self, kind: str, side: str = "") -> int:
        """Returns how often an event happens; with a side, with that side or both."""
        return sum(e.count for e in self.find(kind) if not side or e.side in (side, BOTH))

    def find(self, kind: str) -> tuple[Event, ...]:
        """Returns the moves, turns, postures and events of a kind, by start."""
        return of_kind((*self.moves, *self.turns, *self.postures, *self.events), kind)


def of_kind(events: Iterable[Event], kind: str) -> tuple[Event, ...]:
    """Returns the events of a kind, by start."""
    matching = (event for event in events if event.kind == kind)
    return tuple(sorted(matching, key=lambda event: event.start))


@dataclass(frozen=True)
class SingleAction:
    """One action of a clip and the window that shows nothing else."""

    kind: str  # Name of the action, such as `walk`, `punch` or `turn_then_walk`.
    start: int  # First frame of the window (20 frames per second).
    end: int  # One past the last frame of the window.
    side: str = ""  # `left`, `right`, `both`, or nothing where no side applies.
    direction: str = ""  # `forward`, `backward`, `left`, `right`, `up`, `down`, or nothing.
    count: int = 1  # Number of repetitions; 1 where they are not counted.
    degrees: float = 0.0  # Net change of heading over the window, in degrees; 0 where none.
    gait: str = ""  # `walk`, `jog` or `run` while turning or circling; nothing on the spot.
    pace: str = ""  # `slow`, `normal` or `fast` for gaits; nothing where no pace applies.
    act: tuple[int, int] = (0, 0)  # First frame and one past the last frame of the act itself.

    @property
    def frames(self) -> int:
        """Length of the window."""
        return self.end - self.start


def joined_moves(moves: Iterable[Event], gap: int) -> list[Event]:
    """Joins successive moves of one kind and direction with less than `gap` frames between."""
    joined: list[Event] = []
    for move in moves:
        last = joined[-1] if joined else None
        alike = last and (last.kind, last.direction) == (move.kind, move.direction)
        if last and alike and move.start - last.end < gap:
            frames = last.frames + move.frames
            speed = (last.amount * last.frames + move.amount * move.frames) / frames
            joined[-1] = replace(last, end=move.end, amount=speed)
        else:
            joined.append(move)
    return joined
