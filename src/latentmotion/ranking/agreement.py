"""Agreement of a motion with the claims of a sentence: it agrees, contradicts or is silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from latentmotion.language.claims import SLIGHT, Claim, kinds, related
from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import BOTH, LEFT, RIGHT, Description, Event
from latentmotion.measure.whole_body import FAST, SLOW
from latentmotion.plugins import entries

Verdict = Literal["agrees", "contradicts", "silent"]

_GAITS = kinds("gait")

_OPPOSITE = {"forward": "backward", "backward": "forward"}


@dataclass(frozen=True)
class Agreement:
    """The comparison of a motion with a sentence."""

    claims: tuple[Claim, ...]  # Claims of the sentence.
    verdicts: tuple[Verdict, ...]  # One per claim.
    reasons: tuple[str, ...]  # One per claim: what was found in the motion.

    @property
    def verdict(self) -> Verdict:
        """`contradicts` if any claim is contradicted, `agrees` if any agrees, else `silent`."""
        if "contradicts" in self.verdicts:
            return "contradicts"
        return "agrees" if "agrees" in self.verdicts else "silent"


# Compares a claim with a motion; returns the verdict and what was found.
Check = Callable[[Claim, Description], tuple[Verdict, str]]

# Checks by kind of claim; all other kinds are compared with events.
_CHECKS: dict[str, Check] = {}


def check(sentence: str | tuple[Claim, ...], description: Description) -> Agreement:
    """Compares what a sentence claims with what a motion does.

    Args:
        sentence: A caption or prompt, or its claims.
        description: The motion's.
    """
    claims = claims_of(sentence) if isinstance(sentence, str) else sentence
    verdicts: list[Verdict] = []
    reasons: list[str] = []
    before: tuple[int, int] | None = None
    for claim in claims:
        repeated = sum(claim.kind == other.kind for other in claims) > 1
        verdict, reason = check_claim(claim, description, repeated)
        span = frames_for(claim, description) if verdict == "agrees" else None
        if claim.then and span and before and span[1] <= before[0]:
            reason = f"{reason}, but earlier than what it follows"
            verdict, span = "contradicts", None
        verdicts.append(verdict)
        reasons.append(f"{claim.kind}: {reason}")
        before = span or before
    return Agreement(claims, tuple(verdicts), tuple(reasons))


def check_claim(
    claim: Claim, description: Description, repeated: bool = False
) -> tuple[Verdict, str]:
    """Compares one claim with a motion; returns the verdict and what was found.

    Args:
        claim: The claim.
        description: The motion's.
        repeated: Whether the sentence has more claims of the same kind, so that counts are parts.
    """
    if claim.kind in _CHECKS:
        return _CHECKS[claim.kind](claim, description)
    events = events_for(claim.kind, description)
    if not events:
        behind = claim.kind == "kick" and claim.direction == "backward"
        runs = any(move.kind in ("jog", "run") for move in description.moves)
        hidden = claim.kind in ("jump", "hop") and runs  # it looks like a stride
        sure = claim.kind in kinds("sure") and not behind and not hidden
        return ("contradicts" if sure else "silent"), "not found"
    sides = ", ".join(sorted({event.side or "?" for event in events}))
    if claim.side and claim.kind in kinds("limb"):
        if claim.side == BOTH:
            if claim.kind in ("kick", "punch", "knee"):
                return "agrees", f"found, {sides}"
            if not any(event.side == BOTH for event in events):
                each_side = {LEFT, RIGHT} <= {event.side for event in events}
                missing = "silent" if claim.kind in ("raise", "wave") else "contradicts"
                return ("agrees" if each_side else missing), f"found {sides}"
        sided = tuple(event for event in events if event.side)  # a bent trunk has no side
        events = tuple(event for event in sided or events if event.side in (claim.side, BOTH, ""))
        if not events:
            return "contradicts", f"found {sides}, expected {claim.side}"
    if claim.count and claim.kind in kinds("tallied"):
        count = sum(event.count for event in events if event.kind in (claim.kind, "jump", "hop"))
        if count != claim.count:
            near = repeated and count > claim.count
            near |= claim.count >= 4 and abs(count - claim.count) == 1
            return ("silent" if near else "contradicts"), f"found {count}, told {claim.count}"
    if claim.kind in ("jump", "hop") and claim.direction in _OPPOSITE:
        directions = {event.direction for event in events}
        if claim.direction not in directions:
            verdict = "contradicts" if _OPPOSITE[claim.direction] in directions else "silent"
            return verdict, f"went {', '.join(sorted(directions))}"
    return "agrees", f"found {sides}"


def events_for(kind: str, description: Description) -> tuple[Event, ...]:
    """Returns events, postures and turns that a claim of a kind may mean, by start."""
    events = [
        event for name in related("similar").get(kind, (kind,)) for event in description.find(name)
    ]
    return tuple(sorted(events, key=lambda event: event.start))


def frames_for(claim: Claim, description: Description) -> tuple[int, int] | None:
    """Returns the frames from the first to the last event that a claim may mean."""
    if claim.kind in (*_GAITS, "move"):
        events = [m for m in description.moves if m.kind != "stand"]
        if claim.direction in ("forward", "backward", LEFT, RIGHT):
            events = [m for m in events if m.direction == claim.direction] or events
    elif claim.kind in ("turn", "circle"):
        events = [t for t in description.turns if not claim.side or t.side == claim.side]
    else:
        events = [
            e for e in events_for(claim.kind, description) if claim.side in ("", e.side, BOTH)
        ]
    return (events[0].start, max(event.end for event in events)) if events else None


_checks = entries(_CHECKS)  # Registers the check of some kinds of claims.


@_checks(*_GAITS, "move")
def _gait(claim: Claim, description: Description) -> tuple[Verdict, str]:
    """Compares gait, direction and pace."""
    moves = [move for move in description.moves if move.kind != "stand"]
    if not moves:
        still = claim.kind != "move" and description.steps < 2
        return ("contradicts" if still else "silent"), "stays"
    gaits = {move.kind for move in moves}
    reason = ", ".join(sorted(gaits))
    fastest = max(move.amount for move in moves)
    gait: Verdict = "agrees"
    if claim.kind == "walk" and "walk" not in gaits and fastest >= 2.0:
        gait = "silent" if fastest < 2.6 else "contradicts"
    elif claim.kind in ("jog", "run") and not gaits & {"jog", "run"}:
        gait = "contradicts" if fastest < 1.1 else "silent"
        reason = f"{reason} at {fastest:.1f} m/s"
    if gait == "contradicts":
        return gait, reason
    direction, distances = _direction(claim, description, moves)
    if direction == "contradicts":
        return direction, distances
    frames = sum(move.frames for move in moves)
    speed = sum(move.amount * move.frames for move in moves) / frames
    if claim.kind in ("jog", "run"):
        wrong = claim.pace == "slow" and speed > 3.3
    else:
        too_fast = claim.pace == "slow" and speed > FAST - 0.1
        wrong = claim.kind == "walk" and (too_fast or (claim.pace == "fast" and speed < SLOW))
    if wrong:
        return "contradicts", f"{speed:.1f} m/s"
    return ("agrees" if "agrees" in (gait, direction) else "silent"), f"{reason}, {distances}"


def _direction(claim: Claim, description: Description, moves: list[Event]) -> tuple[Verdict, str]:
    """Compares the direction of a gait; returns the distances in each direction as well."""
    path, claimed, loose = description.path, claim.direction, claim.kind == "move"
    meters = {move.direction: 0.0 for move in moves}
    for move in moves:
        meters[move.direction] += move.amount * move.seconds
    distances = ", ".join(f"{direction} {far:.1f} m" for direction, far in meters.items())
    if not claimed or claimed == "place":
        far = claimed == "place" and path.length > 1.5 and not path.closed
        return ("contradicts" if far else "silent"), distances
    if claimed in _OPPOSITE:
        if meters.get(claimed, 0) > 0.25:
            return "agrees", distances
        unsure = loose and meters.get(_OPPOSITE[claimed], 0) < 0.5
        return ("contradicts" if path.length > 0.6 and not unsure else "silent"), distances
    if claimed == "side":
        if meters.get(LEFT, 0) + meters.get(RIGHT, 0) > 0.25:
            return "agrees", distances
        return ("contradicts" if path.length > 1 else "silent"), distances
    # A way to a side may be sideways, a drift, or a turn.
    other, sign = (RIGHT, 1) if claimed == LEFT else (LEFT, -1)
    turned = {
        side: sum(turn.amount for turn in description.turns if turn.side == side)
        for side in (claimed, other)
    }
    if meters.get(claimed, 0) > 0.25 or sign * path.left > 0.35 or turned[claimed] > 35:
        return "agrees", distances
    against = meters.get(other, 0) > 0.4 or sign * path.left < -0.5 or turned[other] > 45
    return ("contradicts" if against and not loose else "silent"), distances


@_checks("turn", "circle")
def _turn(claim: Claim, description: Description) -> tuple[Verdict, str]:
    """Compares side and degrees."""
    total = description.path.turned
    turned = [total, *(t.amount if t.side == LEFT else -t.amount for t in description.turns)]
    reason = ", ".join(f"{degrees:+.0f}" for degrees in turned[1:]) or f"{total:+.0f} in all"
    if claim.side:
        turned = [degrees if claim.side == LEFT else -degrees for degrees in turned]
    amounts = [degrees if claim.side else abs(degrees) for degrees in turned]
    most = max(amounts)
    if claim.degrees == SLIGHT:
        against = claim.side and most < 15 and min(turned) < -35
        return "contradicts" if against else "agrees" if most >= 15 else "silent", reason
    if claim.degrees:
        close = [a for a in amounts if 0.6 * claim.degrees <= a <= 1.4 * claim.degrees + 20]
        return "agrees" if close else "contradicts", reason
    circle = claim.kind == "circle"
    if most >= (200.0 if circle else 30.0):
        return "agrees", reason
    if circle and not claim.side and description.path.closed:
        return "agrees", reason
    left, right = description.twist
    twists = (claim.side != RIGHT and left > 25) or (claim.side != LEFT and right > 25)
    if twists and not circle:
        return "silent", f"{reason}, but the trunk twists"
    return "silent" if most >= (45.0 if circle else 18.0) else "contradicts", reason


@_checks("stop")
def _stop(claim: Claim, description: Description) -> tuple[Verdict, str]:
    stops = any(a.kind != "stand" and b.kind == "stand" for a, b in pairwise(description.moves))
    return ("agrees", "moves, then stands") if stops else ("silent", "no stop found")


@_checks("stand")
def _stand(claim: Claim, description: Description) -> tuple[Verdict, str]:
    standing = sum(move.frames for move in description.moves if move.kind == "stand")
    share = standing / description.frames
    reason = f"stands {100 * share:.0f} % of the time"
    if description.path.length > 1.0 and share < 0.25 and not claim.then:
        return "contradicts", reason
    return ("agrees" if share > 0.3 else "silent"), reason


@_checks("twist", "lift")
def _unmeasured(claim: Claim, description: Description) -> tuple[Verdict, str]:
    return "silent", "not measured"
