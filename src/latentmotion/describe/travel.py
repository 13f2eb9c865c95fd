"""Moves over the floor: standing, walking, jogging, running, by direction; turns; the path."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from latentmotion.describe.facts import FPS, LEFT, RIGHT, Event, Path
from latentmotion.describe.signals import Signals, spans

MOVING = 0.22
"""Meters per second above which a body goes somewhere."""

SLOW, FAST = 0.75, 1.55
"""Meters per second below and above which a walk is slow or fast."""

JOG, RUN = 1.7, 2.7
"""Meters per second above which a gait with flight is a jog and a run."""

SHORTEST = 8
"""Frames of the shortest move."""

LEAST_TURN = 25.0
"""Degrees of the smallest turn that is told."""


def moves_of(
    signals: Signals, running: Float[np.ndarray, " frames"], treading: list[Event]
) -> tuple[Event, ...]:
    """Cuts a motion into moves.

    Args:
        signals: Its curves.
        running: Where the gait is a jog or run, 1, else 0.
        treading: Steps on the spot.
    """
    codes = _codes(signals)
    cut = [(start, end) for start, end in _stretches(_merged(codes))]
    moves = [_move(signals, codes, running, start, end) for start, end in cut]
    return _joined([part for move in moves for part in _treaded(move, treading)])


def turns_of(signals: Signals) -> tuple[Event, ...]:
    """Returns turns by at least 25°; several pauses apart are several turns."""
    degrees = np.degrees(signals.heading)
    found = [part for run in _monotone(degrees) for part in _without_pauses(degrees, *run)]
    feet = _foot_headings(signals)
    turns = [_turn(signals, degrees, *one) for one in _same_way(degrees, found)]
    return tuple(turn for turn in turns if _with_feet(turn, feet))


def path_of(signals: Signals, turns: tuple[Event, ...]) -> Path:
    """Measures the way of the pelvis."""
    way = signals.joints[:, 0, ::2]
    net = way[-1] - way[0]
    c, s = np.cos(signals.heading[0]), np.sin(signals.heading[0])
    moving = signals.speed > MOVING
    length = float(signals.speed[moving].sum() / FPS)
    sideways, ahead = signals.velocity[moving].sum(axis=0) / FPS
    return Path(
        length=length,
        forward=float(s * net[0] + c * net[1]),
        left=float(c * net[0] - s * net[1]),
        ahead=float(ahead),
        sideways=float(sideways),
        turned=float(np.degrees(signals.heading[-1] - signals.heading[0])),
        closed=length > 2 and float(np.linalg.norm(net)) < 0.3 * length,
        widening=_widening(way, turns),
    )


def _codes(signals: Signals) -> Int[np.ndarray, " frames"]:
    """-1 where the body stays, else the index of the direction it goes."""
    left, ahead = signals.velocity.T
    angle = np.degrees(np.arctan2(left, ahead))
    codes = np.select([np.abs(angle) < 55, np.abs(angle) > 125, angle > 0], [0, 2, 1], 3)
    return np.where(signals.speed > MOVING, codes, -1)


def _merged(codes: Int[np.ndarray, " frames"]) -> Int[np.ndarray, " frames"]:
    """Gives stretches that are too short to what is around them."""
    codes = codes.copy()
    while True:
        cut = _stretches(codes)
        start, end = min(cut, key=lambda one: one[1] - one[0])
        if end - start >= SHORTEST or len(cut) == 1:
            return codes
        before = codes[start - 1] if start else codes[end]
        after = codes[end] if end < len(codes) else before
        codes[start:end] = before if before == after or before != -1 else after


def _stretches(codes: Int[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    return list(pairwise(edges))


def _move(
    signals: Signals,
    codes: Int[np.ndarray, " frames"],
    running: Float[np.ndarray, " frames"],
    start: int,
    end: int,
) -> Event:
    speed = float(signals.speed[start:end].mean())
    flying = float(running[start:end].mean()) > 0.5
    direction = _direction(signals, start, end)
    if speed < MOVING or np.mean(codes[start:end] < 0) > 0.6:
        kind, direction = ("jog", "place") if flying else ("stand", "")
    else:
        kind = "run" if flying and speed > RUN else "jog" if flying else "walk"
    if kind == "walk" and speed > 2.3:
        kind = "run" if speed > RUN else "jog"
    return Event(kind, start, end, direction=direction, amount=speed)


def _treaded(move: Event, treading: list[Event]) -> list[Event]:
    """Cuts steps on the spot out of standing."""
    if move.kind != "stand":
        return [move]
    parts, start = [], move.start
    for event in treading:
        first, last = max(event.start, start), min(event.end, move.end)
        if last - first < 2 * SHORTEST:
            continue
        if first > start:
            parts.append(replace(move, start=start, end=first))
        parts.append(replace(event, start=first, end=last, count=1))
        start = last
    return [*parts, replace(move, start=start)] if start < move.end else parts


def _direction(signals: Signals, start: int, end: int) -> str:
    left, ahead = signals.velocity[start:end].mean(axis=0)
    angle = np.degrees(np.arctan2(left, ahead))
    if abs(angle) < 50:
        return "forward"
    return "backward" if abs(angle) > 130 else LEFT if angle > 0 else RIGHT


def _joined(moves: list[Event]) -> tuple[Event, ...]:
    """Joins neighbors that are alike."""
    out = moves[:1]
    for move in moves[1:]:
        last = out[-1]
        if (last.kind, last.direction) == (move.kind, move.direction):
            total = last.amount * last.frames + move.amount * move.frames
            amount = total / (last.frames + move.frames)
            out[-1] = Event(
                last.kind, last.start, move.end, direction=last.direction, amount=amount
            )
        else:
            out.append(move)
    return tuple(out)


def _monotone(degrees: Float[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """Cuts a heading where it changes its way by more than the smallest turn."""
    values = degrees.tolist()
    low = high = 0
    way, found, last = 0, [], 0
    for frame, value in enumerate(values):
        if value < values[low]:
            low = frame
        if value > values[high]:
            high = frame
        if way >= 0 and values[high] - value > 0.8 * LEAST_TURN:
            if way > 0:
                found.append((last, high))
            way, last, low = -1, high, frame
            high = frame
        elif way <= 0 and value - values[low] > 0.8 * LEAST_TURN:
            if way < 0:
                found.append((last, low))
            way, last, high = 1, low, frame
            low = frame
    if way:
        found.append((last, high if way > 0 else low))
    return [run for run in found if run[1] - run[0] > 2]


def _without_pauses(
    degrees: Float[np.ndarray, " frames"], start: int, end: int
) -> list[tuple[int, int]]:
    """Cuts a turn where nothing turns for a second, and at its slow ends."""
    rate = np.abs(np.gradient(degrees[start : end + 1])) * FPS
    turning = rate > 10.0
    for a, b in list(spans(~turning)):
        if b - a < FPS and a > 0 and b < len(turning):
            turning[a:b] = True
    return [(start + a, start + b - 1) for a, b in spans(turning, 3)]


def _same_way(
    degrees: Float[np.ndarray, " frames"], found: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Joins turns to one side with less than a second between; drops small ones."""
    joined: list[tuple[int, int]] = []
    for start, end in found:
        amount = degrees[end] - degrees[start]
        if joined:
            first, last = joined[-1]
            same = amount * (degrees[last] - degrees[first]) > 0
            if same and start - last < FPS:
                joined[-1] = (first, end)
                continue
        joined.append((start, end))
    return [(a, b) for a, b in joined if abs(degrees[b] - degrees[a]) >= LEAST_TURN]


