"""Mannequin: a smooth skin around the bones of any human skeleton, made by formula.

The body is the surface f(p) = 0 of tapered capsules, blended by a soft minimum

    f(p) = −k log Σᵢ exp(−dᵢ(p) / k),      wᵢ(p) = exp((f(p) − dᵢ(p)) / k),

and wᵢ, the share that each capsule has in the blend, is also the skinning weight of its joint.

A standard body is meshed once for each kind of skeleton: one vertex in each cell of a coarse grid
that the surface crosses, the mean of the crossings on the cell's 12 edges; one quad around each
crossed edge, through the four cells that share it; then all is pulled onto f = 0.

Any other body is the standard one stretched along its bones and pulled onto its own surface: a
vertex p at the shares tᵢ along the capsules goes to

    p' = s p + Σᵢ wᵢ ((1 − tᵢ) (aᵢ' − s aᵢ) + tᵢ (bᵢ' − s bᵢ)),

where aᵢ and bᵢ are the joints at both ends of capsule i, and s is the ratio of the bodies' sizes,
and from there along the gradient of the new f, by two steps of Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Animation, Skeleton
from latentmotion.motion import Motion


def surface_net(
    values: Float[np.ndarray, "x y z"],
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "quads 4"]]:
    """Finds the surface between negative values, inside, and positive ones.

    Args:
        values: Positive all around the edge of the grid.

    Returns:
        Vertices in steps of the grid, and the corners of the quads, counterclockwise from outside.
    """
    steps, inside = np.eye(3, dtype=int), values < 0
    corners = [
        inside[tuple(slice(c, n - 1 + c) for c, n in zip(corner, values.shape, strict=True))]
        for corner in product((0, 1), repeat=3)
    ]
    crossed = np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)
    cells = np.argwhere(crossed)
    total, count = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for axis, (u, v) in product(range(3), product((0, 1), repeat=2)):  # the 12 edges of each cell
        first = np.insert((u, v), axis, 0)
        a, b = (values[tuple((cells + end).T)] for end in (first, first + steps[axis]))
        cut = (a < 0) != (b < 0)
        total += cut[:, None] * first
        total[:, axis] += np.where(cut, a / np.where(cut, a - b, 1), 0)
        count += cut
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(len(cells))
    quads = []
    for axis in range(3):  # the four cells around each crossed edge of the grid
        ahead = np.roll(inside, -1, axis)
        ahead[tuple(slice(-1, None) if a == axis else slice(None) for a in range(3))] = False
        edges = np.argwhere(inside != ahead)
        outward = inside[tuple(edges.T)]
        second, third = steps[[(axis + 1) % 3, (axis + 2) % 3]]
        around = [edges - second - third, edges - third, edges, edges - second]
        ring = np.stack([number[tuple(cell.T)] for cell in around], axis=-1)
        quads.append(np.where(outward[:, None], ring, ring[:, ::-1]))
    return cells + total / count[:, None], np.concatenate(quads)


_BLEND = 0.013
"""k, meters: how widely neighboring capsules flow into one another."""

_REFERENCE_HEIGHT = 1.4
"""Distance of the neck from the ankles, meters, for which the radii below are."""

_SOFTNESS = 1.5
"""Factor by which skinning weights blend wider than the skin, so that bent joints stay round."""

_INFLUENCES = 4

_REACH = 10
"""Distance from a capsule, in k, beyond which it has no share."""

_LEAST_SHARE = 1e-3
"""Share of a capsule in the standard body's skin below which it is left out of others' skin."""

_MOST_DIFFERENCE = 0.08
"""Meters that a bone may end elsewhere than a standard one; other bodies are meshed anew."""

_LONGEST_STEP = 0.02
"""Meters that Newton's method moves a vertex at most."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """A part of the body between two points, relative to joints in rest pose, meters."""

    joint: str
    """The joint that it moves with."""
    start: tuple[float, float, float]
    """Where it starts, relative to the joint; x points to the body's outside."""
    end: tuple[float, float, float]
    """Where it ends, relative to `toward`."""
    radii: tuple[float, float]
    """Radius at the start and at the end."""
    toward: str = ""
    """The joint it leads to; the same joint if empty."""
    squash: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Scale of its thickness along each axis."""


_FLAT = (1.0, 0.62, 1.0)
_DEEP = (1.0, 1.0, 0.84)

_WIDE = (1.34, 1.0, 0.86)

_MIDDLE = (
    Capsule("pelvis", (-0.058, -0.03, 0), (0.058, -0.03, 0), (0.104, 0.104), squash=_DEEP),
    Capsule("pelvis", (0, 0, 0), (0, 0, 0.002), (0.100, 0.092), "spine1", _WIDE),
    Capsule("spine1", (0, 0, 0.002), (0, 0, 0.006), (0.092, 0.097), "spine2", _WIDE),
    Capsule("spine2", (0, 0, 0.006), (0, 0, 0.01), (0.097, 0.104), "spine3", _WIDE),
    Capsule("spine3", (-0.075, 0.05, 0.01), (0.075, 0.05, 0.01), (0.106, 0.106), squash=_DEEP),
    Capsule("spine3", (0, 0.1, -0.01), (0, -0.03, -0.01), (0.085, 0.060), "neck", (1.2, 1, 0.9)),
    Capsule("neck", (0, -0.03, -0.006), (0, 0.01, 0), (0.058, 0.052), "head"),
    Capsule("head", (0, 0.012, 0.03), (0, 0.09, 0.014), (0.068, 0.098), squash=(0.9, 1.06, 1.05)),
)
_SIDE = (
    Capsule("collar", (0.0, -0.02, 0), (-0.015, -0.005, 0), (0.070, 0.068), "shoulder"),
    Capsule("shoulder", (0, 0, 0), (0, 0, 0), (0.062, 0.044), "elbow"),
    Capsule("elbow", (0, 0, 0), (0, 0, 0), (0.045, 0.031), "wrist"),
    Capsule("wrist", (0.03, 0, 0), (0.085, -0.004, 0), (0.043, 0.041), squash=_FLAT),
    Capsule("wrist", (0.10, -0.005, 0.002), (0.155, -0.015, 0.002), (0.037, 0.027), squash=_FLAT),
    Capsule("wrist", (0.03, -0.005, 0.025), (0.085, -0.012, 0.058), (0.021, 0.016)),
    Capsule("hip", (0.022, -0.02, 0), (0, 0.02, 0), (0.086, 0.059), "knee"),
    Capsule("knee", (0, 0, 0.004), (0, 0, 0), (0.058, 0.038), "ankle"),
    Capsule("knee", (0, -0.07, -0.014), (0, -0.18, -0.012), (0.050, 0.046)),
    Capsule("ankle", (0, 0, -0.022), (0, 0.012, 0), (0.042, 0.038), "foot"),
    Capsule("foot", (0, 0.012, -0.01), (0.004, 0.008, 0.065), (0.040, 0.031)),
)


@dataclass(frozen=True, eq=False)
class Mannequin:
    """A skinned mesh in the rest pose of a skeleton."""

    vertices: Float[np.ndarray, "vertices 3"]
    """Positions in rest pose, meters, the root at the origin."""
    normals: Float[np.ndarray, "vertices 3"]
    """Outward unit normals."""
    quads: Int[np.ndarray, "quads 4"]
    """Corners of each face, counterclockwise from outside."""
    joints: Int[np.ndarray, "vertices 4"]
    """The joints that move each vertex."""
    weights: Float[np.ndarray, "vertices 4"]
    """Skinning weight of each; the sum is 1."""
    skeleton: Skeleton
    """The skeleton whose rest pose it has."""

    def moves(
        self, animation: Animation
    ) -> tuple[Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames joints 3"]]:
        """Returns how each joint turns and then shifts what it carries, in the world."""
        world = animation.skeleton.world_rotations(animation.rotations)
        rest = self.skeleton.rest_joints()
        return world, animation.joints() - np.einsum("tjab,jb->tja", world, rest)

    def pose(
        self, animation: Animation
    ) -> tuple[Float[np.ndarray, "frames vertices 3"], Float[np.ndarray, "frames vertices 3"]]:
        """Returns vertices and normals in every frame, by linear blend skinning."""
        world, shift = self.moves(animation)
        turn = np.einsum("vk,tvkab->tvab", self.weights, world[:, self.joints])
        moved = np.einsum("vk,tvka->tva", self.weights, shift[:, self.joints])
        return (
            np.einsum("tvab,vb->tva", turn, self.vertices) + moved,
            np.einsum("tvab,vb->tva", turn, self.normals),
        )


Figure = Callable[[Motion, float], tuple[Mannequin, Animation]]
"""Skin for a motion and how it moves, from the motion and the size of the skin's faces, meters."""


