"""Where in a motion each act happens: a few lines of kinematics for each, on joints alone.

Written from the prompts of the benchmark, without a look at `latentmotion.measure`, by whose
detectors models are trained and takes are chosen: what these find is news to a model.

A motion as curves over time: heights, headings, speeds, distances; and events of a curve.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.data.instructions import Check, Term
from latentmotion.errors import named
from latentmotion.plugins import entries

FPS = 20.0  # Frames per second of all motions.

LEFT, RIGHT = "left", "right"

_HIPS, _KNEES, _ANKLES, _TOES = (1, 2), (4, 5), (7, 8), (10, 11)
_SHOULDERS, _ELBOWS, _WRISTS = (16, 17), (18, 19), (20, 21)
_PELVIS, _NECK, _HEAD = 0, 12, 15

Curve = Float[np.ndarray, " frames"]
Span = tuple[int, int]  # First frame of an event, and one past its last.


class Body:
    """Curves of one motion.

    Args:
        joints: Positions of SMPL's 22 body joints, y up, meters, 20 frames per second.
    """

    def __init__(self, joints: Float[np.ndarray, "frames 22 3"]) -> None:
        joints = np.array(joints, np.float64)
        self.floor = float(np.percentile(joints[:, _TOES, 1].min(axis=1), 5))
        joints[..., 1] -= self.floor
        self.joints = smooth(joints, 1)
        thigh = np.linalg.norm(joints[:, _HIPS] - joints[:, _KNEES], axis=-1)
        shank = np.linalg.norm(joints[:, _KNEES] - joints[:, _ANKLES], axis=-1)
        self.leg = float(np.median(thigh + shank))
        upper = np.linalg.norm(joints[:, _SHOULDERS] - joints[:, _ELBOWS], axis=-1)
        lower = np.linalg.norm(joints[:, _ELBOWS] - joints[:, _WRISTS], axis=-1)
        self.arm = float(np.median(upper + lower))
        self.frames = len(joints)

    @property
    def seconds(self) -> float:
        """Length of the motion."""
        return self.frames / FPS

    def of(self, joints: tuple[int, int], side: str) -> Float[np.ndarray, "frames 3"]:
        """Returns the positions of one joint of a pair."""
        return self.joints[:, joints[side == RIGHT]]

    @cached_property
    def heading(self) -> Curve:
        """Direction that hips and shoulders face, radians without jumps; it grows to the left."""
        hips = self.joints[:, _HIPS[0]] - self.joints[:, _HIPS[1]]
        shoulders = self.joints[:, _SHOULDERS[0]] - self.joints[:, _SHOULDERS[1]]
        across = smooth(hips / 0.1 + shoulders / 0.35, 3)
        return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))

    @cached_property
    def velocity(self) -> Float[np.ndarray, "frames 2"]:
        """Velocity of the pelvis ahead of the body and to its left, m/s."""
        moving = np.gradient(smooth(self.joints[:, _PELVIS][:, [0, 2]], 4), axis=0) * FPS
        x, z = moving.T
        sin, cos = np.sin(self.heading), np.cos(self.heading)
        return np.stack([x * sin + z * cos, x * cos - z * sin], axis=-1)

    @cached_property
    def speed(self) -> Curve:
        """Speed of the pelvis over the floor, m/s."""
        return np.linalg.norm(self.velocity, axis=-1)

    @property
    def way(self) -> float:
        """Length of the root's path along the floor, meters."""
        return float(self.speed.sum() / FPS)

    @property
    def away(self) -> float:
        """Distance from the first to the last position of the root, meters."""
        path = self.joints[:, _PELVIS][:, [0, 2]]
        return float(np.linalg.norm(path[-1] - path[0]))

    @cached_property
    def height(self) -> Curve:
        """Height of the pelvis as a share of its height in a standing body."""
        return self.joints[:, _PELVIS, 1] / (1.13 * self.leg)

    @cached_property
    def pitch(self) -> Curve:
        """Angle of the trunk to the vertical, degrees."""
        trunk = self.joints[:, _NECK] - self.joints[:, _PELVIS]
        return np.degrees(np.arccos(trunk[:, 1] / np.linalg.norm(trunk, axis=-1)))

    @property
    def head(self) -> Float[np.ndarray, "frames 3"]:
        """Position of the head."""
        return self.joints[:, _HEAD]

    def hand(self, side: str) -> Curve:
        """Height of a wrist above its shoulder, meters."""
        return (self.of(_WRISTS, side) - self.of(_SHOULDERS, side))[:, 1]

    def wrist(self, side: str) -> Float[np.ndarray, "frames 3"]:
        """A wrist from its shoulder: to the body's left, up, ahead, meters."""
        return self._turned(self.of(_WRISTS, side) - self.of(_SHOULDERS, side))

    def ankle(self, side: str) -> Float[np.ndarray, "frames 3"]:
        """An ankle from its hip: to the body's left, up, ahead, meters."""
        return self._turned(self.of(_ANKLES, side) - self.of(_HIPS, side))

    def foot(self, side: str) -> Curve:
        """Height of a foot's lowest point over where it stands, meters."""
        ankle, toe = self.of(_ANKLES, side)[:, 1], self.of(_TOES, side)[:, 1]
        return np.minimum(ankle - 0.07, toe)

    def lifted(self, side: str) -> Curve:
        """Height of an ankle above the other one, meters."""
        ankles = self.joints[:, _ANKLES, 1]
        return (ankles[:, 0] - ankles[:, 1]) * (1 if side == LEFT else -1)

    def knee(self, side: str) -> Curve:
        """Height of a knee below its hip, by the length of the thigh; 0 is a level thigh."""
        return (self.of(_HIPS, side) - self.of(_KNEES, side))[:, 1] / (0.5 * self.leg)

    def shin(self, side: str) -> Curve:
        """Height of a knee above the floor, meters."""
        return self.of(_KNEES, side)[:, 1]

    def stepping(self, side: str) -> Curve:
        """Speed of an ankle over the floor, m/s."""
        return np.linalg.norm(np.gradient(self.of(_ANKLES, side)[:, [0, 2]], axis=0), axis=-1) * FPS

    @property
    def hands_apart(self) -> Curve:
        """Distance of the wrists, meters."""
        return np.linalg.norm(self.joints[:, _WRISTS[0]] - self.joints[:, _WRISTS[1]], axis=-1)

    @property
    def hands_up(self) -> Curve:
        """Height of the higher wrist over the floor, meters."""
        return self.joints[:, _WRISTS, 1].max(axis=1)

    @property
    def hands_low(self) -> Curve:
        """Height of the lower wrist over the floor, meters."""
        return self.joints[:, _WRISTS, 1].min(axis=1)

    @property
    def hands_from_hips(self) -> Curve:
        """Distance of each wrist from its hip, the larger one, meters."""
        apart = self.joints[:, _WRISTS] - self.joints[:, _HIPS]
        return np.linalg.norm(apart, axis=-1).max(axis=1)

    @property
    def feet_apart(self) -> Curve:
        """Distance of the ankles over the floor, meters."""
        ankles = self.joints[:, _ANKLES][..., [0, 2]]
        return np.linalg.norm(ankles[:, 0] - ankles[:, 1], axis=-1)

    @cached_property
    def busy(self) -> Curve:
        """Speed of the fastest hand or foot, m/s."""
        ends = self.joints[:, [*_ANKLES, *_WRISTS]]
        return np.linalg.norm(np.gradient(smooth(ends, 2), axis=0), axis=-1).max(axis=1) * FPS

    def _turned(self, vectors: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
        x, y, z = vectors.T
        sin, cos = np.sin(self.heading), np.cos(self.heading)
        return np.stack([x * cos - z * sin, y, x * sin + z * cos], axis=-1)


def smooth(values: np.ndarray, reach: int) -> np.ndarray:
    """Returns means over `reach` frames to either side, weighted by a triangle; ends are held."""
    weights = np.concatenate([np.arange(1, reach + 2), np.arange(reach, 0, -1)]).astype(float)
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), "edge")
    shifted = [padded[n : n + len(values)] * w for n, w in enumerate(weights)]
    return np.sum(shifted, axis=0) / weights.sum()


