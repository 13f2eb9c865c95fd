"""Whether a window shows a single action and nothing else that is worth telling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from latentmotion.describe.acts import acts_of
from latentmotion.describe.facts import BOTH, FPS, LEFT, RIGHT, Event
from latentmotion.describe.poses import stillness
from latentmotion.describe.scene import Scene
from latentmotion.describe.signals import peaks
from latentmotion.describe.single import SingleAction

_CALM = frozenset({"still", "stand", "gesture", "stop"})
_GOING = frozenset({"walk", "jog", "run"})
_RISE = {"jump": 0.08, "hop": 0.03}
_PUNCH_SPEED = 2.1
"""Meters per second by which a punching fist leaves its shoulder; gestures are slower."""

_OTHER = {LEFT: RIGHT, RIGHT: LEFT}

_TOLD = frozenset({"jack", "crawl", "arms_out", "hands_on_hips", "touch_head"})


@dataclass(frozen=True)
class Limits:
    """What a window of a kind may show besides."""

    also: frozenset[str] = frozenset()
    """Kinds of acts that may be told of it as well."""
    travel: float = 0.7
    """Most meters that the pelvis goes, either way."""
    turned: float = 45.0
    """Most degrees by which the heading changes."""


def _limits(also: str = "", travel: float = 0.7, turned: float = 45.0) -> Limits:
    return Limits(_CALM | frozenset(also.split()), travel, turned)


_LIMITS = {
    "jump": _limits("jump hop squat raise walk arms_out bow", 4.0),
    "hop": _limits("hop knee balance raise walk", 4.0),
    "kick": _limits("kick knee balance raise walk", 1.8, 60),
    "punch": _limits("punch raise walk", 1.0, 60),
    "wave": _limits("wave raise touch_head arms_out", 0.5),
    "raise": _limits("raise arms_out touch_head", 0.5),
    "clap": _limits("clap raise", 0.6),
    "knee": _limits("knee balance raise walk", 0.9),
    "march": _limits("walk knee balance", 0.9),
    "jog_in_place": _limits("jog knee jump walk", 0.9),
    "jack": _limits("jack jump raise arms_out wave arm_circle", 0.9),
    "squat": _limits("squat stay_crouch raise arms_out", 0.5),
    "bow": _limits("bow stay_bend raise", 0.6),
    "pick_up": _limits("pick_up squat bow walk", 1.2, 70),
    "balance": _limits("balance knee raise arms_out kick", 0.6, 50),
    "arms_out": _limits("arms_out raise", 0.5),
    "hands_on_hips": _limits("hands_on_hips", 0.5),
    "touch_head": _limits("touch_head raise", 0.5),
    "arm_circle": _limits("arm_circle raise arms_out wave", 0.6),
    "sit_down": _limits("sit_down stay_sit knee balance bow", 1.0, 120),
    "sit": _limits("stay_sit sit_down", 0.3),
    "stand_up": _limits("stand_up stay_sit knee balance bow", 1.0, 90),
    "sit_floor": _limits("sit_down stay_floor floor stay_kneel kneel_down", 1.0, 120),
    "lie_down": _limits(
        "lie_down stay_lie stay_floor sit_down kneel_down crawl stay_kneel", 2.0, 150
    ),
    "lie": _limits("stay_lie crawl", 0.6, 60),
    "get_up": _limits("get_up stand_up stay_lie stay_floor stay_kneel sit_up crawl", 2.0, 150),
    "kneel": _limits("kneel_down stay_kneel stay_crouch knee balance", 1.0, 60),
    "crouch": _limits("stay_crouch squat", 0.6),
    "crawl": _limits("crawl walk stay_bend stay_kneel stay_crouch climb", 9, 60),
    "climb": _limits("climb walk", 6, 60),
    "stand": _limits("", 0.25, 20),
}


def strictly(action: SingleAction, scene: Scene) -> SingleAction | None:
    """Returns the action as its window shows it, measured anew; None where it shows more, or less.

    Args:
        action: A candidate.
        scene: What is measured in its window alone.
    """
    check = _WAYS.get(action.kind)
    if check:
        return check(action, scene)
    limits, path = _LIMITS[action.kind], scene.facts.path
    if path.length > limits.travel or abs(path.turned) > limits.turned:
        return None
    if others(scene) - limits.also:
        return None
    return _ACTS[action.kind](action, scene)


def others(scene: Scene) -> set[str]:
    """Returns the kinds of what is worth telling of a window."""
    told = {act.kind for act in acts_of(scene.facts)}
    return told | {pose.kind for pose in scene.poses if pose.kind in _TOLD and pose.frames >= 10}


def _only(action: SingleAction, events: list[Event], count: int | None = None) -> bool:
    """Whether events are all of the action's side, and as many as it has."""
    if not events:
        return False
    if action.side in (LEFT, RIGHT) and any(event.side != action.side for event in events):
        return False
    return count is None or count == action.count


