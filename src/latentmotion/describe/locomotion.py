"""Locomotion: standing, walking, jogging and running by direction; turns; the path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from latentmotion.describe.facts import FPS, LEFT, RIGHT, Event, Path, joined_moves
from latentmotion.describe.signals import (
    Signals,
    bearing,
    intervals,
    monotone_intervals,
    spans,
    without_short_intervals,
)

MOVING = 0.22
"""Speed, m/s, above which a body goes somewhere."""

SLOW, FAST = 0.75, 1.55
"""Speeds, m/s, below and above which a walk is slow or fast."""

JOG, RUN = 1.7, 2.7
"""Speeds, m/s, above which a gait with flight is a jog and a run."""

SHORTEST = 8
"""Frames of the shortest move."""

LEAST_TURN = 25.0
"""Degrees of the smallest turn that is reported."""


def moves_of(
    signals: Signals, running: Float[np.ndarray, " frames"], treading: list[Event]
) -> tuple[Event, ...]:
    """Divides a motion into moves.

    Args:
        signals: Its curves.
        running: 1 in frames where the gait is a jog or run, else 0.
        treading: Steps in place.
    """
    left, ahead = signals.velocity.T
    angle = np.degrees(np.arctan2(left, ahead))
    codes = np.select([np.abs(angle) < 55, np.abs(angle) > 125, angle > 0], [0, 2, 1], 3)
    codes = np.where(signals.speed > MOVING, codes, -1)
    moves: list[Event] = []
    for start, end in intervals(without_short_intervals(codes, SHORTEST, weak=-1)):
        speed = float(signals.speed[start:end].mean())
        flying = float(running[start:end].mean()) > 0.5
        direction = bearing(*signals.velocity[start:end].mean(axis=0))
        if speed < MOVING or np.mean(codes[start:end] < 0) > 0.6:
            kind, direction = ("jog", "place") if flying else ("stand", "")
        else:
            kind = "run" if flying and speed > RUN else "jog" if flying else "walk"
        if kind == "walk" and speed > 2.3:
            kind = "run" if speed > RUN else "jog"
        move = Event(kind, start, end, direction=direction, amount=speed)
        for event in treading if kind == "stand" else ():
            first, last = max(event.start, move.start), min(event.end, end)
            if last - first < 2 * SHORTEST:
                continue
            if first > move.start:
                moves.append(replace(move, end=first))
            moves.append(replace(event, start=first, end=last, count=1))
            move = replace(move, start=last)
        moves += [move] if move.frames > 0 else []
    return tuple(joined_moves(moves, 1))


def turns_of(signals: Signals) -> tuple[Event, ...]:
    """Returns turns by at least 25°; parts with pauses between them are separate turns."""
    degrees = np.degrees(signals.heading)
    foot = signals.joints[:, [10, 11]] - signals.joints[:, [7, 8]]
    feet = np.degrees(np.unwrap(np.arctan2(foot[..., 0], foot[..., 2]), axis=0))
    turning: list[tuple[int, int]] = []  # first and last frames
    for first, last in monotone_intervals(degrees, 0.8 * LEAST_TURN):
        fast = np.abs(np.gradient(degrees[first : last + 1])) * FPS > 10.0
        for a, b in list(spans(~fast)):
            if b - a < FPS and a > 0 and b < len(fast):
                fast[a:b] = True
        for start, end in ((first + a, first + b - 1) for a, b in spans(fast, 3)):
            begin, until = turning[-1] if turning else (0, 0)
            same_side = (degrees[end] - degrees[start]) * (degrees[until] - degrees[begin]) > 0
            if same_side and start - until < FPS:
                turning[-1] = (begin, end)
            else:
                turning.append((start, end))
    turns = []
    for start, end in turning:
        amount = float(degrees[end] - degrees[start])
        if abs(amount) < LEAST_TURN:
            continue
        walked = float(signals.speed[start : end + 1].sum() / FPS)
        radius = walked / max(np.radians(abs(amount)), 1e-3)
        walking = walked > 0.5 and radius > 0.25
        first, last = max(start - 3, 0), min(end + 3, len(feet) - 1)
        turned = (feet[last] - feet[first]).mean() * (1 if amount > 0 else -1)
        if walking or turned > 0.5 * abs(amount):  # else the feet stay and the body only twists
            side = LEFT if amount > 0 else RIGHT
            direction = "walking" if walking else "place"
            turns.append(Event("turn", start, end + 1, side, direction, abs(amount)))
    return tuple(turns)


def path_of(signals: Signals, turns: tuple[Event, ...]) -> Path:
    """Measures the path of the pelvis."""
    points = signals.joints[:, 0, ::2]
    net = points[-1] - points[0]
    c, s = np.cos(signals.heading[0]), np.sin(signals.heading[0])
    moving = signals.speed > MOVING
    length = float(signals.speed[moving].sum() / FPS)
    sideways, ahead = signals.velocity[moving].sum(axis=0) / FPS
    longest = max(turns, key=lambda turn: turn.amount, default=None)
    widening = 0.0
    if longest and longest.amount >= 450:
        circle = points[longest.start : longest.end]
        third = len(circle) // 3
        first, last = (
            float(np.linalg.norm(part - part.mean(axis=0), axis=1).mean())
            for part in (circle[:third], circle[-third:])
        )
        widening = last / max(first, 0.05) - 1
    return Path(
        length=length,
        forward=float(s * net[0] + c * net[1]),
        left=float(c * net[0] - s * net[1]),
        ahead=float(ahead),
        sideways=float(sideways),
        turned=float(np.degrees(signals.heading[-1] - signals.heading[0])),
        closed=length > 2 and float(np.linalg.norm(net)) < 0.3 * length,
        widening=widening,
    )
