"""Joints → windows that show one action alone.

Finders draw candidate windows around the acts, gaits and postures of a motion; `strictness` keeps
those that show nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.language.claims import kinds
from latentmotion.measure.facts import BOTH, Event, SingleAction
from latentmotion.measure.limbs import strides_of
from latentmotion.measure.scene import Measured, describe
from latentmotion.measure.signals import closed_gaps, spans
from latentmotion.measure.whole_body import stooped
from latentmotion.training.captioning.strictness import strictly

SHORTEST, LONGEST = 16, 196
"""Frames of the shortest and of the longest window."""

_GAITS = kinds("gait")
_RUNS = ("jog", "run")

# Windows of counted steps that are tried in one clip, which has many.
_MOST_STEPS = 12

# Kinds that repeat, and the most repetitions of a window.
_COUNTED = {
    "jump": 8, "hop": 8, "kick": 4, "punch": 6, "clap": 1, "knee": 8, "jack": 6, "squat": 4,
    "bow": 4, "raise": 4, "arm_circle": 2, "wave": 2,
}  # fmt: skip

_HELD = ("balance", "arms_out", "hands_on_hips", "touch_head")
_ALTERNATING = ("knee", "punch")
_LOWERED = {"sit_down": "sit_down", "lie_down": "lie_down", "kneel_down": "kneel"}
_POSTURES = {"sit": "sit", "lie": "lie", "kneel": "kneel", "crouch": "crouch", "floor": "sit_floor"}
# Least and most frames of a window before and after an act; others (5, 16).
_MARGINS = {"raise": (8, 18), "punch": (4, 14), "clap": (5, 14), "wave": (6, 18)}

Finder = Callable[[Measured, np.random.Generator], Iterator[SingleAction]]
"""Yields candidates, whose windows may show other acts as well."""

# All finders, in the order in which they draw windows.
_FINDERS: list[Finder] = []


def single_actions(
    joints: Float[np.ndarray, "frames 22 3"],
    generator: np.random.Generator,
    kinds: frozenset[str] | None = None,
) -> list[SingleAction]:
    """Returns windows that show one action and nothing else worth reporting.

    Args:
        joints: As `describe` takes them.
        generator: Draws margins; other draws give other windows of the same actions.
        kinds: Kinds of actions to return; all by default.
    """
    if len(joints) < SHORTEST:
        return []
    scene = describe(joints)
    actions: dict[tuple[str, int, int], SingleAction] = {}
    windows: dict[tuple[int, int], Measured] = {}
    for candidate in candidates(scene, generator):
        # Training shows multiples of four frames whole.
        action = replace(candidate, end=candidate.start + candidate.frames // 4 * 4)
        key, window = (action.kind, action.start, action.end), (action.start, action.end)
        if kinds is not None and action.kind not in kinds:
            continue
        if key in actions or not SHORTEST <= action.frames <= LONGEST:
            continue
        if window not in windows:
            windows[window] = describe(joints[action.start : action.end])
        verified = strictly(action, windows[window])
        if verified:
            actions[key] = verified
    return list(actions.values())


def candidates(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Yields windows that may show one action alone."""
    for find in _FINDERS:
        yield from find(scene, generator)


def _finder(function: Finder) -> Finder:
    """Registers a finder."""
    _FINDERS.append(function)
    return function


def _draw(generator: np.random.Generator, low: int, high: int) -> int:
    """Returns an integer from `low` to `high`, both included; `low` where there is no room."""
    return int(generator.integers(low, high + 1)) if high > low else low


def _inside(
    generator: np.random.Generator, start: int, end: int, shortest: int, longest: int
) -> tuple[int, int]:
    """Draws a window inside an interval."""
    length = _draw(generator, min(shortest, end - start), min(longest, end - start))
    first = start + _draw(generator, 0, end - start - length)
    return first, first + length


def _widened(
    scene: Measured,
    generator: np.random.Generator,
    event: Event,
    before: tuple[int, int],
    after: tuple[int, int],
) -> tuple[int, int]:
    """Draws a window around an event, with the least and most frames before and after it."""
    start = max(event.start - _draw(generator, *before), 0)
    return start, min(event.end + _draw(generator, *after), scene.frames)


