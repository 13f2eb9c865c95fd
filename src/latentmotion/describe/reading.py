"""Joints → description and scene: all measurements of a motion, or of windows of it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from latentmotion.describe import arms, legs, whole_body
from latentmotion.describe.acts import acts_of
from latentmotion.describe.agreement import check
from latentmotion.describe.claims import claims_of
from latentmotion.describe.facts import FPS, LEFT, RIGHT, Description, Event, Path, among
from latentmotion.describe.sentences import sentences
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

    @cached_property
    def poses(self) -> tuple[Event, ...]:
        """Poses and exercises of the whole body."""
        return whole_body.poses_of(self.signals)

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
    return Measured(measure(joints))


_SOURCES = (
    ("moves", ("stand", "walk", "jog", "run")),
    ("turns", ("turn",)),
    ("postures", ("stand", "crouch", "bend", "kneel", "sit", "floor", "lie")),
    ("jumps", ("jump", "hop")),
    ("kicks", ("kick",)),
    ("knees", ("knee",)),
    ("balances", ("balance",)),
    ("climbs", ("climb",)),
    ("raises", ("raise",)),
    ("waves", ("wave",)),
    ("punches", ("punch",)),
    ("arm_circles", ("arm_circle",)),
    ("claps", ("clap",)),
    ("changes", whole_body.CHANGES),
    ("dips", ("squat", "bow", "pick_up")),
)
"""What is measured by one detector, and the kinds of events that it finds."""


Fact = TypeVar("Fact")


def _of_signals(function: Callable[[Signals], Fact]) -> cached_property[Fact]:
    """Returns a property that is measured from the signals alone."""
    return cached_property(lambda measured: function(measured.signals))


def _order(event: Event) -> tuple[int, str, str]:
    return event.start, event.kind, event.side


class Measured(Description):
    """A description whose facts are measured when they are first asked for.

    A sentence asks for a few of them, and to measure all takes longer than all networks.

    Args:
        signals: The curves that they are measured from.
    """

    def __init__(self, signals: Signals) -> None:
        # The class is frozen, as descriptions are, and lets only cached properties in.
        self.__dict__.update(signals=signals, frames=signals.frames)

    def find(self, kind: str, side: str = "", direction: str = "") -> tuple[Event, ...]:
        """Returns the moves, turns, postures and events of a kind, by start."""
        sources = [source for source, kinds in _SOURCES if kind in kinds]
        return among(
            [event for source in sources for event in sorted(getattr(self, source), key=_order)],
            kind,
            side,
            direction,
        )

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """All that is neither a move nor a turn nor a posture, by start."""
        found = (event for source, _ in _SOURCES[3:] for event in getattr(self, source))
        return tuple(sorted(found, key=_order))

    @cached_property
    def path(self) -> Path:
        """Its path over the floor."""
        return whole_body.path_of(self.signals, self.turns)

    @cached_property
    def moves(self) -> tuple[Event, ...]:
        """Gaits and pauses, one after another without gaps."""
        return whole_body.moves_of(self.signals, self.running, legs.treading_of(self.signals))

    @cached_property
    def running(self) -> Float[np.ndarray, " frames"]:
        """Share of running around each frame."""
        return legs.running_of(self.flights, self.signals)

    @cached_property
    def jumps(self) -> list[Event]:
        """Jumps, hops and leaps."""
        return legs.jumps_of(self.signals, self.flights, self.running)

    @cached_property
    def knees(self) -> list[Event]:
        """Raised knees that are no kicks."""
        return legs.knees_of(self.signals, self.kicks)

    @cached_property
    def changes(self) -> list[Event]:
        """Changes of posture."""
        return whole_body.changes_of(self.postures)

    @cached_property
    def dips(self) -> list[Event]:
        """Squats, bows and what is picked up."""
        return whole_body.dips_of(self.signals, self.changes)

    turns = _of_signals(whole_body.turns_of)
    postures = _of_signals(whole_body.postures_of)
    flights = _of_signals(legs.flights_of)
    kicks = _of_signals(legs.kicks_of)
    balances = _of_signals(legs.balances_of)
    climbs = _of_signals(legs.climbs_of)
    raises = _of_signals(arms.raises_of)
    waves = _of_signals(arms.waves_of)
    punches = _of_signals(arms.punches_of)
    arm_circles = _of_signals(arms.arm_circles_of)
    claps = _of_signals(arms.claps_of)
    steps = _of_signals(legs.steps_of)
    twist = _of_signals(twist_of)
    activity = _of_signals(activity_of)


def scene_of(joints: Float[np.ndarray, "frames 22 3"]) -> Scene:
    """Measures a motion.

    Args:
        joints: Positions of HumanML3D's joints at 20 frames per second, meters, y up.

    Raises:
        InputError: The joints have another shape, too few frames, or are not numbers.
    """
    signals = measure(joints)
    return Scene(Measured(signals), signals)


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


Row = tuple[str, int, int]
"""A sentence, the first frame that it describes, and one past the last."""

NEARLY_ALL = 0.8
"""Share of a caption's frames that counts as all of them."""