def spans(
    holds: Bool[np.ndarray, " frames"], shortest: float = 0.0, gap: float = 0.0
) -> list[Span]:
    """Returns where something holds for `shortest` seconds or more, across gaps up to `gap`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]])))
    joined: list[Span] = []
    for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if joined and start - joined[-1][1] <= gap * FPS:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return [(start, end) for start, end in joined if end - start >= shortest * FPS]


def swings(curve: Curve, low: float, high: float) -> list[Span]:
    """Returns the intervals from above `high` to below `low` again, one for each swing."""
    intervals, start = [], None
    for frame, value in enumerate(curve.tolist()):
        if start is None and value > high:
            start = frame
        elif start is not None and value < low:
            intervals.append((start, frame))
            start = None
    return intervals if start is None else [*intervals, (start, len(curve))]


# Motion and side (`left`, `right`, `both` or `any`) to where the act happens.
Detector = Callable[[Body, str], list[Span]]

ConditionTest = Callable[[Body, Term], bool]  # Whether a condition holds for a motion.

# Units in all detectors: lengths in meters, speeds in m/s, times in seconds, angles in degrees,
# heights of the pelvis as shares of a standing body's. Pairs such as (-0.1, 0.08) are the lower and
# upper bound of a hysteresis, so that a limb that trembles at a threshold counts once.
_OTHER = {LEFT: RIGHT, RIGHT: LEFT}


# Acts by name; those of more than an expression register themselves below.
ACTS: dict[str, Detector] = {
    # Depth of the pelvis below standing, as a share; pitch of the trunk; distance of the wrists.
    "squat": lambda body, side: swings(1 - body.height, 0.12, 0.25),
    "bow": lambda body, side: swings(body.pitch, 20, 38),
    "clap": lambda body, side: swings(-body.hands_apart, -0.33, -0.24),
    "lie": lambda body, side: spans((body.height < 0.4) & (body.head[:, 1] < 0.55), 0.4),
    "kneel": lambda body, side: spans(
        (np.minimum(body.shin(LEFT), body.shin(RIGHT)) < 0.2) & (body.height > 0.35), 0.4
    ),
    "crouch": lambda body, side: spans(body.height < 0.82, 0.3, 0.1),
    "stand": lambda body, side: spans((body.height > 0.9) & (body.pitch < 30), 0.2),
    "low": lambda body, side: spans(body.height < 0.45, 0.2),
    "reach_floor": lambda body, side: spans(body.hands_low < 0.35, 0.1),
    "on_hips": lambda body, side: spans(body.hands_from_hips < 0.24, 0.4, 0.1),
    # Below the speed of any step and of any gesture; swaying stays below both.
    "still": lambda body, side: spans((body.speed < 0.2) & (body.busy < 0.45), 0.4, 0.1),
    # People change from walking to running at about 2 m/s; the bounds of both overlap around it.
    "run": lambda body, side: spans(body.speed > 1.8, 0.4, 0.2),
    "walk": lambda body, side: spans(
        (body.speed > 0.3) & (body.speed < 1.9) & (body.height > 0.8), 0.5, 0.2
    ),
}

# Conditions on a whole motion, by name; others register themselves below.
CONDITIONS: dict[str, ConditionTest] = {
    "way": lambda body, term: body.way >= term.numbers[0],
    "stays": lambda body, term: body.away <= term.numbers[0],
    "lasts": lambda body, term: bool(np.mean(body.height < term.numbers[0]) > 0.5),
    "upright": lambda body, term: bool(np.mean((body.height > 0.88) & (body.pitch < 25)) > 0.9),
    "hunched": lambda body, term: bool(np.median(body.pitch) > 15 or np.median(body.height) < 0.93),
    # The last 5 frames are a quarter of a second.
    "stops": lambda body, term: bool(body.speed[-5:].mean() < 0.3 and body.speed.max() > 0.5),
    "both_ways": lambda body, term: bool(_turning(body, LEFT) and _turning(body, RIGHT)),
    "motionless": lambda body, term: bool(
        np.mean((body.speed < 0.2) & (body.busy < 0.6)) > 0.85 and np.ptp(body.heading) < 0.5
    ),
}


def _act(name: str, of_sides: bool = False) -> Callable[[Detector], Detector]:
    """Registers the detector of an act; with `of_sides` it finds the act of one given side."""

    def register(detect: Detector) -> Detector:
        def of_either(body: Body, side: str) -> list[Span]:
            if side in _OTHER:  # the other side must do less of it
                events, other = detect(body, side), detect(body, _OTHER[side])
                return events if len(events) > len(other) or not other else []
            return sorted(detect(body, LEFT) + detect(body, RIGHT))

        ACTS[name] = of_either if of_sides else detect
        if of_sides:
            _OF_ONE_SIDE[name] = detect
        return detect

    return register


# Detectors of the acts of a given side, whatever the other side does.
_OF_ONE_SIDE: dict[str, Detector] = {}

_condition = entries(CONDITIONS)  # Registers a condition.


def fulfills(body: Body, check: Check) -> bool:
    """Returns whether a motion does what a check asks.

    Raises:
        InputError: There is no such act or condition.
    """
    if not check.ordered:
        return all(
            CONDITIONS[term.name](body, term)
            if term.name in CONDITIONS
            else term.often[0] <= len(_events(body, term)) <= term.often[1]
            for term in check.terms
        )
    # Of an act on one side, then on the other, neither side does more.
    names = [term.name for term in check.terms]
    events = [_events(body, term, names.count(term.name) > 1) for term in check.terms]
    for earlier, later, term in zip(events, events[1:], check.terms[1:], strict=False):
        # Acts within two frames (0.1 s) of each other happen at once, in no order.
        if not earlier or not later or earlier[0][0] + 2 > later[-1][0]:
            return False
        # What goes on from the start may also come again.
        if term.name not in _LASTING and later[0][0] <= earlier[0][0]:
            return False
    return True


def _events(body: Body, term: Term, either: bool = False) -> list[Span]:
    act = named("act", term.name, ACTS)
    side = term.words[0] if term.words else "any"
    detect = _OF_ONE_SIDE.get(term.name) if either and side in _OTHER else None
    return (detect or act)(body, side)


@_act("raise")
def _raise(body: Body, side: str) -> list[Span]:
    left, right = body.hand(LEFT), body.hand(RIGHT)
    if side == "both":
        # Raised: 8 cm above the shoulder; lowered: 10 cm below.
        return swings(np.minimum(left, right), -0.1, 0.08)
    if side == "any":
        return swings(np.maximum(left, right), -0.1, 0.08)
    raised, other = (left, right) if side == LEFT else (right, left)
    up = swings(raised, -0.1, 0.08)
    # The other hand may pass the shoulder's height, but not stay there.
    return [(s, e) for s, e in up if np.mean(other[s:e] > 0.0) < 0.4]


def _wave_of(body: Body, side: str) -> list[Span]:
    """A raised hand that changes its direction across or up and down three times or more."""
    wrist = body.wrist(side)
    waves = []
    # A hand that waves may be 25 cm below the shoulder, as from a bent arm; strokes of less than 5
    # cm are noise, and a wave spans 10 cm or more.
    for start, end in spans(wrist[:, 1] > -0.25, 0.5, 0.2):
        turns = [_reversals(wrist[start:end, axis], 0.05) for axis in (0, 1)]
        if max(turns) >= 3 and np.ptp(wrist[start:end], axis=0).max() > 0.1:
            waves.append((start, end))
    return waves


@_act("wave")
def _wave(body: Body, side: str) -> list[Span]:
    left, right = _wave_of(body, LEFT), _wave_of(body, RIGHT)
    if side == "any":
        return sorted(left + right)
    if side == "both":
        return left if right else []
    waves, other = (left, right) if side == LEFT else (right, left)
    return waves if sum(e - s for s, e in waves) > 1.5 * sum(e - s for s, e in other) else []


@_act("punch", of_sides=True)
def _punch_of(body: Body, side: str) -> list[Span]:
    """A fist that shoots out: the arm gets straight fast, at the height of chest or head."""
    wrist = body.wrist(side)
    level = np.hypot(wrist[:, 0], wrist[:, 2]) / body.arm
    rate = np.gradient(level * body.arm) * FPS
    punches = []
    # Reach over the floor as a share of the arm's length: 0.72 is nearly straight ahead, 0.6 drawn
    # back.
    for start, end in swings(level, 0.6, 0.72):
        before = slice(max(start - 6, 0), start + 4)
        # An arm that is raised swings out, too, but up rather than ahead.
        rise, out = np.ptp(wrist[before, 1]), np.ptp(level[before]) * body.arm
        if rate[before].max() > 1.2 and wrist[start:end, 1].max() > -0.35 and rise < 1.3 * out:
            punches.append((start, end))
    return punches


@_act("kick", of_sides=True)
def _kick_of(body: Body, side: str) -> list[Span]:
    """A foot far from the body and off the floor with the leg stretched, the other one standing."""
    ankle, height = body.ankle(side), body.foot(side)
    out = np.hypot(ankle[:, 0], ankle[:, 2]) / body.leg
    straight = np.linalg.norm(ankle, axis=-1) / body.leg
    standing = body.foot(_OTHER[side]) < 0.15
    # Off the floor by 15 cm and out by 42 % of the leg, which is 80 % stretched; steps stay below.
    kicked = (height > 0.15) & (out > 0.42) & (straight > 0.8) & standing & (body.height > 0.75)
    fast = body.stepping(side) + np.abs(np.gradient(height)) * FPS
    # A runner's trailing foot is bent, a walker's low.
    return [
        (s, e)
        for s, e in spans(kicked, 0.05, 0.3)
        if fast[max(s - 6, 0) : e + 2].max() > 1.8 and ankle[s:e, 2].max() > -0.25
    ]


@_act("knee", of_sides=True)
def _knee_of(body: Body, side: str) -> list[Span]:
    """A knee near the height of the hip, the shin hanging, on a standing leg."""
    # The knee at most 45 % of a thigh's length below the hip; over once it is 70 % below.
    standing = (body.knee(_OTHER[side]) > 0.75) & (body.height > 0.8)
    return swings(np.where(standing, -body.knee(side), -1.0), -0.7, -0.45)


@_act("one_leg", of_sides=True)
def _one_leg_of(body: Body, side: str) -> list[Span]:
    """Standing on one foot for at least a second."""
    other = _OTHER[side]
    return spans((body.lifted(other) > 0.1) & (body.foot(side) < 0.1), 1.0, 0.1)


def _flights(body: Body) -> list[Span]:
    """Both feet off the floor, with the pelvis rising and falling."""
    low = np.minimum(body.foot(LEFT), body.foot(RIGHT))
    flights = []
    # 5 cm and 0.1 s are above the noise of reconstructed feet; no person flies for 1.2 s.
    for start, end in spans(low > 0.05, 0.1):
        around = body.joints[max(start - 5, 0) : end + 5, 0, 1]
        if around.max() - min(around[0], around[-1]) > 0.05 and end - start < 1.2 * FPS:
            flights.append((start, end))
    return flights


@_act("jump")
def _jump(body: Body, side: str) -> list[Span]:
    """Flights that begin and end with both feet near each other, unlike a runner's."""
    jumps = []
    for start, end in _flights(body):
        off, on = max(start - 1, 0), min(end, body.frames - 1)
        # A runner's ankles are far apart in height; a rise of 15 cm is a jump in any stance.
        even = min(abs(body.lifted(LEFT)[off]), abs(body.lifted(LEFT)[on])) < 0.13
        rise = body.joints[start:end, 0, 1].max() - body.joints[[off, on], 0, 1].min()
        if rise > 0.06 and (even or rise > 0.15):
            jumps.append((start, end))
    return jumps


