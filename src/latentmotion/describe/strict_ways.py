"""Whether a window shows one way over the floor alone: straight, turned, started, stopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from latentmotion.describe.facts import FPS, LEFT, RIGHT
from latentmotion.describe.scene import Scene, meters, told_kinds
from latentmotion.describe.signals import peaks
from latentmotion.describe.single import SingleAction
from latentmotion.describe.strict_acts import Check

CALM = frozenset({"still", "stand", "gesture", "stop"})
"""Kinds that are told where nothing else is."""

GOING = frozenset({"walk", "jog", "run"})
"""Gaits."""


def _upright(scene: Scene) -> bool:
    standing = sum(part.frames for part in scene.facts.postures if part.kind == "stand")
    runs = any(move.kind in ("jog", "run") for move in scene.facts.moves)
    height, lean = (0.72, 40) if runs else (0.8, 25)
    low = (scene.signals.joints[:, 0, 1] < height) | (scene.signals.lean > lean)
    upright = standing > 0.95 * scene.facts.frames and float(low.mean()) < (0.3 if runs else 0.15)
    return upright and not _spreads_arms(scene)


def _spreads_arms(scene: Scene) -> bool:
    """Whether both arms are held out for half a second, as actors do before a take."""
    outward = [
        (scene.signals.of(f"{side}_wrist") - scene.signals.of(f"{side}_shoulder"))[:, 0] * sign
        for side, sign in ((LEFT, 1), (RIGHT, -1))
    ]
    return int((np.minimum(*outward) > 0.28).sum()) >= 10


def _is_straight(scene: Scene, turned: float) -> bool:
    way = scene.signals.joints[:, 0, ::2]
    net = float(np.linalg.norm(way[-1] - way[0]))
    heading = np.degrees(scene.signals.heading)
    return (
        abs(scene.facts.path.turned) <= turned
        and np.ptp(heading) <= turned + 20
        and net >= 0.9 * scene.facts.path.length
    )


def _pace(kind: str, speed: float) -> str:
    slow, normal, fast = {
        "walk": (0.8, (0.85, 1.35), 1.4),
        "jog": (1.9, (2.0, 2.6), 2.7),
        "run": (0.0, (2.7, 3.3), 3.6),
    }[kind]  # fmt: skip
    if speed < slow:
        return "slow"
    if speed > fast:
        return "fast"
    return "normal" if normal[0] <= speed <= normal[1] else ""


def _gait(action: SingleAction, scene: Scene) -> SingleAction | None:
    runs = {"jog", "run"}
    kinds = runs if action.kind in runs else {action.kind}
    if told_kinds(scene) - CALM - kinds or not _upright(scene):
        return None
    moves = [move for move in scene.facts.moves if move.kind != "stand"]
    if {move.direction for move in moves} != {action.direction}:
        return None
    if not {move.kind for move in moves} <= kinds:
        return None
    going = sum(move.frames for move in moves) / scene.facts.frames
    if going < 0.9 or not _is_straight(scene, 18) or scene.facts.path.length < 0.5:
        return None
    speed = float(scene.signals.speed.mean())
    kind = action.kind if action.kind == "walk" else "run" if speed > 2.6 else "jog"
    return replace(action, kind=kind, pace=_pace(kind, speed))


def _turn(action: SingleAction, scene: Scene) -> SingleAction | None:
    turns, net = scene.facts.turns, scene.facts.path.turned
    if told_kinds(scene) - CALM - GOING - {"turn"} or not turns:
        return None
    side = LEFT if net > 0 else RIGHT
    total = sum(turn.amount for turn in turns)
    if len(turns) > 1 and action.kind == "turn":
        return None
    if any(turn.side != side for turn in turns) or abs(total - abs(net)) > 20 + 0.1 * total:
        return None
    if side != action.side or not _upright(scene):
        return None
    return _shaped(replace(action, degrees=abs(net)), scene)


def _shaped(action: SingleAction, scene: Scene) -> SingleAction | None:
    """Checks how far a turn goes."""
    length, degrees = scene.facts.path.length, action.degrees
    kinds = {m.kind for m in scene.facts.moves if m.kind in GOING and m.direction != "place"}
    if action.gait:
        if kinds != {action.gait} or length < 0.8:
            return None
    elif length > 0.6:
        return None
    radius = length / max(np.radians(degrees), 0.1)
    if action.kind == "circle":
        return action if degrees >= 270 and length >= 2.2 and radius > 0.3 else None
    if action.kind == "half_circle":
        gradual = max(t.frames for t in scene.facts.turns) > 0.6 * scene.facts.frames
        return (
            action if 130 <= degrees <= 230 and length > 1.6 and radius > 0.4 and gradual else None
        )
    return action if 18 <= degrees <= 430 and not (action.gait and degrees > 250) else None


def _turned_way(action: SingleAction, scene: Scene) -> SingleAction | None:
    net = scene.facts.path.turned
    turns = scene.facts.turns
    if told_kinds(scene) - CALM - GOING - {"turn"} or len(turns) != 1 or not _upright(scene):
        return None
    moves = [m for m in scene.facts.moves if m.kind in GOING]
    if {m.kind for m in moves} != {action.gait} or any(m.direction == "place" for m in moves):
        return None
    if turns[0].side != action.side or abs(turns[0].amount - abs(net)) > 25:
        return None
    if action.kind == "turn_and_return" and not 140 <= abs(net) <= 225:
        return None
    straight = abs(net) >= 30 and _going_straight(action, scene)
    return replace(action, degrees=abs(net)) if straight else None


def _going_straight(action: SingleAction, scene: Scene) -> bool:
    """Whether there is a straight way of 0.5 m and more before or after the turn."""
    first, last = action.act[0] - action.start, action.act[1] - action.start
    speed = scene.signals.speed / FPS
    before, after = float(speed[:first].sum()), float(speed[last:].sum())
    if action.kind == "walk_then_turn":
        return before > 0.5
    return after > 0.5 and (action.kind == "turn_then_walk" or before > 0.5)


def _change(action: SingleAction, scene: Scene) -> SingleAction | None:
    """Checks a start, a stop, or a change of gait: the moves are these two, straight."""
    allowed = CALM | GOING | {"turn"}
    if told_kinds(scene) - allowed or abs(scene.facts.path.turned) > 40 or not _upright(scene):
        return None
    if any(turn.amount > 50 for turn in scene.facts.turns):
        return None
    moves = [move for move in scene.facts.moves if move.frames >= 8]
    kinds = [_CLASS.get(move.kind, "") for move in moves]
    merged = [kind for n, kind in enumerate(kinds) if n == 0 or kinds[n - 1] != kind]
    if merged != _STAGES[action.kind] or any(move.direction == "place" for move in moves):
        return None
    going = [move for move in moves if move.kind != "stand"]
    ways = {move.direction for move in going}
    fast = all(move.amount > (1.4 if move.kind in ("jog", "run") else 0.4) for move in going)
    if len(ways) != 1 or not fast or min(move.frames for move in going) < 10:
        return None
    return replace(action, direction=ways.pop())


_CLASS = {"stand": "stand", "walk": "walk", "jog": "run", "run": "run"}
_STAGES = {
    "start_walking": ["stand", "walk"], "start_running": ["stand", "run"],
    "stop_walking": ["walk", "stand"], "stop_running": ["run", "stand"],
    "walk_to_run": ["walk", "run"], "run_to_walk": ["run", "walk"],
}  # fmt: skip


def _paces(action: SingleAction, scene: Scene) -> SingleAction | None:
    moves = scene.facts.moves
    if told_kinds(scene) - CALM - GOING or not _upright(scene) or not _is_straight(scene, 40):
        return None
    if any(move.direction != "forward" for move in moves):
        return None
    gaits = {_CLASS[move.kind] for move in moves}
    if gaits == {"walk"} and float(scene.signals.speed.max()) > 1.9:
        return None
    return replace(action, gait=gaits.pop(), direction="forward") if len(gaits) == 1 else None


def _weaves(action: SingleAction, scene: Scene) -> SingleAction | None:
    if told_kinds(scene) - CALM - GOING - {"turn"} or not _upright(scene):
        return None
    left, ahead = scene.signals.velocity.T
    moving = scene.signals.speed > 0.3
    course = np.degrees(np.unwrap(scene.signals.heading + np.arctan2(left, ahead))[moving])
    if moving.mean() < 0.85 or scene.facts.path.length < 1.6 or abs(scene.facts.path.turned) > 80:
        return None
    swings = sum(len(peaks(c - c.min(), 0, 25)) for c in (course, -course))
    kinds = {m.kind for m in scene.facts.moves if m.kind in GOING}
    return action if swings >= 2 and kinds == {action.gait} else None


def _steps(action: SingleAction, scene: Scene) -> SingleAction | None:
    if told_kinds(scene) - CALM - {"walk"} or scene.facts.turns or not _upright(scene):
        return None
    way = max(meters(scene).items(), key=lambda item: item[1])
    total = sum(meters(scene).values())
    if scene.facts.steps != action.count or way[1] < max(0.2 * action.count, 0.8 * total):
        return None
    if abs(scene.facts.path.turned) > 30:
        return None
    return replace(action, direction=way[0])


def _sneaks(action: SingleAction, scene: Scene) -> SingleAction | None:
    low = (scene.signals.joints[:, 0, 1] < 0.84) | (scene.signals.lean > 22)
    postures = {posture.kind for posture in scene.facts.postures}
    kinds = {m.kind for m in scene.facts.moves if m.kind in GOING}
    fine = low.mean() > 0.8 and postures <= {"stand", "crouch", "bend"} and kinds == {"walk"}
    if not fine or scene.facts.path.length < 0.6 or abs(scene.facts.path.turned) > 60:
        return None
    if told_kinds(scene) - CALM - {"walk", "turn", "stay_crouch", "stay_bend", "bow", "squat"}:
        return None
    ways = {m.direction for m in scene.facts.moves if m.kind in GOING}
    fine = len(ways) == 1 and ways <= {"forward", "backward"} and not _spreads_arms(scene)
    return replace(action, direction=ways.pop()) if fine else None


WAY_CHECKS: dict[str, Check] = {
    "walk": _gait, "jog": _gait, "run": _gait, "turn": _turn, "circle": _turn,
    "half_circle": _turn, "walk_then_turn": _turned_way, "turn_then_walk": _turned_way,
    "turn_and_return": _turned_way, "speed_up": _paces, "slow_down": _paces, "weave": _weaves,
    "steps": _steps, "sneak": _sneaks, **dict.fromkeys(_STAGES, _change),
}  # fmt: skip
"""Checks by kind."""
