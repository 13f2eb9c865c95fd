"""Made-up motions of a body that does one known thing: it walks, turns, kicks, waves, sits, jumps.

Arms and legs are solved for hands and ankles. All motions have 20 frames per second, the skeleton
of HumanML3D, meters and y up; they begin at the origin, facing +z. Sides are the body's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.measure.facts import LEFT, RIGHT, SIDES
from latentmotion.measure.scene import Measured, describe
from latentmotion.measure.signals import JOINT

FPS = 20
STANDING = 0.88  # Height of the pelvis over stretched legs.

_REST = HUMANML3D.rest_joints()
# An upright chest: with identity rotations the skeleton's shoulders hang beside the ribs.
for _side, _outward in ((LEFT, 1.0), (RIGHT, -1.0)):
    _REST[JOINT[f"{_side}_collar"]] = (0.07 * _outward, 0.45, 0.0)
    _REST[JOINT[f"{_side}_shoulder"]] = (0.195 * _outward, 0.49, 0.0)
_REST[JOINT["head"]] = (0.0, 0.64, 0.05)
_TRUNK = ("spine1", "spine2", "spine3", "neck", "head")
_HANGING = (0.05, -0.5, 0.06)  # From the shoulder to a hand that hangs: outward, up, ahead.
_SIGN = {LEFT: 1.0, RIGHT: -1.0}

Curve = np.ndarray | float
Points = np.ndarray | tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Body:
    """Curves over time of a body; one number holds for all frames.

    Hands are offsets from the shoulder, feet from where they stand: outward, up, ahead.
    """

    frames: int
    ahead: Curve = 0.0  # Meters per second in the direction that the body faces.
    left: Curve = 0.0  # Meters per second to its left.
    heading: Curve = 0.0  # Degrees turned to the left since the first frame.
    height: Curve = STANDING  # Height of the pelvis.
    ground: Curve = 0.0  # Height of the floor under the feet.
    lean: Curve = 0.0  # Degrees by which the trunk leans forward.
    twist: Curve = 0.0  # Degrees by which the shoulders turn to the left of the hips.
    hands: Mapping[str, Points] = field(default_factory=dict)
    feet: Mapping[str, Points] = field(default_factory=dict)
    stoop: float = 0.0  # Degrees by which thighs and shins hang backward, as of a body that kneels.

    def joints(self) -> np.ndarray:
        """Returns the joint positions, (frames, 22, 3)."""
        local = np.zeros((self.frames, 22, 3))
        trunk = _turned(self.frames, 0, self.lean) @ _turned(self.frames, 1, self.twist)
        for name in _TRUNK:
            local[:, JOINT[name]] = trunk @ _REST[JOINT[name]]
        for side in SIDES:
            for name in (f"{side}_collar", f"{side}_shoulder"):
                local[:, JOINT[name]] = trunk @ _REST[JOINT[name]]
            self._place_arm(local, side)
            self._place_leg(local, side)
        world = np.einsum("fij,fkj->fki", _turned(self.frames, 1, self.heading), local)
        return world + self._root()[:, None]

    def _root(self) -> np.ndarray:
        angle = np.radians(np.broadcast_to(self.heading, self.frames))
        left, ahead = (np.broadcast_to(v, self.frames) / FPS for v in (self.left, self.ahead))
        steps = np.zeros((self.frames, 3))
        steps[:, 0] = np.cos(angle) * left + np.sin(angle) * ahead
        steps[:, 2] = np.cos(angle) * ahead - np.sin(angle) * left
        root = np.cumsum(steps, axis=0) - steps[:1]
        root[:, 1] = self.height
        return root

    def _place_arm(self, local: np.ndarray, side: str) -> None:
        offset = np.broadcast_to(self.hands.get(side, _HANGING), (self.frames, 3))
        shoulder = local[:, JOINT[f"{side}_shoulder"]]
        target = shoulder + offset * (_SIGN[side], 1, 1)
        elbow, wrist = _bent(shoulder, target, (0.26, 0.268), (0.3 * _SIGN[side], -0.8, -0.5))
        local[:, JOINT[f"{side}_elbow"]], local[:, JOINT[f"{side}_wrist"]] = elbow, wrist

    def _place_leg(self, local: np.ndarray, side: str) -> None:
        offset = np.broadcast_to(self.feet.get(side, (0.0, 0.0, 0.0)), (self.frames, 3))
        hip = np.broadcast_to(_REST[JOINT[f"{side}_hip"]], (self.frames, 3))
        target = hip * (1, 0, 1) + offset * (_SIGN[side], 1, 1)
        target[:, 1] += 0.06 + self.ground - np.broadcast_to(self.height, self.frames)
        pole = (0.0, -0.2, 1.0) if not self.stoop else (0.0, -1.0, self.stoop)
        knee, ankle = _bent(hip, target, (0.392, 0.428), pole)
        for name, points in (("hip", hip), ("knee", knee), ("ankle", ankle)):
            local[:, JOINT[f"{side}_{name}"]] = points
        local[:, JOINT[f"{side}_foot"]] = ankle + np.array((0, -0.06, 0.13))


def _turned(frames: int, axis: int, degrees: Curve) -> np.ndarray:
    vectors = np.zeros((frames, 3))
    vectors[:, axis] = np.radians(degrees)
    return matrix_from_axis_angle(vectors)


def _bent(
    start: np.ndarray,
    target: np.ndarray,
    lengths: tuple[float, float],
    pole: tuple[float, float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Returns middle and end of a limb of two bones that reaches as far as it can."""
    first, second = lengths
    away = target - start
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    along = away / np.maximum(distance, 1e-9)
    distance = np.clip(distance, abs(first - second) + 1e-6, first + second - 1e-6)
    aside = np.array(pole) - (along @ np.array(pole))[:, None] * along
    aside = aside / np.linalg.norm(aside, axis=1, keepdims=True)
    part = (first**2 - second**2 + distance**2) / (2 * distance)
    middle = start + part * along + np.sqrt(np.maximum(first**2 - part**2, 0)) * aside
    return middle, start + distance * along