@_act("hop", of_sides=True)
def _hop_of(body: Body, side: str) -> list[Span]:
    """Flights from one foot to the same one."""
    other = _OTHER[side]
    return [
        (start, end)
        for start, end in _flights(body)
        if min(body.lifted(other)[[max(start - 2, 0), min(end + 1, body.frames - 1)]]) > 0.08
    ]


@_act("turn")
def _turning(body: Body, side: str) -> list[Span]:
    """Turns to one side by more than 25 degrees, throughout faster than 15 degrees per second."""
    rate = np.degrees(np.gradient(body.heading)) * FPS
    turns = []
    for sign in {LEFT: (1,), RIGHT: (-1,)}.get(side, (1, -1)):
        for start, end in spans(sign * rate > 15, 0.2, 0.2):
            if abs(body.heading[end - 1] - body.heading[start]) > np.radians(25):
                turns.append((start, end))
    return sorted(turns)


@_act("go")
def _going(body: Body, side: str) -> list[Span]:
    """Half a second in one direction of the body: forward, backward, left or right."""
    ahead, left = body.velocity.T
    along, across = {
        "forward": (ahead, left),
        "backward": (-ahead, left),
        LEFT: (left, ahead),
        RIGHT: (-left, ahead),
    }[side]
    return spans((along > 0.2) & (along > np.abs(across)), 0.4, 0.2)


