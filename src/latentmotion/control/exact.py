"""Exact: joints are put where their goals are, in the joints themselves, as the last of all steps.

Clean-up moves goals by a centimeter at the pelvis and by up to four at the wrists. Here an offset
that is right at its goal goes to nothing before and after with continuous acceleration. The trunk
is moved and turned as a whole, feet stay where clean-up holds them, arms and legs bend for their
ends; a foot that has to be elsewhere while it stands is moved for the whole contact. A goal that
holds has an offset in each of its frames; before and after it the offset begins as fast as it ends,
so that a hand comes to rest at its place and leaves it without a jerk. Pasted pieces get the
position and the velocity of what they replace at both seams (Bollo 2018, inertialization).
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.floor import find_arms
from latentmotion.cleanup.leg_ik import Leg, find_legs
from latentmotion.cleanup.leg_ik import reach as bend
from latentmotion.cleanup.smoothing import quintic, rate_left, spread
from latentmotion.control.goals import Targets, hand_points, heading_gaps, with_hands
from latentmotion.kinematics.rotations import quaternion_from_axis_angle, quaternion_rotate
from latentmotion.kinematics.skeleton import Joints, Skeleton, joints_of_bones
from latentmotion.measure.signals import spans
from latentmotion.representation.canonical import turn

Offsets = Float[np.ndarray, "frames 3"]

BLEND = 0.5  # Seconds in which an offset comes and goes.

# Share of the time of an offset in which its rate decays: over all of it, a leg that swings at a
# seam swung on through the floor.
_RATE = 0.5

# Meters that a standing foot may be moved by an offset that comes and goes.
_STILL = 1e-4

# Rounds in which body and limbs share the distance that a limb is too short for.
_ROUNDS = 6

# Share of its length to which an arm or a leg is stretched for a goal.
_STRETCHED = 0.999


def hold_targets(joints: Joints, targets: Targets, fps: float, skeleton: Skeleton) -> Joints:
    """Returns the joints with those that have goals at them, in the frames of the goals.

    Args:
        joints: A motion that is near its goals, cleaned up.
        targets: The goals.
        fps: Frames per second.
        skeleton: Says what arms and legs are.
    """
    if not (len(targets.frames) or len(targets.turned)):
        return joints
    joints = joints.astype(np.float64)
    # The frames in which more than half of the joints have goals.
    frames, counts = np.unique(targets.frames, return_counts=True)
    poses = [int(f) for f, n in zip(frames, counts, strict=True) if n > len(skeleton) // 2]
    limbs = _Limbs(joints, targets, poses, fps, skeleton)
    # The joints turned about the pelvis toward the headings that are given.
    missing = heading_gaps(joints, targets, skeleton)
    offsets = {int(f): np.full(3, gap) for f, gap in zip(targets.turned, missing, strict=True)}
    angle, root = spread(offsets, len(joints), BLEND * fps)[:, :1], joints[:, :1]
    turned = root + turn(joints - root, angle)
    # How far the body is moved for its goals that are not at the end of a limb.
    body, gaps = dict[int, np.ndarray](), targets.gaps(turned, skeleton)
    for point in np.argsort(targets.joints, kind="stable").tolist():
        frame, joint = int(targets.frames[point]), int(targets.joints[point])
        if joint not in limbs.ends and (joint == 0 or frame not in poses):
            body.setdefault(frame, gaps[point])
    moved = turned
    for _ in range(_ROUNDS):
        curve = spread(body, len(joints), BLEND * fps)
        moved, short = limbs.follow(turned + curve[:, None])
        if all(np.linalg.norm(over) < 1e-5 for over in short.values()):
            break
        for frame, over in short.items():
            body[frame] = body.get(frame, np.zeros(3)) + over
    return limbs.posed(moved)


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
    filled, others = dict(offsets), list[tuple[int, int]]()
    step = max(1, int(blend))  # offsets that are farther apart go to zero in between
    for start, end in spans(standing):
        goals = sorted(frame for frame in offsets if start <= frame < end)
        if not goals:
            others.append((start, end))
            continue
        values = np.array([offsets[frame] for frame in goals])
        for frame in (*range(start, end, step), end - 1):
            held = [float(np.interp(frame, goals, axis)) for axis in values.T]
            filled.setdefault(frame, np.array(held))
    curve = spread(filled, len(standing), blend)
    height = curve[:, 1].copy()
    while others:
        size = np.linalg.norm(curve, axis=-1)
        start, end = max(others, key=lambda contact: size[slice(*contact)].max())
        nearest = start + int(size[start:end].argmax())
        if size[nearest] < _STILL:
            break
        others.remove((start, end))
        for frame in (*range(start, end, step), end - 1):
            filled[frame] = curve[nearest]
        curve = spread(filled, len(standing), blend)
    curve[:, 1] = height
    return curve


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
    # What is left of an offset and of its rate, from the first frame after a seam on.
    blend = min(blend, float(count))
    short = _RATE * blend + 1
    u, v = (
        np.clip((np.arange(count) + 1) / length, 0, 1)[:, None, None]
        for length in (blend + 1, short)
    )
    still, rate = 1 - quintic(u), short * rate_left(v)
    lengths = []
    for beside, backwards in ((before, False), (after, True)):
        if not len(beside):
            continue
        near = (beside if backwards else beside[::-1])[:3].astype(np.float64)
        around = near[:, 1:] - near[:, parents]
        lengths.append(np.linalg.norm(around[0], axis=-1, keepdims=True))
        flip = slice(None, None, -1) if backwards else slice(None)
        moved, turned = root[flip], bones[flip]
        # Both continue each other's way: the piece to the frames before it, as far as they go.
        offsets = near[:2, :1] - _continued(moved)[: len(near[:2])]
        ways, goals = unit(_continued(turned)[: len(near[:2])]), unit(around[:2])
        # The smallest rotations of these ways into those, as vectors.
        axes = np.cross(ways, goals)
        sines = np.linalg.norm(axes, axis=-1, keepdims=True)
        angles = np.arctan2(sines, (ways * goals).sum(axis=-1, keepdims=True))
        turns = axes / np.maximum(sines, 1e-9) * angles
        root = (moved + still * offsets[0] + rate * (offsets[0] - offsets[-1]))[flip]
        turn = still * turns[0] + rate * (turns[0] - turns[-1])
        bones = quaternion_rotate(quaternion_from_axis_angle(turn), turned)[flip]
    u = np.linspace(0, 1, count + 2)[1:-1, None, None]
    bones = bones * ((1 - u) * lengths[0] + u * lengths[-1])
    return joints_of_bones(root[:, 0], bones, skeleton)


def _continued(values: Float[np.ndarray, "frames n 3"]) -> Float[np.ndarray, "two n 3"]:
    """Returns what was one and two frames before the first, had it gone on as it does."""
    few = values[:3]
    if len(few) < 3:
        return np.stack([few[0], few[0]])
    step, bend = few[0] - few[1], few[0] - 2 * few[1] + few[2]
    return np.stack([few[0] + step + 0.5 * bend, few[0] + 2 * step + 1.5 * bend])


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
        self.hands = {len(skeleton) + n: hand for n, hand in enumerate(hand_points(skeleton))}
        self.ends |= set(self.hands)

    def follow(self, carried: Joints) -> tuple[Joints, dict[int, np.ndarray]]:
        """Returns the joints with limbs that meet their goals, and what they are too short for.

        Args:
            carried: The motion with its body moved.
        """
        moved, short = carried.copy(), {}
        # Legs first: an arm whose goal counts from a foot or from the other hand comes after it.
        across = carried[:, self.legs[0].hip] - carried[:, self.legs[-1].hip] if self.legs else 0
        for leg in self.legs:
            standing = self._standing(leg)
            stays = self.joints[:, leg.ankle] - carried[:, leg.ankle]
            # Feet do not turn with the body.
            foot, placed = [leg.ankle, *leg.below], carried.copy()
            placed[:, foot] = self.joints[:, foot]
            offset = self._offsets(placed, (leg.ankle, *leg.below), standing)
            if offset is not None:
                stays = stays + offset
            toes = carried[:, leg.pivots[-1]] - carried[:, leg.ankle]
            ahead = np.cross(across, carried[:, leg.hip] - carried[:, leg.ankle]) + 0.1 * toes
            chain = leg.hip, leg.knee, leg.ankle
            self._bend(moved, carried, chain, stays, ahead, short, leg.below)
        middle = carried[:, [arm[0] for arm in self.arms]].mean(axis=1) if self.arms else 0
        origins = self.targets.origins
        for _ in range(1 if origins is None else 2):
            for shoulder, elbow, wrist in self.arms:
                points = [n for n, hand in self.hands.items() if hand.wrist == wrist]
                for end in (wrist, *points):
                    others = {wrist, *points} - {end}
                    offset = self._offsets(moved, (end,), None, others)
                    if offset is None:
                        continue
                    out = moved[:, elbow] - (moved[:, shoulder] + moved[:, wrist]) / 2
                    out = out + 0.1 * (moved[:, shoulder] - middle)
                    self._bend(moved, moved, (shoulder, elbow, end), offset, out, short, ())
        return moved, short

    def posed(self, joints: Joints) -> Joints:
        """Returns the joints with whole poses met, every joint by an offset of its own.

        A foot that stands in a pose stands there for the whole contact.
        """
        if not self.poses:
            return joints
        moved, gaps = joints.copy(), self.targets.gaps(joints, self.skeleton)
        offsets: dict[int, dict[int, np.ndarray]] = {}
        for point, (frame, joint) in enumerate(
            zip(self.targets.frames.tolist(), self.targets.joints.tolist(), strict=True)
        ):
            # Goals of other frames are met already: their offsets are 0 and hold what is there.
            gap, hand = gaps[point] if frame in self.poses else np.zeros(3), self.hands.get(joint)
            for moving in (joint,) if hand is None else (hand.elbow, hand.wrist):
                offsets.setdefault(moving, {}).setdefault(frame, gap)
        offsets = {joint: each for joint, each in offsets.items() if set(each) & self.poses}
        blend = BLEND * self.fps
        for joint, each in offsets.items():
            moved[:, joint] += spread(each, len(joints), blend)
        for leg in self.legs:
            foot = [joint for joint in (leg.ankle, *leg.below) if joint in offsets]
            standing = self._standing(leg)
            held = {j: joints[:, j] + held_in_contacts(offsets[j], standing, blend) for j in foot}
            if leg.ankle not in held:
                continue
            hip, knee, ankle = moved[:, leg.hip], moved[:, leg.knee], moved[:, leg.ankle]
            away = np.linalg.norm(held[leg.ankle] - ankle, axis=-1) > 1e-9
            knees, ankles = bend(hip, knee, ankle, held[leg.ankle], knee - (hip + ankle) / 2)
            moved[away, leg.knee] = knees[away]
            short = ankles - held[leg.ankle]
            for joint in foot:
                moved[away, joint] = (held[joint] + short)[away]
        return moved

    def _standing(self, leg: Leg) -> Bool[np.ndarray, " frames"]:
        """Returns whether a foot stands, for each frame."""
        pivots = [self.order.index(pivot) for pivot in leg.pivots]
        return np.asarray(self.standing[:, pivots].any(axis=1))

    def _offsets(
        self,
        carried: Joints,
        ends: tuple[int, ...],
        standing: Bool[np.ndarray, " frames"] | None,
        others: Set[int] = frozenset(),
    ) -> Offsets | None:
        """Returns how far the end of a limb has to be moved, or None where it has no goals.

        Args:
            carried: The motion with its body moved.
            ends: The joints that count as the end.
            standing: Whether it stands; None for arms.
            others: Further points of the limb, whose goals of other frames it keeps.
        """
        targets, offsets = self.targets, dict[int, np.ndarray]()
        gaps, others_at = targets.gaps(carried, self.skeleton), set[int]()
        for point, (frame, joint) in enumerate(
            zip(targets.frames.tolist(), targets.joints.tolist(), strict=True)
        ):
            if frame in self.poses:
                continue
            if joint in ends and frame not in offsets:
                offsets[frame] = gaps[point]
            elif joint in others:
                others_at.add(frame)
        if not offsets:
            return None
        blend = BLEND * self.fps
        if standing is None:
            unmoved = {frame: np.zeros(3) for frame in others_at - set(offsets)}
            return spread(unmoved | offsets, len(carried), blend)
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
        top, middle = (carried[:, joint] for joint in chain[:2])
        end = with_hands(carried, self.skeleton)[:, chain[2]]
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
        hand = self.hands.get(chain[2])
        last = chain[2] if hand is None else hand.wrist
        if hand is not None:  # it is on the line of the forearm
            tip = tip - hand.beyond * unit(tip - knee)
        moved[touched, chain[1]], moved[touched, last] = knee[touched], tip[touched]
        rest = list(below)
        if rest:
            carry = (tip - self.joints[:, chain[2]])[touched, None]
            moved[np.ix_(touched, rest)] = self.joints[np.ix_(touched, rest)] + carry


def distances(joints: Joints, targets: Targets, skeleton: Skeleton) -> Float[np.ndarray, " points"]:
    """Returns how far each joint is from its goal, meters, in the coordinates that are given."""
    return np.linalg.norm(targets.gaps(joints, skeleton), axis=-1)
