"""Acts of the limbs.

Legs: steps, flights (jumps, hops, running), kicks, raised knees, balance. Arms: raised hands,
waves, punches, circles of straight arms, claps.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import length, running_maximum
from latentmotion.measure.facts import BOTH, FPS, LEFT, RIGHT, SIDES, Event
from latentmotion.measure.signals import (
    JOINT,
    Curve,
    Signals,
    around_peak,
    bearing,
    bend,
    closed_gaps,
    peaks,
    smooth,
    spans,
)


@dataclass(frozen=True)
class Flight:
    """An interval in which no foot touches the floor."""

    start: int  # First frame in the air.
    end: int  # First frame back on the floor.
    rise: float  # Meters by which the pelvis is higher than at take-off and landing.
    travel: tuple[float, float]  # Meters flown to the left and ahead.
    leaves: str  # Foot or feet that touched the floor last.
    lands: str  # Foot or feet that touch it first.


def flights_of(signals: Signals) -> list[Flight]:
    """Returns every flight of at least two frames and less than a second."""
    low = signals.feet.min(axis=1)
    level = _level(low)
    flights = []
    for start, end in spans(low - level > 0.045, 2):
        if end - start > FPS:
            continue
        pelvis = signals.joints[:, 0, 1]
        before, after = max(start - 1, 0), min(end, signals.frames - 1)
        rise = float(pelvis[start:end].max() - 0.5 * (pelvis[before] + pelvis[after]))
        travel = signals.velocity[start:end].sum(axis=0) / FPS
        flights.append(
            Flight(
                start=start,
                end=end,
                rise=rise,
                travel=(float(travel[0]), float(travel[1])),
                leaves=_touching(signals, level, before - 2, before + 1),
                lands=_touching(signals, level, after, after + 3),
            )
        )
    return flights


def running_of(flights: list[Flight], signals: Signals) -> Curve:
    """Returns 1 in frames where the gait is a jog or run, else 0.

    In these frames the pelvis bobs, both feet hardly ever stand, and heels swing up; or flights
    from one foot to the other follow each other, as in running in place.
    """
    both = (signals.feet.max(axis=1) < 0.03).astype(np.float64)
    heel = signals.joints[:, [7, 8], 1].max(axis=1)
    pelvis = signals.joints[:, 0, 1]
    bob = pelvis - smooth(pelvis, 8.0)
    bounce = _most(bob, 8) + _most(-bob, 8)
    gait = (bounce > 0.07) & (smooth(both, 6.0) < 0.2) & (_most(heel, 8) > 0.25)
    running = ((gait & (signals.speed > 1.0)) | (signals.speed > 2.3)).astype(np.float64)
    for first, two in pairwise([flight for flight in flights if _is_stride(flight)]):
        if two.start - first.end < 0.4 * FPS and first.leaves != two.leaves:
            running[first.start : two.end] = 1
    return running


def jumps_of(signals: Signals, flights: list[Flight], running: Curve) -> list[Event]:
    """Returns jumps from both feet, hops on one, and leaps from one foot to the other."""
    jumps = []
    for flight in flights:
        fast = signals.speed[flight.start : flight.end].mean() > 0.9
        crossed = flight.leaves != flight.lands
        least = (0.2, 6) if fast and crossed else (0.12, 4)
        high = flight.rise > least[0] and flight.end - flight.start >= least[1]
        stride = _is_stride(flight) and running[flight.start : flight.end].mean() > 0.5
        if (stride and not high) or flight.rise < 0.02:
            continue
        same = flight.leaves == flight.lands and flight.leaves != BOTH
        if same and flight.rise > 0.04:
            jumps.append(_jump("hop", flight, flight.leaves))
        elif high or (flight.leaves == flight.lands == BOTH and flight.rise > 0.035):
            jumps.append(_jump("jump", flight, BOTH if flight.leaves == BOTH else ""))
    return jumps


def kicks_of(signals: Signals) -> list[Event]:
    """Returns swings of a stretched leg that are high, or low ones much faster than a step."""
    kicks = []
    for index, side in enumerate(SIDES):
        foot = signals.of(f"{side}_ankle")
        away = foot - signals.of(f"{side}_hip")
        reach = length(away)
        swing = length(np.gradient(smooth(away, 0.7), axis=0)) * FPS
        straight = bend(signals, f"{side}_hip", f"{side}_knee", f"{side}_ankle")
        other_foot = np.minimum(signals.feet[:, 1 - index], 0.6) + 0.06  # higher on a stair
        height = foot[:, 1] - other_foot
        for top in peaks(height, 0.42, 0.25):
            near = slice(max(top - 4, 0), top + 5)
            fast = swing[max(top - 8, 0) : top + 6].max() > 2.6
            behind = away[top, 2] < -0.2 and abs(away[top, 0]) < 0.35
            if fast and not behind and straight[near].max() > 125 and reach[near].max() > 0.6:
                direction = bearing(away[top, 0], away[top, 2])
                direction = "side" if direction in SIDES else direction
                kicks.append(_event_at(top, height, "kick", side, direction))
        kicks += _low_kicks(signals, side, away, height, kicks)
    return kicks


def _low_kicks(
    signals: Signals,
    side: str,
    away: Float[np.ndarray, "frames 3"],
    height: Curve,
    known: list[Event],
) -> list[Event]:
    """Returns kicks as of a ball: the foot swings ahead low, and faster than the body moves."""
    ahead = smooth(away[:, 2], 0.5)
    pace = np.gradient(ahead) * FPS
    kicks = []
    for top in peaks(ahead, 0.3, 0.45):
        before = slice(max(top - 7, 0), top + 1)
        speed = signals.speed[before].mean()
        slow, lifted = speed < 2.6, height[top] > 0.1
        free = not any(k.side == side and k.start - 6 <= top < k.end + 6 for k in known)
        if free and slow and lifted and pace[before].max() > 3.4 + 0.8 * speed:
            end = min(top + 4, signals.frames)
            kicks.append(Event("kick", before.start, end, side, "forward", float(height[top])))
    return kicks


def knees_of(signals: Signals, kicks: list[Event]) -> list[Event]:
    """Returns knees raised to the hip or higher while the other foot stands."""
    knees = []
    for index, side in enumerate(SIDES):
        knee = signals.of(f"{side}_knee")
        thigh = knee[:, 1] - signals.of(f"{side}_hip")[:, 1]
        free = (signals.feet[:, index] > 0.15) & (signals.feet[:, 1 - index] < 0.15)
        up = free & (signals.joints[:, 0, 1] > 0.75) & (signals.tilt < 60)
        curve = np.where(up, thigh + 0.4, 0)
        for top in peaks(curve, 0.27, 0.15):
            if not any(kick.start <= top < kick.end and kick.side == side for kick in kicks):
                knees.append(_event_at(top, curve, "knee", side, "up"))
    return knees


def balances_of(signals: Signals) -> list[Event]:
    """Returns intervals of a second and more on one foot that stays in place."""
    balances = []
    still = signals.speed < 0.35
    for index, side in enumerate(SIDES):
        stands = (signals.feet[:, index] < 0.06) & (signals.feet[:, 1 - index] > 0.12)
        upright = signals.joints[:, 0, 1] > 0.6
        for start, end in spans(stands & still & upright, 22):
            balances.append(Event("balance", start, end, side=side))
    return balances


def treading_of(signals: Signals) -> list[Event]:
    """Returns intervals of steps in place: feet lifted in turn, four times and more."""
    lifts = sorted(
        (top, index)
        for index in (0, 1)
        for top in peaks(signals.feet[:, index], 0.08, 0.06)
        if signals.speed[top] < 0.5 and signals.feet[top, 1 - index] < 0.12
    )
    treading, run = [], lifts[:1]
    for lift in [*lifts[1:], (10**6, -1)]:
        if run and lift[0] - run[-1][0] < 1.1 * FPS and lift[1] != run[-1][1]:
            run.append(lift)
            continue
        if len(run) >= 4:
            pace = FPS * (len(run) - 1) / (run[-1][0] - run[0][0])
            kind = "jog" if pace > 2.3 else "walk"
            start, end = max(run[0][0] - 4, 0), min(run[-1][0] + 5, signals.frames)
            treading.append(Event(kind, start, end, direction="place", amount=0.1, count=len(run)))
        run = [lift]
    return treading


def climbs_of(signals: Signals) -> list[Event]:
    """Returns climbs of a stair, ladder or seat: the height of the ground under the feet changes.

    The amount is the meters climbed, `up` or `down`.
    """
    level = smooth(_level(signals.feet.min(axis=1)), 4.0)
    pelvis = smooth(signals.joints[:, 0, 1], 4.0)
    rate = np.gradient(level) * FPS
    climbs = []
    for sign, direction in ((1, "up"), (-1, "down")):
        for start, end in spans(closed_gaps(sign * rate > 0.04, 20), 6):
            rise = sign * (level[end - 1] - level[start])
            if rise > 0.14 and sign * (pelvis[end - 1] - pelvis[start]) > 0.1:
                climbs.append(Event("climb", start, end, direction=direction, amount=float(rise)))
    return climbs


def strides_of(signals: Signals) -> list[tuple[int, int]]:
    """Returns the first frame and one past the last of every step of both feet, by start.

    A step is a swing of a foot that carries it over the floor by 15 cm and more.
    """
    strides = []
    for name in ("left_foot", "right_foot"):
        toe = signals.joints[:, JOINT[name]]
        moving = smooth(length(np.gradient(toe[:, ::2], axis=0)) * FPS, 0.7) > 0.6
        for start, end in spans(moving, 3):
            travel = toe[min(end, len(toe) - 1), ::2] - toe[start, ::2]
            if float(np.linalg.norm(travel)) > 0.15:
                strides.append((start, end))
    return sorted(strides)


def _level(low: Curve) -> Curve:
    """Height of the ground, which may be a stair: the lowest of the lower foot within 0.8 s."""
    return np.minimum(-_most(-low, 16), 0.6)


def _most(curve: Curve, reach: int) -> Curve:
    """Returns the maximum within `reach` frames on both sides."""
    ends = np.full(reach, -np.inf)
    return running_maximum(np.concatenate([ends, curve, ends]), 2 * reach + 1)


def _touching(signals: Signals, level: Curve, start: int, end: int) -> str:
    """Returns the foot, or both, that touches the ground in some frames."""
    height = signals.feet[max(start, 0) : end] - level[max(start, 0) : end, None]
    if not len(height):
        return BOTH
    left, right = height.min(axis=0) < 0.07
    return BOTH if left == right else LEFT if left else RIGHT


def _is_stride(flight: Flight) -> bool:
    """Whether a flight leads from one foot to the other, or may do so while running."""
    return {flight.leaves, flight.lands} == {LEFT, RIGHT} or (
        BOTH in (flight.leaves, flight.lands)
        and flight.rise < 0.06
        and float(np.hypot(*flight.travel)) > 0.2
    )


def _jump(kind: str, flight: Flight, side: str) -> Event:
    left, ahead = flight.travel
    far = float(np.hypot(left, ahead))
    if far < 0.12:
        direction = "place"
    elif abs(ahead) >= abs(left):
        direction = "forward" if ahead > 0 else "backward"
    else:
        direction = LEFT if left > 0 else RIGHT
    return Event(kind, flight.start, flight.end, side, direction, flight.rise)


def _event_at(top: int, curve: Curve, kind: str, side: str, direction: str) -> Event:
    """Returns the event around a peak, in which a curve stays above a third of it."""
    before, after = around_peak(curve, top, curve[top] / 3)
    return Event(kind, before + 1, after, side, direction, float(curve[top]))


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
            tops = peaks(curve - curve.min(), 0.0, 0.07)
            swings = sorted({*tops, *peaks(curve.max() - curve, 0.0, 0.07)})
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
        reach, other_reach = length(away), length(other_away)
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
    series: list[list[Event]] = []
    for clap in single_claps_of(signals):
        if series and clap.start - series[-1][-1].start < 1.0 * FPS:
            series[-1].append(clap)
        else:
            series.append([clap])
    return [
        Event("clap", max(s[0].start - 5, 0), min(s[-1].start + 5, signals.frames), BOTH, count=n)
        for s in series
        if (n := len(s)) >= 2
    ]


def single_claps_of(signals: Signals) -> list[Event]:
    """Returns moments at which the hands meet in front of the chest or higher.

    Wrists come within 16 cm; in drawn claps it is 0 to 12. Of 1,238 recordings, none of which
    people call a clap, 14 had claps with 25 cm, 4 have some with 16.
    """
    apart = hands_apart(signals)
    wrists = 0.5 * (signals.of("left_wrist") + signals.of("right_wrist"))
    high = wrists[:, 1] > signals.of("spine1")[:, 1]
    tops = peaks(np.where(high, np.maximum(0.8 - apart, 0), 0), 0.64, 0.1)
    return [Event("clap", top, top + 1, BOTH) for top in tops]


def hands_apart(signals: Signals) -> Curve:
    """Returns the distance of the wrists, meters."""
    between = signals.of("left_wrist") - signals.of("right_wrist")
    return smooth(length(between), 0.5)


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
    return high & (away[:, 2] > 0.08) & (outward < 0.15) & (length(away) < 0.47)


def _hooks(signals: Signals, side: str, other: str) -> list[Event]:
    """Returns hooks and uppercuts: a bent arm that is very quick while the other is on guard."""
    wrist = signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder")
    speed = length(np.gradient(smooth(wrist, 0.5), axis=0)) * FPS
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