@_act("step")
def _step(body: Body, side: str) -> list[Span]:
    """A foot that is set 15 cm or more away."""
    steps = []
    for foot in (LEFT, RIGHT):
        # A swinging foot is faster than the body; 0.4 m/s leaves out sliding and shifting of
        # weight.
        for start, end in spans(body.stepping(foot) > 0.4, 0.1, 0.05):
            positions = body.joints[[start, end - 1], 7 + (foot == RIGHT)][:, [0, 2]]
            if np.linalg.norm(positions[1] - positions[0]) > 0.15:
                steps.append((start, end))
    return sorted(steps)


@_act("sit")
def _sit(body: Body, side: str) -> list[Span]:
    """A low pelvis with the feet well before it, or on the floor, and the trunk up."""
    # On a chair the feet are before the hips and a thigh is near level; on the floor (height below
    # 0.35) they may be anywhere.
    before = np.maximum(body.ankle(LEFT)[:, 2], body.ankle(RIGHT)[:, 2])
    level = np.minimum(body.knee(LEFT), body.knee(RIGHT)) < 0.5
    low = (body.height < 0.78) & level & ((before > 0.12) | (body.height < 0.35))
    return spans(low & (body.pitch < 60), 0.4, 0.2)


@_act("jack")
def _jack(body: Body, side: str) -> list[Span]:
    """Arms that go up while the legs go apart."""
    up = swings(np.minimum(body.hand(LEFT), body.hand(RIGHT)), -0.1, 0.1)
    wide = body.feet_apart
    # Wide by half more than the narrowest stance, and by 10 cm for stances that are never narrow.
    return [(s, e) for s, e in up if wide[max(s - 4, 0) : e].max() > 1.5 * wide.min() + 0.1]


