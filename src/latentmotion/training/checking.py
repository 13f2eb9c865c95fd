"""Checks of motions: the acts and conditions that terms name, and whether a motion meets them.

An act of one side is only that side's: a motion that raises both hands does not raise the left one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from latentmotion.data.instructions import DIRECTIONS, SIDES, TURNS, Check, Term
from latentmotion.errors import InputError, hint
from latentmotion.measure.facts import FPS, LEFT, RIGHT, Event
from latentmotion.measure.repetitions import bends, jumps
from latentmotion.measure.scene import Measured, describe, in_place, lasting, meters, swings
from latentmotion.measure.signals import peaks
from latentmotion.measure.whole_body import stillness, stooped
from latentmotion.storage.configuration import from_json
from latentmotion.storage.reading import packaged_toml


@dataclass(frozen=True)
class MotionCondition:
    """A kind of condition."""

    holds: Callable[[Measured, Term], bool]  # Whether it holds for a motion.
    numbers: int  # Number of numbers in a term.
    words: tuple[tuple[str, ...], ...] = ()  # Choices for each word of a term.


def turns_by(scene: Measured, term: Term) -> bool:
    """The heading turns to a side by so many degrees in all, with full turns counted."""
    turned, (side,) = scene.path.turned, term.words
    amount = abs(turned) if side == "either" else turned if side == LEFT else -turned
    return term.numbers[0] <= amount <= term.numbers[1]


def moves_towards(scene: Measured, term: Term) -> bool:
    """It moves so many meters to a side of the body, and farther than to any other."""
    distance, least = meters(scene), term.numbers[0]
    if term.words[0] == "sideways":
        distance["sideways"] = max(distance.pop(LEFT), distance.pop(RIGHT))
    return distance[term.words[0]] >= max(least, *distance.values())


def has_speed(scene: Measured, term: Term) -> bool:
    """The mean speed while it moves, m/s, is within bounds."""
    moves = [move for move in scene.moves if move.kind != "stand" and move.direction]
    moves = [move for move in moves if move.direction != "place"]
    frames = sum(move.frames for move in moves)
    if not frames:
        return False
    mean = sum(move.amount * move.frames for move in moves) / frames
    return term.numbers[0] <= mean <= term.numbers[1]


def speeds_up(scene: Measured, term: Term, step: int = 1) -> bool:
    """The last third is so many times as fast as the first; with step -1 the first as the last."""
    speed = scene.signals.speed[::step]
    third = max(len(speed) // 3, 1)
    first, last = float(speed[:third].mean()), float(speed[-third:].mean())
    return last >= max(term.numbers[0] * first, first + 0.2)


def steps_in_place(scene: Measured, term: Term) -> bool:
    """A foot leaves the floor and comes back so many times."""
    lifts = sum(len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T)
    return term.numbers[0] <= lifts <= term.numbers[1]


def keeps_facing(scene: Measured, term: Term) -> bool:
    """It ends within so many degrees of its first heading."""
    return abs(scene.path.turned) <= term.numbers[0]


def goes_straight(scene: Measured, term: Term) -> bool:
    """It moves along a line, and ends within so many degrees of its first heading."""
    path = scene.signals.joints[:, 0, ::2]
    net = float(np.linalg.norm(path[-1] - path[0]))
    return keeps_facing(scene, term) and net >= 0.9 * scene.path.length


def is_upright(scene: Measured, term: Term) -> bool:
    """It stands with the trunk upright all the time."""
    standing = sum(part.frames for part in scene.postures if part.kind == "stand")
    return standing > 0.9 * scene.frames and float(np.median(scene.signals.tilt)) < 20


# Every condition by name.
CONDITIONS: dict[str, MotionCondition] = {
    "turn": MotionCondition(turns_by, 2, (TURNS,)),
    # The path of the pelvis is so many meters long.
    "travel": MotionCondition(lambda scene, term: scene.path.length >= term.numbers[0], 1),
    "move": MotionCondition(moves_towards, 1, ((*DIRECTIONS, "sideways"),)),
    "speed": MotionCondition(has_speed, 2),
    "faster": MotionCondition(speeds_up, 1),
    "slower": MotionCondition(partial(speeds_up, step=-1), 1),
    # Both feet together make so many steps.
    "step": MotionCondition(lambda scene, term: term.often[0] <= scene.steps <= term.often[1], 2),
    "lift_feet": MotionCondition(steps_in_place, 2),
    "in_place": MotionCondition(lambda scene, term: in_place(scene, term.numbers[0]), 1),
    "facing": MotionCondition(keeps_facing, 1),
    "straight": MotionCondition(goes_straight, 1),
    # The direction of travel swings to a side by so many degrees, twice or more.
    "weave": MotionCondition(lambda scene, term: swings(scene, term.numbers[0]) >= 2, 1),
    # The pelvis rises by so many meters in a jump.
    "height": MotionCondition(
        lambda scene, term: any(e.amount >= term.numbers[0] for e in scene.all_of("jump", "hop")), 1
    ),
    # Nothing moves for such a part of the time; hips are low or the trunk is bent half of it.
    "still": MotionCondition(
        lambda scene, term: bool(stillness(scene.signals).mean() >= term.numbers[0]), 1
    ),
    "stooped": MotionCondition(lambda scene, term: bool(stooped(scene.signals).mean() >= 0.5), 0),
    "upright": MotionCondition(is_upright, 0),
}


@dataclass(frozen=True)
class Act:
    """A kind of act, a row of `checks.toml`."""

    kinds: tuple[str, ...]  # Kinds of its events, moves or postures.
    finder: str = "events"  # What finds them, of `_FINDERS`.
    seconds: float = 0.0  # Shorter ones do not count.
    choices: tuple[str, ...] = ()  # Which words of `_WORDS` a term has.
    lasts: bool = False  # Whether it is continuous, e.g. walking, instead of a single event.
    repeats: bool = False  # Whether an event of several repetitions counts as several.

    @property
    def words(self) -> tuple[tuple[str, ...], ...]:
        """Choices for each word of a term."""
        return tuple(_WORDS[name] for name in self.choices)

    def find(self, scene: Measured) -> list[Event]:
        """Finds the events of this kind, of every side."""
        return lasting(_FINDERS[self.finder](scene, self.kinds), self.seconds)


def _gaits(scene: Measured, kinds: Collection[str]) -> list[Event]:
    """Finds moves that travel on the feet, without standing and running in place.

    Only stretches count in which the body is not bent, down or seated.
    """
    events = []
    for move in scene.moves:
        if move.kind not in kinds or move.direction in ("", "place"):
            continue
        upright: list[Event] = []
        for posture in scene.postures:
            start, end = max(move.start, posture.start), min(move.end, posture.end)
            if posture.kind in ("stand", "crouch") and end > start:
                if upright and upright[-1].end == start:
                    start = upright.pop().start
                upright.append(replace(move, start=start, end=end))
        events += upright
    return events


_WORDS = {"side": SIDES, "turn": TURNS, "direction": DIRECTIONS, "head": ("head",)}
_FINDERS: dict[str, Callable[[Measured, tuple[str, ...]], list[Event]]] = {
    "events": lambda scene, kinds: scene.all_of(*kinds),
    "jumps": lambda scene, kinds: jumps(scene.all_of(*kinds)),
    "bends": lambda scene, _: bends(scene.events, scene.postures),
    "moves": lambda scene, kinds: [move for move in scene.moves if move.kind in kinds],
    "postures": lambda scene, kinds: [part for part in scene.postures if part.kind in kinds],
    "gaits": _gaits,
}

# Every act by name; the numbers of `turn` are degrees, all others are counts.
ACTS = {name: from_json(Act, row) for name, row in packaged_toml(__file__, "checks.toml").items()}


def fulfills(scene: Measured, check: Check) -> bool:
    """Returns whether a motion meets all requirements, in order if the check has one."""
    if check.ordered:
        pairs = zip(check.terms[:-1], check.terms[1:], strict=True)
        return all(follows(scene, first, second) for first, second in pairs)
    return all(
        CONDITIONS[term.name].holds(scene, term)
        if term.name in CONDITIONS
        else happens(scene, term)
        for term in check.terms
    )


def happens(scene: Measured, term: Term) -> bool:
    """Returns whether a motion has an act as often as required, and of no other side."""
    act, events = ACTS[term.name], events_of(scene, term)
    one_sided = term.name != "go" and term.words[:1] in ((LEFT,), (RIGHT,))
    if one_sided and len(events) < len(act.find(scene)):
        return False
    number = sum(event.count for event in events) if act.repeats else len(events)
    least, most = term.often
    return least <= number <= most


def events_of(scene: Measured, term: Term) -> list[Event]:
    """Returns the events of the act that a term names."""
    events = ACTS[term.name].find(scene)
    if term.name == "go":
        return [event for event in events if event.direction == term.words[0]]
    side = term.words[0] if term.words else "any"
    if side not in ("any", "either"):
        events = [event for event in events if event.side == side]
    if term.name == "turn":
        least, most = term.often
        return [event for event in events if least <= event.amount <= most]
    return events


def follows(scene: Measured, first: Term, second: Term) -> bool:
    """Returns whether the second act follows the first.

    Of a single event the first occurrence counts. A continuous act must start half a second before
    the event that follows it, or end half a second after the event that it follows.
    """
    before, after = events_of(scene, first), events_of(scene, second)
    first_lasts, second_lasts = ACTS[first.name].lasts, ACTS[second.name].lasts

    def precedes(one: Event, two: Event) -> bool:
        if first_lasts:
            return one.start + (0.4 if second_lasts else 0.5) * FPS <= two.start
        if second_lasts:
            return one.end + 0.5 * FPS <= two.end
        return one.start + 0.2 * FPS <= two.start and one.end <= two.end

    before = before if first_lasts else before[:1]
    after = after if second_lasts else after[:1]
    return any(precedes(event, two) for event in before for two in after)


def meets(check: Check, joints: Float[np.ndarray, "frames 22 3"]) -> bool:
    """Returns whether a motion meets a check, from its joints at 20 frames per second."""
    return fulfills(describe(joints), check)


def validate(check: Check) -> None:
    """Checks names, words and numbers.

    Raises:
        InputError: One is unknown or missing.
    """
    for term in check.terms:
        names = ACTS if check.ordered else ACTS | CONDITIONS
        if term.name not in names:
            raise InputError(f"check {term}: unknown {term.name!r}, {hint(term.name, names)}")
        condition = None if check.ordered else CONDITIONS.get(term.name)
        words = condition.words if condition else ACTS[term.name].words
        if condition and len(term.numbers) != condition.numbers:
            raise InputError(f"check {term}: expected {condition.numbers} numbers")
        # In an order acts are not counted; only a turn has numbers, its degrees.
        most = 0 if check.ordered and term.name != "turn" else 2
        if not condition and len(term.numbers) > most:
            raise InputError(f"check {term}: expected fewer numbers")
        if list(term.numbers) != sorted(term.numbers):
            raise InputError(f"check {term}: expected the smaller number first")
        if len(term.words) > len(words) or (condition and len(term.words) < len(words)):
            raise InputError(f"check {term}: expected {len(words)} words")
        for word, choices in zip(term.words, words, strict=False):
            if word not in choices:
                raise InputError(f"check {term}: unknown word {word!r}, {hint(word, choices)}")