def mannequin_of(motion: Motion, cell: float) -> tuple[Mannequin, Animation]:
    """Returns the mannequin in a motion: the `Figure` that files have."""
    animation = motion.animation()
    return make_mannequin(animation.skeleton, cell), animation


def sticks_of(motion: Motion, cell: float) -> tuple[Mannequin, Animation]:
    """Returns a stick for each bone, in a motion."""
    animation = motion.animation()
    skeleton = animation.skeleton
    names = tuple(f"stick {name}" for name in skeleton.names)  # no part of the mannequin's
    return make_mannequin(replace(skeleton, names=names), cell), animation


def make_mannequin(skeleton: Skeleton, cell: float = 0.022) -> Mannequin:
    """Makes a body for a skeleton whose rest pose is a T.

    Args:
        skeleton: With the joint names of HumanML3D or KIT; capsules of missing joints are left out,
            and a skeleton with other names gets a stick for each bone.
        cell: Size of the grid's cells, meters on a body of 1.7 m: about the length of a face.
    """
    standard = _standard(skeleton)
    rest = tuple(map(tuple, standard.offsets.tolist()))
    mesh = _mesh(standard.name, standard.names, standard.parents, rest, cell)
    body, built = _Body(skeleton), mesh.body
    ratio = np.float32(body.scale / built.scale)
    points = ratio * mesh.points + (body.rest - ratio * built.rest) @ mesh.anchors
    points, _ = body.settled(points, mesh.near)
    points, slope = body.settled(points, mesh.near)
    normals = slope / np.sqrt((slope**2).sum(0))
    return Mannequin(points.T, normals.T, mesh.quads, mesh.joints, mesh.weights, skeleton)