def _times(*kinds: str) -> Callable[[SingleAction, Scene], SingleAction | None]:
    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        events = scene.find(*(kinds or (action.kind,)))
        number = sum(event.count for event in events)
        return action if _only(action, events, number) else None

    return check


def _squats(action: SingleAction, scene: Scene) -> SingleAction | None:
    planted = float(scene.signals.feet.max()) < 0.15
    return action if planted and _only(action, (e := scene.find("squat")), len(e)) else None


def _jumps(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("jump", "hop")
    real = [event for event in events if event.amount >= _RISE[event.kind]]
    if len(real) != action.count or len(events) != len(real):
        return None
    if action.kind == "hop" and not all(_is_hop(event, action.side, scene) for event in events):
        return None
    if action.kind == "jump" and any(e.kind == "hop" for e in events):
        return None
    way = max(meters(scene).items(), key=lambda item: item[1])
    far = way[1] > (0.3 if way[0] == "forward" else 0.2)
    near = scene.facts.path.length < 0.4
    if not far and not near:
        return None
    return replace(action, direction=way[0] if far else "")


def _is_hop(event: Event, side: str, scene: Scene) -> bool:
    """Whether it is a hop on that foot, and the other foot does not touch the floor around it."""
    around = slice(max(event.start - 3, 0), event.end + 4)
    other = scene.signals.feet[around, 1 if side == LEFT else 0]
    return event.kind == "hop" and event.side == side and float(other.min()) > 0.05


def _kicks(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("kick")
    if not _only(action, events, len(events)) or any(e.kind == "hop" for e in scene.find("hop")):
        return None
    ways = {event.direction for event in events}
    return replace(action, direction=ways.pop() if len(ways) == 1 else "")


def _punches(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("punch")
    if len(events) != action.count or scene.find("wave"):
        return None
    sides = {event.side for event in events}
    right = sides == {action.side} or (action.side == BOTH and len(sides) == 2)
    quick = all(event.amount > _PUNCH_SPEED for event in events)
    return action if right and quick else None


def _waves(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("wave")
    others_down = all(
        _highest(scene, side) < -0.1 for side in (LEFT, RIGHT) if action.side not in (side, BOTH)
    )
    calm = np.degrees(np.ptp(scene.signals.heading)) < 40
    right = {event.side for event in events} == {action.side}
    return action if right and others_down and calm else None


def _raises(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("raise")
    if scene.find("wave", "punch", "clap", "arm_circle") or len(events) != action.count:
        return None
    if any(event.side != action.side or event.amount < 0.12 for event in events):
        return None
    other = [s for s in (LEFT, RIGHT) if s != action.side and action.side != BOTH]
    if any(_highest(scene, side) > -0.15 for side in other):
        return None
    up = {event.direction for event in events}
    return replace(action, direction=up.pop() if len(up) == 1 else "")


def _highest(scene: Scene, side: str) -> float:
    """Meters by which a hand gets above its shoulder; negative is below."""
    signals = scene.signals
    return float((signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"))[:, 1].max())


def _knees(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("knee")
    if scene.find("kick", "hop", "jump") or len(events) != action.count:
        return None
    sides = {event.side for event in events}
    if action.side == BOTH:
        return action if len(sides) == 2 else None
    return action if sides == {action.side} else None


def _marches(action: SingleAction, scene: Scene) -> SingleAction | None:
    if not in_place(scene, 0.6):
        return None
    lifts = [len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T]
    return action if min(lifts) >= 2 and sum(lifts) >= 4 else None


def _reaches(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("pick_up")
    ends = scene.facts.postures[-1].kind, scene.facts.postures[0].kind
    fine = len(events) == 1 and ends == ("stand", "stand")
    return replace(action, side=events[0].side) if fine else None


def _held(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find(action.kind)
    held = sum(event.frames for event in events) > 0.4 * scene.facts.frames
    if action.kind == "touch_head" and _highest(scene, _OTHER[action.side]) > -0.1:
        return None
    return action if held and _only(action, events) else None


def _passing(kind: str) -> int:
    """Frames from which a posture between others is one of its own."""
    return 30 if kind in ("bend", "crouch") else 16


def _postures(*stages: str) -> Callable[[SingleAction, Scene], SingleAction | None]:
    """Checks that postures follow each other so, short passing ones left out."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        kept = [
            posture.kind
            for posture in scene.facts.postures
            if posture.kind in stages or posture.frames >= _passing(posture.kind)
        ]
        merged = [kind for n, kind in enumerate(kept) if n == 0 or kept[n - 1] != kind]
        return action if tuple(merged) == stages else None

    return check


def _rests(kind: str) -> Callable[[SingleAction, Scene], SingleAction | None]:
    """Checks that a posture is all there is and that little moves."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        alone = {posture.kind for posture in scene.facts.postures} == {kind}
        return action if alone and scene.facts.activity < 0.35 else None

    return check


def _seated(*stages: str) -> Callable[[SingleAction, Scene], SingleAction | None]:
    """Checks postures of which one is on a seat, as high as a low stool at least."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        high = float(scene.signals.joints[:, 0, 1].min()) > 0.35
        return _postures(*stages)(action, scene) if high else None

    return check


def _either(
    *checks: Callable[[SingleAction, Scene], SingleAction | None],
) -> Callable[[SingleAction, Scene], SingleAction | None]:
    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        return next((found for one in checks if (found := one(action, scene))), None)

    return check


def _crawls(action: SingleAction, scene: Scene) -> SingleAction | None:
    held = sum(event.frames for event in scene.find("crawl"))
    return action if held > 0.8 * scene.facts.frames else None


def _climbs(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("climb")
    return action if [e.direction for e in events] == [action.direction] else None


def _stands(action: SingleAction, scene: Scene) -> SingleAction | None:
    still = stillness(scene.signals).mean() >= 0.85
    standing = all(posture.kind == "stand" for posture in scene.facts.postures)
    hands = max(_highest(scene, side) for side in (LEFT, RIGHT)) < -0.15
    return action if still and standing and hands else None


def _circles(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("arm_circle")
    fine = events and {event.side for event in events} == {action.side}
    count = sum(event.count for event in events)
    return replace(action, direction=events[0].direction, count=count) if fine else None


_ACTS: dict[str, Callable[[SingleAction, Scene], SingleAction | None]] = {
    "jump": _jumps, "hop": _jumps, "kick": _kicks, "punch": _punches, "wave": _waves,
    "raise": _raises, "clap": _times(), "knee": _knees, "march": _marches,
    "jog_in_place": _marches, "jack": _times(), "squat": _squats, "bow": _times(),
    "pick_up": _reaches, "balance": _held, "arms_out": _held, "hands_on_hips": _held,
    "touch_head": _held, "arm_circle": _circles, "sit_down": _seated("stand", "sit"),
    "sit": _seated("sit"), "stand_up": _seated("sit", "stand"),
    "sit_floor": _either(
        _postures("stand", "floor"), _postures("floor"), _postures("stand", "kneel", "floor")
    ),
    "lie_down": _either(
        _postures("stand", "lie"), _postures("stand", "floor", "lie"),
        _postures("stand", "kneel", "lie"),
    ),
    "lie": _rests("lie"),
    "get_up": _either(
        _postures("lie", "stand"), _postures("floor", "stand"), _postures("lie", "kneel", "stand"),
        _postures("lie", "floor", "stand"), _postures("floor", "kneel", "stand"),
    ),
    "kneel": _either(_postures("stand", "kneel"), _postures("kneel")),
    "crouch": _either(
        _postures("stand", "crouch"), _postures("crouch"), _postures("stand", "crouch", "stand")
    ),
    "crawl": _crawls, "climb": _climbs, "stand": _stands,
}  # fmt: skip


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


def in_place(scene: Scene, most: float) -> bool:
    """Whether the pelvis stays within so many meters of its middle."""
    way = scene.signals.joints[:, 0, ::2]
    return float(np.linalg.norm(way - np.median(way, axis=0), axis=1).max()) <= most


def meters(scene: Scene) -> dict[str, float]:
    """Returns how far the pelvis goes to each side of the body."""
    left, ahead = scene.signals.velocity.T / FPS
    sideways, forward = np.abs(left) > np.abs(ahead), np.abs(ahead) >= np.abs(left)
    return {
        "forward": float(ahead[forward & (ahead > 0)].sum()),
        "backward": float(-ahead[forward & (ahead < 0)].sum()),
        LEFT: float(left[sideways & (left > 0)].sum()),
        RIGHT: float(-left[sideways & (left < 0)].sum()),
    }


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
    if others(scene) - _CALM - kinds or not _upright(scene):
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
    if others(scene) - _CALM - _GOING - {"turn"} or not turns:
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
    kinds = {m.kind for m in scene.facts.moves if m.kind in _GOING and m.direction != "place"}
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
    if others(scene) - _CALM - _GOING - {"turn"} or len(turns) != 1 or not _upright(scene):
        return None
    moves = [m for m in scene.facts.moves if m.kind in _GOING]
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
    allowed = _CALM | _GOING | {"turn"}
    if others(scene) - allowed or abs(scene.facts.path.turned) > 40 or not _upright(scene):
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
    fast = all(move.amount > (1.9 if move.kind in ("jog", "run") else 0.4) for move in going)
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
    if others(scene) - _CALM - _GOING or not _upright(scene) or not _is_straight(scene, 40):
        return None
    if any(move.direction != "forward" for move in moves):
        return None
    gaits = {_CLASS[move.kind] for move in moves}
    if gaits == {"walk"} and float(scene.signals.speed.max()) > 1.9:
        return None
    return replace(action, gait=gaits.pop(), direction="forward") if len(gaits) == 1 else None


def _weaves(action: SingleAction, scene: Scene) -> SingleAction | None:
    if others(scene) - _CALM - _GOING - {"turn"} or not _upright(scene):
        return None
    left, ahead = scene.signals.velocity.T
    moving = scene.signals.speed > 0.3
    course = np.degrees(np.unwrap(scene.signals.heading + np.arctan2(left, ahead))[moving])
    if moving.mean() < 0.85 or scene.facts.path.length < 1.6 or abs(scene.facts.path.turned) > 80:
        return None
    swings = sum(len(peaks(c - c.min(), 0, 25)) for c in (course, -course))
    kinds = {m.kind for m in scene.facts.moves if m.kind in _GOING}
    return action if swings >= 2 and kinds == {action.gait} else None


def _steps(action: SingleAction, scene: Scene) -> SingleAction | None:
    if others(scene) - _CALM - {"walk"} or scene.facts.turns or not _upright(scene):
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
    kinds = {m.kind for m in scene.facts.moves if m.kind in _GOING}
    fine = low.mean() > 0.8 and postures <= {"stand", "crouch", "bend"} and kinds == {"walk"}
    if not fine or scene.facts.path.length < 0.6 or abs(scene.facts.path.turned) > 60:
        return None
    if others(scene) - _CALM - {"walk", "turn", "stay_crouch", "stay_bend", "bow", "squat"}:
        return None
    ways = {m.direction for m in scene.facts.moves if m.kind in _GOING}
    fine = len(ways) == 1 and ways <= {"forward", "backward"} and not _spreads_arms(scene)
    return replace(action, direction=ways.pop()) if fine else None


_WAYS: dict[str, Callable[[SingleAction, Scene], SingleAction | None]] = {
    "walk": _gait, "jog": _gait, "run": _gait, "turn": _turn, "circle": _turn,
    "half_circle": _turn, "walk_then_turn": _turned_way, "turn_then_walk": _turned_way,
    "turn_and_return": _turned_way, "speed_up": _paces, "slow_down": _paces, "weave": _weaves,
    "steps": _steps, "sneak": _sneaks, **dict.fromkeys(_STAGES, _change),
}  # fmt: skip
