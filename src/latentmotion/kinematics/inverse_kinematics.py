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

    pelvis, chest    the rigid rotation that fits all bones that leave them
    spine between    interpolated from the pelvis' rotation to the chest's, then swing only
    hip, shoulder    the hinge: knee and elbow bend about one axis, normal to the limb's plane;
                     for straight limbs see 1 and 2 above
    all others       swing only, from the parent

The rest pose is a T: arms along ±x, legs down and a little apart, feet flat and pointing ahead. Its
bones have the motion's median lengths, so that forward kinematics gives the same joints again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import cross, quantile, unit
from latentmotion.kinematics import rotations as rot
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, BatchedJoints, Joints, Skeleton

# μ and κ.
_PRIOR, _CONTINUITY = 0.1, 5.0

# Greatest number of times that λ_t is raised.
_ROUNDS = 8

# Share of a raised λ_t that the steps before and after get, so that the turn spreads to them.
_SHARE = 0.5

# Ratio to the pace above which a turn is slowed down.
_TOLERANCE = 1.1

# Steps of Newton's method, which doubles the digits of a root in each.
_NEWTON = 12


def hinge(
    axis: Float[np.ndarray, "frames *limbs 3"],
    normal: Float[np.ndarray, "frames *limbs 3"],
    prior: Float[np.ndarray, "frames *limbs 3"],
    stiffness: float,
    pace: Float[np.ndarray, " steps *limbs"],
) -> Float[np.ndarray, "frames *limbs 3"]:
    """Returns the hinges of limbs, unit vectors normal to their upper bones in every frame.

    Args:
        axis: Direction of the upper bone, in its parent's frame.
        normal: Normal of the plane of both bones, as long as the sine of the bend.
        prior: Expected hinge of a straight limb; its length is its weight.
        stiffness: λ, per frame.
        pace: Greatest turn about the bone from each frame to the next, radians.
    """
    shape = axis.shape
    axis, normal, prior = (x.reshape(len(x), -1, 3) for x in (axis, normal, prior))
    pace = pace.reshape(len(pace), len(axis[0]))
    first = _parallel_transport(axis)
    frame = np.stack([first, cross(axis, first)], axis=2)
    weight, trust = (normal**2).sum(-1), np.linalg.norm(prior, axis=-1)
    plane, prior = (unit((frame @ x[..., None])[..., 0]) for x in (normal, prior))
    signed = plane * (weight * _signs(plane, weight, prior))[..., None]
    every = np.full(pace.shape, stiffness)
    right = np.moveaxis(signed + prior * trust[..., None], -1, 0)
    x, y = _solve_chain(weight + trust, every, right)
    unlimited = angle = np.unwrap(np.arctan2(y, x), axis=0)
    resistance, ends = np.zeros_like(every), np.zeros((1, len(axis[0])))
    for _ in range(_ROUNDS):  # turns faster than the pace are spread over the frames around them
        excess = np.abs(np.diff(angle, axis=0)) / pace
        fast = (excess > _TOLERANCE).any(axis=0)
        if not fast.any():
            break
        raised = np.maximum(resistance, every) * np.minimum(excess, 4) ** 2
        resistance = np.where(excess > 1, raised, resistance)
        padded = np.concatenate([ends, resistance, ends])
        resistance = np.maximum(resistance, _SHARE * np.maximum(padded[2:], padded[:-2]))
        slower = _solve_chain(weight + trust, resistance, ((weight + trust) * unlimited)[None])[0]
        angle = np.where(fast, slower, angle)
    turn = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[..., None, :]
    return (turn @ frame).reshape(shape)


def _parallel_transport(
    axis: Float[np.ndarray, "frames limbs 3"],
) -> Float[np.ndarray, "frames limbs 3"]:
    """Returns normals of axes that do not turn about them: parallel transport."""
    normals = np.empty((*axis.shape, 1))
    normals[0, ..., 0] = unit(cross(axis[0], np.eye(3)[np.abs(axis[0]).argmin(-1)]))
    halves = axis[:-1] + axis[1:]
    squares = 0.5 * (halves**2).sum(-1)  # 1 + the cosine of the step
    scaled = np.where(squares > 1e-6, 1 / np.maximum(squares, 1e-6), 0)[..., None] * axis[1:]
    steps = np.eye(3) - halves[..., None] * scaled[..., None, :]
    for t, step in enumerate(steps):
        np.matmul(step, normals[t], out=normals[t + 1])
    return normals[..., 0]


