"""Windows that may show one act alone: what hands and feet do, counted, and postures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from latentmotion.describe.facts import BOTH, Event
from latentmotion.describe.scene import Scene
from latentmotion.describe.signals import closed_gaps, spans
from latentmotion.describe.single import SingleAction

_COUNTED = {
    "jump": 8, "hop": 8, "kick": 4, "punch": 6, "clap": 1, "knee": 8, "jack": 6, "squat": 4,
    "bow": 4, "raise": 4, "arm_circle": 2, "wave": 2,
}  # fmt: skip
"""Kinds that repeat, and how many of them a window may have."""

_HELD = ("balance", "arms_out", "hands_on_hips", "touch_head")
_ALTERNATING = ("knee", "punch")
_BEFORE = {"raise": (8, 18), "punch": (4, 14), "clap": (5, 14), "wave": (6, 18)}
"""Frames by which a window begins before an act and ends after it; others (5, 16)."""


def acts(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Yields candidates; whether nothing else happens in them is for `strictness` to say."""
    for find in (_series, _held, _risen, _lowered, _picked, _lasting, _low_ways, _climbs):
        yield from find(scene, generator)


def _draw(generator: np.random.Generator, low: int, high: int) -> int:
    return int(generator.integers(low, high + 1)) if high > low else low


def _around(
    scene: Scene,
    generator: np.random.Generator,
    act: tuple[int, int],
    margins: tuple[int, int],
    bounds: tuple[int, int],
) -> tuple[int, int] | None:
    """Draws a window around an act within bounds; None where it has no room."""
    before = min(act[0] - bounds[0], margins[1])
    after = min(bounds[1] - act[1], margins[1])
    if min(before, after) < 2:
        return None
    start = act[0] - _draw(generator, min(margins[0], before), before)
    end = act[1] + _draw(generator, min(margins[0], after), after)
    return max(start, 0), min(end, scene.facts.frames)


