"""The acts that checks name: how each is found, counted and put in order.

An act of one side is only that side's: who raises both hands does not raise the left hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from latentmotion.describe.facts import BOTH, FPS, LEFT, RIGHT, Event
from latentmotion.describe.scene import Scene, lasting
from latentmotion.evaluation.instructions.expressions import Check, Term

SIDES = (LEFT, RIGHT, BOTH, "any")
WAYS = ("forward", "backward", LEFT, RIGHT)
TURNS = (LEFT, RIGHT, "either")

_RISE = {"jump": 0.08, "hop": 0.03}
"""Meters by which the pelvis rises in the lowest jump."""


@dataclass(frozen=True)
class Act:
    """A kind of act."""

    find: Callable[[Scene], list[Event]]
    """Finds them all, of every side."""
    words: tuple[tuple[str, ...], ...] = ()
    """What each word of a term may be."""
    lasts: bool = False
    """Whether it is something that goes on, e.g. walking, and not something that happens."""
    repeats: bool = True
    """Whether an event that repeats the act counts as often."""


def _of(*kinds: str, seconds: float = 0.0) -> Callable[[Scene], list[Event]]:
    return lambda scene: lasting(scene.find(*kinds), seconds)


def _moves(*kinds: str) -> Callable[[Scene], list[Event]]:
    """Moves that go somewhere on the feet; standing is a move as well, and so is a run in place."""
    return lambda scene: [
        part
        for move in scene.facts.moves
        if move.kind in kinds and move.direction not in ("", "place")
        for part in _on_feet(scene, move)
    ]


def _on_feet(scene: Scene, move: Event) -> list[Event]:
    """The parts of a move, 0.4 s and longer, in which the body is not bent, down or seated."""
    found = []
    for posture in scene.facts.postures:
        start, end = max(move.start, posture.start), min(move.end, posture.end)
        if posture.kind in ("stand", "crouch") and end > start:
            joined = found and found[-1].end == start
            first = found.pop().start if joined else start
            found.append(replace(move, start=first, end=end))
    return lasting(found, 0.4)


def _halts(scene: Scene) -> list[Event]:
    return lasting([move for move in scene.facts.moves if move.kind == "stand"], 0.4)


def _standing(scene: Scene) -> list[Event]:
    return lasting([part for part in scene.facts.postures if part.kind == "stand"], 0.3)


def _jumps(scene: Scene) -> list[Event]:
    """Jumps in which the pelvis rises, and hops; feet drawn off the floor alone are none."""
    return [event for event in scene.find("jump", "hop") if event.amount >= _RISE[event.kind]]


def _bends(scene: Scene) -> list[Event]:
    """Bows and reaches down, and where the trunk stays bent without coming up again."""
    dips = scene.find("bow", "pick_up")
    held = [
        part
        for part in scene.find("bend")
        if not any(dip.start < part.end and part.start < dip.end for dip in dips)
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
    "stand": Act(_standing, lasts=True, repeats=False),
    "halt": Act(_halts, lasts=True, repeats=False),
    "walk": Act(_moves("walk"), lasts=True, repeats=False),
    "run": Act(_moves("jog", "run"), lasts=True, repeats=False),
    "go": Act(_moves("walk", "jog", "run"), (WAYS,), lasts=True, repeats=False),
    "turn": Act(_of("turn"), (TURNS,), repeats=False),
}
"""Every act by name; `turn`'s numbers are degrees, all others count."""


def happens(scene: Scene, term: Term) -> bool:
    """Returns whether a motion has an act as often as it is demanded, and no other side's."""
    act, side = ACTS[term.name], term.words[0] if term.words else "any"
    everything = act.find(scene)
    mine = [event for event in everything if _is_of(event, side)]
    if side in (LEFT, RIGHT) and len(mine) < len(everything):
        return False
    number = sum(event.count for event in mine) if act.repeats else len(mine)
    least, most = term.often
    return least <= number <= most


def in_order(scene: Scene, check: Check) -> bool:
    """Returns whether every act is followed by the next."""
    pairs = zip(check.terms[:-1], check.terms[1:], strict=True)
    return all(_follows(scene, before, after) for before, after in pairs)


def found(scene: Scene, term: Term) -> list[Event]:
    """Returns the acts that a term names, whatever else there is."""
    events = ACTS[term.name].find(scene)
    if term.name == "go":
        return [event for event in events if event.direction == term.words[0]]
    mine = [event for event in events if _is_of(event, term.words[0] if term.words else "any")]
    if term.name == "turn":
        least, most = term.often
        return [event for event in mine if least <= event.amount <= most]
    return mine


def _is_of(event: Event, side: str) -> bool:
    return side in ("any", "either") or event.side == side


def _follows(scene: Scene, first: Term, second: Term) -> bool:
    """Of what happens, the first time counts; what goes on may do so before and after."""
    before, after = found(scene, first), found(scene, second)
    goes_on = ACTS[first.name].lasts, ACTS[second.name].lasts
    before = before if goes_on[0] else before[:1]
    after = after if goes_on[1] else after[:1]
    return any(_precedes(one, two, goes_on) for one in before for two in after)


def _precedes(one: Event, two: Event, goes_on: tuple[bool, bool]) -> bool:
    """Something that goes on is there half a second before or after what it is in order with."""
    if goes_on == (False, False):
        return one.start + 0.2 * FPS <= two.start and one.end <= two.end
    if goes_on == (True, True):
        return one.start + 0.4 * FPS <= two.start
    if goes_on[0]:
        return one.start + 0.5 * FPS <= two.start
    return one.end + 0.5 * FPS <= two.end