def _signs(
    plane: Float[np.ndarray, "frames limbs 2"],
    weight: Float[np.ndarray, "frames limbs"],
    prior: Float[np.ndarray, "frames limbs 2"],
) -> Float[np.ndarray, "frames limbs"]:
    """Chooses for each frame: the limb bends naturally (1), or beyond straight (-1)."""
    natural = weight * (weight + _PRIOR * (plane * prior).sum(-1))
    pull = _CONTINUITY * np.minimum(weight[1:], weight[:-1]) * (plane[1:] * plane[:-1]).sum(-1)
    # By how much more the best path that ends naturally costs than the best that ends beyond.
    more, most, turn = -2 * natural, 2 * np.abs(pull), np.sign(pull)
    for t in range(len(pull)):
        more[t + 1] += turn[t] * np.minimum(np.maximum(more[t], -most[t]), most[t])
    beyond = more > 0
    # Which sign the frame before has, if this one bends naturally, and if it bends beyond.
    natural_after, beyond_after = more[:-1] > 2 * pull, more[:-1] > -2 * pull
    for t in reversed(range(len(pull))):
        beyond[t] = np.where(beyond[t + 1], beyond_after[t], natural_after[t])
    return np.where(beyond, -1.0, 1.0)


def _solve_chain(
    weight: Float[np.ndarray, "frames limbs"],
    stiffness: Float[np.ndarray, "steps limbs"],
    right: Float[np.ndarray, "columns frames limbs"],
) -> Float[np.ndarray, "columns frames limbs"]:
    """Solves the tridiagonal systems (diag(w) + Laplacian of λ) x = wanted by Thomas' algorithm."""
    diagonal, solution = weight.copy(), np.moveaxis(right, 1, 0).copy()
    diagonal[:-1] += stiffness
    diagonal[1:] += stiffness
    factors = np.empty_like(stiffness)
    for t, link in enumerate(stiffness):
        factor = np.divide(link, diagonal[t], out=factors[t])
        diagonal[t + 1] -= factor * link
        solution[t + 1] += factor * solution[t]
    solution /= diagonal[:, None]
    for t in reversed(range(len(factors))):
        solution[t] += factors[t] * solution[t + 1]
    return np.moveaxis(solution, 0, 1)


# Meters that the bones leaving pelvis or chest may move relative to each other before the animation
# translates those joints as well as rotating them.
RIGID_TOLERANCE = 0.002

# λ of the hinge at 20 fps: a limb bent by 18° already decides its hinge within a frame.
_STIFFNESS = 0.1

# Weights of rest pose and toes for the hinge, as sin² of the bend that weighs as much.
_SWING_PRIOR, _TOE_PRIOR = 0.01, 0.05

# Meters: children of a joint that are nearer to each other lie at one point.
_APART = 0.01

# Radians per second that a limb may twist while its two bones stand still.
_PACE = 2.0

# Outward slope of thigh and shank in rest pose, so that the skins of the legs part.
_STRADDLE = {"knee": np.radians(7), "ankle": np.radians(3)}


@dataclass(frozen=True)
class Limb:
    """Two bones with a hinge between them."""

    joints: tuple[str, str, str]  # The joints at its start, its bend and its end.
    hinge: tuple[int, int, int]  # Axis about which it bends in rest pose.
    # A joint beyond its end that shows the plane of a straight limb: the toes.
    tip: str | None = None


# The limbs of a person whose rest pose is a T.
LIMBS = (
    Limb(("left_shoulder", "left_elbow", "left_wrist"), (0, -1, 0)),
    Limb(("right_shoulder", "right_elbow", "right_wrist"), (0, 1, 0)),
    Limb(("left_hip", "left_knee", "left_ankle"), (1, 0, 0), "left_foot"),
    Limb(("right_hip", "right_knee", "right_ankle"), (1, 0, 0), "right_foot"),
)

_LIMB_OF = {limb.joints[0]: limb for limb in LIMBS}


def solve(joints: Joints, fps: float, skeleton: Skeleton = HUMANML3D) -> Animation:
    """Finds the rotations of a T-pose skeleton that reach the given joints.

    Args:
        joints: Global joint positions, meters, y up.
        fps: Frames per second.
        skeleton: Names and parents of the joints.

    Returns:
        The animation. Its skeleton has the median bone lengths of the motion. It has
        `translations` only where the bones that leave pelvis or chest are not rigid.
    """
    return solve_batch(joints[:, None], fps, skeleton)[0]


def solve_batch(joints: BatchedJoints, fps: float, skeleton: Skeleton) -> list[Animation]:
    """Finds the rotations of several motions, each as `solve` does; together takes less time."""
    return _Solver(np.asarray(joints, dtype=np.float64), fps, skeleton).animations()