@_finder
def _gaits(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    for move in scene.moves:
        if move.kind in _GAITS and move.direction not in ("", "place") and move.frames >= 20:
            shortest = 28 if move.kind == "walk" else 20
            for _ in range((2 if move.kind == "walk" else 4) + move.frames // 50):
                window = _inside(generator, move.start, move.end, shortest, 150)
                yield SingleAction(move.kind, *window, direction=move.direction, act=window)
        if move.kind in _GAITS and move.direction == "place" and move.frames >= 24:
            kind = "march" if move.kind == "walk" else "jog_in_place"
            for _ in range(2):
                window = _inside(generator, move.start, move.end, 30, 140)
                yield SingleAction(kind, *window, act=window)


def _gait_of(scene: Measured, turn: Event) -> str:
    """Returns the gait of a turn that is walked, jogged or run; nothing in place."""
    if turn.direction != "walking":
        return ""
    shared = dict.fromkeys(_GAITS, 0)
    for move in scene.moves:
        if move.kind in _GAITS and move.direction != "place":
            shared[move.kind] += turn.overlap(move)
    best = max(_GAITS, key=lambda kind: shared[kind])
    return best if shared[best] > 0.5 * turn.frames else ""


@_finder
def _turns(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    for turn in scene.turns:
        gait = _gait_of(scene, turn)
        if turn.direction == "walking" and not gait:
            continue
        kinds = ("turn", "circle", "half_circle") if gait else ("turn",)
        for _ in range(2):
            window = _widened(scene, generator, turn, (4, 16), (4, 16))
            for kind in kinds:
                act = (turn.start, turn.end)
                yield SingleAction(kind, *window, turn.side, gait=gait, act=act)
        for _ in range(3 if gait and turn.frames > 36 else 0):
            window = _inside(generator, turn.start, turn.end, 24, 170)
            for kind in kinds:
                yield SingleAction(kind, *window, turn.side, gait=gait, act=window)


@_finder
def _turns_with_gait(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds a straight gait before or after a turn, or both."""
    frames = scene.frames
    for turn in scene.turns:
        before, after = _straight(scene, turn, -1), _straight(scene, turn, 1)
        gaits = {kind for kind, _ in (before, after) if kind}
        act = (turn.start, turn.end)
        tail = min(turn.end + _draw(generator, 3, 12), frames)
        head = max(turn.start - _draw(generator, 3, 12), 0)
        first = turn.start - _draw(generator, 14, min(before[1], 60))
        last = turn.end + _draw(generator, 14, min(after[1], 60))
        if before[1] >= 14:
            yield SingleAction("walk_then_turn", first, tail, turn.side, gait=before[0], act=act)
        if after[1] >= 14:
            yield SingleAction("turn_then_walk", head, last, turn.side, gait=after[0], act=act)
        if min(before[1], after[1]) >= 14 and len(gaits) == 1 and 130 < turn.amount < 230:
            yield SingleAction("turn_and_return", first, last, turn.side, gait=before[0], act=act)


def _straight(scene: Measured, turn: Event, step: int) -> tuple[str, int]:
    """Returns the gait before (-1) or after (1) a turn, and the frames for which it is straight."""
    edge = turn.end if step > 0 else turn.start - 1
    heading = np.degrees(scene.signals.heading)
    for move in scene.moves:
        if not (move.start <= edge + 4 * step < move.end and move.kind in _GAITS):
            continue
        if move.direction != "forward":
            break
        count = 0
        for frame in range(edge, move.end if step > 0 else move.start - 1, step):
            if not 0 <= frame < len(heading) or abs(heading[frame] - heading[edge]) > 20:
                break
            count += 1
        return move.kind, count
    return "", 0


@_finder
def _changes(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds starts, stops and changes between walking and running."""
    for earlier, later in pairwise(scene.moves):
        before, after = ("run" if move.kind in _RUNS else move.kind for move in (earlier, later))
        kind = {
            ("stand", "walk"): "start_walking",
            ("stand", "run"): "start_running",
            ("walk", "stand"): "stop_walking",
            ("run", "stand"): "stop_running",
            ("walk", "run"): "walk_to_run",
            ("run", "walk"): "run_to_walk",
        }.get((before, after), "")
        in_place = "place" in (earlier.direction, later.direction)
        if not kind or in_place or min(earlier.frames, later.frames) < 10:
            continue
        for _ in range(4 if "run" in kind else 2):
            start = max(earlier.end - _draw(generator, 12, min(earlier.frames, 60)), earlier.start)
            end = min(later.start + _draw(generator, 14, min(later.frames, 80)), later.end)
            direction = later.direction if earlier.kind == "stand" else earlier.direction
            act = (earlier.end, later.start + 1)
            yield SingleAction(kind, start, end, direction=direction, act=act)


@_finder
def _paces(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds windows in which the body gets faster or slower."""
    frames = scene.frames
    for _ in range(2 + frames // 30 if frames >= 40 else 0):
        window = _inside(generator, 0, frames, 32, 120)
        speed = scene.signals.speed[slice(*window)]
        third = len(speed) // 3
        first, last = float(speed[:third].mean()), float(speed[-third:].mean())
        if min(first, last) < 0.35 or speed.min() < 0.25:
            continue
        if last > 1.5 * first + 0.2:
            yield SingleAction("speed_up", *window, act=window)
        if first > 1.5 * last + 0.2:
            yield SingleAction("slow_down", *window, act=window)


@_finder
def _weaving(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    turns = scene.turns
    for index in range(len(turns) - 1):
        for count in (2, 3, 4):
            group = turns[index : index + count]
            if len(group) < count or any(a.side == b.side for a, b in pairwise(group)):
                continue
            if any(turn.amount > 140 or turn.direction != "walking" for turn in group):
                continue
            way = replace(group[0], end=group[-1].end)
            window = _widened(scene, generator, way, (4, 20), (4, 20))
            gait = _gait_of(scene, group[0])
            if gait:
                yield SingleAction("weave", *window, gait=gait, act=window)


@_finder
def _steps(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds one to six steps; the body stands before them, after them or both."""
    strides, frames = strides_of(scene.signals), scene.frames
    actions = []
    for count in range(1, 7):
        for first in range(len(strides) - count + 1):
            following = strides[first + count :]
            start = strides[first][0]
            end = max(end for _, end in strides[first : first + count])
            before = start - max((end for _, end in strides[:first]), default=-99)
            after = (following[0][0] if following else frames + 99) - end
            turned = np.degrees(np.ptp(scene.signals.heading[start:end]))
            if max(before, after) < 8 or min(before, after) < 1 or turned > 40:
                continue
            early = min(start, before - 1)
            begin = max(start - _draw(generator, min(2, early), min(early, 16)), 0)
            late = _draw(generator, min(2, after - 1), min(after - 1, 18))
            window = (begin, min(end + late, frames))
            actions.append(SingleAction("steps", *window, count=count, act=(start, end)))
    for index in generator.permutation(len(actions))[:_MOST_STEPS].tolist():
        yield actions[index]


@_finder
def _standing(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    for move in scene.moves:
        if move.kind == "stand" and move.frames >= 24:
            window = _inside(generator, move.start, move.end, 24, 160)
            yield SingleAction("stand", *window, act=window)


@_finder
def _series(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds acts of a kind, one or several that follow each other within two seconds."""
    for kind, most in _COUNTED.items():
        events = scene.all_of(kind)
        for first in range(len(events)):
            for last in range(first, min(first + most, len(events))):
                group = events[first : last + 1]
                if any(b.start - a.end > 40 for a, b in pairwise(group)):
                    break
                side = _side(kind, group)
                if side is None:
                    continue
                start, end = group[0].start, max(event.end for event in group)
                least, margin = _MARGINS.get(kind, (5, 16))
                before = start - max((event.end for event in events[:first]), default=0)
                following = events[last + 1 :]
                after = (following[0].start if following else scene.frames) - end
                before, after = min(before, margin), min(after, margin)
                count = sum(event.count for event in group) if kind != "wave" else 1
                for _ in range(2 if min(before, after) >= 2 else 0):
                    begin = max(start - _draw(generator, min(least, before), before), 0)
                    until = end + _draw(generator, min(least, after), after)
                    window = (begin, min(until, scene.frames))
                    yield SingleAction(kind, *window, side, count=count, act=(start, end))


def _side(kind: str, group: list[Event]) -> str | None:
    """Returns the side of all events; `both` for alternating sides; None for another mixture."""
    sides = [event.side for event in group]
    if kind in ("jump", "clap", "jack", "squat", "bow"):
        return ""
    if len(set(sides)) == 1:
        return sides[0]
    if kind == "punch":
        return BOTH
    alternating = all(a != b for a, b in pairwise(sides))
    return BOTH if kind in _ALTERNATING and alternating and len(group) > 1 else None


@_finder
def _raises(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds a hand that goes up and stays there until the window ends."""
    for event in scene.all_of("raise"):
        if event.frames < 14 or event.start < 8:
            continue
        start = event.start - _draw(generator, 8, min(event.start, 20))
        end = event.start + _draw(generator, 12, min(event.frames, 70))
        yield SingleAction("raise", start, end, event.side, act=(event.start, end))


@_finder
def _held(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds poses that are held."""
    for kind in _HELD:
        for event in scene.all_of(kind):
            for _ in range(2 if event.frames >= 10 else 0):
                start, end = _widened(scene, generator, event, (2, 16), (2, 16))
                if end - start > 120:
                    end = start + _draw(generator, 40, 120)
                side = "" if event.side == BOTH else event.side
                yield SingleAction(kind, start, end, side, act=(event.start, event.end))


def _posture_at(scene: Measured, frame: int) -> str:
    for posture in scene.postures:
        if posture.start <= max(frame, 0) < posture.end:
            return posture.kind
    return ""


@_finder
def _rises(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds getting up from a seat or from the floor."""
    for event in scene.all_of("stand_up", "get_up"):
        before = _posture_at(scene, event.start - 2)
        kind = "stand_up" if event.kind == "stand_up" and before == "sit" else "get_up"
        for _ in range(0 if event.kind == "stand_up" and before == "kneel" else 2):
            window = _widened(scene, generator, event, (4, 24), (4, 24))
            yield SingleAction(kind, *window, act=(event.start, event.end))


@_finder
def _lowerings(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds sitting, lying and kneeling down from standing."""
    for event in scene.all_of(*_LOWERED):
        kind = _LOWERED[event.kind]
        if kind == "sit_down" and _posture_at(scene, event.end - 2) == "floor":
            kind = "sit_floor"
        for _ in range(2):
            window = _widened(scene, generator, event, (4, 24), (6, 40))
            yield SingleAction(kind, *window, act=(event.start, event.end))


@_finder
def _pick_ups(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    for event in scene.all_of("pick_up"):
        for _ in range(2):
            window = _widened(scene, generator, event, (3, 16), (3, 16))
            yield SingleAction("pick_up", *window, event.side, act=(event.start, event.end))


@_finder
def _postures(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds postures that are held: sitting, lying, kneeling, crouching, sitting on the floor."""
    for posture in scene.postures:
        kind = _POSTURES.get(posture.kind)
        if kind is None or posture.frames < (10 if kind == "crouch" else 20):
            continue
        for _ in range(2):
            start, end = _inside(generator, posture.start, posture.end, 24, 140)
            if kind == "crouch":
                start, end = _widened(scene, generator, posture, (4, 20), (0, 16))
                end = min(end, start + 120)
            yield SingleAction(kind, start, end, act=(posture.start, posture.end))


@_finder
def _low_gaits(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Finds crawling, and walking stooped."""
    for event in scene.all_of("crawl"):
        for _ in range(3 if event.frames >= 20 else 0):
            window = _inside(generator, event.start, event.end, 20, 140)
            yield SingleAction("crawl", *window, act=window)
    low = stooped(scene.signals)
    for first, last in spans(closed_gaps(low & (scene.signals.speed > 0.2), 6), 28):
        for _ in range(2):
            window = _inside(generator, first, last, 28, 140)
            yield SingleAction("sneak", *window, act=window)


@_finder
def _climbs(scene: Measured, generator: np.random.Generator) -> Iterator[SingleAction]:
    for event in scene.all_of("climb"):
        window = _widened(scene, generator, event, (4, 20), (4, 20))
        act = (event.start, event.end)
        yield SingleAction("climb", *window, direction=event.direction, act=act)