@_act("touch_head", of_sides=True)
def _touch_head_of(body: Body, side: str) -> list[Span]:
    wrist = body.joints[:, 20 + (side == RIGHT)]
    # The wrist is a hand's length from the head, whose joint is at its base.
    return spans(np.linalg.norm(wrist - body.head, axis=-1) < 0.28, 0.15, 0.2)


@_act("crawl")
def _crawl(body: Body, side: str) -> list[Span]:
    """Hands and knees on the floor while the body moves."""
    down = np.maximum(body.shin(LEFT), body.shin(RIGHT)) < 0.3
    return spans((body.hands_up < 0.3) & down & (body.speed > 0.1), 0.6, 0.3)


@_act("arms_out")
def _arms_out(body: Body, side: str) -> list[Span]:
    """Both arms stretched to the sides at the height of the shoulders."""
    out = [body.wrist(LEFT)[:, 0], -body.wrist(RIGHT)[:, 0]]
    level = [np.abs(body.hand(each)) < 0.3 for each in (LEFT, RIGHT)]
    return spans((np.minimum(*out) > 0.7 * body.arm) & level[0] & level[1], 0.3, 0.1)


# Acts that also are what a body does before others.
_LASTING = {"stand", "still", "walk", "run", "go", "step"}


@_condition("net")
def _net_turn(body: Body, term: Term) -> bool:
    """Whether the net turn lies between two angles in degrees, to one side or to either."""
    net = float(np.degrees(body.heading[-1] - body.heading[0]))
    net = {LEFT: net, RIGHT: -net}.get(term.words[0] if term.words else "either", abs(net))
    return term.numbers[0] <= net <= term.numbers[1]