def frames_of(seconds: float) -> int:
    return round(seconds * FPS)


def ramp(frames: int, start: float, end: float) -> np.ndarray:
    """Rises smoothly from 0 to 1 between two frames."""
    part = np.clip((np.arange(frames) - start) / max(end - start, 1e-9), 0, 1)
    return part * part * (3 - 2 * part)


def bump(frames: int, start: float, top: float, end: float) -> np.ndarray:
    """Rises smoothly to 1 and falls again."""
    return ramp(frames, start, top) - ramp(frames, top, end)


def between(one: Points, other: Points, part: np.ndarray) -> np.ndarray:
    """Goes from one point to another."""
    return np.array(one) + part[:, None] * (np.array(other) - np.array(one))


def swung(one: Points, other: Points, part: np.ndarray) -> np.ndarray:
    """Goes from one point to another on an arc about the origin, as a hand about its shoulder."""
    first, last = np.array(one), np.array(other)
    near, far = np.linalg.norm(first), np.linalg.norm(last)
    angle = np.arccos(first @ last / (near * far))
    weights = np.sin(np.stack([(1 - part) * angle, part * angle], axis=1)) / np.sin(angle)
    length = near + part[:, None] * (far - near)
    return length * (weights[:, :1] * first / near + weights[:, 1:] * last / far)


