"""How closely a motion does what a prompt asks: degrees, counts, sides, ways, paces and order.

`agreement.py` says yes, no or nothing of captions, as people would; here takes of one prompt are
graded, so that of two that agree the nearer one is preferred.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from latentmotion.language.claims import SLIGHT, Claim, Request, kinds, limits, related
from latentmotion.measure.facts import BOTH, FPS, LEFT, RIGHT, Event
from latentmotion.measure.scene import Measured, lasting, meters, swings
from latentmotion.measure.signals import peaks
from latentmotion.measure.whole_body import stillness, stooped
from latentmotion.plugins import entries
from latentmotion.ranking.agreement import check_claim, events_for

_GAITS = kinds("gait")
# Degrees of turns, circles and slight turns that say none.
_USUAL_TURN, _USUAL_CIRCLE, _SLIGHTLY = 90.0, 360.0, 40.0

# Meters of a plain walk or run.
_FAR = 3.0

# Postures and poses that show an act.
_POSTURES = related("shown_by")

# Returns how closely a motion does what one claim asks, 0 to 1.
Grade = Callable[[Claim, Measured, Request], float]

# Grades by kind of claim; all other kinds are graded by their events.
_GRADES: dict[str, Grade] = {}


def closeness(request: Request, scene: Measured) -> float:
    """Returns how closely a motion does what is asked, the mean over its claims, 0 to 1.

    Args:
        request: What a prompt asks for.
        scene: The measurements of the motion.
    """
    grades = []
    for index, claim in enumerate(request.claims):
        grade = _GRADES.get(claim.kind, _event)(claim, scene, request)
        if index and request.in_turn:
            late = _follows(request.claims[index - 1], claim, scene)
            grade *= late if claim.then else 0.5 + 0.5 * late
        grades.append(grade)
    return float(np.mean(grades)) if grades else 0.0


_grades = entries(_GRADES)  # Registers the grade of some kinds of claims.


def _ramp(value: float, worst: float, best: float) -> float:
    """Returns 0 at the worst value, 1 at the best and beyond, and what is between."""
    return min(max(float(value - worst) / (best - worst), 0.0), 1.0)


def _near(count: float, asked: float) -> float:
    """Returns how near a count is to that asked."""
    return _ramp(abs(count - asked), 0.5 * asked + 1, 0.0)


@_grades("turn", "circle")
def _turn(claim: Claim, scene: Measured, request: Request) -> float:
    usual = _USUAL_CIRCLE if claim.kind == "circle" else _USUAL_TURN
    degrees = _SLIGHTLY if claim.degrees == SLIGHT else claim.degrees or usual
    degrees *= max(claim.count, 1)
    turns = [other for other in request.claims if other.kind in ("turn", "circle")]
    alone = len(turns) == 1
    turned = scene.path.turned
    if not alone:  # each is the largest turn to its side
        sides = [t.amount if t.side == LEFT else -t.amount for t in scene.turns]
        fitting = [a for a in sides if not claim.side or (a > 0) == (claim.side == LEFT)]
        turned = max(fitting, key=abs, default=0.0)
    turned = abs(turned) if not claim.side else turned if claim.side == LEFT else -turned
    error = abs(turned - degrees)
    if not claim.degrees:  # a turn that says no degrees may be smaller or larger
        error = max(error - 0.35 * degrees, 0) if turned < degrees or claim.kind == "turn" else 0.0
    if turned > degrees >= 360:
        error *= 0.5
    grade = _ramp(error, 0.45 * degrees + 20, 0.0)
    walked = claim.kind == "circle" or any(other.kind in _GAITS for other in request.claims)
    return grade * _ramp(scene.path.length, 0.0, 1.0) if walked else grade


@_grades(*_GAITS, "move")
def _gait(claim: Claim, scene: Measured, request: Request) -> float:
    moves = _moves(claim, scene)
    if claim.direction == "place":
        lifts = sum(len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T)
        return _ramp(lifts, 0, 4) * _ramp(scene.path.length, 1.5, 0.5)
    seconds = sum(move.seconds for move in moves)
    if claim.count:
        grade = _near(scene.steps, claim.count)
    else:
        grade = _ramp(seconds, 0.0, 0.6) * _ramp(scene.path.length, 0.0, 0.8)
        if claim.kind in _GAITS and claim.pace != "slow":
            grade *= 0.7 + 0.3 * _ramp(scene.path.length, 0.8, _FAR)
    if seconds:
        speed = sum(move.amount * move.seconds for move in moves) / seconds
        grade *= _pace(claim, speed)
    return grade * _way(claim, scene, request)


def _pace(claim: Claim, speed: float) -> float:
    """Compares the mean speed, m/s, with gait and pace."""
    if claim.pace == "slow":
        return _ramp(speed, 1.3, 0.8) if claim.kind in ("walk", "move") else _ramp(speed, 4, 2.5)
    if claim.kind == "run":
        return _ramp(speed, 1.5, 3.2) if claim.pace == "fast" else _ramp(speed, 1.0, 2.2)
    if claim.kind == "jog":
        return _ramp(speed, 1.0, 1.8)
    if claim.kind == "walk" and claim.pace == "fast":
        return _ramp(speed, 0.9, 1.5)
    if claim.kind == "walk":  # people walk at 1.2 to 1.4 m/s, halves of generated walks at 0.9
        return _ramp(speed, 2.3, 1.7) * (0.7 + 0.3 * _ramp(speed, 0.5, 1.2))
    return 1.0


def _way(claim: Claim, scene: Measured, request: Request) -> float:
    """Compares the direction of a gait, and whether the body keeps facing."""
    if claim.direction in ("", "place", "up"):
        return 1.0
    gone = meters(scene)
    if claim.direction == "side":
        gone["side"] = max(gone.pop(LEFT), gone.pop(RIGHT))
    ways = {other.direction for other in request.claims if other.direction}
    far = gone[claim.direction]
    if len(ways) > 1:
        return _ramp(far, 0.0, 0.4)
    share = far / max(sum(gone.values()), 1e-6)
    turning = any(other.kind in ("turn", "circle", "weave") for other in request.claims)
    faces = 1.0 if turning else _ramp(abs(scene.path.turned), 75.0, 15.0)
    return _ramp(share, 0.2, 0.9) * _ramp(far, 0.0, 0.3) * (0.4 + 0.6 * faces)


@_grades("stop", "stand")
def _stand(claim: Claim, scene: Measured, request: Request) -> float:
    if claim.kind == "stand" and len(request.claims) == 1:
        return float(stillness(scene.signals).mean())
    halts = [move for move in scene.moves if move.kind == "stand"]
    return _ramp(max((move.seconds for move in halts), default=0.0), 0.0, 0.5)


@_grades("weave")
def _weave(claim: Claim, scene: Measured, request: Request) -> float:
    return _ramp(swings(scene, 22), 0, 3) * _ramp(scene.path.length, 0.0, 1.5)


@_grades("speed_up", "slow_down")
def _change(claim: Claim, scene: Measured, request: Request) -> float:
    speed, third = scene.signals.speed, max(scene.frames // 3, 1)
    first, last = float(speed[:third].mean()), float(speed[-third:].mean())
    slow, fast = (first, last) if claim.kind == "speed_up" else (last, first)
    return _ramp(fast - slow, 0.0, 0.8) * _ramp(fast / max(slow, 0.1), 1.0, 1.6)


@_grades("stooped")
def _stooped(claim: Claim, scene: Measured, request: Request) -> float:
    share = float(stooped(scene.signals).mean())
    return _ramp(share, 0.0, 0.8) * _ramp(scene.path.length, 0.0, 0.8)


@_grades(*_POSTURES)
def _posture(claim: Claim, scene: Measured, request: Request) -> float:
    return _ramp(sum(event.seconds for event in _events(claim, scene)), 0.0, 0.8)


@_grades("stand_up")
def _stand_up(claim: Claim, scene: Measured, request: Request) -> float:
    postures = lasting(list(scene.postures), 0.3)
    low = [p.start for p in postures if p.kind not in ("stand", "bend")]
    rises = bool(low) and any(p.kind == "stand" and p.start > low[0] for p in postures)
    return 1.0 if rises else 0.0


@_grades("twist", "lift")
def _unmeasured(claim: Claim, scene: Measured, request: Request) -> float:
    return 0.5


def _event(claim: Claim, scene: Measured, request: Request) -> float:
    """Grades acts of hands, feet and the whole body: present, of the side, as often as asked."""
    events = _events(claim, scene)
    if not events:
        return 0.0
    same = {claim.kind} if claim.kind != "bow" else {"bow", "pick_up", "bend"}
    exact = [event for event in events if event.kind in same]
    if not exact:
        return {"agrees": 0.4, "silent": 0.2}.get(check_claim(claim, scene)[0], 0.0)
    sides = [event.side for event in exact]
    repeated = sum(other.kind == claim.kind for other in request.claims) > 1
    share = 1.0
    if claim.side and not repeated:
        share = sum(side == claim.side for side in sides) / len(sides)
        if claim.side == BOTH and {LEFT, RIGHT} <= set(sides):
            share = max(share, 0.5)
    elif claim.side:
        share = float(claim.side in sides)
    plain = limits("plain").get(claim.kind)
    most = max(event.amount for event in exact)  # height of a jump or a hand, speed of a fist
    grade = share * (0.7 + 0.3 * (_ramp(most, 0.0, plain) if plain else 1.0))
    if claim.count:
        times = len(exact) if claim.kind in ("raise", "wave") else sum(e.count for e in exact)
        grade *= _near(times, claim.count)
    elif claim.kind in kinds("single") and not repeated:
        grade *= _near(max(1, sum(e.count for e in exact if e.kind == claim.kind)), 1)
    if claim.kind in ("jump", "hop"):
        grade *= _way(replace(claim, kind="move"), scene, request)
    return grade


def _moves(claim: Claim, scene: Measured) -> list[Event]:
    """Returns the moves that a gait may mean, on foot and over the floor."""
    gaits = {"walk": ("walk",), "jog": ("jog", "run"), "run": ("jog", "run")}.get(
        claim.kind, _GAITS
    )
    moves = [move for move in scene.moves if move.kind in gaits]
    moves = [move for move in moves if move.direction not in ("", "place")]
    one_way = claim.direction in ("forward", "backward", LEFT, RIGHT)
    towards = [move for move in moves if move.direction == claim.direction]
    return lasting(towards if one_way else moves, 0.3)


def _events(claim: Claim, scene: Measured) -> list[Event]:
    """Returns the events, postures and poses that a claim may mean, by start."""
    if claim.kind in _POSTURES:
        return scene.all_of(*_POSTURES[claim.kind])
    if claim.kind in ("jack", "touch_head"):
        return scene.all_of(claim.kind)
    return list(events_for(claim.kind, scene))


def _spans(claim: Claim, scene: Measured) -> list[Event]:
    """Returns when an act takes place: all stretches of one that lasts, else the first."""
    if claim.kind in (*_GAITS, "move"):
        return _moves(claim, scene)
    if claim.kind in ("stop", "stand"):
        return lasting([move for move in scene.moves if move.kind == "stand"], 0.4)
    if claim.kind in ("turn", "circle"):
        turns = [turn for turn in scene.turns if claim.side in ("", turn.side)]
        return [max(turns, key=lambda turn: turn.amount)] if turns else []
    if claim.kind == "stand_up":
        return lasting([p for p in scene.postures if p.kind == "stand"], 0.3)
    events = [event for event in _events(claim, scene) if claim.side in ("", event.side)]
    exact = [event for event in events if event.kind == claim.kind]
    return (exact or events)[:1]


def _follows(first: Claim, second: Claim, scene: Measured) -> float:
    """Returns how surely the second act follows the first, 0 to 1 at half a second and more."""
    first_lasts, second_lasts = (claim.kind in kinds("lasting") for claim in (first, second))
    leads = []
    for before, after in product(_spans(first, scene), _spans(second, scene)):
        begins, ends = after.start - before.start, after.end - before.end
        lead = begins if first_lasts else ends if second_lasts else min(begins, ends)
        leads.append(lead / (0.5 * FPS))
    return _ramp(max(leads, default=0.0), 0.0, 1.0)
