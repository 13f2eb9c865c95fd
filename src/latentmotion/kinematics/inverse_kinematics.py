"""Inverse kinematics: joint positions → local rotations; the hinges of elbows and knees.

Let m_t be the normal of the plane of both bones, w_t = sin²(bend) = |m_t|², p_t a weak prior from
rest pose and toes. Two steps, both exact:

1. Signs. Real mocap shows elbows up to 30° beyond straight, where m_t points the wrong way. The
   signs s_t = ±1 minimize, by dynamic programming (Viterbi 1967),

       − Σ s_t w_t (w_t + μ p_t·m_t)  −  κ Σ s_t s_{t−1} min(w_t, w_{t−1}) m_t·m_{t−1}

   (m and p as unit vectors): a joint bends in its natural direction, near the rest pose, and the
   plane does not flip from one frame to the next.

2. Directions. The hinge n_t minimizes

       Σ w_t |n_t − s_t m_t|² + |p_t| |n_t − p_t|² + λ Σ |n_t − n_{t−1}|²,

   in axes that follow the bone without rotating about it (parallel transport), so that λ resists
   twist alone.

3. Pace. Where n_t turns faster than the motion of the bones explains, the same chain is solved
   again for its angle φ_t, with λ_t raised until the turn is spread over enough frames:

       Σ (w_t + |p_t|) (φ_t − angle n_t)²  +  Σ λ_t (φ_t − φ_{t−1})²

   A limb that passes through straight then turns gradually, while its elbow bends a little off its
   hinge. The joints stay where they are.

A bone's direction fixes two of its three degrees of freedom. The third, the twist, comes from:

    pelvis, chest    the rigid rotation that fits all bones that leave them (Kabsch)
    spine between    interpolated from the pelvis' rotation to the chest's, then swing only
    hip, shoulder    the hinge: knee and elbow bend about one axis, normal to the limb's plane;
                     for straight limbs see `hinge.py`
    all others       swing only, from the parent

The rest pose is a T: arms along ±x, legs down and a little apart, feet flat and pointing ahead. Its
bones have the motion's median lengths, so that forward kinematics gives the same joints again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import cross, unit
from latentmotion.kinematics.rotations import (
    matrix_between,
    matrix_from_quaternion,
    quaternion_from_matrix,
    slerp,
)
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton

_PRIOR, _CONTINUITY = 0.1, 5.0
"""μ and κ."""

_ROUNDS = 8
"""Greatest number of times that λ_t is raised."""

_SHARE = 0.5
"""Share of a raised λ_t that the steps before and after get, so that the turn spreads to them."""

_TOLERANCE = 1.1
"""Ratio to the pace above which a turn is slowed down."""


def hinge(
    axis: Float[np.ndarray, "frames 3"],
    normal: Float[np.ndarray, "frames 3"],
    prior: Float[np.ndarray, "frames 3"],
    stiffness: float,
    pace: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, "frames 3"]:
    """Returns the hinge of a limb, a unit vector normal to its upper bone in every frame.

    Args:
        axis: Direction of the upper bone, in its parent's frame.
        normal: Normal of the plane of both bones, as long as the sine of the bend.
        prior: Expected hinge of a straight limb; its length is its weight.
        stiffness: λ, per frame.
        pace: Greatest turn about the bone from each frame to the next, radians.
    """
    first = _carried(axis)
    frame = np.stack([first, cross(axis, first)], axis=1)
    weight, trust = (normal**2).sum(-1), np.linalg.norm(prior, axis=-1)
    plane, prior = (unit(np.einsum("tij,tj->ti", frame, x)) for x in (normal, prior))
    signed = plane * (weight * _signs(plane, weight, prior))[:, None]
    every = np.full(len(pace), stiffness)
    direction = _solve_chain(weight + trust, every, signed + prior * trust[:, None])
    wanted = angle = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    resistance = np.zeros_like(every)
    for _ in range(_ROUNDS):  # turns faster than the pace are spread over the frames around them
        excess = np.abs(np.diff(angle)) / pace
        if not (excess > _TOLERANCE).any():
            break
        raised = np.maximum(resistance, every) * np.minimum(excess, 4) ** 2
        resistance = np.where(excess > 1, raised, resistance)
        before, after = np.append(resistance[1:], 0), np.append(0, resistance[:-1])
        resistance = np.maximum(resistance, _SHARE * np.maximum(before, after))
        right = ((weight + trust) * wanted)[:, None]
        angle = _solve_chain(weight + trust, resistance, right)[:, 0]
    return np.einsum("tij,ti->tj", frame, np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def _carried(axis: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
    """Returns a normal of an axis that does not turn about it: parallel transport."""
    start = unit(cross(axis[0], np.eye(3)[np.argmin(np.abs(axis[0]))]))
    x, y, z = start.tolist()
    halves = axis[:-1] + axis[1:]
    squares = 0.5 * (halves**2).sum(-1)  # 1 + the cosine of the step
    found = [(x, y, z)]
    steps = zip(axis[1:].tolist(), halves.tolist(), squares.tolist(), strict=True)
    for (a, b, c), (u, v, w), square in steps:
        along = (a * x + b * y + c * z) / square if square > 1e-6 else 0.0
        x, y, z = x - along * u, y - along * v, z - along * w
        found.append((x, y, z))
    return np.array(found)


def _signs(
    plane: Float[np.ndarray, "frames 2"],
    weight: Float[np.ndarray, " frames"],
    prior: Float[np.ndarray, "frames 2"],
) -> Float[np.ndarray, " frames"]:
    """Chooses for each frame: the limb bends naturally (1), or beyond straight (-1)."""
    natural = weight * (weight + _PRIOR * (plane * prior).sum(-1))
    pull = _CONTINUITY * np.minimum(weight[1:], weight[:-1]) * (plane[1:] * plane[:-1]).sum(-1)
    first = float(natural[0])
    bends, beyond, choices = -first, first, []  # least costs of paths to either sign
    for unary, pair in zip(natural[1:].tolist(), pull.tolist(), strict=True):
        stays, comes = (bends - pair, beyond + pair), (bends + pair, beyond - pair)
        choices.append((stays[1] < stays[0], comes[1] < comes[0]))
        bends, beyond = min(stays) - unary, min(comes) + unary
    path = [beyond < bends]
    for before in reversed(choices):
        path.append(before[path[-1]])
    return np.where(path[::-1], -1.0, 1.0)


def _solve_chain(
    weight: Float[np.ndarray, " frames"],
    stiffness: Float[np.ndarray, " steps"],
    wanted: Float[np.ndarray, "frames width"],
) -> Float[np.ndarray, "frames width"]:
    """Solves the tridiagonal system (diag(w) + Laplacian of λ) x = wanted, by Thomas' algorithm."""
    links = np.concatenate([[0.0], stiffness, [0.0]])
    diagonal = (weight + links[:-1] + links[1:]).tolist()
    factors = []
    for t, link in enumerate(stiffness.tolist(), start=1):
        factors.append(link / diagonal[t - 1])
        diagonal[t] -= factors[-1] * link
    columns = wanted.T.tolist()
    for column in columns:
        for t, factor in enumerate(factors, start=1):
            column[t] += factor * column[t - 1]
        column[:] = [value / pivot for value, pivot in zip(column, diagonal, strict=True)]
        for t in range(len(factors) - 1, -1, -1):
            column[t] += factors[t] * column[t + 1]
    return np.stack([np.array(column) for column in columns], axis=1)