def _standard(skeleton: Skeleton) -> Skeleton:
    """Returns the skeleton whose body is stretched to fit another; that itself if none is alike."""
    found, least = skeleton, _MOST_DIFFERENCE
    offsets = skeleton.offsets / _scale(skeleton)
    for standard in _STANDARDS:
        if (standard.names, standard.parents) == (skeleton.names, skeleton.parents):
            apart = np.linalg.norm(standard.offsets / _scale(standard) - offsets, axis=-1).max()
            found, least = (standard, apart) if apart < least else (found, least)
    return found


def _t_pose(**ends: tuple[float, float, float]) -> Skeleton:
    """Returns a body with arms to the sides, with the ends of some bones on the left."""
    bones = _BONES | ends
    offsets = []
    for name in HUMANML3D.names:
        side, _, joint = name.rpartition("_")
        x, y, z = bones[joint]
        offsets.append((-x if side == "right" else x, y, z))
    return replace(HUMANML3D, offsets=np.array(offsets))


def _kit_t_pose() -> Skeleton:
    """Returns KIT's body with arms to the sides."""
    offsets = KIT.offsets.copy()
    for joint, name in enumerate(KIT.names):
        if name.endswith(("elbow", "wrist")):
            side = 1 if name.startswith("left") else -1
            offsets[joint] = side * np.linalg.norm(offsets[joint]), 0, 0
    return replace(KIT, offsets=offsets)


