"""Exact: joints are put where their goals are, in the joints themselves, as the last of all steps.

Clean-up moves goals by a centimeter at the pelvis and by up to four at the wrists. Here an offset
that is right at its goal goes to nothing before and after with continuous acceleration. The trunk
is moved as a whole, feet stay where clean-up holds them, arms and legs bend for their ends; a foot
that has to be elsewhere while it stands is moved for the whole contact. Pasted pieces get the
position and the velocity of what they replace at both seams (Bollo 2018, inertialization).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.cleanup.contacts import contact_intervals, foot_contacts
from latentmotion.cleanup.floor import find_arms
from latentmotion.cleanup.leg_ik import find_legs
from latentmotion.cleanup.leg_ik import reach as bend
from latentmotion.control.goals import Targets
from latentmotion.kinematics.rotations import quaternion_from_axis_angle, quaternion_rotate
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Offsets = Float[np.ndarray, "frames 3"]

_BLEND = 0.5
"""Seconds in which an offset comes and goes."""

_STILL = 1e-4
"""Meters that a standing foot may be moved by an offset that comes and goes."""

_ROUNDS = 6
"""Rounds in which body and limbs share the distance that a limb is too short for."""

_STRETCHED = 0.999
"""Share of its length to which an arm or a leg is stretched for a goal."""


def hold_targets(joints: Joints, targets: Targets, fps: float, skeleton: Skeleton) -> Joints:
    """Returns the joints with those that have goals at them, in the frames of the goals.

    Args:
        joints: A motion that is near its goals, cleaned up.
        targets: The goals; headings are left as they are.
        fps: Frames per second.
        skeleton: Says what arms and legs are.
    """
    if not len(targets.frames):
        return joints
    joints = joints.astype(np.float64)
    poses = _pose_frames(targets, skeleton)
    limbs = _Limbs(joints, targets, poses, fps, skeleton)
    body = _trunk_offsets(joints, targets, limbs.ends, poses)
    moved = joints
    for _ in range(_ROUNDS):
        curve = spread(body, len(joints), _BLEND * fps)
        moved, short = limbs.follow(joints + curve[:, None])
        if all(np.linalg.norm(over) < 1e-5 for over in short.values()):
            break
        for frame, over in short.items():
            body[frame] = body.get(frame, np.zeros(3)) + over
    return _with_poses(moved, targets, poses, fps)


def spread(offsets: dict[int, np.ndarray], frames: int, blend: float) -> Offsets:
    """Returns a curve through offsets at some frames, with continuous acceleration.

    Between two that are near one goes over to the other, elsewhere to zero.

    Args:
        offsets: By frame.
        frames: Length of the curve.
        blend: Frames in which an offset comes and goes.
    """
    known = sorted(offsets)
    curve = np.zeros((frames, 3))
    if not known:
        return curve
    knots = [(known[0] - blend, np.zeros(3))]
    for frame, later in zip(known, [*known[1:], None], strict=True):
        knots.append((float(frame), np.asarray(offsets[frame], float)))
        if later is None:
            knots.append((frame + blend, np.zeros(3)))
        elif later - frame > 2 * blend:
            knots += [(frame + blend, np.zeros(3)), (later - blend, np.zeros(3))]
    time = np.arange(frames)
    for (start, a), (end, b) in pairwise(knots):
        inside = (time >= start) & (time <= end)
        u = quintic((time[inside] - start) / max(end - start, 1e-9))[:, None]
        curve[inside] = (1 - u) * a + u * b
    return curve


def held_in_contacts(
    offsets: dict[int, np.ndarray], standing: Bool[np.ndarray, " frames"], blend: float
) -> Offsets:
    """Returns a curve through offsets at some frames by which no foot slides while it stands.

    A contact with a goal is moved as a whole. One without that the curve reaches is moved along the
    floor as a whole, by what the curve has where it is nearest to a goal.

    Args:
        offsets: By frame.
        standing: Whether the foot stands, for each frame of the curve.
        blend: Frames in which an offset comes and goes while the foot swings.
    """
    known, others = dict(offsets), list[tuple[int, int]]()
    step = max(1, int(blend))  # offsets that are farther apart go to zero in between
    for start, end in contact_intervals(standing):
        goals = sorted(frame for frame in offsets if start <= frame < end)
        if not goals:
            others.append((start, end))
            continue
        values = np.array([offsets[frame] for frame in goals])
        for frame in (*range(start, end, step), end - 1):
            held = [float(np.interp(frame, goals, axis)) for axis in values.T]
            known.setdefault(frame, np.array(held))
    curve = spread(known, len(standing), blend)
    height = curve[:, 1].copy()
    while others:
        size = np.linalg.norm(curve, axis=-1)
        start, end = max(others, key=lambda contact: size[slice(*contact)].max())
        nearest = start + int(size[start:end].argmax())
        if size[nearest] < _STILL:
            break
        others.remove((start, end))
        for frame in (*range(start, end, step), end - 1):
            known[frame] = curve[nearest]
        curve = spread(known, len(standing), blend)
    curve[:, 1] = height
    return curve


def quintic(u: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Returns a step from 0 to 1 whose velocity and acceleration are 0 at both ends."""
    return u**3 * (10 - 15 * u + 6 * u**2)