class _Solver:
    """State of the solution: directions of the bones, rest poses, world rotations so far."""

    def __init__(self, joints: BatchedJoints, fps: float, skeleton: Skeleton) -> None:
        self.joints, self.fps, self.skeleton = joints, fps, skeleton
        self.children = [skeleton.children(joint) for joint in range(len(skeleton))]
        self.branches = [j for j, children in enumerate(self.children) if len(children) > 1]
        bones = joints - joints[..., [max(parent, 0) for parent in skeleton.parents], :]
        lengths = np.linalg.norm(bones, axis=-1)
        self.lengths = quantile(lengths, 0.5)
        rest = unit(np.array(skeleton.offsets, dtype=np.float64))
        for joint, name in enumerate(skeleton.names):  # the bone directions of a T-pose
            side = {"left": 1.0, "right": -1.0}.get(name.partition("_")[0], 0.0)
            if name.endswith(("shoulder", "elbow", "wrist")):
                rest[joint] = (side, 0, 0)
            elif name.endswith("collar"):
                rest[joint] = unit(np.array([side, 1.0, 0.0]))
            elif (lean := _STRADDLE.get(name.rpartition("_")[2])) is not None:
                rest[joint] = (side * np.sin(lean), -np.cos(lean), 0)
            elif name in ("head", "neck"):
                rest[joint] = (0, 1, 0)
        self.rest = np.repeat(rest[None], joints.shape[1], axis=0)
        # Joints at one point, as in rigs with helper bones, have no direction: the T-pose's is
        # taken.
        has_length = lengths[..., None] > 1e-6
        self.bones = np.where(has_length, bones / np.maximum(lengths, 1e-6)[..., None], rest)
        # Of each joint; the last is the root's parent.
        self.world = np.tile(np.eye(3), (len(skeleton) + 1, *joints.shape[:2], 1, 1))

    def animations(self) -> list[Animation]:
        for branch in self.branches:
            self.world[branch] = self._fit_branch(branch)
        self._fit_feet_and_head()
        for level in self._levels():
            self._turn(level)
        rotations = self.skeleton.local_rotations(np.moveaxis(self.world[:-1], 0, 2))
        # Joints around pelvis and chest move where rotations alone cannot reach them.
        offsets = self.rest * self.lengths[..., None]
        translations = np.repeat(offsets[None], len(self.joints), axis=0)
        for branch in self.branches:
            children = list(self.children[branch])
            bones = np.moveaxis(self._local_bones(children, [branch] * len(children)), 0, 2)
            translations[:, :, children] = bones * self.lengths[:, children, None]
        moves = np.linalg.norm(translations - offsets, axis=-1).max(axis=(0, 2)) > RIGID_TOLERANCE
        return [
            Animation(
                skeleton=replace(self.skeleton, offsets=offsets[motion]),
                rotations=np.ascontiguousarray(rotations[:, motion]),
                root_positions=self.joints[:, motion, 0],
                fps=self.fps,
                translations=np.ascontiguousarray(translations[:, motion]) if moved else None,
            )
            for motion, moved in enumerate(moves.tolist())
        ]

    def _fit_branch(self, joint: int) -> Float[np.ndarray, "frames motions 3 3"]:
        """Fits rotation and rest directions of the bones that leave a joint.

        Necks and collars of some skeletons lie at one point, and so say nothing of how the chest is
        turned about them; shoulders and hips do.
        """
        children = list(self.children[joint])
        # The hips say how the pelvis is turned; the spine bends above it and has less of a say.
        spine = [self.skeleton.names[child].startswith("spine") for child in children]
        weights = np.where(spine, 0.2, 1.0)[:, None]
        bones = np.ascontiguousarray(self.bones[:, :, children])
        places = self.joints[:, :, children]
        apart = np.linalg.norm(places - places[:, :, :1], axis=-1).max(axis=-1)
        alike, shown = quantile(apart, 0.5) < _APART, None
        ends = [self.children[child][0] for child in children if self.children[child]]
        sides = [j for j in ends if self.skeleton.names[j].partition("_")[0] in SIDES]
        if alike.any() and sides:
            hips = [j for j, name in enumerate(self.skeleton.names) if name.endswith("_hip")]
            up = self.joints[:, :, [joint]] - self.joints[:, :, hips].mean(axis=2, keepdims=True)
            across = self.joints[:, :, sides] - self.joints[:, :, sides].mean(axis=2, keepdims=True)
            axes = unit(np.concatenate([across, up], axis=2))
            shown = np.swapaxes(axes, -1, -2) @ np.array([*self.rest[0, sides], (0, 1, 0)])
        for _ in range(3):
            rest = weights * self.rest[:, children]
            products = np.swapaxes(bones, -1, -2) @ rest
            if shown is not None:
                products[:, alike] = shown[:, alike]
            rotation = nearest_rotation(products)
            self.rest[:, children] = unit((bones @ rotation).sum(axis=0))
        return rotation

    def _levels(self) -> list[list[int]]:
        """Returns the joints that are no branches, parents first; all limbs turn together."""
        parents, depths = self.skeleton.parents, {-1: -1}
        for joint, parent in enumerate(parents):
            depths[joint] = depths[parent] + 1
        limbs = {joint: limb for joint in depths if (limb := self._limb_from(joint))}
        latest = max((depths[joint] for joint in limbs), default=0)
        levels: dict[int, list[int]] = {}
        for joint, parent in enumerate(parents):
            depths[joint] = latest if joint in limbs else depths[parent] + 1
            if joint not in self.branches:
                levels.setdefault(depths[joint], []).append(joint)
        return [levels[depth] for depth in sorted(levels)]

    def _limb_from(self, joint: int) -> Limb | None:
        """Returns the limb whose upper bone leaves a joint, if there is one."""
        names = self.skeleton.names
        limb = _LIMB_OF.get(names[joint]) if joint >= 0 and self.children[joint] else None
        return limb if limb is not None and set(limb.joints) <= set(names) else None

    def _turn(self, joints: list[int]) -> None:
        """Turns limbs about their hinges, other bones by the shortest rotation."""
        parents = self.skeleton.parents
        limbs = {joint: limb for joint in joints if (limb := self._limb_from(joint))}
        if limbs:
            above = [parents[joint] for joint in limbs]
            self.world[list(limbs)] = self._turn_limbs([*limbs.values()], above)
        for joint in joints:
            if not self.children[joint]:
                self.world[joint] = self.world[parents[joint]]
        swinging = [joint for joint in joints if self.children[joint] and joint not in limbs]
        if not swinging:
            return
        before = self.world[[parents[joint] for joint in swinging]]  # what each swings from
        for number, joint in enumerate(swinging):
            end, steps = joint, 0
            while len(self.children[end]) == 1:
                end, steps = self.children[end][0], steps + 1
            if end in self.branches:  # between branches, a share of the rotation to the other
                a, b = (rot.quaternion_from_matrix(self.world[n]) for n in (parents[joint], end))
                before[number] = rot.matrix_from_quaternion(rot.slerp(a, b, 1 / (steps + 1)))
        children = [self.children[joint][0] for joint in swinging]
        rest = np.moveaxis(self.rest[:, children], 1, 0)[:, None, ..., None]
        bones = np.moveaxis(self.bones[:, :, children], 2, 0)
        self.world[swinging] = rot.matrix_between((before @ rest)[..., 0], bones) @ before

    def _fit_feet_and_head(self) -> None:
        """Sets the rest direction of feet to how they stand, and of the head to its usual tilt.

        Positions do not show where a foot points when its ankle is at rest, nor an upright head.
        The slope of a foot is the median over frames where it is low and still, at most 60 degrees;
        the tilt of the head is the median over all frames, at most 45 degrees.
        """
        feet = [f for f in (self.skeleton.left_foot, self.skeleton.right_foot) if len(f) == 2]
        slopes = np.zeros((len(feet), len(self.rest)))
        for foot, (ankle, toe) in enumerate(feet):
            # Angles below the horizontal where the foot is low and still.
            pair = self.joints[:, :, [ankle, toe]]
            speed = np.zeros(pair.shape[:2])
            if len(pair) > 1:
                speed = np.abs(np.gradient(pair, axis=0)).sum((2, 3))
            height = pair[:, :, 1, 1]
            # Near the foot's lowest height, but for its lowest 5 %, which may be errors; 3 cm is
            # the spread of a standing ankle.
            low = height < quantile(height, 0.05) + 0.03
            slope = np.arcsin(np.clip(-self.bones[:, :, toe, 1], -1, 1))
            for motion, near in enumerate(low.T):
                slow = speed[near, motion]
                still = slow <= quantile(slow, 0.5)
                slopes[foot, motion] = quantile(slope[near, motion][still], 0.5)
        slopes = slopes.clip(0, np.radians(60))
        for _, toe in feet:
            slope = slopes.mean(axis=0)
            self.rest[:, toe] = np.stack([0 * slope, -np.sin(slope), np.cos(slope)], axis=-1)
        if "head" in self.skeleton.names and self.branches:
            head = self.skeleton.names.index("head")
            carried = quantile(self._local_bones([head], [self.branches[-1]])[0], 0.5)
            lean = np.arctan2(carried[:, 2], carried[:, 1]).clip(-np.pi / 4, np.pi / 4)
            self.rest[:, head] = np.stack([0 * lean, np.cos(lean), np.sin(lean)], axis=-1)

    def _turn_limbs(
        self, limbs: Sequence[Limb], parents: Sequence[int]
    ) -> Float[np.ndarray, "limbs frames motions 3 3"]:
        """Turns upper bones so that the middle joints bend about their hinges."""
        names = self.skeleton.names
        middles, ends = ([names.index(limb.joints[n]) for limb in limbs] for n in (1, 2))
        tips = [
            names.index(limb.tip) if limb.tip in names else end
            for limb, end in zip(limbs, ends, strict=True)
        ]
        upper, lower, tip = (self._local_bones(ones, parents) for ones in (middles, ends, tips))
        rest = np.moveaxis(self.rest[:, middles], 1, 0)[:, None]
        bends = np.array([limb.hinge for limb in limbs], float)[:, None, None]
        rest_hinge = unit(cross(cross(rest, bends), rest))
        swing = rot.quaternion_rotate(rot.quaternion_between(rest, upper), rest_hinge)
        prior = _SWING_PRIOR * (1 + (upper * rest).sum(-1, keepdims=True)) * swing
        prior = prior + _TOE_PRIOR * cross(tip, lower)  # none without toes: tip and lower are one
        stiffness = _STIFFNESS * (self.fps / 20) ** 2
        # A limb may twist a little in a step, and as far as both its bones turn.
        swings = [np.linalg.norm(np.diff(bones, axis=1), axis=-1) for bones in (upper, lower)]
        pace = _PACE / self.fps + np.maximum(*swings)
        axis, normal, prior, pace = (
            np.moveaxis(x, 0, 1) for x in (upper, cross(upper, lower), prior, pace)
        )
        hinges = hinge(axis, normal, prior, stiffness, pace)
        turned = _frame(upper, np.moveaxis(hinges, 1, 0))
        return self.world[parents] @ turned @ np.swapaxes(_frame(rest, rest_hinge), -1, -2)

    def _local_bones(
        self, joints: Sequence[int], frames: Sequence[int]
    ) -> Float[np.ndarray, "joints frames motions 3"]:
        """Returns the directions of bones, each in the frame of another joint."""
        bones = np.moveaxis(self.bones[:, :, joints], 2, 0)
        return (bones[..., None, :] @ self.world[frames])[..., 0, :]