def repeated(count: int, seconds: float, once: Callable[[int], np.ndarray]) -> np.ndarray:
    """One curve several times, with half a second of rest before and after."""
    rest = np.zeros(FPS // 2)
    return np.concatenate([rest, *[once(frames_of(seconds)) for _ in range(count)], rest])


def in_sequence(*motions: np.ndarray, blend: int = 6) -> np.ndarray:
    """Motions one after the other, each where and as the last one ends."""
    joined = motions[0]
    for motion in motions[1:]:
        turn = _facing(joined[-1]) - _facing(motion[0])
        motion = motion @ _turned(1, 1, turn)[0].T
        motion = motion + (joined[-1, 0] - motion[0, 0]) * (1, 0, 1)
        part = np.linspace(0, 1, blend + 2)[1:-1, None, None]
        joined = np.concatenate([joined, joined[-1] + part * (motion[0] - joined[-1]), motion])
    return joined


def _facing(joints: np.ndarray) -> float:
    across = joints[JOINT["right_hip"]] - joints[JOINT["left_hip"]]
    return float(np.degrees(np.arctan2(across[2], -across[0])))


def stand(seconds: float = 2.0) -> np.ndarray:
    return Body(frames=frames_of(seconds)).joints()


def walk(
    seconds: float = 4.0, speed: float = 1.0, way: float = 0.0, turn: float = 0.0
) -> np.ndarray:
    """Walks `way` degrees to the left of ahead with planted feet, and turns left evenly."""
    frames = frames_of(seconds)
    time = np.arange(frames) / FPS
    heading = turn * time / max(time[-1], 1e-9)
    left, ahead = np.sin(np.radians(way)), np.cos(np.radians(way))
    cycles = max(0.8, 1.2 * speed)
    feet = {}
    for side, phase in ((LEFT, 0.0), (RIGHT, 0.5)):
        reach, lift = _step(time * cycles + phase, 0.6)
        reach = reach * 0.6 * speed / cycles
        feet[side] = np.stack([_SIGN[side] * left * reach, 0.1 * lift, ahead * reach], axis=1)
    return Body(
        frames=frames,
        ahead=speed * ahead,
        left=speed * left,
        heading=heading,
        height=0.85,
        feet=feet,
    ).joints()


def run(seconds: float = 4.0, speed: float = 3.0, turn: float = 0.0) -> np.ndarray:
    """Runs with flights between steps."""
    frames = frames_of(seconds)
    time = np.arange(frames) / FPS
    phase = 1.4 * time
    feet = {}
    for side, shift in ((LEFT, 0.0), (RIGHT, 0.5)):
        reach, lift = _step(phase + shift, 0.35)
        z = np.clip(reach * 0.35 * speed / 1.4, -0.3, 0.3)
        feet[side] = np.stack([0 * z, 0.35 * lift, z - 0.2 * lift], axis=1)
    return Body(
        frames=frames,
        ahead=speed,
        heading=turn * time / time[-1],
        height=0.85 - 0.05 * np.cos(4 * np.pi * (phase - 0.175)),
        feet=feet,
    ).joints()


def _step(cycle: np.ndarray, stance: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns how far ahead a foot is, -0.5 to 0.5 of a step, and how high, 0 to 1."""
    phase = cycle % 1.0
    swing = np.clip((phase - stance) / (1 - stance), 0, 1)
    reach = np.where(phase < stance, 0.5 - phase / stance, -0.5 + swing * swing * (3 - 2 * swing))
    return reach, np.sin(np.pi * swing)


def steps(count: int, length: float = 0.4) -> np.ndarray:
    """Walks a number of steps ahead, left foot first, between stands; the feet end together."""
    each, pause = 10, 14
    frames = 2 * pause + each * count
    marks = [0.0] + [length * (n + 1) for n in range(count - 1)]
    marks += [marks[-1]] if count > 1 else [length]
    ahead = np.zeros((frames, 2))
    lift = np.zeros((frames, 2))
    for number in range(count):
        start, foot = pause + number * each, number % 2
        target = marks[number + 1]
        ahead[:, foot] += (target - ahead[-1, foot]) * ramp(frames, start, start + each)
        lift[:, foot] += bump(frames, start, start + each / 2, start + each)
    middle = ahead.mean(axis=1)
    speed = np.concatenate([[0.0], np.diff(middle)]) * FPS
    feet = {
        side: np.stack([0 * middle, 0.1 * lift[:, n], ahead[:, n] - middle], axis=1)
        for n, side in enumerate(SIDES)
    }
    return Body(frames=frames, ahead=speed, height=0.86, feet=feet).joints()


def turn_in_place(degrees: float = 90.0, seconds: float = 2.0) -> np.ndarray:
    frames = frames_of(seconds + 1)
    return Body(frames=frames, heading=degrees * ramp(frames, 10, frames - 10)).joints()


def march(seconds: float = 4.0, cycles: float = 0.9) -> np.ndarray:
    """Lifts the feet in turn without going anywhere."""
    phase = np.arange(frames_of(seconds)) / FPS * cycles
    lift = {LEFT: _step(phase, 0.5)[1], RIGHT: _step(phase + 0.5, 0.5)[1]}
    feet = {side: np.stack([0 * up, 0.25 * up, 0.1 * up], axis=1) for side, up in lift.items()}
    return Body(frames=len(phase), feet=feet).joints()


def _rise(frames: int) -> np.ndarray:
    """A jump's height, 0 to 1: a parabola in the middle third, bent knees before it and after."""
    time = np.arange(frames) / frames
    flight = np.where(abs(time - 0.5) < 1 / 6, 1 - (6 * (time - 0.5)) ** 2, 0.0)
    return flight - 0.4 * (bump(frames, 0.1 * frames, 0.22 * frames, 0.34 * frames))


def jump(count: int = 1, rise: float = 0.3, speed: float = 0.0, left: float = 0.0) -> np.ndarray:
    """Jumps with both feet, at a speed while in the air."""
    up = repeated(count, 1.5, _rise)
    air = np.maximum(up, 0)
    feet: dict[str, Points] = {side: np.stack([0 * air, rise * air, 0 * air], 1) for side in SIDES}
    flying = (air > 0) * 1.0
    return Body(
        frames=len(up),
        height=STANDING + rise * up,
        ahead=speed * flying,
        left=left * flying,
        feet=feet,
    ).joints()


def hop(side: str = LEFT, count: int = 1, rise: float = 0.15) -> np.ndarray:
    """Hops on one foot; the other stays up."""
    up = repeated(count, 1.2, _rise)
    other = LEFT if side == RIGHT else RIGHT
    air = rise * np.maximum(up, 0)
    feet: dict[str, Points] = {
        side: np.stack([0 * air, air, 0 * air], axis=1),
        other: np.stack([0 * air, 0.3 + air, 0 * air - 0.25], axis=1),
    }
    return Body(frames=len(up), height=STANDING + rise * up, feet=feet).joints()


_KICKS = {"forward": (0.0, 0.6, 0.7), "side": (0.7, 0.6, 0.1)}


def kick(
    side: str = LEFT, count: int = 1, direction: str = "forward", seconds: float = 1.5
) -> np.ndarray:
    """Swings a stretched leg up and puts it back."""
    part = repeated(count, seconds, lambda n: bump(n, 0.25 * n, 0.5 * n, 0.75 * n))
    foot = between((0, 0, 0), _KICKS[direction], part)
    return Body(frames=len(part), feet={side: foot}).joints()


def knee_up(side: str = LEFT, count: int = 1, height: float = 0.45) -> np.ndarray:
    """Raises a bent knee, the foot below it."""
    part = repeated(count, 1.5, lambda n: bump(n, 0.15 * n, 0.5 * n, 0.85 * n))
    foot = between((0, 0, 0), (0, height, 0.3), part)
    return Body(frames=len(part), feet={side: foot}).joints()


def balance(side: str = LEFT, seconds: float = 3.0, height: float = 0.25) -> np.ndarray:
    """Stands on the foot of a side, the other one behind and up."""
    frames = frames_of(seconds)
    other = LEFT if side == RIGHT else RIGHT
    part = bump(frames, 5, 10, 15) + ramp(frames, 10, 15) - ramp(frames, frames - 10, frames - 5)
    return Body(frames=frames, feet={other: between((0, 0, 0), (0, height, -0.2), part)}).joints()


def hands(
    seconds: float = 3.0, away: Points = (0.05, 0.5, 0.05), sides: tuple[str, ...] = SIDES
) -> np.ndarray:
    """Hands go from where they hang to an offset from the shoulder, stay, and come back."""
    frames = frames_of(seconds)
    part = ramp(frames, 10, 20) - ramp(frames, frames - 20, frames - 10)
    hand = swung(_HANGING, away, part)
    return Body(frames=frames, hands=dict.fromkeys(sides, hand)).joints()


def raise_hand(side: str = LEFT, count: int = 1, away: Points = (0.05, 0.5, 0.05)) -> np.ndarray:
    """Raises a hand, or both with side `both`, and lowers it."""
    part = repeated(count, 2.0, lambda n: bump(n, 0.1 * n, 0.5 * n, 0.9 * n))
    hand = swung(_HANGING, away, part)
    sides = SIDES if side == "both" else (side,)
    return Body(frames=len(part), hands=dict.fromkeys(sides, hand)).joints()


def wave(side: str = LEFT, swings: int = 4, width: float = 0.3) -> np.ndarray:
    """Raises a hand and swings it sideways and back, twice per second."""
    frames = 20 + 10 * swings + 20
    up = ramp(frames, 5, 18) - ramp(frames, frames - 18, frames - 5)
    hand = swung(_HANGING, (0.2, 0.25, 0.1), up)
    hand[20:-20, 0] += width / 2 * np.sin(2 * np.pi * np.arange(frames - 40) / 10)
    sides = SIDES if side == "both" else (side,)
    return Body(frames=frames, hands=dict.fromkeys(sides, hand)).joints()


def punch(side: str = LEFT, count: int = 1, seconds: float = 1.0, reach: float = 0.5) -> np.ndarray:
    """Stretches one arm ahead from a guard of both fists."""
    guard = (-0.05, -0.05, 0.2)
    part = repeated(count, seconds, lambda n: bump(n, 0.3 * n, 0.5 * n, 0.8 * n))
    both: dict[str, Points] = dict.fromkeys(SIDES, guard)
    both[side] = between(guard, (-0.05, 0.0, reach), part)
    return Body(frames=len(part), hands=both).joints()


def clap(count: int = 3, width: float = 0.5, high: float = -0.1) -> np.ndarray:
    """Brings both hands together in front of the chest, once every half a second."""
    frames = 20 + 10 * count
    near = np.zeros(frames)
    for number in range(count):
        near += bump(frames, 10 + 10 * number, 15 + 10 * number, 20 + 10 * number)
    hand = between((width / 2 - 0.195, high, 0.3), (0.02 - 0.195, high, 0.3), near)
    return Body(frames=frames, hands=dict.fromkeys(SIDES, hand)).joints()


def arm_circle(side: str = LEFT, count: int = 2, direction: str = "forward") -> np.ndarray:
    """Turns a stretched arm about its shoulder, one round per second."""
    frames = FPS * count
    angle = -np.pi / 2 + 2 * np.pi * np.arange(frames + 1) / FPS
    angle = np.concatenate([np.full(10, angle[0]), angle, np.full(10, angle[-1])])
    ahead = np.cos(angle) * (-1 if direction == "forward" else 1)
    hand = 0.5 * np.stack([0.2 + 0 * angle, np.sin(angle), ahead], axis=1)
    sides = SIDES if side == "both" else (side,)
    return Body(frames=len(angle), hands=dict.fromkeys(sides, hand)).joints()


def squat(count: int = 1, depth: float = 0.4) -> np.ndarray:
    """Bends both knees and stands up again, the trunk nearly upright."""
    part = repeated(count, 2.0, lambda n: bump(n, 0.1 * n, 0.5 * n, 0.9 * n))
    return Body(frames=len(part), height=STANDING - depth * part, lean=25 * part).joints()


def bow(count: int = 1, degrees: float = 70.0) -> np.ndarray:
    """Leans the trunk forward and back up."""
    part = repeated(count, 2.0, lambda n: bump(n, 0.1 * n, 0.5 * n, 0.9 * n))
    return Body(frames=len(part), lean=degrees * part).joints()


def pick_up(side: str = LEFT) -> np.ndarray:
    """Bends down and reaches to the floor with one hand, or with both."""
    part = repeated(1, 2.5, lambda n: bump(n, 0.1 * n, 0.5 * n, 0.9 * n))
    sides = SIDES if side == "both" else (side,)
    hand = swung(_HANGING, (0.03, -0.5, 0.1), part)
    still = swung(_HANGING, (0.03, -0.1, 0.2), part)
    both: dict[str, Points] = {one: hand if one in sides else still for one in SIDES}
    return Body(frames=len(part), height=STANDING - 0.3 * part, lean=75 * part, hands=both).joints()


# By posture: height of the pelvis, lean, and where the feet are.
_LOW: dict[str, tuple[float, float, tuple[float, float, float]]] = {
    "sit": (0.5, 5.0, (0.0, 0.0, 0.42)),
    "floor": (0.15, 5.0, (0.0, 0.0, 0.7)),
    "lie": (0.12, -85.0, (0.0, 0.0, 0.8)),
    "kneel": (0.5, 0.0, (0.0, 0.02, -0.42)),
    "crouch": (0.5, 30.0, (0.0, 0.0, 0.0)),
    "bend": (0.85, 70.0, (0.0, 0.0, 0.05)),
}


def lowered(posture: str, seconds: float = 3.0) -> np.ndarray:
    """Goes from standing to a posture in a second, and holds it."""
    frames = frames_of(seconds + 1.5)
    part = ramp(frames, 10, 30)
    height, lean, away = _LOW[posture]
    feet: dict[str, Points] = dict.fromkeys(SIDES, between((0, 0, 0), away, part))
    return Body(
        frames=frames,
        height=STANDING + (height - STANDING) * part,
        lean=lean * part,
        feet=feet,
        stoop=0.3 if posture == "kneel" else 0.0,
    ).joints()


def held(posture: str, seconds: float = 3.0) -> np.ndarray:
    """Holds a posture all the time."""
    return lowered(posture, seconds)[-frames_of(seconds) :]


def climb(steps_up: int = 4, rise: float = 0.17, down: bool = False) -> np.ndarray:
    """Goes up or down a stair, one foot after the other."""
    each = 12
    frames = 20 + each * steps_up
    heights = np.zeros((frames, 2))
    lift = np.zeros((frames, 2))
    for number in range(steps_up):
        start, foot = 10 + each * number, number % 2
        target = rise * (number + 1) if number + 1 < steps_up else rise * number
        heights[:, foot] += (target - heights[-1, foot]) * ramp(frames, start, start + each)
        lift[:, foot] += bump(frames, start, start + each / 2, start + each)
    low = heights.min(axis=1)
    feet: dict[str, Points] = {
        side: np.stack([0 * low, heights[:, n] - low + 0.08 * lift[:, n], 0.1 * lift[:, n]], 1)
        for n, side in enumerate(SIDES)
    }
    speed = -0.4 if down else 0.4
    body = Body(frames=frames, ahead=speed, ground=low, height=0.85 + low, feet=feet).joints()
    return body[::-1] - body[-1, :1] * (1, 0, 1) if down else body


def jack(count: int = 2) -> np.ndarray:
    """Jumping jacks: feet apart and arms up, and back."""
    part = repeated(count, 1.0, lambda n: bump(n, 0, 0.5 * n, n))
    hand = 0.5 * np.stack([np.sin(np.pi * part), -np.cos(np.pi * part), 0.1 + 0 * part], axis=1)
    foot = np.stack([0.25 * part, 0 * part, 0 * part], axis=1)
    return Body(
        frames=len(part),
        height=STANDING - 0.04 * part,
        hands=dict.fromkeys(SIDES, hand),
        feet=dict.fromkeys(SIDES, foot),
    ).joints()


def crawl(seconds: float = 3.0, speed: float = 0.4) -> np.ndarray:
    """Goes on hands and knees."""
    return Body(
        frames=frames_of(seconds),
        ahead=speed,
        height=0.5,
        lean=80.0,
        hands=dict.fromkeys(SIDES, (0.05, -0.48, 0.0)),
        feet=dict.fromkeys(SIDES, (0.0, 0.02, -0.42)),
        stoop=0.3,
    ).joints()


def mirrored(joints: np.ndarray) -> np.ndarray:
    """The same motion seen in a mirror: left and right are exchanged."""
    return joints[:, list(HUMANML3D.mirror)] * (-1, 1, 1)


def elsewhere(joints: np.ndarray, degrees: float, x: float = 3.0, z: float = -7.0) -> np.ndarray:
    """The same motion turned about the vertical, at another place."""
    return joints @ _turned(1, 1, degrees)[0].T + (x, 0, z)


# Motions by what they do.
MOTIONS: dict[str, Callable[[], np.ndarray]] = {
    "stand": stand,
    "walk": walk,
    "walk slowly": lambda: walk(speed=0.5),
    "walk fast": lambda: walk(speed=1.8),
    "walk backward": lambda: walk(speed=0.8, way=180),
    "walk to the left": lambda: walk(speed=0.8, way=90),
    "walk to the right": lambda: walk(speed=0.8, way=-90),
    "walk a curve": lambda: walk(turn=90),
    "walk a circle": lambda: walk(8, 1.1, turn=-360),
    "jog": lambda: run(speed=2.1),
    "run": run,
    "turn left": turn_in_place,
    "turn around": lambda: turn_in_place(-180),
    "march": march,
    "three steps": lambda: steps(3),
    "jump": jump,
    "jump forward": lambda: jump(speed=1.0),
    "hop twice": lambda: hop(RIGHT, 2),
    "kick": kick,
    "kick to the side": lambda: kick(RIGHT, 2, "side"),
    "raise a knee": lambda: knee_up(RIGHT),
    "balance": balance,
    "raise a hand": raise_hand,
    "raise both hands": lambda: raise_hand("both"),
    "wave": lambda: wave(RIGHT),
    "punch": lambda: punch(LEFT, 2),
    "clap": clap,
    "circle an arm": lambda: arm_circle(RIGHT, 2, "backward"),
    "squat": lambda: squat(2),
    "bow": bow,
    "pick up": lambda: pick_up(RIGHT),
    "sit down": lambda: lowered("sit"),
    "lie down": lambda: lowered("lie"),
    "kneel down": lambda: lowered("kneel"),
    "crouch": lambda: lowered("crouch"),
    "climb": climb,
    "jack": jack,
    "crawl": crawl,
    "walk, then wave": lambda: in_sequence(walk(3), stand(1), wave()),
    "wave, then walk": lambda: in_sequence(wave(), stand(1), walk(3)),
    "walk and stop": lambda: in_sequence(walk(3), stand(2)),
    "walk, then sit down": lambda: in_sequence(walk(3), stand(1), lowered("sit")),
    "turn, then walk": lambda: in_sequence(turn_in_place(90), walk(3)),
}


@cache
def scene(name: str) -> Measured:
    """Measures one of `MOTIONS`."""
    return describe(MOTIONS[name]())
