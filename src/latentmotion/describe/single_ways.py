"""Windows that may show one way over the floor alone: gaits, turns, starts, stops, steps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from latentmotion.describe.facts import Event
from latentmotion.describe.legs import strides_of
from latentmotion.describe.scene import Scene
from latentmotion.describe.single import SingleAction

GAITS = ("walk", "jog", "run")
_RUNS = ("jog", "run")

_MOST_STEPS = 12
"""Windows of counted steps that are tried in one clip, which has many."""


def ways(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Yields candidates; whether nothing else happens in them is for `strictness` to say."""
    for find in (_gaits, _turns, _turned_ways, _changes, _paces, _weaving, _steps, _standing):
        yield from find(scene, generator)


def _draw(generator: np.random.Generator, low: int, high: int) -> int:
    """Returns a whole number from `low` to `high`, both included; `low` where there is no room."""
    return int(generator.integers(low, high + 1)) if high > low else low


def _inside(
    generator: np.random.Generator, start: int, end: int, shortest: int, longest: int
) -> tuple[int, int]:
    """Draws a window of a stretch."""
    length = _draw(generator, min(shortest, end - start), min(longest, end - start))
    first = start + _draw(generator, 0, end - start - length)
    return first, first + length


def _gaits(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    for move in scene.facts.moves:
        if move.kind in GAITS and move.direction not in ("", "place") and move.frames >= 20:
            shortest = 28 if move.kind == "walk" else 20
            for _ in range((2 if move.kind == "walk" else 4) + move.frames // 50):
                start, end = _inside(generator, move.start, move.end, shortest, 150)
                yield SingleAction(
                    move.kind, start, end, direction=move.direction, act=(start, end)
                )
        if move.kind in GAITS and move.direction == "place" and move.frames >= 24:
            kind = "march" if move.kind == "walk" else "jog_in_place"
            for _ in range(2):
                start, end = _inside(generator, move.start, move.end, 30, 140)
                yield SingleAction(kind, start, end, act=(start, end))


def _gait_of(scene: Scene, turn: Event) -> str:
    """The gait of a turn that is walked, jogged or run; nothing on the spot."""
    if turn.direction != "walking":
        return ""
    shared = dict.fromkeys(GAITS, 0)
    for move in scene.facts.moves:
        if move.kind in GAITS and move.direction != "place":
            shared[move.kind] += max(min(turn.end, move.end) - max(turn.start, move.start), 0)
    best = max(GAITS, key=lambda kind: shared[kind])
    return best if shared[best] > 0.5 * turn.frames else ""


def _turns(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    frames = scene.facts.frames
    for turn in scene.facts.turns:
        gait = _gait_of(scene, turn)
        if turn.direction == "walking" and not gait:
            continue
        for _ in range(2):
            start = max(turn.start - _draw(generator, 4, 16), 0)
            end = min(turn.end + _draw(generator, 4, 16), frames)
            for kind in ("turn", "circle", "half_circle") if gait else ("turn",):
                yield SingleAction(
                    kind, start, end, turn.side, gait=gait, act=(turn.start, turn.end)
                )
        for _ in range(3 if gait and turn.frames > 36 else 0):
            start, end = _inside(generator, turn.start, turn.end, 24, 170)
            for kind in ("turn", "circle", "half_circle"):
                yield SingleAction(kind, start, end, turn.side, gait=gait, act=(start, end))


def _turned_ways(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """A straight way before or after a turn, or both."""
    for turn in scene.facts.turns:
        before, after = _straight(scene, turn, -1), _straight(scene, turn, 1)
        gaits = [kind for kind, _ in (before, after) if kind]
        act = (turn.start, turn.end)
        frames = scene.facts.frames
        tail = min(turn.end + _draw(generator, 3, 12), frames)
        head = max(turn.start - _draw(generator, 3, 12), 0)
        ahead = turn.start - _draw(generator, 14, min(before[1], 60))
        rest = turn.end + _draw(generator, 14, min(after[1], 60))
        if before[1] >= 14:
            yield SingleAction("walk_then_turn", ahead, tail, turn.side, gait=before[0], act=act)
        if after[1] >= 14:
            yield SingleAction("turn_then_walk", head, rest, turn.side, gait=after[0], act=act)
        if min(before[1], after[1]) >= 14 and len(set(gaits)) == 1 and 130 < turn.amount < 230:
            yield SingleAction("turn_and_return", ahead, rest, turn.side, gait=gaits[0], act=act)


def _straight(scene: Scene, turn: Event, way: int) -> tuple[str, int]:
    """The gait that leads to a turn or away from it, and for how many frames it goes straight."""
    edge = turn.end if way > 0 else turn.start - 1
    heading = np.degrees(scene.signals.heading)
    for move in scene.facts.moves:
        near = edge + 4 * way
        if not (move.start <= near < move.end and move.kind in GAITS):
            continue
        if move.direction != "forward":
            break
        last = move.end if way > 0 else move.start - 1
        count = 0
        for frame in range(edge, last, way):
            if not 0 <= frame < len(heading) or abs(heading[frame] - heading[edge]) > 20:
                break
            count += 1
        return move.kind, count
    return "", 0


def _changes(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Starts, stops and changes between walking and running."""
    for one, two in pairwise(scene.facts.moves):
        kind = _change(one, two)
        if not kind or min(one.frames, two.frames) < 10:
            continue
        for _ in range(4 if "run" in kind else 2):
            start = one.end - _draw(generator, 12, min(one.frames, 60))
            end = two.start + _draw(generator, 14, min(two.frames, 80))
            direction = two.direction if one.kind == "stand" else one.direction
            yield SingleAction(
                kind,
                max(start, one.start),
                min(end, two.end),
                direction=direction,
                act=(one.end, two.start + 1),
            )


def _change(one: Event, two: Event) -> str:
    if "place" in (one.direction, two.direction):
        return ""
    kinds = one.kind, two.kind
    if kinds[0] == "stand" and kinds[1] in GAITS:
        return "start_running" if kinds[1] in _RUNS else "start_walking"
    if kinds[1] == "stand" and kinds[0] in GAITS:
        return "stop_running" if kinds[0] in _RUNS else "stop_walking"
    if kinds[0] == "walk" and kinds[1] in _RUNS:
        return "walk_to_run"
    return "run_to_walk" if kinds[0] in _RUNS and kinds[1] == "walk" else ""


def _paces(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Where the body gets faster or slower on its way."""
    speed, frames = scene.signals.speed, scene.facts.frames
    for _ in range(2 + frames // 30 if frames >= 40 else 0):
        start, end = _inside(generator, 0, frames, 32, 120)
        part = speed[start:end]
        third = len(part) // 3
        first, last = float(part[:third].mean()), float(part[-third:].mean())
        if min(first, last) < 0.35 or part.min() < 0.25:
            continue
        if last > 1.5 * first + 0.2:
            yield SingleAction("speed_up", start, end, act=(start, end))
        if first > 1.5 * last + 0.2:
            yield SingleAction("slow_down", start, end, act=(start, end))


def _weaving(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    turns = scene.facts.turns
    for index in range(len(turns) - 1):
        for count in (2, 3, 4):
            group = turns[index : index + count]
            sides = [turn.side for turn in group]
            if len(group) < count or any(a == b for a, b in pairwise(sides)):
                continue
            if any(turn.amount > 140 or turn.direction != "walking" for turn in group):
                continue
            start = max(group[0].start - _draw(generator, 4, 20), 0)
            end = min(group[-1].end + _draw(generator, 4, 20), scene.facts.frames)
            gait = _gait_of(scene, group[0])
            if gait:
                yield SingleAction("weave", start, end, gait=gait, act=(start, end))


def _steps(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """One to six steps, from standing to standing, or from standing, or to it."""
    strides = strides_of(scene.signals)
    spans = [
        (first, first + count - 1)
        for count in range(1, 7)
        for first in range(len(strides) - count + 1)
    ]
    found = [
        action
        for first, last in spans
        if (action := _stepped(scene, generator, strides, first, last)) is not None
    ]
    for index in generator.permutation(len(found))[:_MOST_STEPS].tolist():
        yield found[index]


def _stepped(
    scene: Scene,
    generator: np.random.Generator,
    strides: list[tuple[int, int]],
    first: int,
    last: int,
) -> SingleAction | None:
    """Cuts a window around some strides; the body stands before them, after them or both."""
    frames = scene.facts.frames
    start, end = strides[first][0], max(end for _, end in strides[first : last + 1])
    before = start - max((end for _, end in strides[:first]), default=-99)
    after = (strides[last + 1][0] if last + 1 < len(strides) else frames + 99) - end
    turned = np.degrees(np.ptp(scene.signals.heading[start:end]))
    if max(before, after) < 8 or min(before, after) < 1 or turned > 40:
        return None
    early = min(start, before - 1)
    begin = start - _draw(generator, min(2, early), min(early, 16))
    finish = min(end + _draw(generator, min(2, after - 1), min(after - 1, 18)), frames)
    return SingleAction("steps", max(begin, 0), finish, count=last - first + 1, act=(start, end))


def _standing(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    for move in scene.facts.moves:
        if move.kind == "stand" and move.frames >= 24:
            start, end = _inside(generator, move.start, move.end, 24, 160)
            yield SingleAction("stand", start, end, act=(start, end))