@_condition("pace")
def _pace(body: Body, term: Term) -> bool:
    """Median speed of what moves between two numbers, m/s."""
    moving = body.speed[body.speed > 0.2]
    usual = float(np.median(moving)) if len(moving) > 0.25 * body.frames else 0.0
    return term.numbers[0] <= usual <= term.numbers[1]


@_condition("faster")
def _faster(body: Body, term: Term) -> bool:
    third = body.frames // 3
    # From the first to the last third by 30 %, and by 0.1 m/s where the body hardly moves.
    return bool(body.speed[-third:].mean() > 1.3 * body.speed[:third].mean() + 0.1)


@_condition("slower")
def _slower(body: Body, term: Term) -> bool:
    third = body.frames // 3
    return bool(body.speed[:third].mean() > 1.3 * body.speed[-third:].mean() + 0.1)


@_condition("on_the_spot")
def _on_the_spot(body: Body, term: Term) -> bool:
    """Feet that are lifted in turn, four times or more, while the body stays."""
    # A step lifts its foot by 7 cm; `stays` leaves out walks.
    lifts = [len(swings(body.foot(side), 0.03, 0.07)) for side in (LEFT, RIGHT)]
    up = [body.foot(side) > 0.05 for side in (LEFT, RIGHT)]
    in_turn = (up[0] & up[1]).sum() < 0.5 * (up[0] | up[1]).sum()
    stays = body.away < 1.0 and np.median(body.speed) < 0.5
    return bool(min(lifts) >= 2 and in_turn and stays)


@_condition("returns")
def _returns(body: Body, term: Term) -> bool:
    """Ends nearer to the start than the farthest point by 40 % or more."""
    path = body.joints[:, 0][:, [0, 2]]
    far = np.linalg.norm(path - path[0], axis=-1)
    return bool(far[-1] < 0.6 * far.max())


@_condition("heads")
def _heads(body: Body, term: Term) -> bool:
    """Two thirds of the path lead in one direction of the body, or to the sides."""
    ahead, left = body.velocity.T
    along = {"forward": ahead, "backward": -ahead, LEFT: left, RIGHT: -left, "sideways": abs(left)}
    return bool(along[term.words[0]].sum() > 0.65 * body.speed.sum())


def _reversals(curve: np.ndarray, least: float) -> int:
    """Returns how often a curve changes its direction by `least` or more."""
    turns, rising, low, high = 0, 0, curve[0], curve[0]
    for value in curve.tolist():
        if not rising:
            low, high = min(low, value), max(high, value)
            rising = int(value - low > least) - int(high - value > least)
            extreme = value
        elif rising * (value - extreme) > 0:
            extreme = value
        elif rising * (extreme - value) > least:
            turns, rising, extreme = turns + 1, -rising, value
    return turns