LONG_ENOUGH = 2.5
"""Seconds in which a repeating movement can be recognized."""

_REPEATING = re.compile(
    r"\b(?:danc|box(?:es|ing)|fight|karate|martial|swim|dribbl|exercis|play|wash|wip|stir|mop|sweep"
    r"|conduct|direct|juggl|swing(?:s|ing) (?:his|her|their|both|the)|sway|laugh|talk|row|paddl"
    r"|cycl|skat|march|jumping jack|stretch|practic|pretend|imitat"
    r"|act(?:s|ing)|wander|pac(?:es|ing)"
    r"|limp|stagger|sneak|strut|drum|guitar|violin|chop|saw|hammer"
    r"|cheer|protest|gestur)"
)
_CLAUSES = re.compile(r",|;|\. |\bthen\b|\band\b|\bbefore\b|\bafter\b|\bfollowed by\b|\bwhile\b")


@dataclass(frozen=True)
class Windows:
    """Number and length of the windows of a motion, and the number of their sentences."""

    count: int = 3
    """Windows per motion."""
    shortest: int = 20
    """Frames of the shortest window."""
    longest: int = 196
    """Frames of the longest window."""
    sentences: int = 2
    """Measured sentences per window."""
    whole: int = 2
    """Measured sentences about the whole motion."""
    acts: int = 0
    """Most acts that a window may show; zero is any number."""


def caption_windows(
    joints: Float[np.ndarray, "frames 22 3"],
    captions: Sequence[Row],
    generator: np.random.Generator,
    windows: Windows = Windows(),
) -> list[Row]:
    """Returns sentences about a motion and about windows of it.

    Args:
        joints: As `describe` takes them.
        captions: Captions that it already has; these rows are not repeated.
        generator: Draws windows and wording.
        windows: Number and length of the windows.
    """
    frames = len(joints)
    rows: list[Row] = []
    if frames <= windows.longest and windows.whole:
        whole = describe(joints)
        rows += [(text, 0, frames) for text in sentences(whole, generator, count=windows.whole)]
    known: dict[tuple[int, int], Description] = {}
    for start, end in draw_windows(frames, generator, windows):
        window = describe(joints[start:end])
        if windows.acts and len(acts_of(window)) > windows.acts:
            continue
        texts = sentences(window, generator, count=windows.sentences)
        for text, first, last in captions:
            if first <= start and end <= last and text not in texts:
                if (first, last) not in known:
                    known[first, last] = describe(joints[first:last])
                if holds(text, known[first, last], window):
                    texts.append(text)
        rows += [(text, start, end) for text in texts]
    return rows


def draw_windows(
    frames: int, generator: np.random.Generator, windows: Windows
) -> list[tuple[int, int]]:
    """Draws different windows; the logarithm of their length is uniform."""
    longest = min(windows.longest, frames)
    if frames < 1.25 * windows.shortest:
        return []
    drawn: list[tuple[int, int]] = []
    for _ in range(windows.count):
        low, high = np.log(windows.shortest), np.log(longest)
        length = min(int(np.exp(generator.uniform(low, high)) + 0.5), longest)
        start = int(generator.integers(frames - length + 1))
        if (start, start + length) not in drawn and length < frames:
            drawn.append((start, start + length))
    return drawn


def holds(caption: str, whole: Description, part: Description) -> bool:
    """Says whether a caption of a motion is true of a part of it.

    Everything that the motion is found to do must be found in the part as well, with side, count
    and order. Words that cannot be measured are taken to hold if they describe a movement that
    repeats and the part is long enough, or if the part is nearly all of the motion.

    Args:
        caption: The sentence.
        whole: Description of the frames that the sentence is about.
        part: Description of some of them.
    """
    claims = claims_of(caption)
    of_whole, of_part = check(claims, whole), check(claims, part)
    if of_part.verdict == "contradicts":
        return False
    pairs = list(zip(of_whole.verdicts, of_part.verdicts, strict=True))
    if any(before == "agrees" and now != "agrees" for before, now in pairs):
        return False
    if part.frames >= NEARLY_ALL * whole.frames:
        return True
    if any(now != "agrees" for _, now in pairs):
        return False
    long_enough = part.seconds >= LONG_ENOUGH
    return all(
        long_enough if _REPEATING.search(clause) else len(clause.split()) < 3 or claims_of(clause)
        for clause in _CLAUSES.split(caption.lower())
    )
