"""Mannequin: the body of all files, pages and pictures, fitted to any human skeleton.

The body is one mesh with skinning weights, `mannequin.json` beside this file; the page's script
reads the same. `python -m benchmarks.mannequin` makes it. It stands in a T-pose on a skeleton of
its own; on another one a vertex p, anchored at the share t of the bone from a to b, goes to

    p' = a' + t (b' − a') + s Q (p − a − t (b − a)),

where s is the ratio of the bodies' sizes and Q turns the bone of an arm to its direction there.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.bone_names import REQUIRED
from latentmotion.kinematics.rotations import matrix_between
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Joints, Skeleton
from latentmotion.motion import Motion

GREY = (0.57, 0.60, 0.65)  # Linear RGB of the body.

# Linear RGB of its joints, waist and face, where no take has a color of its own.
ACCENT = (0.028, 0.275, 0.337)

# Joints without which a skeleton is drawn as sticks.
_NEEDED = frozenset({"pelvis", "head", *REQUIRED})

# Edges of a stick's cross-section.
_SIDES = 10


@dataclass(frozen=True, eq=False)
class Mannequin:
    """A skinned mesh in the rest pose of a skeleton."""

    # Positions in rest pose, meters, the root at the origin.
    vertices: Float[np.ndarray, "vertices 3"]
    normals: Float[np.ndarray, "vertices 3"]  # Outward unit normals.
    # Corners of each face, counterclockwise from outside.
    triangles: Int[np.ndarray, "triangles 3"]
    joints: Int[np.ndarray, "vertices 4"]  # The joints that move each vertex.
    weights: Float[np.ndarray, "vertices 4"]  # Skinning weight of each; the sum is 1.
    skeleton: Skeleton  # The skeleton whose rest pose it has.
    # Number of triangles, the first, that are grey; the others have the take's color.
    shell: int = 0

    def moves(self, animation: Animation) -> tuple[Float[np.ndarray, "frames joints 3 3"], Joints]:
        """Returns the rotation, then the shift, of each joint's vertices in the world."""
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


# Skin for a motion and how it moves, from the motion.
Figure = Callable[[Motion], tuple[Mannequin, Animation]]


def mannequin_of(motion: Motion) -> tuple[Mannequin, Animation]:
    """Returns the mannequin in a motion: the `Figure` that files have."""
    animation = motion.animation()
    return make_mannequin(animation.skeleton), animation


def sticks_of(motion: Motion) -> tuple[Mannequin, Animation]:
    """Returns a stick for each bone, in a motion."""
    animation = motion.animation()
    return _sticks(animation.skeleton), animation


def make_mannequin(skeleton: Skeleton) -> Mannequin:
    """Returns the body for a skeleton.

    Args:
        skeleton: With the joint names of HumanML3D or KIT, in rest pose; one with other names gets
            a stick for each bone.
    """
    if not {*skeleton.names} >= _NEEDED:
        return _sticks(skeleton)
    asset, at_rest = _asset(), skeleton.rest_joints()
    scale, rest = _length(skeleton) / asset.length, asset.rest
    # Which joint of the skeleton carries each of the asset's, and where each is at rest. A joint
    # that the skeleton lacks goes with the nearest one above it.
    carriers, places = np.zeros(len(HUMANML3D), int), np.zeros((len(HUMANML3D), 3))
    for joint, (name, parent) in enumerate(zip(HUMANML3D.names, HUMANML3D.parents, strict=True)):
        if name in skeleton.names:
            carriers[joint] = skeleton.names.index(name)
            places[joint] = at_rest[carriers[joint]]
        else:
            carriers[joint] = carriers[parent]
            places[joint] = places[parent] + scale * (rest[joint] - rest[parent])
    start, end = places[asset.anchors[:, 0]], places[asset.anchors[:, 1]]
    first, last = rest[asset.anchors[:, 0]], rest[asset.anchors[:, 1]]
    share = asset.places[:, None]
    beside = scale * (asset.vertices - first - share * (last - first))
    for name in ("elbow", "wrist"):
        for side in ("left", "right"):
            tip = HUMANML3D.names.index(f"{side}_{name}")
            arm = asset.anchors[:, 1] == tip
            bone = HUMANML3D.parents[tip]
            turn = matrix_between(rest[tip] - rest[bone], places[tip] - places[bone])
            beside[arm] = beside[arm] @ turn.T
    vertices = start + share * (end - start) + beside
    joints = np.pad(carriers[asset.joints], ((0, 0), (0, 2)))
    weights = np.stack([asset.shares, 1 - asset.shares, 0 * asset.shares, 0 * asset.shares], -1)
    normals = smooth_normals(vertices, asset.triangles)
    return Mannequin(vertices, normals, asset.triangles, joints, weights, skeleton, asset.shell)