def inertialized(
    piece: Joints,
    before: Float[np.ndarray, "earlier joints 3"],
    after: Float[np.ndarray, "later joints 3"],
    skeleton: Skeleton,
    blend: float,
) -> Joints:
    """Returns a piece of motion that leaves what is before and meets what is after.

    The root's offset in position and velocity, and every bone's in direction and its rate, decay
    along quintics from both seams; so bones keep the lengths of what is around.

    Args:
        piece: The frames between the seams.
        before: Three frames before them or more; two give no rate, none no seam.
        after: Frames after them, likewise.
        skeleton: Of the joints.
        blend: Frames in which an offset decays.
    """
    parents, count = list(skeleton.parents[1:]), len(piece)
    root = piece[:, :1].astype(np.float64)
    bones = unit(piece[:, 1:].astype(np.float64) - piece[:, parents])
    lengths = []
    for known, backwards in ((before, False), (after, True)):
        if not len(known):
            continue
        near = (known if backwards else known[::-1])[:3].astype(np.float64)
        around = near[:, 1:] - near[:, parents]
        lengths.append(np.linalg.norm(around[0], axis=-1, keepdims=True))
        flip = slice(None, None, -1) if backwards else slice(None)
        moved, turned = root[flip], bones[flip]
        # Both continue each other's way: the piece to the frames before it, as far as they go.
        offsets = near[:2, :1] - _continued(moved)[: len(near[:2])]
        turns = _rotation_between(unit(_continued(turned)[: len(near[:2])]), unit(around[:2]))
        still, rate = _decay(count, min(blend, float(count)))
        root = (moved + still * offsets[0] + rate * (offsets[0] - offsets[-1]))[flip]
        turn = still * turns[0] + rate * (turns[0] - turns[-1])
        bones = quaternion_rotate(quaternion_from_axis_angle(turn), turned)[flip]
    u = np.linspace(0, 1, count + 2)[1:-1, None, None]
    bones = bones * ((1 - u) * lengths[0] + u * lengths[-1])
    joints = [root[:, 0]]
    for joint, parent in enumerate(parents):
        joints.append(joints[parent] + bones[:, joint])
    return np.stack(joints, axis=1)


def _continued(values: Float[np.ndarray, "frames n 3"]) -> Float[np.ndarray, "two n 3"]:
    """Returns what was one and two frames before the first, had it gone on as it does."""
    few = values[:3]
    if len(few) < 3:
        return np.stack([few[0], few[0]])
    step, bend = few[0] - few[1], few[0] - 2 * few[1] + few[2]
    return np.stack([few[0] + step + 0.5 * bend, few[0] + 2 * step + 1.5 * bend])