RIGID_TOLERANCE = 0.002
"""Meters that the bones leaving pelvis or chest may move relative to each other before the
animation translates those joints as well as rotating them."""

_STIFFNESS = 0.1
"""λ of the hinge at 20 fps: a limb bent by 18° already decides its hinge within a frame."""

_SWING_PRIOR, _TOE_PRIOR = 0.01, 0.05
"""Weights of rest pose and toes for the hinge, as sin² of the bend that weighs as much."""

_PACE = 2.0
"""Radians per second that a limb may twist while its two bones stand still."""

_STRADDLE = {"knee": np.radians(7), "ankle": np.radians(3)}
"""Outward slope of thigh and shank in rest pose, so that the skins of the legs part."""


@dataclass(frozen=True)
class Limb:
    """Two bones with a hinge between them."""

    joints: tuple[str, str, str]
    """The joints at its start, its bend and its end."""
    hinge: tuple[int, int, int]
    """Axis about which it bends in rest pose."""
    tip: str | None = None
    """A joint beyond its end that shows the plane of a straight limb: the toes."""


LIMBS = (
    Limb(("left_shoulder", "left_elbow", "left_wrist"), (0, -1, 0)),
    Limb(("right_shoulder", "right_elbow", "right_wrist"), (0, 1, 0)),
    Limb(("left_hip", "left_knee", "left_ankle"), (1, 0, 0), "left_foot"),
    Limb(("right_hip", "right_knee", "right_ankle"), (1, 0, 0), "right_foot"),
)
"""The limbs of a person whose rest pose is a T."""

_LIMB_OF = {limb.joints[0]: limb for limb in LIMBS}


