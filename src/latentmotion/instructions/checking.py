"""Checks of motions: the acts that terms name, and whether a motion meets a check.

An act of one side is only that side's: a motion that raises both hands does not raise the left one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from latentmotion.describe.facts import FPS, LEFT, RIGHT, Event
from latentmotion.describe.reading import Scene, lasting
from latentmotion.errors import InputError, hint
from latentmotion.instructions.conditions import CONDITIONS
from latentmotion.instructions.prompts import DIRECTIONS, SIDES, TURNS, Check, Term

_RISE = {"jump": 0.08, "hop": 0.03}
"""Meters that the pelvis rises in the lowest jump."""


@dataclass(frozen=True)
class Act:
    """A kind of act."""

    find: Callable[[Scene], list[Event]]
    """Finds the events of this kind, of every side."""
    words: tuple[tuple[str, ...], ...] = ()
    """Choices for each word of a term."""
    lasts: bool = False
    """Whether it is continuous, e.g. walking, instead of a single event."""
    repeats: bool = True
    """Whether an event of several repetitions counts as several."""


def _of(*kinds: str, seconds: float = 0.0) -> Callable[[Scene], list[Event]]:
    return lambda scene: lasting(scene.find(*kinds), seconds)


def _moves(*kinds: str) -> Callable[[Scene], list[Event]]:
    """Finds moves that travel on the feet, without standing and running in place.

    Only stretches of 0.4 s and longer count in which the body is not bent, down or seated.
    """

    def find(scene: Scene) -> list[Event]:
        events = []
        for move in scene.facts.moves:
            if move.kind not in kinds or move.direction in ("", "place"):
                continue
            upright: list[Event] = []
            for posture in scene.facts.postures:
                start, end = max(move.start, posture.start), min(move.end, posture.end)
                if posture.kind in ("stand", "crouch") and end > start:
                    if upright and upright[-1].end == start:
                        start = upright.pop().start
                    upright.append(replace(move, start=start, end=end))
            events += lasting(upright, 0.4)
        return events

    return find


def _jumps(scene: Scene) -> list[Event]:
    """Finds jumps and hops in which the pelvis rises; lifted feet alone are no jump."""
    return [event for event in scene.find("jump", "hop") if event.amount >= _RISE[event.kind]]


def _bends(scene: Scene) -> list[Event]:
    """Finds bows, reaches down, and stretches in which the trunk stays bent."""
    dips = scene.find("bow", "pick_up")
    held = [
        bend
        for bend in scene.find("bend")
        if not any(dip.start < bend.end and bend.start < dip.end for dip in dips)
    ]
    return sorted([*dips, *held], key=lambda event: event.start)


ACTS: dict[str, Act] = {
    "raise": Act(_of("raise"), (SIDES,), repeats=False),
    "wave": Act(_of("wave"), (SIDES,), repeats=False),
    "punch": Act(_of("punch"), (SIDES,)),
    "kick": Act(_of("kick"), (SIDES,)),
    "knee_up": Act(_of("knee"), (SIDES,)),
    "hop": Act(_of("hop"), (SIDES,)),
    "one_leg": Act(_of("balance"), (SIDES,)),
    "touch": Act(_of("touch_head"), (SIDES, ("head",))),
    "jump": Act(_jumps),
    "clap": Act(_of("clap")),
    "squat": Act(_of("squat")),
    "jack": Act(_of("jack")),
    "bend": Act(_bends),
    "reach_down": Act(_of("pick_up")),
    "arms_out": Act(_of("arms_out"), repeats=False),
    "hands_on_hips": Act(_of("hands_on_hips"), repeats=False),
    "crawl": Act(_of("crawl"), repeats=False),
    "sit": Act(_of("sit", "floor", seconds=0.4), repeats=False),
    "sit_floor": Act(_of("floor", seconds=0.4), repeats=False),
    "lie": Act(_of("lie", seconds=0.4), repeats=False),
    "crouch": Act(_of("crouch", "squat", seconds=0.3), repeats=False),
    "kneel": Act(_of("kneel", seconds=0.3), repeats=False),
    "low": Act(_of("crouch", "squat", "kneel", "floor", "lie", seconds=0.3), repeats=False),
    "stand": Act(
        lambda scene: lasting([p for p in scene.facts.postures if p.kind == "stand"], 0.3),
        lasts=True,
        repeats=False,
    ),
    "halt": Act(
        lambda scene: lasting([move for move in scene.facts.moves if move.kind == "stand"], 0.4),
        lasts=True,
        repeats=False,
    ),
    "walk": Act(_moves("walk"), lasts=True, repeats=False),
    "run": Act(_moves("jog", "run"), lasts=True, repeats=False),
    "go": Act(_moves("walk", "jog", "run"), (DIRECTIONS,), lasts=True, repeats=False),
    "turn": Act(_of("turn"), (TURNS,), repeats=False),
}
"""Every act by name; the numbers of `turn` are degrees, all others are counts."""


def fulfills(scene: Scene, check: Check) -> bool:
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


def happens(scene: Scene, term: Term) -> bool:
    """Returns whether a motion has an act as often as required, and of no other side."""
    act, events = ACTS[term.name], events_of(scene, term)
    one_sided = term.name != "go" and term.words[:1] in ((LEFT,), (RIGHT,))
    if one_sided and len(events) < len(act.find(scene)):
        return False
    number = sum(event.count for event in events) if act.repeats else len(events)
    least, most = term.often
    return least <= number <= most


def events_of(scene: Scene, term: Term) -> list[Event]:
    """Returns the events of the act that a term names."""
    events = ACTS[term.name].find(scene)
    if term.name == "go":
        return [event for event in events if event.direction == term.words[0]]
    events = [event for event in events if _is_of(event, term.words[0] if term.words else "any")]
    if term.name == "turn":
        least, most = term.often
        return [event for event in events if least <= event.amount <= most]
    return events


def follows(scene: Scene, first: Term, second: Term) -> bool:
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
    return any(precedes(one, two) for one in before for two in after)


def validate(check: Check) -> None:
    """Checks names, words and numbers.

    Raises:
        InputError: One is unknown or missing.
    """
    for term in check.terms:
        known = ACTS if check.ordered else ACTS | CONDITIONS
        if term.name not in known:
            raise InputError(f"check {term}: unknown {term.name!r}, {hint(term.name, known)}")
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


def _is_of(event: Event, side: str) -> bool:
    return side in ("any", "either") or event.side == side