_BONES = {
    **{"pelvis": (0.0, 0.0, 0.0), "spine1": (0, 0.128, 0), "spine2": (0, 0.14, 0)},
    **{"spine3": (0, 0.056, 0), "neck": (0, 0.213, 0), "head": (0, 0.098, 0.003)},
    **{"knee": (0.046, -0.378, 0), "ankle": (0.022, -0.418, 0), "shoulder": (0.122, 0, 0)},
    **{"elbow": (0.254, 0, 0), "wrist": (0.259, 0, 0)},
}
"""Ends of bones in the rest poses of generated motions, meters from their starts."""

_STANDARDS = (
    # The data that models learn from have shoulders of two kinds.
    _t_pose(hip=(0.070, -0.066, 0.029), foot=(0, -0.055, 0.130), collar=(0.078, 0.109, 0)),
    _t_pose(hip=(0.073, -0.070, 0.008), foot=(0, -0.073, 0.118), collar=(0.130, 0.016, 0)),
    BODY,
    _kit_t_pose(),
)
"""Skeletons whose bodies are meshed, each when it is first needed."""


def _scale(skeleton: Skeleton) -> float:
    """Returns the length of leg and trunk in rest pose, relative to `_REFERENCE_HEIGHT`."""
    if not {"neck", "left_ankle"} <= set(skeleton.names):
        return 1.0
    height, index = skeleton.rest_joints()[:, 1], skeleton.names.index
    return max(0.1, float(height[index("neck")] - height[index("left_ankle")]) / _REFERENCE_HEIGHT)


@dataclass(frozen=True, eq=False)
class _Near:
    """Pairs of points and capsules that have a share in the skin there, in the points' order."""

    points: Int[np.ndarray, " pairs"]
    capsules: Int[np.ndarray, " pairs"]

    @cached_property
    def first(self) -> Int[np.ndarray, " points"]:
        """The first pair of each point."""
        return np.flatnonzero(np.diff(self.points, prepend=-1))


@dataclass(frozen=True, eq=False)
class _Mesh:
    """The body of one skeleton, to be stretched to fit others; not to be written to."""

    body: _Body
    points: Float[np.ndarray, "3 vertices"]
    quads: Int[np.ndarray, "quads 4"]
    joints: Int[np.ndarray, "vertices 4"]
    weights: Float[np.ndarray, "vertices 4"]
    anchors: Float[np.ndarray, "joints vertices"]
    """Weights of vertices by joint when bones change."""
    near: _Near


@lru_cache(maxsize=16)
def _mesh(
    name: str,
    names: tuple[str, ...],
    parents: tuple[int, ...],
    offsets: tuple[tuple[float, ...], ...],
    cell: float,
) -> _Mesh:
    """Returns the body of a skeleton."""
    body = _Body(Skeleton(name, names, parents, np.array(offsets)))
    low, values = body.sample(cell * body.scale)
    corners, quads = surface_net(values)
    points = np.ascontiguousarray(low[:, None] + cell * body.scale * corners.T, np.float32)
    near = body.near(points)
    for _ in range(2):
        points, _ = body.settled(points, near)
    _, _, share = body.evaluate(points, near)
    joints, weights = body.influences(points, near, share)
    anchors = body.anchors(points, near, share)
    kept = share > _LEAST_SHARE
    for array in (points, quads, joints, weights, anchors):
        array.setflags(write=False)
    near = _Near(near.points[kept], near.capsules[kept])
    return _Mesh(body, points, quads, joints, weights, anchors, near)


_Template = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@lru_cache(maxsize=16)
def _template(names: tuple[str, ...], parents: tuple[int, ...]) -> _Template:
    """Returns a body's capsules: the joints of both ends, the ends from there, radii, squash."""
    body = [_named(capsule, "", 1) for capsule in _MIDDLE]
    for side, sign in (("left_", 1), ("right_", -1)):
        body += [_named(capsule, side, sign) for capsule in _SIDE]
    found = [capsule for capsule in body if {capsule.joint, capsule.toward} <= {*names}]
    if not found:  # joints of other names: a stick for each bone
        bones = [(names[p], name) for name, p in zip(names, parents, strict=True)]
        found = [Capsule(a, (0, 0, 0), (0, 0, 0), (0.035, 0.025), b) for a, b in bones[1:] or bones]
    owner = np.array([names.index(capsule.joint) for capsule in found])
    toward = np.array([names.index(capsule.toward) for capsule in found])
    start, end, radii, squash = (
        np.array([getattr(capsule, part) for capsule in found], np.float32).T.copy()
        for part in ("start", "end", "radii", "squash")
    )
    return owner, toward, start, end, radii, squash


