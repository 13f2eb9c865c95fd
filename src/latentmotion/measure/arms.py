"""Acts of the arms: raised hands, waves, punches, circles of straight arms, claps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from latentmotion.measure.facts import BOTH, FPS, LEFT, RIGHT, SIDES, Event
from latentmotion.measure.signals import Signals, bend, closed_gaps, peaks, smooth, spans


def raises_of(signals: Signals) -> list[Event]:
    """Returns intervals in which a hand is above its shoulder, joined where both hands are.

    The amount is the height of the hand above the shoulder, meters. The direction is `up` above
    the head, else where the hand is (`forward` or `side`).
    """
    raises: dict[str, list[Event]] = {side: [] for side in SIDES}
    for side in SIDES:
        wrist, shoulder = signals.of(f"{side}_wrist"), signals.of(f"{side}_shoulder")
        above = wrist[:, 1] - shoulder[:, 1]
        upright = signals.tilt < 55
        for start, end in spans(closed_gaps((above > -0.02) & upright, 6), 4):
            top = start + int(np.argmax(above[start:end]))
            if above[top] < 0.08:
                continue
            away = wrist[top] - shoulder[top]
            direction = "forward" if away[2] > abs(away[0]) else "side"
            if above[top] > 0.25 or float(np.hypot(away[0], away[2])) < 0.2:
                direction = "up"
            raises[side].append(Event("raise", start, end, side, direction, float(above[top])))
    joint, used = [], set()
    for left in raises[LEFT]:
        for right in raises[RIGHT]:
            if left.overlap(right) > 0.6 * min(left.frames, right.frames) and id(right) not in used:
                start, end = min(left.start, right.start), max(left.end, right.end)
                lower = min(left, right, key=lambda one: one.amount)
                joint.append(Event("raise", start, end, BOTH, lower.direction, lower.amount))
                used |= {id(left), id(right)}
                break
    return joint + [event for side in SIDES for event in raises[side] if id(event) not in used]


def waves_of(signals: Signals) -> list[Event]:
    """Returns intervals in which a hand beside or above the chest swings, and counts the swings."""
    waves = []
    for side in SIDES:
        wrist, elbow, shoulder = (signals.of(f"{side}_{n}") for n in ("wrist", "elbow", "shoulder"))
        across = smooth(wrist - elbow, 0.7)[:, 0]
        up = (wrist[:, 1] > shoulder[:, 1] - 0.1) & (wrist[:, 1] > elbow[:, 1] + 0.05)
        for start, end in spans(closed_gaps(up, 6), 14):
            curve = across[start:end]
            tops, lows = (
                peaks(curve - curve.min(), 0.0, 0.07),
                peaks(curve.max() - curve, 0.0, 0.07),
            )
            swings = sorted({*tops, *lows})
            quick = len(swings) >= 3 and np.diff(swings).mean() < 0.7 * FPS
            if quick and _is_waving(signals, side, start + swings[0], start + swings[-1] + 1):
                first, last = start + max(swings[0] - 5, 0), min(start + swings[-1] + 5, end)
                waves.append(Event("wave", first, last, side, count=(len(swings) + 1) // 2))
    return _paired(waves, 0.5)


def punches_of(signals: Signals) -> list[Event]:
    """Returns jabs, quick stretches of an arm at the height of chest or head, and hooks.

    A push or a pass, in which the other arm stretches at the same time, is no punch.
    """
    punches: list[Event] = []
    for side, other in (SIDES, SIDES[::-1]):
        away = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
        other_away = signals.of(f"{other}_wrist") - signals.of(f"{other}_shoulder")
        reach, other_reach = np.linalg.norm(away, axis=1), np.linalg.norm(other_away, axis=1)
        speed = np.gradient(smooth(reach, 0.5)) * FPS
        jabs: list[Event] = []
        for top in peaks(smooth(reach, 0.5), 0.44, 0.1):
            fastest = speed[max(top - 6, 0) : top + 1].max()
            level = -0.25 < away[top, 1] < 0.3 and np.hypot(away[top, 0], away[top, 2]) > 0.35
            near = other_reach[max(top - 2, 0) : top + 3].max()
            stretched = near > 0.4 and near - other_reach[max(top - 7, 0) : top + 1].min() > 0.1
            if fastest > 1.6 and level and not (stretched and other_away[top, 2] > 0.2):
                start, end = max(top - 6, 0), min(top + 4, signals.frames)
                direction = "forward" if abs(away[top, 2]) >= abs(away[top, 0]) else "side"
                jabs.append(Event("punch", start, end, side, direction, float(fastest)))
        punches += jabs
        punches += [
            hook
            for hook in _hooks(signals, side, other)
            if not any(jab.start - 6 < hook.end and hook.start < jab.end + 6 for jab in jabs)
        ]
    return punches


def arm_circles_of(signals: Signals) -> list[Event]:
    """Returns full circles of a stretched arm about its shoulder."""
    circles: list[Event] = []
    for side in SIDES:
        away = smooth(signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"), 0.7)
        stretched = bend(signals, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist") > 115
        of_side: list[Event] = []
        # From ahead (+z) over the top (+y) to the back is a backward circle.
        for horizontal, positive, negative in ((2, "backward", "forward"), (0, "", "")):
            radius = np.hypot(away[:, horizontal], away[:, 1])
            angle = np.unwrap(np.arctan2(away[:, 1], away[:, horizontal]))
            for start, end in spans(closed_gaps(stretched & (radius > 0.2), 5), 8):
                total = np.degrees(angle[end - 1] - angle[start])
                counted = any(circle.start < end and start < circle.end for circle in of_side)
                if abs(total) >= 290 and not counted and radius[start:end].mean() > 0.3:
                    direction = positive if total > 0 else negative
                    count = max(1, round(abs(total) / 360))
                    # An arm that hangs before and after is stretched as well.
                    left = np.abs(np.degrees(angle[start:end] - angle[start])) > 30
                    right = np.abs(np.degrees(angle[start:end] - angle[end - 1])) > 30
                    start, end = start + int(left.argmax()), end - int(right[::-1].argmax())
                    of_side.append(Event("arm_circle", start, end, side, direction, count=count))
        circles += of_side
    return _paired(circles, 0.4)


def claps_of(signals: Signals) -> list[Event]:
    """Returns series of two and more claps, the hands in front of the chest or higher."""
    left, right = signals.of("left_wrist"), signals.of("right_wrist")
    apart = smooth(np.linalg.norm(left - right, axis=1), 0.5)
    high = 0.5 * (left[:, 1] + right[:, 1]) > signals.of("spine1")[:, 1]
    near = np.where(high, np.maximum(0.8 - apart, 0), 0)
    tops = peaks(near, 0.55, 0.1)
    series: list[list[int]] = []
    for top in tops:
        if series and top - series[-1][-1] < 1.0 * FPS:
            series[-1].append(top)
        else:
            series.append([top])
    return [
        Event("clap", max(s[0] - 5, 0), min(s[-1] + 5, signals.frames), BOTH, count=len(s))
        for s in series
        if len(s) >= 2
    ]


def _is_waving(signals: Signals, side: str, start: int, end: int) -> bool:
    """Whether swings of a hand are a wave, not the guard of a boxer, a dance or a run.

    The hand is above its shoulder on average and not in front of the chest, it swings sideways
    more than forward and back, and the body stays in place.
    """
    frames = slice(start, end)
    outward = 1 if side == LEFT else -1
    wrist, elbow, shoulder = (
        signals.of(f"{side}_{name}")[frames] for name in ("wrist", "elbow", "shoulder")
    )
    high = float((wrist - shoulder)[:, 1].mean())
    aside = float((wrist - shoulder)[:, 0].mean()) * outward
    across, along = (float(np.ptp((wrist - elbow)[:, axis])) for axis in (0, 2))
    calm = signals.speed[frames].mean() < 0.45 and signals.feet[frames].min(axis=1).max() < 0.1
    if _on_guard(signals, RIGHT if side == LEFT else LEFT)[frames].mean() > 0.4:
        return False
    return bool(calm and high > -0.03 and (aside > 0.0 or high > 0.25) and across > 0.8 * along)


def _on_guard(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """Whether a fist is held in front of the chest or the chin, the elbow bent, as boxers do."""
    away = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
    outward = away[:, 0] * (1 if side == LEFT else -1)
    high = (away[:, 1] > -0.25) & (away[:, 1] < 0.2)
    return high & (away[:, 2] > 0.08) & (outward < 0.15) & (np.linalg.norm(away, axis=1) < 0.47)


def _hooks(signals: Signals, side: str, other: str) -> list[Event]:
    """Returns hooks and uppercuts: a bent arm that is very quick while the other is on guard."""
    wrist = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
    speed = np.linalg.norm(np.gradient(smooth(wrist, 0.5), axis=0), axis=1) * FPS
    guarded = _on_guard(signals, other) | _on_guard(signals, side)
    hooks: list[Event] = []
    for top in peaks(speed, 4.0, 1.5):
        around = slice(max(top - 8, 0), top + 9)
        level = -0.35 < wrist[top, 1] < 0.35 and wrist[top, 2] > 0.05
        alone = not hooks or top - hooks[-1].end > 4
        if level and alone and guarded[around].mean() > 0.5 and signals.speed[top] < 1.2:
            first, last = max(top - 5, 0), min(top + 5, signals.frames)
            hooks.append(Event("punch", first, last, side, "forward", float(speed[top])))
    return hooks


def _paired(events: list[Event], share: float) -> list[Event]:
    """Joins events of both sides that overlap by more than a share of the longer one."""
    paired: list[Event] = []
    lefts = [event for event in events if event.side == LEFT]
    rights = [event for event in events if event.side == RIGHT]
    for left in lefts:
        for right in rights:
            if left.overlap(right) > share * max(left.frames, right.frames):
                rights.remove(right)
                start, end = min(left.start, right.start), max(left.end, right.end)
                count = max(left.count, right.count)
                direction = left.direction if left.direction == right.direction else ""
                paired.append(Event(left.kind, start, end, BOTH, direction, left.amount, count))
                break
        else:
            paired.append(left)
    return paired + rights