def smooth_normals(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Returns the unit normals of vertices: the mean over their faces, weighted by area."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    corners, pulls = triangles.ravel(), np.repeat(across, 3, axis=0)
    total = np.stack([np.bincount(corners, pull, len(vertices)) for pull in pulls.T], axis=-1)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return total / np.where(length > 0, length, 1)


@dataclass(frozen=True, eq=False)
class _Asset:
    """The stored mesh; not to be written to."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    joints: Int[np.ndarray, "vertices 2"]
    shares: Float[np.ndarray, " vertices"]  # Weight of the first joint; the second has the rest.
    # Joints at both ends of the bone along which a vertex is stretched.
    anchors: Int[np.ndarray, "vertices 2"]
    places: Float[np.ndarray, " vertices"]  # Share of the way from the first to the second.
    rest: Float[np.ndarray, "joints 3"]  # The joints of HumanML3D in this body's T-pose.
    shell: int

    @property
    def length(self) -> float:
        """Length of a leg and the trunk, meters."""
        offsets = self.rest - self.rest[[max(parent, 0) for parent in HUMANML3D.parents]]
        return _length(replace(HUMANML3D, offsets=offsets))


@lru_cache(maxsize=1)
def _asset() -> _Asset:
    folder = resources.files("latentmotion.render")
    stored = json.loads(folder.joinpath("mannequin.json").read_text(encoding="utf-8"))

    def array(name: str, kind: str, columns: int) -> np.ndarray:
        values = np.frombuffer(base64.b64decode(stored[name]), kind)
        return values.reshape(-1, columns)

    asset = _Asset(
        array("vertices", "<i2", 3) * stored["step"],
        array("triangles", "<u2", 3).astype(np.int64),
        array("joints", "u1", 2).astype(np.int64),
        array("shares", "u1", 1)[:, 0] / 255,
        array("anchors", "u1", 2).astype(np.int64),
        array("places", "u1", 1)[:, 0] / 255,
        np.array(stored["rest"], dtype=np.float64),
        stored["shell"],
    )
    for value in vars(asset).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return asset


def _length(skeleton: Skeleton) -> float:
    """Returns the length of a leg and the trunk at rest, meters; at least a tenth of a meter."""
    rest, index = skeleton.rest_joints(), skeleton.names.index
    ways = (("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("pelvis", "head"))
    return max(0.1, sum(float(np.linalg.norm(rest[index(b)] - rest[index(a)])) for a, b in ways))


def _sticks(skeleton: Skeleton) -> Mannequin:
    """Returns a double cone for each bone, thickest near its start."""
    rest = skeleton.rest_joints()
    bones = [(p, j) for j, p in enumerate(skeleton.parents) if p >= 0] or [(0, 0)]
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    around = np.arange(_SIDES)
    after = (around + 1) % _SIDES
    tip = np.full(_SIDES, _SIDES + 1)
    faces = np.concatenate(
        [np.stack([tip * 0, after + 1, around + 1], -1), np.stack([around + 1, after + 1, tip], -1)]
    )
    vertices, joints = [], []
    for parent, joint in bones:
        a, b = rest[parent], rest[joint]
        length = float(np.linalg.norm(b - a)) or 0.05
        way = (b - a) / length if (b != a).any() else np.array([0.0, 1.0, 0.0])
        side = np.cross(way, (0, 0, 1) if abs(way[2]) < 0.9 else (1, 0, 0))
        side /= np.linalg.norm(side)
        # Thin enough for fingers, at most 4.4 cm for long bones.
        radius = min(0.12 * length, 0.04) + 0.004
        circle = a + 0.18 * length * way + radius * ring @ np.stack([side, np.cross(way, side)])
        vertices.append(np.concatenate([[a], circle, [a + length * way]]))
        joints.append(np.tile([parent, 0, 0, 0], (_SIDES + 2, 1)))
    points = np.concatenate(vertices)
    triangles = np.concatenate([faces + n * (_SIDES + 2) for n in range(len(bones))])
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    normals = smooth_normals(points, triangles)
    return Mannequin(points, normals, triangles, np.concatenate(joints), weights, skeleton)