def solve(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, skeleton: Skeleton = HUMANML3D
) -> Animation:
    """Finds the rotations of a T-pose skeleton that reach the given joints.

    Args:
        joints: Global joint positions, meters, y up.
        fps: Frames per second.
        skeleton: Names and parents of the joints.

    Returns:
        The animation. Its skeleton has the median bone lengths of the motion. It has
        `translations` only where the bones that leave pelvis or chest are not rigid.
    """
    return _Solver(np.asarray(joints, dtype=np.float64), fps, skeleton).animation()


class _Solver:
    """State of the solution: directions of the bones, rest pose, world rotations so far."""

    def __init__(
        self, joints: Float[np.ndarray, "frames joints 3"], fps: float, skeleton: Skeleton
    ) -> None:
        self.joints, self.fps, self.skeleton = joints, fps, skeleton
        self.children = [skeleton.children(joint) for joint in range(len(skeleton))]
        self.branches = [j for j, children in enumerate(self.children) if len(children) > 1]
        bones = joints - joints[:, [max(parent, 0) for parent in skeleton.parents]]
        lengths = np.linalg.norm(bones, axis=-1)
        self.lengths = np.median(lengths, axis=0)
        self.rest = unit(np.array(skeleton.offsets, dtype=np.float64))
        for joint, name in enumerate(skeleton.names):  # the bone directions of a T-pose
            side = {"left": 1.0, "right": -1.0}.get(name.partition("_")[0], 0.0)
            if name.endswith(("shoulder", "elbow", "wrist")):
                self.rest[joint] = (side, 0, 0)
            elif name.endswith("collar"):
                self.rest[joint] = unit(np.array([side, 1.0, 0.0]))
            elif (lean := _STRADDLE.get(name.rpartition("_")[2])) is not None:
                self.rest[joint] = (side * np.sin(lean), -np.cos(lean), 0)
            elif name in ("head", "neck"):
                self.rest[joint] = (0, 1, 0)
        known = lengths[..., None] > 1e-6
        self.bones = np.where(known, bones / np.maximum(lengths, 1e-6)[..., None], self.rest)
        # Of each joint; the last is the root's parent.
        self.world = np.tile(np.eye(3), (len(skeleton) + 1, len(joints), 1, 1))

    def animation(self) -> Animation:
        for branch in self.branches:
            self.world[branch] = self._fit_branch(branch)
        self._fit_feet_and_head()
        for level in self._levels():
            self._turn(level)
        world = np.ascontiguousarray(np.moveaxis(self.world[:-1], 0, 1))
        # Joints around pelvis and chest move where rotations alone cannot reach them.
        offsets = self.rest * self.lengths[:, None]
        translations = np.repeat(offsets[None], len(self.joints), axis=0)
        for branch in self.branches:
            for child in self.children[branch]:
                bone = self._local_bone(child, branch)
                translations[:, child] = bone * self.lengths[child]
        moves = np.linalg.norm(translations - offsets, axis=-1).max() > RIGID_TOLERANCE
        return Animation(
            skeleton=replace(self.skeleton, offsets=offsets),
            rotations=self.skeleton.local_rotations(world),
            root_positions=self.joints[:, 0],
            fps=self.fps,
            translations=translations if moves else None,
        )

    def _fit_branch(self, joint: int) -> Float[np.ndarray, "frames 3 3"]:
        """Fits rotation (Kabsch 1976) and rest directions of the bones that leave a joint."""
        children = list(self.children[joint])
        # The hips say how the pelvis is turned; the spine bends above it and has less of a say.
        spine = [self.skeleton.names[child].startswith("spine") for child in children]
        weights = np.where(spine, 0.2, 1.0)
        bones = self.bones[:, children]
        for _ in range(3):
            rest = self.rest[children]
            u, _, vt = np.linalg.svd(np.einsum("c,tci,cj->tij", weights, bones, rest))
            u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
            rotation = u @ vt
            self.rest[children] = unit(np.einsum("tij,tci->cj", rotation, bones))
        return rotation

    def _levels(self) -> list[list[int]]:
        """Returns the joints that are no branches, those of one depth together, rising."""
        levels: dict[int, list[int]] = {}
        depths = {-1: -1}
        for joint, parent in enumerate(self.skeleton.parents):
            depths[joint] = depths[parent] + 1
            if joint not in self.branches:
                levels.setdefault(depths[joint], []).append(joint)
        return [levels[depth] for depth in sorted(levels)]

    def _turn(self, joints: list[int]) -> None:
        """Turns limbs about their hinges, other bones by the shortest rotation."""
        names, parents = self.skeleton.names, self.skeleton.parents
        swinging = []
        for joint in joints:
            limb = _LIMB_OF.get(names[joint])
            if not self.children[joint]:
                self.world[joint] = self.world[parents[joint]]
            elif limb is not None and set(limb.joints) <= set(names):
                self.world[joint] = self._turn_limb(limb, parents[joint])
            else:
                swinging.append(joint)
        if swinging:
            children = [self.children[joint][0] for joint in swinging]
            before = np.stack([self._reference(joint) for joint in swinging])
            rest = np.einsum("ctij,cj->cti", before, self.rest[children])
            bones = np.moveaxis(self.bones[:, children], 1, 0)
            self.world[swinging] = matrix_between(rest, bones) @ before

    def _reference(self, joint: int) -> Float[np.ndarray, "frames 3 3"]:
        """Returns the rotation from which a bone swings, most often its parent's."""
        parent = self.skeleton.parents[joint]
        end, steps = joint, 0
        while len(self.children[end]) == 1:
            end, steps = self.children[end][0], steps + 1
        if end not in self.branches:
            return self.world[parent]
        # Between branches, a share of the rotation from one to the other.
        ends = [quaternion_from_matrix(self.world[other]) for other in (parent, end)]
        return matrix_from_quaternion(slerp(ends[0], ends[1], 1 / (steps + 1)))

    def _fit_feet_and_head(self) -> None:
        """Takes as rest pose of the feet how they stand, and of the head how it is mostly held."""
        feet = [f for f in (self.skeleton.left_foot, self.skeleton.right_foot) if len(f) == 2]
        slopes = []
        for ankle, toe in feet:  # angle below the horizontal where the foot is low and still
            pair = self.joints[:, [ankle, toe]]
            speed = np.abs(np.gradient(pair, axis=0)).sum((1, 2)) if len(pair) > 1 else np.zeros(1)
            low = pair[:, 1, 1] < np.percentile(pair[:, 1, 1], 5) + 0.03
            still = speed <= np.percentile(speed[low], 50)
            slope = np.arcsin(np.clip(-self.bones[:, toe, 1], -1, 1))
            slopes.append(float(np.clip(np.median(slope[low & still]), 0, np.radians(60))))
        for _, toe in feet:
            slope = float(np.mean(slopes))
            self.rest[toe] = (0.0, -np.sin(slope), np.cos(slope))
        if "head" in self.skeleton.names and self.branches:
            head = self.skeleton.names.index("head")
            carried = np.median(self._local_bone(head, self.branches[-1]), axis=0)
            lean = np.clip(np.arctan2(carried[2], carried[1]), -np.pi / 4, np.pi / 4)
            self.rest[head] = (0.0, np.cos(lean), np.sin(lean))

    def _turn_limb(self, limb: Limb, parent: int) -> Float[np.ndarray, "frames 3 3"]:
        """Turns the upper bone so that the middle joint bends about its hinge."""
        names = self.skeleton.names
        _, middle, end = (names.index(name) for name in limb.joints)
        tip = self._local_bone(names.index(limb.tip), parent) if limb.tip in names else None
        upper, lower = self._local_bone(middle, parent), self._local_bone(end, parent)
        rest = self.rest[middle]
        rest_hinge = unit(cross(cross(rest, np.array(limb.hinge, float)), rest))
        swing = matrix_between(rest, upper) @ rest_hinge
        prior = _SWING_PRIOR * (1 + upper @ rest)[:, None] * swing
        if tip is not None:
            prior = prior + _TOE_PRIOR * cross(tip, lower)
        stiffness = _STIFFNESS * (self.fps / 20) ** 2
        # A limb may twist a little in a step, and as far as both its bones turn.
        swings = [np.linalg.norm(np.diff(bone, axis=0), axis=-1) for bone in (upper, lower)]
        pace = _PACE / self.fps + np.maximum(*swings)
        axis = hinge(upper, cross(upper, lower), prior, stiffness, pace)
        return self.world[parent] @ _frame(upper, axis) @ _frame(rest, rest_hinge).T

    def _local_bone(self, joint: int, frame: int) -> Float[np.ndarray, "frames 3"]:
        return np.einsum("tij,ti->tj", self.world[frame], self.bones[:, joint])


def _frame(
    axis: Float[np.ndarray, "*frames 3"], normal: Float[np.ndarray, "*frames 3"]
) -> Float[np.ndarray, "*frames 3 3"]:
    return np.stack([axis, normal, cross(axis, normal)], axis=-1)