# Share of its greatest value below which the determinant of the closed form is too small.
_POOR = 0.05


def nearest_rotation(b: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Returns the rotations R of greatest tr(Rᵀ B) in closed form (Markley 1993, FOAM).

    λ, the value reached, is the largest root of (λ² − |B|²)² − 8 λ det B − 4 |cof B|². Where B is
    nearly of rank one, the singular value decomposition says as much as is known.
    """
    rows = [b[..., n, :] for n in range(3)]
    cofactors = np.stack([cross(rows[n - 2], rows[n - 1]) for n in range(3)], axis=-2)
    det = (cofactors[..., 0, :] * rows[0]).sum(-1)
    square, minors = ((x**2).sum((-2, -1)) for x in (b, cofactors))
    value = np.sqrt(3 * square)
    for _ in range(_NEWTON):  # from above
        rest = value**2 - square
        slope = np.maximum(4 * value * rest - 8 * det, 1e-300)
        value = value - (rest**2 - 8 * value * det - 4 * minors) / slope
    half = (value**2 - square) / 2
    divisor = half * value - det
    poor = ~(divisor > _POOR * square**1.5)
    whole, each, by = (x[..., None, None] for x in (half + square, value, divisor))
    product = b @ np.swapaxes(b, -1, -2) @ b
    rotations = (whole * b + each * cofactors - product) / np.where(poor[..., None, None], 1, by)
    if poor.any():
        u, _, vt = np.linalg.svd(b[poor])
        u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
        rotations[poor] = u @ vt
    return rotations


def _frame(
    axis: Float[np.ndarray, "*frames 3"], normal: Float[np.ndarray, "*frames 3"]
) -> Float[np.ndarray, "*frames 3 3"]:
    return np.stack([axis, normal, cross(axis, normal)], axis=-1)
