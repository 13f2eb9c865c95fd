"""Conditions of a whole motion that checks name: its path, pace and posture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from latentmotion.describe.facts import LEFT, RIGHT
from latentmotion.describe.postures import stillness
from latentmotion.describe.reading import Scene, meters
from latentmotion.describe.signals import peaks
from latentmotion.instructions.prompts import DIRECTIONS, TURNS, Term


@dataclass(frozen=True)
class Condition:
    """A kind of condition."""

    holds: Callable[[Scene, Term], bool]
    """Whether it holds for a motion."""
    numbers: int
    """Number of numbers in a term."""
    words: tuple[tuple[str, ...], ...] = ()
    """Choices for each word of a term."""


def turns_by(scene: Scene, term: Term) -> bool:
    """The heading turns to a side by so many degrees in all, with full turns counted."""
    turned, (side,) = scene.facts.path.turned, term.words
    amount = abs(turned) if side == "either" else turned if side == LEFT else -turned
    return term.numbers[0] <= amount <= term.numbers[1]


def travels(scene: Scene, term: Term) -> bool:
    """The path of the pelvis is so many meters long."""
    return scene.facts.path.length >= term.numbers[0]


def moves_towards(scene: Scene, term: Term) -> bool:
    """It moves so many meters to a side of the body, and farther than to any other."""
    distance, least = meters(scene), term.numbers[0]
    if term.words[0] == "sideways":
        distance["sideways"] = max(distance.pop(LEFT), distance.pop(RIGHT))
    return distance[term.words[0]] >= max(least, *distance.values())


def has_speed(scene: Scene, term: Term) -> bool:
    """The mean speed while it moves, m/s, is within bounds."""
    moves = [move for move in scene.facts.moves if move.kind != "stand" and move.direction]
    moves = [move for move in moves if move.direction != "place"]
    frames = sum(move.frames for move in moves)
    if not frames:
        return False
    mean = sum(move.amount * move.frames for move in moves) / frames
    return term.numbers[0] <= mean <= term.numbers[1]


def speeds_up(scene: Scene, term: Term) -> bool:
    """The last third is so many times as fast as the first."""
    first, last = _ends_of_speed(scene)
    return last >= max(term.numbers[0] * first, first + 0.2)


def slows_down(scene: Scene, term: Term) -> bool:
    """The first third is so many times as fast as the last."""
    first, last = _ends_of_speed(scene)
    return first >= max(term.numbers[0] * last, last + 0.2)


def takes_steps(scene: Scene, term: Term) -> bool:
    """Both feet together make so many steps."""
    least, most = term.often
    return least <= scene.facts.steps <= most


def steps_in_place(scene: Scene, term: Term) -> bool:
    """A foot leaves the floor and comes back so many times."""
    lifts = sum(len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T)
    return term.numbers[0] <= lifts <= term.numbers[1]


def stays(scene: Scene, term: Term) -> bool:
    """It stays within so many meters of its median position."""
    path = scene.signals.joints[:, 0, ::2]
    distance = np.linalg.norm(path - np.median(path, axis=0), axis=1)
    return bool(distance.max() <= term.numbers[0])


def keeps_facing(scene: Scene, term: Term) -> bool:
    """It ends within so many degrees of its first heading."""
    return abs(scene.facts.path.turned) <= term.numbers[0]


def goes_straight(scene: Scene, term: Term) -> bool:
    """It moves along a line, and ends within so many degrees of its first heading."""
    path = scene.signals.joints[:, 0, ::2]
    net = float(np.linalg.norm(path[-1] - path[0]))
    return keeps_facing(scene, term) and net >= 0.9 * scene.facts.path.length


def weaves(scene: Scene, term: Term) -> bool:
    """Its direction of travel swings to both sides by so many degrees, twice or more."""
    left, ahead = scene.signals.velocity.T
    travels = scene.signals.speed > 0.3
    # Radians without jumps, of the frames in which it travels.
    course = np.degrees(np.unwrap(scene.signals.heading + np.arctan2(left, ahead))[travels])
    if not len(course):
        return False
    swings = [len(peaks(curve - curve.min(), 0, term.numbers[0])) for curve in (course, -course)]
    return sum(swings) >= 2


def jumps_high(scene: Scene, term: Term) -> bool:
    """The pelvis rises by so many meters in a jump."""
    return any(event.amount >= term.numbers[0] for event in scene.find("jump", "hop"))


def keeps_still(scene: Scene, term: Term) -> bool:
    """Nothing moves for such a part of the time."""
    return bool(stillness(scene.signals).mean() >= term.numbers[0])


def is_stooped(scene: Scene, term: Term) -> bool:
    """The hips are low or the trunk is bent, half of the time or more."""
    low = scene.signals.joints[:, 0, 1] < 0.84
    return bool((low | (scene.signals.lean > 22)).mean() >= 0.5)


def is_upright(scene: Scene, term: Term) -> bool:
    """It stands with the trunk upright all the time."""
    standing = sum(part.frames for part in scene.facts.postures if part.kind == "stand")
    return standing > 0.9 * scene.facts.frames and float(np.median(scene.signals.tilt)) < 20


CONDITIONS: dict[str, Condition] = {
    "turn": Condition(turns_by, 2, (TURNS,)),
    "travel": Condition(travels, 1),
    "move": Condition(moves_towards, 1, ((*DIRECTIONS, "sideways"),)),
    "speed": Condition(has_speed, 2),
    "faster": Condition(speeds_up, 1),
    "slower": Condition(slows_down, 1),
    "step": Condition(takes_steps, 2),
    "lift_feet": Condition(steps_in_place, 2),
    "in_place": Condition(stays, 1),
    "facing": Condition(keeps_facing, 1),
    "straight": Condition(goes_straight, 1),
    "weave": Condition(weaves, 1),
    "height": Condition(jumps_high, 1),
    "still": Condition(keeps_still, 1),
    "stooped": Condition(is_stooped, 0),
    "upright": Condition(is_upright, 0),
}
"""Every condition by name."""


def _ends_of_speed(scene: Scene) -> tuple[float, float]:
    speed = scene.signals.speed
    third = max(len(speed) // 3, 1)
    return float(speed[:third].mean()), float(speed[-third:].mean())
