"""Facts about a motion: moves, turns, postures and events, each with its frames.

Every fact is an `Event`. Sides are the body's own. Frames are counted at 20 per second.
"""

from __future__ import annotations

from dataclasses import dataclass

FPS = 20.0
"""Frames per second of every motion that is described."""

LEFT, RIGHT, BOTH = "left", "right", "both"


@dataclass(frozen=True)
class Event:
    """Something that happens, or lasts, from one frame to another."""

    kind: str
    """What it is, e.g. `walk`, `turn`, `sit`, `kick`."""
    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    side: str = ""
    """`left`, `right` or `both`: the way of a turn, or the hand, foot or knee that acts."""
    direction: str = ""
    """Where it goes as the body sees it (`forward`, `backward`, `left`, `right`, `up`, `place`)."""
    amount: float = 0.0
    """Degrees of a turn, meters per second of a move, meters of height of everything else."""
    count: int = 1
    """How often it is repeated, e.g. swings of a waving hand."""

    @property
    def frames(self) -> int:
        """How long it lasts."""
        return self.end - self.start

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return self.frames / FPS


@dataclass(frozen=True)
class Path:
    """The way of the pelvis over the floor."""

    length: float
    """Meters walked, small sways left out."""
    forward: float
    """Meters gained ahead, seen from where the body faced at the start; negative is backward."""
    left: float
    """Meters gained to the left, seen from where the body faced at the start."""
    ahead: float
    """Meters moved in the direction faced at the time, added up; negative is backward."""
    sideways: float
    """Meters moved to the left of the direction faced at the time, added up."""
    turned: float
    """Degrees by which the heading changed from start to end, turns added up; left is positive."""
    closed: bool
    """Whether the path ends near where it began although it went far."""
    widening: float = 0.0
    """Radius of its last third by radius of its first, minus one; zero where it is no circle."""


@dataclass(frozen=True)
class Description:
    """What can be measured about a motion."""

    frames: int
    """Its length."""
    path: Path
    """Its way over the floor."""
    moves: tuple[Event, ...]
    """`stand`, `walk`, `jog` and `run`, one after another without gaps, by direction and speed."""
    turns: tuple[Event, ...]
    """`turn` by degrees to a side; direction `walking` or `place`; may overlap moves."""
    postures: tuple[Event, ...]
    """`stand`, `crouch`, `bend`, `kneel`, `sit`, `floor` (sitting on it), `lie`, without gaps."""
    events: tuple[Event, ...]
    """All else, by start: jump, hop, kick, knee, balance, climb, raise, wave, punch, arm_circle,
    clap, squat, bow, pick_up, sit_down, stand_up, lie_down, get_up, kneel_down."""
    steps: int
    """Number of steps of both feet."""
    twist: tuple[float, float] = (0.0, 0.0)
    """Degrees by which the shoulders turn at most to the left and right of the hips."""
    activity: float = 1.0
    """Mean speed of hands, feet and head, m/s; below 0.12 the body is as good as still."""

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.frames / FPS

    def count(self, kind: str, side: str = "") -> int:
        """Returns how often an event happens; with a side, with that side or both."""
        return sum(event.count for event in self.find(kind, side))

    def find(self, kind: str, side: str = "", direction: str = "") -> tuple[Event, ...]:
        """Returns the moves, turns, postures and events of a kind, by start."""
        everything = (*self.moves, *self.turns, *self.postures, *self.events)
        found = (
            event
            for event in everything
            if event.kind == kind
            and (not side or event.side in (side, BOTH))
            and (not direction or event.direction == direction)
        )
        return tuple(sorted(found, key=lambda event: event.start))

    def share(self, kind: str, direction: str = "") -> float:
        """Returns the part of the motion, 0 to 1, that moves or postures of a kind take."""
        found = self.find(kind, direction=direction)
        return min(sum(event.frames for event in found) / max(self.frames, 1), 1.0)
