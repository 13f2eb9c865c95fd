"""What the arms do: raised hands, waves, punches, circles of straight arms, claps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.describe.facts import BOTH, FPS, LEFT, RIGHT, Event
from latentmotion.describe.signals import Signals, bend, closed_gaps, peaks, smooth, spans

_SIDES = (LEFT, RIGHT)


def raises_of(signals: Signals) -> list[Event]:
    """Returns times in which a hand is above its shoulder; together they are of both hands.

    The amount is how far the hand gets above the shoulder; `up` is above the head, else the
    direction is where the hand is (`forward` or `side`).
    """
    left, right = (_raised(signals, side) for side in _SIDES)
    joint, used = [], set()
    for one in left:
        for other in right:
            shared = min(one.end, other.end) - max(one.start, other.start)
            if shared > 0.6 * min(one.frames, other.frames) and id(other) not in used:
                amount = min(one.amount, other.amount)
                start, end = min(one.start, other.start), max(one.end, other.end)
                joint.append(Event("raise", start, end, BOTH, one.direction, amount))
                used |= {id(one), id(other)}
                break
    return joint + [one for one in (*left, *right) if id(one) not in used]


def waves_of(signals: Signals) -> list[Event]:
    """Returns times in which a hand beside or above the chest swings to and fro, with swings."""
    out = []
    for side in _SIDES:
        wrist, elbow, shoulder = (signals.of(f"{side}_{n}") for n in ("wrist", "elbow", "shoulder"))
        away = smooth(wrist - elbow, 0.7)
        up = (wrist[:, 1] > shoulder[:, 1] - 0.1) & (wrist[:, 1] > elbow[:, 1] + 0.05)
        for start, end in spans(closed_gaps(up, 6), 14):
            swings = _swings(away[start:end, 0], 0.07)
            quick = len(swings) >= 3 and np.diff(swings).mean() < 0.7 * FPS
            if quick and _is_waving(signals, side, start + swings[0], start + swings[-1] + 1):
                first, last = start + max(swings[0] - 5, 0), min(start + swings[-1] + 5, end)
                out.append(Event("wave", first, last, side, count=(len(swings) + 1) // 2))
    return _paired(out, 0.5)


def punches_of(signals: Signals) -> list[Event]:
    """Returns jabs, quick stretches of an arm at the height of chest or head, and hooks."""
    out: list[Event] = []
    for side in _SIDES:
        away = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
        reach = np.linalg.norm(away, axis=1)
        speed = np.gradient(smooth(reach, 0.5)) * FPS
        for top in peaks(smooth(reach, 0.5), 0.44, 0.1):
            before = slice(max(top - 6, 0), top + 1)
            level = -0.25 < away[top, 1] < 0.3 and np.hypot(away[top, 0], away[top, 2]) > 0.35
            if speed[before].max() > 1.6 and level and not _goes_along(signals, side, top):
                ahead = abs(away[top, 2]) >= abs(away[top, 0])
                direction = "forward" if ahead else "side"
                out.append(
                    Event(
                        "punch",
                        max(top - 6, 0),
                        min(top + 4, signals.frames),
                        side,
                        direction,
                        float(speed[before].max()),
                    )
                )
        jabs = [jab for jab in out if jab.side == side]
        out += [
            hook
            for hook in _hooks(signals, side)
            if not any(j.start - 6 < hook.end and hook.start < j.end + 6 for j in jabs)
        ]
    return out


def arm_circles_of(signals: Signals) -> list[Event]:
    """Returns full circles of a stretched arm about its shoulder."""
    out = []
    for side in _SIDES:
        away = smooth(signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"), 0.7)
        stretched = bend(signals, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist") > 115
        out += _circles(side, away, stretched)
    return _paired(out, 0.4)


def claps_of(signals: Signals) -> list[Event]:
    """Returns series of two and more meetings of the hands in front."""
    left, right = signals.of("left_wrist"), signals.of("right_wrist")
    apart = smooth(np.linalg.norm(left - right, axis=1), 0.5)
    high = 0.5 * (left[:, 1] + right[:, 1]) > signals.of("spine1")[:, 1]
    near = np.where(high, np.maximum(0.8 - apart, 0), 0)
    tops = peaks(near, 0.55, 0.1)
    out: list[list[int]] = []
    for top in tops:
        if out and top - out[-1][-1] < 1.0 * FPS:
            out[-1].append(top)
        else:
            out.append([top])
    return [
        Event("clap", max(s[0] - 5, 0), min(s[-1] + 5, signals.frames), BOTH, count=len(s))
        for s in out
        if len(s) >= 2
    ]


def _is_waving(signals: Signals, side: str, start: int, end: int) -> bool:
    """Whether swings of a hand are a wave, and no guard of a boxer, dance or run.

    The hand is above its shoulder on average and not before the chest, it swings sideways more
    than to and fro, and the body stays where it is.
    """
    part = slice(start, end)
    outward = 1 if side == LEFT else -1
    wrist, elbow, shoulder = (
        signals.of(f"{side}_{name}")[part] for name in ("wrist", "elbow", "shoulder")
    )
    high = float((wrist - shoulder)[:, 1].mean())
    aside = float((wrist - shoulder)[:, 0].mean()) * outward
    across, along = (float(np.ptp((wrist - elbow)[:, axis])) for axis in (0, 2))
    calm = signals.speed[part].mean() < 0.45 and signals.feet[part].min(axis=1).max() < 0.1
    if _on_guard(signals, RIGHT if side == LEFT else LEFT)[part].mean() > 0.4:
        return False
    return bool(calm and high > -0.03 and (aside > 0.0 or high > 0.25) and across > 0.8 * along)


def _on_guard(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """Where a fist is held before the chest or the chin, the elbow bent, as boxers do."""
    away = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
    outward = away[:, 0] * (1 if side == LEFT else -1)
    high = (away[:, 1] > -0.25) & (away[:, 1] < 0.2)
    return high & (away[:, 2] > 0.08) & (outward < 0.15) & (np.linalg.norm(away, axis=1) < 0.47)


def _hooks(signals: Signals, side: str) -> list[Event]:
    """Returns hooks and uppercuts: a bent arm that is very quick while the other is on guard."""
    other = RIGHT if side == LEFT else LEFT
    wrist = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
    speed = np.linalg.norm(np.gradient(smooth(wrist, 0.5), axis=0), axis=1) * FPS
    guarded = _on_guard(signals, other) | _on_guard(signals, side)
    found: list[Event] = []
    for top in peaks(speed, 4.0, 1.5):
        around = slice(max(top - 8, 0), top + 9)
        level = -0.35 < wrist[top, 1] < 0.35 and wrist[top, 2] > 0.05
        alone = not found or top - found[-1].end > 4
        if level and alone and guarded[around].mean() > 0.5 and signals.speed[top] < 1.2:
            first, last = max(top - 5, 0), min(top + 5, signals.frames)
            found.append(Event("punch", first, last, side, "forward", float(speed[top])))
    return found


def _goes_along(signals: Signals, side: str, top: int) -> bool:
    """Whether the other arm stretches at the same time, as in a push or a pass."""
    other = RIGHT if side == LEFT else LEFT
    away = signals.of(f"{other}_wrist") - signals.of(f"{other}_shoulder")
    reach = np.linalg.norm(away, axis=1)
    before = reach[max(top - 7, 0) : top + 1].min()
    near = reach[max(top - 2, 0) : top + 3].max()
    return bool(away[top, 2] > 0.2 and near > 0.4 and near - before > 0.1)


def _raised(signals: Signals, side: str) -> list[Event]:
    wrist, shoulder = signals.of(f"{side}_wrist"), signals.of(f"{side}_shoulder")
    above = wrist[:, 1] - shoulder[:, 1]
    upright = signals.tilt < 55
    out = []
    for start, end in spans(closed_gaps((above > -0.02) & upright, 6), 4):
        top = start + int(np.argmax(above[start:end]))
        if above[top] < 0.08:
            continue
        away = wrist[top] - shoulder[top]
        flat = float(np.hypot(away[0], away[2]))
        out_to = "forward" if away[2] > abs(away[0]) else "side"
        direction = "up" if above[top] > 0.25 or flat < 0.2 else out_to
        out.append(Event("raise", start, end, side, direction, float(above[top])))
    return out


def _swings(curve: Float[np.ndarray, " frames"], least: float) -> list[int]:
    """Returns where a curve turns back after changes of at least `least`."""
    base = curve - curve.min()
    tops = peaks(base, 0.0, least)
    downs = peaks(curve.max() - curve, 0.0, least)
    return sorted({*tops, *downs})


def _circles(
    side: str, away: Float[np.ndarray, "frames 3"], stretched: Bool[np.ndarray, " frames"]
) -> list[Event]:
    out: list[Event] = []
    for plane, names in (((2, 1), ("backward", "forward")), ((0, 1), ("", ""))):
        one, two = away[:, plane[0]], away[:, plane[1]]
        radius = np.hypot(one, two)
        angle = np.unwrap(np.arctan2(two, one))
        for start, end in spans(closed_gaps(stretched & (radius > 0.2), 5), 8):
            total = np.degrees(angle[end - 1] - angle[start])
            taken = any(e.start < end and start < e.end for e in out)
            if abs(total) >= 290 and not taken and radius[start:end].mean() > 0.3:
                # From ahead (+z) over the top (+y) to the back is a backward circle.
                direction = names[0] if total > 0 else names[1]
                count = max(1, round(abs(total) / 360))
                out.append(Event("arm_circle", start, end, side, direction, count=count))
    return out


def _paired(found: list[Event], least: float) -> list[Event]:
    """Joins what both sides do at the same time."""
    out: list[Event] = []
    left = [e for e in found if e.side == LEFT]
    right = [e for e in found if e.side == RIGHT]
    for one in left:
        for other in right:
            shared = min(one.end, other.end) - max(one.start, other.start)
            if shared > least * max(one.frames, other.frames):
                right.remove(other)
                start, end = min(one.start, other.start), max(one.end, other.end)
                count = max(one.count, other.count)
                out.append(Event(one.kind, start, end, BOTH, one.direction, one.amount, count))
                break
        else:
            out.append(one)
    return out + right
