"""Postures over time, the changes between them, squats, bows and things picked from the floor."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from latentmotion.describe.facts import BOTH, LEFT, RIGHT, Event
from latentmotion.describe.signals import Signals, bend, peaks, smooth

KINDS = ("stand", "crouch", "bend", "kneel", "sit", "floor", "lie")
"""Postures; `floor` is sitting on the floor."""

SHORTEST = 6
"""Frames of the shortest posture."""

_CHANGES = {
    ("stand", "sit"): "sit_down",
    ("stand", "floor"): "sit_down",
    ("stand", "lie"): "lie_down",
    ("sit", "lie"): "lie_down",
    ("floor", "lie"): "lie_down",
    ("stand", "kneel"): "kneel_down",
    ("sit", "stand"): "stand_up",
    ("floor", "stand"): "get_up",
    ("lie", "stand"): "get_up",
    ("lie", "sit"): "sit_up",
    ("lie", "floor"): "sit_up",
    ("kneel", "stand"): "stand_up",
    ("kneel", "lie"): "lie_down",
    ("kneel", "floor"): "sit_down",
    ("lie", "kneel"): "get_up",
}
"""What happens between two postures, whatever short crouch or bow lies between."""

_LEADS_ON = {"sit_down": "lie_down", "kneel_down": "lie_down", "sit_up": "get_up"}
"""Changes that are only the first half of another."""

_PASSING = ("crouch", "bend")


def postures_of(signals: Signals) -> tuple[Event, ...]:
    """Cuts a motion into postures."""
    codes = _codes(signals)
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    while len(edges) > 2:
        lengths = np.diff(edges)
        shortest = int(np.argmin(lengths))
        if lengths[shortest] >= SHORTEST:
            break
        start, end = edges[shortest], edges[shortest + 1]
        codes[start:end] = codes[start - 1] if start else codes[end]
        edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    return tuple(Event(KINDS[codes[start]], start, end) for start, end in pairwise(edges))


def changes_of(postures: tuple[Event, ...]) -> list[Event]:
    """Returns `sit_down`, `stand_up` and so on, from the end of one posture to the next."""
    out = []
    held = [p for p in postures if p.kind not in _PASSING]
    for one, two in pairwise(held):
        kind = _CHANGES.get((one.kind, two.kind))
        passing = _LEADS_ON.get(out[-1].kind) if out else None
        if passing == kind and kind and one.frames < 60:
            out[-1] = Event(kind, out[-1].start, min(two.start + 6, two.end))
        elif kind:
            start, end = max(one.end - 6, one.start), min(two.start + 6, two.end)
            out.append(Event(kind, start, end))
    return out


def dips_of(signals: Signals, changes: list[Event]) -> list[Event]:
    """Returns squats, bows and pick-ups: down and up again."""
    pelvis, out = signals.joints[:, 0, 1], []
    depth = smooth(np.maximum(0.92 - pelvis, 0), 1.0)
    lean = smooth(np.maximum(signals.lean, 0), 1.0)
    hands = np.stack([signals.of(f"{side}_wrist")[:, 1] for side in (LEFT, RIGHT)], axis=1)
    knees = np.minimum(
        *(bend(signals, f"{s}_hip", f"{s}_knee", f"{s}_ankle") for s in (LEFT, RIGHT))
    )
    reach = np.maximum(0.9 - hands.min(axis=1), 0)
    dip = np.maximum(depth / 0.25, lean / 45)
    free = 0
    for top in peaks_apart(dip, 1.0, 0.45):
        if any(c.start - 4 <= top < c.end + 4 for c in changes):
            continue
        start, end = _valley(dip, top)
        start, free = max(start, free), end
        if start >= end:
            continue  # a second peak of the same dip
        around = slice(start, end)
        low = int(np.argmax(reach[around])) + start
        if hands[around].min() < 0.32 and lean[around].max() > 35:
            out.append(
                Event("pick_up", start, end, _lower(hands[low]), "", float(hands[low].min()))
            )
        elif depth[top] > 0.2 and knees[around].min() < 120 and lean[around].max() < 70:
            out.append(Event("squat", start, end, amount=float(depth[around].max())))
        elif lean[top] > 45:
            out.append(Event("bow", start, end, direction="forward", amount=float(lean[top])))
    return out


def peaks_apart(curve: Float[np.ndarray, " frames"], least: float, drop: float) -> list[int]:
    """Returns maxima inside a motion: the curve rises to them and falls again."""
    return [top for top in peaks(curve, least, drop) if curve[top:].min() < curve[top] - drop]


def _codes(signals: Signals) -> Int[np.ndarray, " frames"]:
    pelvis = signals.joints[:, 0, 1]
    feet = signals.joints[:, [7, 8], 1].min(axis=1)
    knees = np.stack([signals.of("left_knee"), signals.of("right_knee")], axis=1)
    thigh = pelvis - knees[:, :, 1].min(axis=1)
    ahead = knees[:, :, 2].min(axis=1)
    shin = knees[:, :, 1].max(axis=1)
    over = _behind_feet(signals)
    lie = (signals.tilt > 58) & (pelvis < 0.42)
    floor = (pelvis < 0.28) & (signals.tilt < 60)
    kneel = (knees[:, :, 1].min(axis=1) < 0.14) & (pelvis > 0.28) & (pelvis < 0.65)
    kneel &= feet < 0.25
    sit = (thigh < 0.25) & (ahead > 0.22) & (signals.tilt < 50) & (over > 0.14)
    sit &= signals.speed < 0.5
    bowed = (signals.lean > 45) & ~lie
    crouch = (pelvis - feet < 0.66) & (shin < 0.75)
    return np.select([lie, floor, sit & ~kneel, kneel, bowed, crouch], [6, 5, 4, 3, 2, 1], 0)


def _behind_feet(signals: Signals) -> Float[np.ndarray, " frames"]:
    """Meters by which the weight of the body is behind its feet, as only a seat allows."""
    names = ("left_ankle", "right_ankle", "left_foot", "right_foot")
    feet = np.stack([signals.of(name)[:, 2] for name in names], axis=1).mean(axis=1)
    weight = np.stack([signals.of(n)[:, 2] for n in ("pelvis", "spine3", "spine3", "head")])
    return feet - weight.mean(axis=0)


def _valley(curve: Float[np.ndarray, " frames"], top: int) -> tuple[int, int]:
    """Returns where a curve leaves and comes back to a third of a peak, or turns up again."""
    low = curve < 0.35 * curve[top]
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    start = int(before[-1]) if len(before) else 0
    end = top + int(after[0]) if len(after) else len(curve)
    higher = np.flatnonzero(curve > 1.001 * curve[top])
    left, right = higher[higher < top], higher[higher > top]
    if len(left) and left[-1] >= start:
        start = int(left[-1] + np.argmin(curve[left[-1] : top + 1]))
    if len(right) and right[0] < end:
        end = int(top + np.argmin(curve[top : right[0] + 1]))
    return start, end


def _lower(hands: Float[np.ndarray, " 2"]) -> str:
    if abs(hands[0] - hands[1]) < 0.15:
        return BOTH
    return LEFT if hands[0] < hands[1] else RIGHT
