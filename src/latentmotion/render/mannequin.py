"""Mannequin: a smooth skin around the bones of any human skeleton, made by formula.

One vertex in each cell that the surface crosses: the mean of the crossings on the cell's 12 edges.
One quad around each crossed edge of the grid, through the four cells that share it.

The body is the surface f(p) = 0 of tapered capsules, blended by a soft minimum

    f(p) = −k log Σᵢ exp(−dᵢ(p) / k),      wᵢ(p) = exp((f(p) − dᵢ(p)) / k),

and wᵢ, the share that each capsule has in the blend, is also the skinning weight of its joint.
The surface net of a coarse grid is pulled onto f = 0 by Newton's method.

That takes a tenth of a second, so it is done once for each kind of skeleton, with standard lengths,
and stretched along the bones of each body: a vertex p at the shares tᵢ along the capsules becomes

    p' = s p + Σᵢ wᵢ ((1 − tᵢ) (aᵢ' − s aᵢ) + tᵢ (bᵢ' − s bᵢ)),

where aᵢ and bᵢ are the joints at both ends of capsule i, and s is the ratio of the bodies' sizes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Animation, Skeleton


def surface_net(
    values: Float[np.ndarray, "x y z"],
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "quads 4"]]:
    """Finds the surface between negative values, inside, and positive ones.

    Args:
        values: Positive all around the edge of the grid.

    Returns:
        Vertices in steps of the grid, and the corners of the quads, counterclockwise from outside.
    """
    steps, n = np.eye(3, dtype=int), np.array(values.shape) - 1
    total, count = np.zeros((*n, 3)), np.zeros(n)
    for axis, (u, v) in product(range(3), product((0, 1), repeat=2)):  # the 12 edges of each cell
        first = np.insert((u, v), axis, 0)
        a, b = (
            values[tuple(slice(c, m + c) for c, m in zip(corner, n, strict=True))]
            for corner in (first, first + steps[axis])
        )
        crossed = (a < 0) != (b < 0)
        total += crossed[..., None] * first
        total[..., axis] += np.where(crossed, a / np.where(crossed, a - b, 1), 0)
        count += crossed
    cells = np.stack(np.meshgrid(*[np.arange(m) for m in n], indexing="ij"), axis=-1)
    with np.errstate(invalid="ignore"):
        vertices = cells + total / np.where(count > 0, count, np.nan)[..., None]
    crossed = np.isfinite(vertices[..., 0])
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    quads, inside = [], values < 0
    for axis in range(3):  # the four cells around each crossed edge of the grid
        ahead = np.roll(inside, -1, axis)
        ahead[tuple(slice(-1, None) if a == axis else slice(None) for a in range(3))] = False
        edges = np.argwhere(inside != ahead)
        outward = inside[tuple(edges.T)]
        second, third = steps[[(axis + 1) % 3, (axis + 2) % 3]]
        around = [edges - second - third, edges - third, edges, edges - second]
        ring = np.stack([number[tuple(cell.T)] for cell in around], axis=-1)
        quads.append(np.where(outward[:, None], ring, ring[:, ::-1]))
    return vertices[crossed], np.concatenate(quads)


_BLEND = 0.013
"""k, meters: how widely neighboring capsules flow into one another."""

_REFERENCE_HEIGHT = 1.4
"""Distance of the neck from the ankles, meters, for which the radii below are."""

_SOFTNESS = 1.5
"""How much wider skinning weights blend than the skin, so that bent joints stay round."""

_INFLUENCES = 4

_MOST_STRETCH = 1.35
"""How much longer or shorter a stretched bone may be; other bodies are built anew."""


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

    def pose(
        self, animation: Animation
    ) -> tuple[Float[np.ndarray, "frames vertices 3"], Float[np.ndarray, "frames vertices 3"]]:
        """Returns vertices and normals in every frame, by linear blend skinning."""
        world = animation.rotations.copy()
        for joint, parent in list(enumerate(self.skeleton.parents))[1:]:
            world[:, joint] = world[:, parent] @ world[:, joint]
        shift = animation.joints() - np.einsum("tjab,jb->tja", world, self.skeleton.rest_joints())
        turn = np.einsum("vk,tvkab->tvab", self.weights, world[:, self.joints])
        moved = np.einsum("vk,tvka->tva", self.weights, shift[:, self.joints])
        return (
            np.einsum("tvab,vb->tva", turn, self.vertices) + moved,
            np.einsum("tvab,vb->tva", turn, self.normals),
        )


def make_mannequin(skeleton: Skeleton, cell: float = 0.022) -> Mannequin:
    """Makes a body for a skeleton whose rest pose is a T.

    Args:
        skeleton: With the joint names of HumanML3D or KIT; capsules of missing joints are left out,
            and a skeleton with other names gets a stick for each bone.
        cell: Size of the grid's cells, meters on a body of 1.7 m: about the length of a face.
    """
    standard = _standard_lengths(skeleton)
    rest = tuple(map(tuple, standard.offsets.tolist()))
    built, anchors = _build(skeleton.name, skeleton.names, skeleton.parents, rest, cell)
    ratio = _scale(skeleton) / _scale(standard)
    joints, standard_joints = skeleton.rest_joints(), standard.rest_joints()
    vertices = ratio * built.vertices + anchors @ (joints - ratio * standard_joints)
    flat, floor = built.vertices[:, 1] < standard_joints[:, 1].min() + 1e-9, joints[:, 1].min()
    flat &= vertices[:, 1] < floor + 0.01  # soles, but not of the shorter leg
    vertices[:, 1] = np.where(flat, floor, np.maximum(vertices[:, 1], floor))
    return replace(built, vertices=vertices, skeleton=skeleton)


def _standard_lengths(skeleton: Skeleton) -> Skeleton:
    """Returns a skeleton with the same bone directions and standard lengths, if it has any."""
    for known in (HUMANML3D, KIT, BODY):
        if (known.names, known.parents) == (skeleton.names, skeleton.parents):
            standard = np.linalg.norm(known.offsets[1:], axis=-1, keepdims=True)
            lengths = np.linalg.norm(skeleton.offsets[1:], axis=-1, keepdims=True)
            stretch = lengths / standard / (_scale(skeleton) / _scale(known))
            if stretch.min() * _MOST_STRETCH > 1 and stretch.max() < _MOST_STRETCH:
                # Rounded, so that files of one body, read back, are the same kind of skeleton.
                directions = np.round(skeleton.offsets[1:] / lengths, 2) + 0.0
                offsets = np.concatenate([np.zeros((1, 3)), directions * standard])
                return replace(known, offsets=offsets)
    return skeleton


def _scale(skeleton: Skeleton) -> float:
    """Returns the length of leg and trunk in rest pose, relative to `_REFERENCE_HEIGHT`."""
    if not {"neck", "left_ankle"} <= set(skeleton.names):
        return 1.0
    height, index = skeleton.rest_joints()[:, 1], skeleton.names.index
    return max(0.1, float(height[index("neck")] - height[index("left_ankle")]) / _REFERENCE_HEIGHT)


@lru_cache(maxsize=16)
def _build(
    name: str,
    names: tuple[str, ...],
    parents: tuple[int, ...],
    offsets: tuple[tuple[float, ...], ...],
    cell: float,
) -> tuple[Mannequin, Float[np.ndarray, "vertices joints"]]:
    """Returns the body of a skeleton, and the share of each joint in moving a vertex if it moves.

    The arrays cannot be written to, since several bodies share them.
    """
    skeleton = Skeleton(name, names, parents, np.array(offsets))
    body = _Body(skeleton)
    low, values = body.sample(cell * body.scale)
    corners, quads = surface_net(values)
    vertices = low + cell * body.scale * corners
    for _ in range(2):
        value, slope, _ = body.evaluate(vertices)
        vertices = vertices - (value / (slope**2).sum(-1))[:, None] * slope
    _, slope, share = body.evaluate(vertices)
    joints, weights = body.influences(vertices, share)
    normals = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    anchors = body.anchors(vertices, share)
    for array in (vertices, normals, quads, joints, weights, anchors):
        array.setflags(write=False)
    return Mannequin(vertices, normals, quads, joints, weights, skeleton), anchors


class _Body:
    """The capsules of one skeleton as arrays, and the function whose zero is their skin."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton, self.scale = skeleton, _scale(skeleton)
        names, rest, index = skeleton.names, skeleton.rest_joints(), skeleton.names.index
        body = [_named(capsule, "", 1) for capsule in _MIDDLE]
        for side, sign in (("left_", 1), ("right_", -1)):
            body += [_named(capsule, side, sign) for capsule in _SIDE]
        capsules = [capsule for capsule in body if {capsule.joint, capsule.toward} <= {*names}]
        if not capsules:  # joints of other names: a stick for each bone
            bones = [(names[p], name) for name, p in zip(names, skeleton.parents, strict=True)]
            capsules = [
                Capsule(a, (0, 0, 0), (0, 0, 0), (0.035, 0.025), b) for a, b in bones[1:] or bones
            ]
        self.owner = np.array([index(capsule.joint) for capsule in capsules])
        self.toward = np.array([index(capsule.toward) for capsule in capsules])
        self.start = rest[self.owner] + self.scale * np.array([c.start for c in capsules])
        self.end = rest[self.toward] + self.scale * np.array([c.end for c in capsules])
        self.radii = self.scale * np.array([capsule.radii for capsule in capsules])
        self.squash = np.array([capsule.squash for capsule in capsules])
        self.blend = _BLEND * self.scale
        self.sole = float(rest[:, 1].min())

    def distances(
        self, points: Float[np.ndarray, "*batch 3"], which: slice = slice(None)
    ) -> tuple[Float[np.ndarray, "*batch capsules"], Float[np.ndarray, "*batch capsules 3"]]:
        """Returns the distance from the surface of each capsule, negative inside, and its slope."""
        start, radii, squash = self.start[which], self.radii[which], self.squash[which]
        axis = (self.end[which] - start) / squash
        taper = (radii[:, 1] - radii[:, 0]) / np.maximum((axis**2).sum(-1), 1e-9)
        along, share = self.places(points, which)
        between = (share > 0) & (share < 1)
        share = np.clip(share, 0, 1)
        across = along - share[..., None] * axis
        length = np.linalg.norm(across, axis=-1)
        slope = across / np.maximum(length, 1e-9)[..., None] - (between * taper)[..., None] * axis
        return length - radii[:, 0] - share * (radii[:, 1] - radii[:, 0]), slope / squash

    def places(
        self, points: Float[np.ndarray, "*batch 3"], which: slice = slice(None)
    ) -> tuple[Float[np.ndarray, "*batch capsules 3"], Float[np.ndarray, "*batch capsules"]]:
        """Returns points from each capsule's start, and the share of its length they are at."""
        start, squash = self.start[which], self.squash[which]
        axis = (self.end[which] - start) / squash
        along = (points[..., None, :] - start) / squash
        return along, (along * axis).sum(-1) / np.maximum((axis**2).sum(-1), 1e-9)

    def anchors(
        self, points: Float[np.ndarray, "points 3"], share: Float[np.ndarray, "points capsules"]
    ) -> Float[np.ndarray, "points joints"]:
        """Returns how far each point goes with each joint when the lengths of bones change."""
        place = np.clip(self.places(points)[1], 0, 1)
        joint = np.eye(len(self.skeleton))
        return share * (1 - place) @ joint[self.owner] + share * place @ joint[self.toward]

    def evaluate(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[
        Float[np.ndarray, " points"],
        Float[np.ndarray, "points 3"],
        Float[np.ndarray, "points capsules"],
    ]:
        """Returns f, its gradient, and the share of each capsule in the blend."""
        distances, slopes = self.distances(points)
        closest = distances.min(-1, keepdims=True)
        share = np.exp((closest - distances) / self.blend)
        total = share.sum(-1, keepdims=True)
        value = closest[:, 0] - self.blend * np.log(total[:, 0])
        slope = np.einsum("pc,pcx->px", share / total, slopes)
        below = self.sole - points[:, 1]
        cut = below > value
        return np.where(cut, below, value), np.where(cut[:, None], (0, -1, 0), slope), share / total

    def sample(self, cell: float) -> tuple[Float[np.ndarray, " width"], Float[np.ndarray, "x y z"]]:
        """Returns f on a grid and the grid's corner; far outside, f is just large."""
        edge = 0.15 * self.scale
        low = np.minimum(self.start, self.end).min(0) - edge
        extent = np.maximum(self.start, self.end).max(0) + edge - low
        size = np.ceil(extent / cell).astype(int)
        total = np.full(size, 1e-30)
        margin = (self.radii.max(-1, keepdims=True) + 5 * self.blend) * self.squash
        first = ((np.minimum(self.start, self.end) - margin - low) / cell).astype(int).clip(0)
        last = ((np.maximum(self.start, self.end) + margin - low) / cell).astype(int) + 2
        for number in range(len(self.owner)):
            box = tuple(slice(*ends) for ends in zip(first[number], last[number], strict=True))
            axes = [np.arange(n)[b] for n, b in zip(size, box, strict=True)]
            corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            distance, _ = self.distances(low + cell * corners, slice(number, number + 1))
            total[box] += np.exp(-distance[..., 0] / self.blend)
        height = low[1] + cell * np.arange(size[1])
        return low, np.maximum(-self.blend * np.log(total), (self.sole - height)[:, None])

    def influences(
        self, points: Float[np.ndarray, "points 3"], share: Float[np.ndarray, "points capsules"]
    ) -> tuple[Int[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
        """Returns the joints that move each point, and their weights.

        Left limbs do not move what is right of the middle, nor right limbs what is left.
        """
        total = share ** (1 / _SOFTNESS) @ np.eye(len(self.skeleton))[self.owner]
        sides = [name.partition("_")[0] for name in self.skeleton.names]
        side = np.array([{"left": 1, "right": -1}.get(name, 0) for name in sides])
        total /= 1 + np.exp(np.clip(-side * points[:, :1] / (0.012 * self.scale), -30, 30))
        total = np.pad(total, ((0, 0), (0, max(0, _INFLUENCES - total.shape[1]))))
        joints = np.argsort(-total, axis=-1)[:, :_INFLUENCES]
        weights = np.take_along_axis(total, joints, axis=-1)
        return np.minimum(joints, len(self.skeleton) - 1), weights / weights.sum(-1, keepdims=True)


def _named(capsule: Capsule, side: str, sign: int) -> Capsule:
    """Returns a capsule of one side of the body, with the full names of its joints."""
    (a, b, c), (d, e, f) = capsule.start, capsule.end
    ends = (sign * a, b, c), (sign * d, e, f)
    toward = side + (capsule.toward or capsule.joint)
    return Capsule(side + capsule.joint, *ends, capsule.radii, toward, capsule.squash)