def _turn(signals: Signals, degrees: Float[np.ndarray, " frames"], start: int, end: int) -> Event:
    amount = float(degrees[end] - degrees[start])
    walked = float(signals.speed[start : end + 1].sum() / FPS)
    radius = walked / max(np.radians(abs(amount)), 1e-3)
    return Event(
        "turn",
        start,
        end + 1,
        side=LEFT if amount > 0 else RIGHT,
        direction="walking" if walked > 0.5 and radius > 0.25 else "place",
        amount=abs(amount),
    )


def _foot_headings(signals: Signals) -> Float[np.ndarray, "frames 2"]:
    """Degrees to which the left and right foot point."""
    foot = signals.joints[:, [10, 11]] - signals.joints[:, [7, 8]]
    return np.degrees(np.unwrap(np.arctan2(foot[..., 0], foot[..., 2]), axis=0))


def _with_feet(turn: Event, feet: Float[np.ndarray, "frames 2"]) -> bool:
    """Says whether the feet turned as well; else the body only twists."""
    start, end = max(turn.start - 3, 0), min(turn.end + 2, len(feet) - 1)
    turned = (feet[end] - feet[start]).mean() * (1 if turn.side == LEFT else -1)
    return bool(turn.direction == "walking" or turned > 0.5 * turn.amount)


def _widening(way: Float[np.ndarray, "frames 2"], turns: tuple[Event, ...]) -> float:
    if not turns or max(turn.amount for turn in turns) < 450:
        return 0.0
    turn = max(turns, key=lambda one: one.amount)
    part = way[turn.start : turn.end]
    third = len(part) // 3
    spread = [
        float(np.linalg.norm(p - p.mean(axis=0), axis=1).mean())
        for p in (part[:third], part[-third:])
    ]
    return spread[1] / max(spread[0], 0.05) - 1