def _decay(
    count: int, blend: float
) -> tuple[Float[np.ndarray, "frames 1 1"], Float[np.ndarray, "frames 1 1"]]:
    """Returns what is left of an offset and of its rate, from the first frame after a seam on."""
    u = np.clip((np.arange(count) + 1) / (blend + 1), 0, 1)[:, None, None]
    return 1 - quintic(u), (blend + 1) * u * (1 - u) ** 3 * (1 + 3 * u)


def _rotation_between(
    start: Float[np.ndarray, "*batch 3"], end: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Returns the rotation vectors of the smallest rotations of unit vectors into others."""
    cross = np.cross(start, end)
    sine = np.linalg.norm(cross, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (start * end).sum(axis=-1, keepdims=True))
    return cross / np.maximum(sine, 1e-9) * angle


def _pose_frames(targets: Targets, skeleton: Skeleton) -> list[int]:
    """Returns the frames in which more than half of the joints have goals."""
    frames, counts = np.unique(targets.frames, return_counts=True)
    return [int(f) for f, n in zip(frames, counts, strict=True) if n > len(skeleton) // 2]


def _trunk_offsets(
    joints: Joints, targets: Targets, ends: set[int], poses: Sequence[int]
) -> dict[int, np.ndarray]:
    """Returns how far the body is moved for its goals that are not at the end of a limb."""
    offsets: dict[int, np.ndarray] = {}
    order = np.argsort(targets.joints, kind="stable")
    for frame, joint, place in zip(
        targets.frames[order], targets.joints[order], targets.places[order], strict=True
    ):
        frame = int(frame)
        if frame in poses and joint != 0:
            continue
        if int(joint) not in ends and frame not in offsets:
            gap = place - joints[frame, joint]
            offsets[frame] = np.where(np.isfinite(gap), gap, 0.0)
    return offsets


class _Limbs:
    """Arms and legs, where their ends have to be, relative to a body that may be moved."""

    def __init__(
        self, joints: Joints, targets: Targets, poses: Sequence[int], fps: float, skeleton: Skeleton
    ) -> None:
        self.joints, self.targets, self.fps = joints, targets, fps
        self.poses, self.skeleton = set(poses), skeleton
        self.arms, self.legs = find_arms(skeleton), find_legs(skeleton)
        feet = [*skeleton.left_foot, *skeleton.right_foot]
        self.standing = foot_contacts(joints, fps, skeleton) if feet else np.zeros((len(joints), 0))
        self.order = feet
        pelvis = [int(f) for f, j in zip(targets.frames, targets.joints, strict=True) if j == 0]
        self.fixed_root = set(pelvis) | self.poses
        self.ends = {arm[2] for arm in self.arms} | {
            j for leg in self.legs for j in (leg.ankle, *leg.below)
        }

    def follow(self, carried: Joints) -> tuple[Joints, dict[int, np.ndarray]]:
        """Returns the joints with limbs that meet their goals, and what they are too short for.

        Args:
            carried: The motion with its body moved.
        """
        moved, short = carried.copy(), {}
        middle = carried[:, [arm[0] for arm in self.arms]].mean(axis=1) if self.arms else 0
        for shoulder, elbow, wrist in self.arms:
            offset = self._offsets(carried, (wrist,), None)
            if offset is None:
                continue
            out = carried[:, elbow] - (carried[:, shoulder] + carried[:, wrist]) / 2
            out = out + 0.1 * (carried[:, shoulder] - middle)
            self._bend(moved, carried, (shoulder, elbow, wrist), offset, out, short, ())
        across = carried[:, self.legs[0].hip] - carried[:, self.legs[-1].hip] if self.legs else 0
        for leg in self.legs:
            pivots = [self.order.index(pivot) for pivot in leg.pivots]
            standing = np.asarray(self.standing[:, pivots].any(axis=1))
            stays = self.joints[:, leg.ankle] - carried[:, leg.ankle]
            offset = self._offsets(carried + stays[:, None], (leg.ankle, *leg.below), standing)
            if offset is not None:
                stays = stays + offset
            foot = carried[:, leg.pivots[-1]] - carried[:, leg.ankle]
            ahead = np.cross(across, carried[:, leg.hip] - carried[:, leg.ankle]) + 0.1 * foot
            chain = leg.hip, leg.knee, leg.ankle
            self._bend(moved, carried, chain, stays, ahead, short, leg.below)
        return moved, short

    def _offsets(
        self, carried: Joints, ends: tuple[int, ...], standing: Bool[np.ndarray, " frames"] | None
    ) -> Offsets | None:
        """Returns how far the end of a limb has to be moved, or None where it has no goals."""
        targets, offsets = self.targets, {}
        for frame, joint, place in zip(
            targets.frames.tolist(), targets.joints.tolist(), targets.places, strict=True
        ):
            if joint in ends and frame not in self.poses and frame not in offsets:
                gap = place - carried[frame, joint]
                offsets[frame] = np.where(np.isfinite(gap), gap, 0.0)
        if not offsets:
            return None
        blend = _BLEND * self.fps
        if standing is None:
            return spread(offsets, len(carried), blend)
        return held_in_contacts(offsets, standing, blend)

    def _bend(
        self,
        moved: Joints,
        carried: Joints,
        chain: tuple[int, int, int],
        offset: Offsets,
        ahead: Offsets,
        short: dict[int, np.ndarray],
        below: tuple[int, ...],
    ) -> None:
        """Bends a limb in place; adds to `short` what it lacks in the frames of its goals."""
        top, middle, end = (carried[:, joint] for joint in chain)
        touched = np.linalg.norm(offset, axis=-1) > 1e-9
        goal = end + offset
        whole = np.linalg.norm(middle - top, axis=-1) + np.linalg.norm(end - middle, axis=-1)
        line, length = goal - top, np.linalg.norm(goal - top, axis=-1)
        most = np.maximum(_STRETCHED * whole, np.linalg.norm(end - top, axis=-1))
        over = np.maximum(length - most, 0)[:, None] * unit(line)
        joints = {chain[2], *below}
        for frame, joint in zip(
            self.targets.frames.tolist(), self.targets.joints.tolist(), strict=True
        ):
            if joint in joints and frame not in self.fixed_root and over[frame].any():
                short[frame] = over[frame]
        knee, tip = bend(top, middle, end, goal - over, ahead)
        moved[touched, chain[1]], moved[touched, chain[2]] = knee[touched], tip[touched]
        rest = list(below)
        if rest:
            carry = (tip - end)[touched, None]
            moved[np.ix_(touched, rest)] = carried[np.ix_(touched, rest)] + carry


def _with_poses(joints: Joints, targets: Targets, poses: Sequence[int], fps: float) -> Joints:
    """Returns the joints with whole poses met, every joint by an offset of its own."""
    moved = joints.copy()
    for joint in np.unique(targets.joints):
        own = targets.joints == joint
        offsets = {
            int(frame): np.where(np.isfinite(place), place - joints[frame, joint], 0.0)
            for frame, place in zip(targets.frames[own], targets.places[own], strict=True)
        }
        # Goals of other frames are met already: their offsets are 0 and hold what is there.
        if poses and set(offsets) & set(poses):
            moved[:, joint] += spread(offsets, len(joints), _BLEND * fps)
    return moved


def distances(joints: Joints, targets: Targets) -> Float[np.ndarray, " points"]:
    """Returns how far each joint is from its goal, meters, in the coordinates that are given."""
    gaps = targets.places - joints[targets.frames, targets.joints]
    return np.linalg.norm(np.nan_to_num(gaps), axis=-1)