class _Body:
    """The capsules of one skeleton as arrays, and the function whose zero is their skin."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.names, self.scale = skeleton.names, _scale(skeleton)
        self.rest = skeleton.rest_joints().T.astype(np.float32)
        template = _template(skeleton.names, skeleton.parents)
        self.owner, self.toward, start, end, radii, self.squash = template
        scale = np.float32(self.scale)
        self.start = self.rest[:, self.owner] + scale * start
        self.end = self.rest[:, self.toward] + scale * end
        self.radii = scale * radii
        self.blend = scale * np.float32(_BLEND)
        self.sole = self.rest[1].min()
        axis = (self.end - self.start) / self.squash
        along = axis / np.maximum((axis**2).sum(0), np.float32(1e-9))
        widening = self.radii[1] - self.radii[0]
        self.table = np.concatenate(
            [
                self.start,
                1 / self.squash,
                axis,
                along,
                along * widening,
                self.radii[:1],
                widening[None],
            ]
        )

    def distances(
        self, points: Float[np.ndarray, "3 pairs"], capsules: Int[np.ndarray, " pairs"]
    ) -> tuple[
        Float[np.ndarray, " pairs"], Float[np.ndarray, "3 pairs"], Float[np.ndarray, " pairs"]
    ]:
        """Returns distances from the surfaces of capsules, negative inside, of one capsule a point.

        Returns:
            The distances, their slopes, and the shares of the capsules' lengths, 0 to 1, where the
            points are.
        """
        table = self.table.take(capsules, axis=1)
        start, thinner, axis, along, taper = table[:15].reshape(5, 3, -1)
        radius, widening = table[15:]
        away = (points - start) * thinner
        place = (away * along).sum(0)
        between = (place > 0) & (place < 1)
        place = place.clip(0, 1)
        away -= place * axis
        length = np.sqrt((away**2).sum(0))
        slope = (away / np.maximum(length, np.float32(1e-9)) - between * taper) * thinner
        return length - radius - place * widening, slope, place

    def evaluate(
        self, points: Float[np.ndarray, "3 points"], near: _Near
    ) -> tuple[
        Float[np.ndarray, " points"],
        Float[np.ndarray, "3 points"],
        Float[np.ndarray, " pairs"],
    ]:
        """Returns f, its gradient, and the share of each pair in the blend."""
        distance, slopes, _ = self.distances(points.take(near.points, axis=1), near.capsules)
        share = np.exp(distance / -self.blend)
        total = np.add.reduceat(share, near.first)
        value = -self.blend * np.log(total)
        slope = np.add.reduceat(slopes * share, near.first, axis=1) / total
        below = self.sole - points[1]
        cut = below > value
        slope[:, cut] = np.array([[0], [-1], [0]])
        return np.where(cut, below, value), slope, share / total.take(near.points)

    def settled(
        self, points: Float[np.ndarray, "3 points"], near: _Near
    ) -> tuple[Float[np.ndarray, "3 points"], Float[np.ndarray, "3 points"]]:
        """Returns points near the skin on it, by a step of Newton's method, and f's gradient."""
        value, slope, _ = self.evaluate(points, near)
        most = np.float32(_LONGEST_STEP * self.scale)
        return points - (value / (slope**2).sum(0)).clip(-most, most) * slope, slope

    def sample(self, cell: float) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "x y z"]]:
        """Returns the corner of a grid around the body, and f there; just large far outside."""
        edge = 0.15 * self.scale
        low = np.minimum(self.start, self.end).min(1) - edge
        high = np.maximum(self.start, self.end).max(1) + edge
        size = np.ceil((high - low) / cell).astype(int)
        total = np.full(size.prod(), 1e-30)
        first, last = (((box.T - low) / cell).astype(int) for box in self.boxes(5))
        for number, ends in enumerate(zip(first.clip(0), np.minimum(last + 2, size), strict=True)):
            axes = [np.arange(*pair) for pair in zip(*ends, strict=True)]
            corners = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)
            points = (low[:, None] + cell * corners).astype(np.float32)
            distance, _, _ = self.distances(points, np.full(points.shape[1], number))
            total[np.ravel_multi_index(tuple(corners), size)] += np.exp(distance / -self.blend)
        height = low[1] + cell * np.arange(size[1])
        values = -self.blend * np.log(total.reshape(size))
        return low, np.maximum(values, (self.sole - height)[:, None])

    def boxes(
        self, reach: float
    ) -> tuple[Float[np.ndarray, "3 capsules"], Float[np.ndarray, "3 capsules"]]:
        """Returns the corners of boxes around the capsules and some blends farther."""
        margin = (self.radii.max(0) + reach * self.blend) * self.squash
        return np.minimum(self.start, self.end) - margin, np.maximum(self.start, self.end) + margin

    def near(self, points: Float[np.ndarray, "3 points"]) -> _Near:
        """Returns the pairs of points and capsules near them."""
        low, high = self.boxes(_REACH)
        inside = (points[..., None] > low[:, None]) & (points[..., None] < high[:, None])
        return _Near(*np.nonzero(inside.all(0)))

    def anchors(
        self, points: Float[np.ndarray, "3 points"], near: _Near, share: Float[np.ndarray, " pairs"]
    ) -> Float[np.ndarray, "joints points"]:
        """Returns how far each point goes with each joint when bones change."""
        _, _, place = self.distances(points.take(near.points, axis=1), near.capsules)
        start = self._by_joint(near, self.owner, share * (1 - place))
        end = self._by_joint(near, self.toward, share * place)
        return (start + end).astype(np.float32)

    def influences(
        self, points: Float[np.ndarray, "3 points"], near: _Near, share: Float[np.ndarray, " pairs"]
    ) -> tuple[Int[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
        """Returns the joints that move each point, and their weights.

        Left limbs do not move what is right of the middle, nor right limbs what is left.
        """
        total = self._by_joint(near, self.owner, share ** (1 / _SOFTNESS)).T
        sides = [name.partition("_")[0] for name in self.names]
        side = np.array([{"left": 1, "right": -1}.get(name, 0) for name in sides])
        total /= 1 + np.exp(np.clip(-side * points[0][:, None] / (0.012 * self.scale), -30, 30))
        total = np.pad(total, ((0, 0), (0, max(0, _INFLUENCES - total.shape[1]))))
        joints = np.argsort(-total, axis=-1)[:, :_INFLUENCES]
        weights = np.take_along_axis(total, joints, axis=-1)
        return np.minimum(joints, len(self.names) - 1), weights / weights.sum(-1, keepdims=True)

    def _by_joint(
        self, near: _Near, joints: Int[np.ndarray, " capsules"], values: Float[np.ndarray, " pairs"]
    ) -> Float[np.ndarray, "joints points"]:
        """Returns the sum of pairs' values for each joint of a capsule and each point."""
        shape = len(self.names), len(near.first)
        flat = np.ravel_multi_index((joints[near.capsules], near.points), shape)
        return np.bincount(flat, values, np.prod(shape)).reshape(shape)


def _named(capsule: Capsule, side: str, sign: int) -> Capsule:
    """Returns a capsule of one side of the body, with the full names of its joints."""
    (a, b, c), (d, e, f) = capsule.start, capsule.end
    ends = (sign * a, b, c), (sign * d, e, f)
    toward = side + (capsule.toward or capsule.joint)
    return Capsule(side + capsule.joint, *ends, capsule.radii, toward, capsule.squash)