def _series(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """One act, or several of a kind that follow each other within two seconds."""
    frames = scene.facts.frames
    for kind, most in _COUNTED.items():
        events = scene.find(kind)
        for first in range(len(events)):
            for last in range(first, min(first + most, len(events))):
                group = events[first : last + 1]
                if _gap(group) > 40:
                    break
                side = _side(kind, group)
                if side is None:
                    continue
                act = (group[0].start, max(event.end for event in group))
                bounds = (
                    max((event.end for event in events[:first]), default=0),
                    events[last + 1].start if last + 1 < len(events) else frames,
                )
                margins = _BEFORE.get(kind, (5, 16))
                count = sum(event.count for event in group) if kind != "wave" else 1
                for _ in range(2):
                    window = _around(scene, generator, act, margins, bounds)
                    if window:
                        yield SingleAction(kind, *window, side, count=count, act=act)
    yield from _raised(scene, generator)


def _gap(group: list[Event]) -> int:
    return max((b.start - a.end for a, b in pairwise(group)), default=0)


def _side(kind: str, group: list[Event]) -> str | None:
    """The side of all; `both` for sides in turn; None for another mixture."""
    sides = [event.side for event in group]
    if kind in ("jump", "clap", "jack", "squat", "bow"):
        return ""
    if len(set(sides)) == 1:
        return sides[0]
    if kind == "punch":
        return BOTH
    turns = all(a != b for a, b in pairwise(sides))
    return BOTH if kind in _ALTERNATING and turns and len(group) > 1 else None


def _raised(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """A hand goes up and stays until the window ends."""
    for event in scene.find("raise"):
        if event.frames < 14 or event.start < 8:
            continue
        start = event.start - _draw(generator, 8, min(event.start, 20))
        end = event.start + _draw(generator, 12, min(event.frames, 70))
        yield SingleAction("raise", start, end, event.side, act=(event.start, end))


def _held(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    frames = scene.facts.frames
    for kind in _HELD:
        for event in scene.find(kind):
            if event.frames < 10:
                continue
            for _ in range(2):
                start = max(event.start - _draw(generator, 2, 16), 0)
                end = min(event.end + _draw(generator, 2, 16), frames)
                if end - start > 120:
                    end = start + _draw(generator, 40, 120)
                yield SingleAction(
                    kind,
                    start,
                    end,
                    "" if event.side == BOTH else event.side,
                    act=(event.start, event.end),
                )


def _risen(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Getting up, from a seat or from the floor."""
    for event in scene.find("stand_up", "get_up"):
        seat = _posture_at(scene, event.start - 2)
        kind = "stand_up" if event.kind == "stand_up" and seat == "sit" else "get_up"
        if event.kind == "stand_up" and seat == "kneel":
            continue
        for _ in range(2):
            start = max(event.start - _draw(generator, 4, 24), 0)
            end = min(event.end + _draw(generator, 4, 24), scene.facts.frames)
            yield SingleAction(kind, start, end, act=(event.start, event.end))


def _posture_at(scene: Scene, frame: int) -> str:
    for posture in scene.facts.postures:
        if posture.start <= max(frame, 0) < posture.end:
            return posture.kind
    return ""


def _lowered(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Sitting, lying and kneeling down, from standing."""
    kinds = {"sit_down": "sit_down", "lie_down": "lie_down", "kneel_down": "kneel"}
    for event in scene.find(*kinds):
        kind = kinds[event.kind]
        if kind == "sit_down" and _posture_at(scene, event.end - 2) == "floor":
            kind = "sit_floor"
        for _ in range(2):
            start = max(event.start - _draw(generator, 4, 24), 0)
            end = min(event.end + _draw(generator, 6, 40), scene.facts.frames)
            yield SingleAction(kind, start, end, act=(event.start, event.end))


def _picked(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    for event in scene.find("pick_up"):
        for _ in range(2):
            start = max(event.start - _draw(generator, 3, 16), 0)
            end = min(event.end + _draw(generator, 3, 16), scene.facts.frames)
            yield SingleAction("pick_up", start, end, event.side, act=(event.start, event.end))


def _lasting(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Postures that are held: sitting, lying, kneeling, crouching, sitting on the floor."""
    names = {"sit": "sit", "lie": "lie", "kneel": "kneel", "crouch": "crouch", "floor": "sit_floor"}
    for posture in scene.facts.postures:
        kind = names.get(posture.kind)
        if kind is None or posture.frames < (10 if kind == "crouch" else 20):
            continue
        for _ in range(2):
            length = _draw(generator, min(24, posture.frames), min(posture.frames, 140))
            start = posture.start + _draw(generator, 0, posture.frames - length)
            end = start + length
            if kind == "crouch":
                start = max(posture.start - _draw(generator, 4, 20), 0)
                end = min(posture.end + _draw(generator, 0, 16), scene.facts.frames, start + 120)
            yield SingleAction(kind, start, end, act=(posture.start, posture.end))


def _low_ways(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    """Crawling, and going stooped."""
    for event in scene.find("crawl"):
        if event.frames >= 20:
            for _ in range(3):
                length = _draw(generator, 20, min(event.frames, 140))
                start = event.start + _draw(generator, 0, event.frames - length)
                yield SingleAction("crawl", start, start + length, act=(start, start + length))
    low = (scene.signals.joints[:, 0, 1] < 0.84) | (scene.signals.lean > 22)
    for first, last in spans(closed_gaps(low & (scene.signals.speed > 0.2), 6), 28):
        for _ in range(2):
            length = _draw(generator, 28, min(last - first, 140))
            start = first + _draw(generator, 0, last - first - length)
            yield SingleAction("sneak", start, start + length, act=(start, start + length))


def _climbs(scene: Scene, generator: np.random.Generator) -> Iterator[SingleAction]:
    for event in scene.find("climb"):
        start = max(event.start - _draw(generator, 4, 20), 0)
        end = min(event.end + _draw(generator, 4, 20), scene.facts.frames)
        yield SingleAction(
            "climb", start, end, direction=event.direction, act=(event.start, event.end)
        )
