"""Measurements of the whole body: gaits, turns and the path; postures and their changes."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool

from latentmotion.arrays import length
from latentmotion.measure.facts import BOTH, FPS, LEFT, RIGHT, SIDES, Event, FloorPath, joined_moves
from latentmotion.measure.signals import (
    JOINT,
    Curve,
    Signals,
    bearing,
    bend,
    closed_gaps,
    intervals,
    monotone_intervals,
    peaks,
    smooth,
    spans,
    valley,
    without_short_intervals,
)
from latentmotion.storage.reading import packaged_toml

MOVING = 0.22  # Speed, m/s, above which a body goes somewhere.

SLOW, FAST = 0.75, 1.55  # Speeds, m/s, below and above which a walk is slow or fast.

RUN = 2.7  # Speed, m/s, above which a gait with flight is a run, not a jog.

# Frames of the shortest move.
_SHORTEST_MOVE = 8

LEAST_TURN = 25.0  # Degrees of the smallest turn that is reported.


def moves_of(signals: Signals, running: Curve, treading: list[Event]) -> tuple[Event, ...]:
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
    for start, end in intervals(without_short_intervals(codes, _SHORTEST_MOVE, weak=-1)):
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
            if last - first < 2 * _SHORTEST_MOVE:
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


def path_of(signals: Signals) -> FloorPath:
    """Measures the path of the pelvis."""
    points = signals.joints[:, 0, ::2]
    net = points[-1] - points[0]
    c, s = np.cos(signals.heading[0]), np.sin(signals.heading[0])
    moving = signals.speed > MOVING
    meters = float(signals.speed[moving].sum() / FPS)
    sideways, ahead = signals.velocity[moving].sum(axis=0) / FPS
    return FloorPath(
        length=meters,
        forward=float(s * net[0] + c * net[1]),
        left=float(c * net[0] - s * net[1]),
        ahead=float(ahead),
        sideways=float(sideways),
        turned=float(np.degrees(signals.heading[-1] - signals.heading[0])),
        closed=meters > 2 and float(np.linalg.norm(net)) < 0.3 * meters,
    )


# Height of the pelvis in meters, 0.92 m in a standing body, below which it is stooped, and degrees
# of lean of its trunk from which it is. Chosen by hand; no source.
STOOPED_PELVIS, STOOPED_LEAN = 0.84, 22.0

# Postures; `floor` is sitting on the floor.
KINDS = ("stand", "crouch", "bend", "kneel", "sit", "floor", "lie")

# Frames of the shortest posture and of the shortest pose.
_SHORTEST_POSE = 6

# The change between two postures, with or without a short crouch or bow between them.
_CHANGES = packaged_toml(__file__, "events.toml")["changes"]

# Changes that may be only the first half of another.
_FIRST_HALF = {"sit_down": "lie_down", "kneel_down": "lie_down", "sit_up": "get_up"}

_PASSING = ("crouch", "bend")


def postures_of(signals: Signals) -> tuple[Event, ...]:
    """Divides a motion into postures."""
    pelvis = signals.joints[:, 0, 1]
    feet = signals.joints[:, [7, 8], 1].min(axis=1)
    knees = np.stack([signals.of("left_knee"), signals.of("right_knee")], axis=1)
    thigh = pelvis - knees[:, :, 1].min(axis=1)
    ahead = knees[:, :, 2].min(axis=1)
    shin = knees[:, :, 1].max(axis=1)
    names = ("left_ankle", "right_ankle", "left_foot", "right_foot")
    support = np.stack([signals.of(name)[:, 2] for name in names], axis=1).mean(axis=1)
    weight = np.stack([signals.of(n)[:, 2] for n in ("pelvis", "spine3", "spine3", "head")])
    behind = support - weight.mean(axis=0)  # the weight is this far behind the feet on a seat
    lie = (signals.tilt > 58) & (pelvis < 0.42)
    floor = (pelvis < 0.28) & (signals.tilt < 60)
    kneel = (knees[:, :, 1].min(axis=1) < 0.14) & (pelvis > 0.28) & (pelvis < 0.65)
    kneel &= feet < 0.25
    sit = (thigh < 0.25) & (ahead > 0.22) & (signals.tilt < 50) & (behind > 0.14)
    sit &= signals.speed < 0.5
    bowed = (signals.lean > 45) & ~lie
    crouch = (pelvis - feet < 0.66) & (shin < 0.75)
    codes = np.select([lie, floor, sit & ~kneel, kneel, bowed, crouch], [6, 5, 4, 3, 2, 1], 0)
    codes = without_short_intervals(codes, _SHORTEST_POSE)
    return tuple(Event(KINDS[codes[start]], start, end) for start, end in intervals(codes))


def changes_of(postures: tuple[Event, ...]) -> list[Event]:
    """Returns `sit_down`, `stand_up` and so on, from the end of one posture to the next."""
    changes: list[Event] = []
    held = [posture for posture in postures if posture.kind not in _PASSING]
    # Who gets up from the floor passes the height of a seat.
    rises = [
        seat
        for below, seat, above in zip(held, held[1:], held[2:], strict=False)
        if (seat.kind, above.kind) == ("sit", "stand")
        and below.kind in ("floor", "lie")
        and seat.frames < FPS
    ]
    held = [posture for posture in held if posture not in rises]
    for before, after in pairwise(held):
        kind = _CHANGES.get(before.kind, {}).get(after.kind)
        continued = _FIRST_HALF.get(changes[-1].kind) if changes else None
        end = min(after.start + 6, after.end)
        if kind and continued == kind and before.frames < 60:
            changes[-1] = Event(kind, changes[-1].start, end)
        elif kind:
            changes.append(Event(kind, max(before.end - 6, before.start), end))
    return changes


def dips_of(signals: Signals, changes: list[Event]) -> list[Event]:
    """Returns squats, bows and pick-ups: down and up again."""
    dips = []
    depth = smooth(np.maximum(0.92 - signals.joints[:, 0, 1], 0), 1.0)
    lean = smooth(np.maximum(signals.lean, 0), 1.0)
    hands = np.stack([signals.of(f"{side}_wrist")[:, 1] for side in SIDES], axis=1)
    knees = np.minimum(*(bend(signals, f"{s}_hip", f"{s}_knee", f"{s}_ankle") for s in SIDES))
    reach = np.maximum(0.9 - hands.min(axis=1), 0)
    dip = np.maximum(depth / 0.25, lean / 45)
    free = 0
    for top in peaks(dip, 1.0, 0.45):
        rises_again = dip[top:].min() < dip[top] - 0.45
        if not rises_again or any(c.start - 4 <= top < c.end + 4 for c in changes):
            continue
        start, end = valley(dip, top)
        start, free = max(start, free), end
        if start >= end:
            continue  # a second peak of the same dip
        around = slice(start, end)
        left, right = hands[int(np.argmax(reach[around])) + start]
        if hands[around].min() < 0.32 and lean[around].max() > 35:
            side = BOTH if abs(left - right) < 0.15 else LEFT if left < right else RIGHT
            dips.append(Event("pick_up", start, end, side, "", float(min(left, right))))
        elif depth[top] > 0.2 and knees[around].min() < 120 and lean[around].max() < 70:
            dips.append(Event("squat", start, end, amount=float(depth[around].max())))
        elif lean[top] > 45:
            dips.append(Event("bow", start, end, direction="forward", amount=float(lean[top])))
    return dips


# Kinds of poses.
POSES = {"arms_out", "hands_on_hips", "touch_head", "crawl", "jack"}


def poses_of(signals: Signals) -> tuple[Event, ...]:
    """Returns `arms_out`, `hands_on_hips`, `touch_head`, `crawl` and `jack`, by start."""
    wrists = [signals.of(f"{side}_wrist") for side in SIDES]
    hands = np.maximum(*(wrist[:, 1] for wrist in wrists))
    knees = np.maximum(*(signals.of(f"{side}_knee")[:, 1] for side in SIDES))
    low = (signals.joints[:, 0, 1] < 0.7) & (hands < 0.4) & (knees < 0.45)
    crawls = low & (signals.lean > 40) & (signals.lean < 140)
    at_head = [length(wrist - signals.of("head")) < 0.24 for wrist in wrists]
    poses = [
        *_held("arms_out", _arm_out(signals, LEFT) & _arm_out(signals, RIGHT), BOTH),
        *_held("hands_on_hips", _akimbo(signals, LEFT) & _akimbo(signals, RIGHT), BOTH),
        *_held("touch_head", at_head[0], LEFT),
        *_held("touch_head", at_head[1], RIGHT),
        *_held("crawl", crawls, ""),
    ]
    # Jumping jacks: feet go apart while the arms go up, and both come back.
    feet = signals.joints[:, JOINT["left_ankle"]] - signals.joints[:, JOINT["right_ankle"]]
    apart = length(feet[:, ::2])
    above = [(signals.of(f"{s}_wrist") - signals.of(f"{s}_shoulder"))[:, 1] for s in SIDES]
    for top in peaks(np.minimum(*above), 0.0, 0.3):
        widest = apart[max(top - 5, 0) : top + 6].max()
        narrowest = apart[max(top - 14, 0) : top + 15].min()
        if widest > 0.4 and narrowest < widest - 0.15:
            poses.append(Event("jack", max(top - 5, 0), min(top + 6, signals.frames)))
    return tuple(sorted(poses, key=lambda event: event.start))


def stooped(signals: Signals) -> Bool[np.ndarray, " frames"]:
    """Returns where the body goes stooped: its pelvis is low, or its trunk leans."""
    return (signals.joints[:, 0, 1] < STOOPED_PELVIS) | (signals.lean > STOOPED_LEAN)


def stillness(signals: Signals, slowest: float = 0.25) -> Bool[np.ndarray, " frames"]:
    """Returns the frames in which no joint is faster than `slowest` meters per second."""
    velocity = np.gradient(smooth(signals.joints, 1.5), axis=0) * FPS
    return length(velocity).max(axis=1) < slowest


def _held(kind: str, shown: Bool[np.ndarray, " frames"], side: str) -> list[Event]:
    """Makes an event of every interval that is long enough; short gaps do not end it."""
    return [Event(kind, a, b, side=side) for a, b in spans(closed_gaps(shown, 4), _SHORTEST_POSE)]


def _arm_out(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """Whether an arm is stretched out to its side, level with the shoulder."""
    shoulder, wrist = signals.of(f"{side}_shoulder"), signals.of(f"{side}_wrist")
    outward = (wrist - shoulder)[:, 0] * (1 if side == LEFT else -1)
    return (outward > 0.36) & (np.abs(wrist[:, 1] - shoulder[:, 1]) < 0.25)


def _akimbo(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """Whether a hand is at the hip, the elbow bent and away from the body."""
    hip, elbow, wrist = (signals.of(f"{side}_{name}") for name in ("hip", "elbow", "wrist"))
    near = length(wrist - hip) < 0.33
    bent = bend(signals, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist") < 130
    return near & bent & (np.abs(elbow[:, 0]) > np.abs(wrist[:, 0]))
