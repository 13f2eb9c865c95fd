"""Whether a motion does what a sentence claims: agrees, contradicts, or says nothing about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from latentmotion.describe.claims import SLIGHT, Claim, claims_of
from latentmotion.describe.facts import BOTH, LEFT, RIGHT, Description, Event
from latentmotion.describe.travel import FAST, SLOW

Verdict = Literal["agrees", "contradicts", "silent"]

_GAITS = ("walk", "jog", "run")
_LIMBS = ("kick", "hop", "punch", "raise", "wave", "knee", "balance", "pick_up", "arm_circle")
_COUNTED = ("jump", "hop", "kick", "squat", "arm_circle", "knee")
_SURE = ("jump", "hop", "kick", "squat", "sit", "lie_down", "kneel_down")
"""Kinds of events that are hardly ever overlooked, so that absence contradicts."""

_SIMILAR = {
    "jump": ("jump", "hop"),
    "hop": ("hop", "jump"),
    "sit": ("sit_down", "sit", "floor"),
    "lie_down": ("lie_down", "lie"),
    "kneel_down": ("kneel_down", "kneel"),
    "stand_up": ("stand_up", "get_up", "sit_up"),
    "squat": ("squat", "crouch", "pick_up"),
    "crouch": ("crouch", "squat", "bend", "bow", "kneel"),
    "bow": ("bow", "bend", "pick_up", "squat"),
    "pick_up": ("pick_up", "bend", "squat", "bow"),
    "raise": ("raise", "wave"),
    "wave": ("wave", "raise"),
}


@dataclass(frozen=True)
class Agreement:
    """How a motion and a sentence go together."""

    claims: tuple[Claim, ...]
    """What the sentence claims."""
    verdicts: tuple[Verdict, ...]
    """One per claim."""
    reasons: tuple[str, ...]
    """One per claim: what was found."""

    @property
    def verdict(self) -> Verdict:
        """`contradicts` if any claim is contradicted, `agrees` if any agrees, else `silent`."""
        if "contradicts" in self.verdicts:
            return "contradicts"
        return "agrees" if "agrees" in self.verdicts else "silent"


def check(sentence: str | tuple[Claim, ...], description: Description) -> Agreement:
    """Compares what a sentence claims with what a motion does.

    Args:
        sentence: A caption or prompt, or its claims.
        description: The motion's.
    """
    claims = claims_of(sentence) if isinstance(sentence, str) else sentence
    verdicts: list[Verdict] = []
    reasons: list[str] = []
    spans: list[tuple[int, int] | None] = []
    for claim in claims:
        repeated = sum(claim.kind == other.kind for other in claims) > 1
        verdict, reason = check_claim(claim, description, repeated)
        span = _span(claim, description)
        before = next((one for one in reversed(spans) if one), None)
        if claim.then and verdict == "agrees" and span and before and span[1] <= before[0]:
            verdict, reason = "contradicts", f"{reason}, but earlier than what it follows"
        verdicts.append(verdict)
        reasons.append(f"{claim.kind}: {reason}")
        spans.append(span if verdict == "agrees" else None)
    return Agreement(claims, tuple(verdicts), tuple(reasons))


def check_claim(
    claim: Claim, description: Description, repeated: bool = False
) -> tuple[Verdict, str]:
    """Compares one claim with a motion; returns the verdict and what was found.

    Args:
        claim: The claim.
        description: The motion's.
        repeated: Whether the sentence tells of more of the same kind, so that counts are parts.
    """
    if claim.kind in (*_GAITS, "move"):
        return _check_gait(claim, description)
    special = _CHECKS.get(claim.kind)
    if special:
        return special(claim, description)
    found = events_for(claim.kind, description)
    if not found:
        behind = claim.kind == "kick" and claim.direction == "backward"
        sure = claim.kind in _SURE and not behind and not _may_hide(claim, description)
        return ("contradicts" if sure else "silent"), "not found"
    return _check_details(claim, found, repeated)


def events_for(kind: str, description: Description) -> tuple[Event, ...]:
    """Returns events, postures and turns that a claim of a kind may mean, by start."""
    kinds = _SIMILAR.get(kind, (kind,))
    found = [event for one in kinds for event in description.find(one)]
    return tuple(sorted(found, key=lambda event: event.start))


def _check_details(claim: Claim, found: tuple[Event, ...], repeated: bool) -> tuple[Verdict, str]:
    told = ", ".join(sorted({event.side or "?" for event in found}))
    if claim.side and claim.kind in _LIMBS:
        if claim.side == BOTH:
            if claim.kind in ("kick", "punch", "knee"):
                return "agrees", f"found, {told}"
            if not any(event.side == BOTH for event in found):
                sides = {event.side for event in found}
                unsure = claim.kind in ("raise", "wave")
                missing = "silent" if unsure else "contradicts"
                return ("agrees" if {LEFT, RIGHT} <= sides else missing), f"found {told}"
        same = [e for e in found if e.side in (claim.side, BOTH, "")]
        if not same:
            return "contradicts", f"found {told}, expected {claim.side}"
        found = tuple(same)
    if claim.count and claim.kind in _COUNTED:
        number = sum(event.count for event in found if event.kind in (claim.kind, "jump", "hop"))
        if number != claim.count:
            near = repeated and number > claim.count
            near |= claim.count >= 4 and abs(number - claim.count) == 1
            return ("silent" if near else "contradicts"), f"found {number}, told {claim.count}"
    if claim.kind in ("jump", "hop") and claim.direction in ("forward", "backward"):
        ways = {event.direction for event in found}
        if claim.direction not in ways:
            opposite = {"forward": "backward", "backward": "forward"}[claim.direction] in ways
            return ("contradicts" if opposite else "silent"), f"went {', '.join(sorted(ways))}"
    return "agrees", f"found {told}"


def _check_gait(claim: Claim, description: Description) -> tuple[Verdict, str]:
    moving = [move for move in description.moves if move.kind != "stand"]
    if not moving:
        return ("silent" if claim.kind == "move" else _no_gait(claim, description)), "stays"
    gait, reason = _gait(claim, description, moving)
    if gait == "contradicts":
        return gait, reason
    way, where = _way(claim, description, moving)
    if way == "contradicts":
        return way, where
    pace, speed = _pace(claim, moving)
    if pace == "contradicts":
        return pace, speed
    return ("agrees" if "agrees" in (gait, way) else "silent"), f"{reason}, {where}"


def _no_gait(claim: Claim, description: Description) -> Verdict:
    if claim.direction == "place" and description.steps >= 2:
        return "silent"
    return "silent" if description.steps >= 2 else "contradicts"


def _gait(claim: Claim, description: Description, moving: list[Event]) -> tuple[Verdict, str]:
    found = ", ".join(sorted({move.kind for move in moving}))
    fastest = max(move.amount for move in moving)
    if claim.kind == "move":
        return "agrees", found
    if claim.kind == "walk":
        walked = any(move.kind == "walk" for move in moving)
        if not walked and fastest >= 2.0:
            return ("silent" if fastest < 2.6 else "contradicts"), found
        return "agrees", found
    ran = any(move.kind in ("jog", "run") for move in moving)
    if ran:
        return "agrees", found
    return ("contradicts" if fastest < 1.1 else "silent"), f"{found} at {fastest:.1f} m/s"


def _way(claim: Claim, description: Description, moving: list[Event]) -> tuple[Verdict, str]:
    """Judges forward, backward and sides."""
    path, told = description.path, claim.direction
    ways = {move.direction: 0.0 for move in moving}
    for move in moving:
        ways[move.direction] += move.amount * move.seconds
    found = ", ".join(f"{way} {far:.1f} m" for way, far in ways.items())
    if not told or told == "place":
        far = told == "place" and path.length > 1.5 and not path.closed
        return ("contradicts" if far else "silent"), found
    if told in ("forward", "backward"):
        if ways.get(told, 0) > 0.25:
            return "agrees", found
        opposite = {"forward": "backward", "backward": "forward"}[told]
        unsure = claim.kind == "move" and ways.get(opposite, 0) < 0.5
        return ("contradicts" if path.length > 0.6 and not unsure else "silent"), found
    sides = ways.get(LEFT, 0) + ways.get(RIGHT, 0)
    if told == "side":
        return ("agrees" if sides > 0.25 else "contradicts" if path.length > 1 else "silent"), found
    verdict = _to_side(told, description, ways)
    return ("silent" if claim.kind == "move" and verdict == "contradicts" else verdict), found


def _to_side(told: str, description: Description, ways: dict[str, float]) -> Verdict:
    """A way to the left may be sideways, a drift, or a turn."""
    other = RIGHT if told == LEFT else LEFT
    sign = 1 if told == LEFT else -1
    path = description.path
    turned = {
        side: sum(t.amount for t in description.turns if t.side == side) for side in (told, other)
    }
    for_it = ways.get(told, 0) > 0.25 or sign * path.left > 0.35 or turned[told] > 35
    against = ways.get(other, 0) > 0.4 or sign * path.left < -0.5 or turned[other] > 45
    if for_it:
        return "agrees"
    return "contradicts" if against else "silent"


def _pace(claim: Claim, moving: list[Event]) -> tuple[Verdict, str]:
    total = sum(move.frames for move in moving)
    speed = sum(move.amount * move.frames for move in moving) / total
    fast, slow = claim.pace == "fast", claim.pace == "slow"
    if claim.kind == "move":
        wrong = False
    elif claim.kind in ("jog", "run"):
        wrong = slow and speed > 3.3
    else:
        wrong = (slow and speed > FAST - 0.1) or (fast and speed < SLOW)
    return ("contradicts" if wrong else "silent"), f"{speed:.1f} m/s"


def _check_turn(claim: Claim, description: Description) -> tuple[Verdict, str]:
    turned = description.path.turned
    ways = [turned, *(t.amount if t.side == LEFT else -t.amount for t in description.turns)]
    found = ", ".join(f"{way:+.0f}" for way in ways[1:]) or f"{turned:+.0f} in all"
    if claim.side:
        ways = [way if claim.side == LEFT else -way for way in ways]
    amounts = [way if claim.side else abs(way) for way in ways]
    best = max(amounts)
    if claim.degrees == SLIGHT:
        against = claim.side and best < 15 and min(ways) < -35
        return "contradicts" if against else "agrees" if best >= 15 else "silent", found
    if claim.degrees:
        close = [a for a in amounts if 0.6 * claim.degrees <= a <= 1.4 * claim.degrees + 20]
        return "agrees" if close else "contradicts", found
    least = 200.0 if claim.kind == "circle" else 30.0
    closed = claim.kind == "circle" and not claim.side and description.path.closed
    if best >= least or closed:
        return "agrees", found
    if claim.kind == "turn" and _twists(claim, description):
        return "silent", f"{found}, but the trunk twists"
    arc = 45.0 if claim.kind == "circle" else 0.6 * least
    return "silent" if best >= arc else "contradicts", found


def _twists(claim: Claim, description: Description) -> bool:
    left, right = description.twist
    return (claim.side != RIGHT and left > 25) or (claim.side != LEFT and right > 25)


def _check_stop(claim: Claim, description: Description) -> tuple[Verdict, str]:
    moves = description.moves
    stops = any(one.kind != "stand" and two.kind == "stand" for one, two in pairwise(moves))
    if stops:
        return "agrees", "moves, then stands"
    return "silent", "no stop found"


def _check_stand(claim: Claim, description: Description) -> tuple[Verdict, str]:
    share = description.share("stand")
    stays = sum(move.frames for move in description.moves if move.kind == "stand")
    share = stays / description.frames
    if description.path.length > 1.0 and share < 0.25 and not claim.then:
        return "contradicts", f"stands {100 * share:.0f} % of the time"
    return ("agrees" if share > 0.3 else "silent"), f"stands {100 * share:.0f} % of the time"


def _check_nothing(claim: Claim, description: Description) -> tuple[Verdict, str]:
    return "silent", "not measured"


def _may_hide(claim: Claim, description: Description) -> bool:
    """A jump or hop while running looks like a stride; a squat may be a crouch."""
    if claim.kind in ("jump", "hop"):
        return any(move.kind in ("jog", "run") for move in description.moves)
    return False


def _span(claim: Claim, description: Description) -> tuple[int, int] | None:
    """From the start of the first to the end of the last time that a claim may mean."""
    if claim.kind in (*_GAITS, "move"):
        found = [m for m in description.moves if m.kind != "stand"]
        if claim.direction in ("forward", "backward", LEFT, RIGHT):
            found = [m for m in found if m.direction == claim.direction] or found
    elif claim.kind in ("turn", "circle"):
        found = [t for t in description.turns if not claim.side or t.side == claim.side]
    else:
        found = [e for e in events_for(claim.kind, description) if claim.side in ("", e.side, BOTH)]
    return (found[0].start, max(event.end for event in found)) if found else None


_CHECKS: dict[str, Callable[[Claim, Description], tuple[Verdict, str]]] = {
    "turn": _check_turn,
    "circle": _check_turn,
    "stop": _check_stop,
    "stand": _check_stand,
    "twist": _check_nothing,
    "lift": _check_nothing,
}
