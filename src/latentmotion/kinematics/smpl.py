"""SMPL: model files that users bring, and their skinned surface (Loper et al., 2015).

None ships with this package: SMPL is free for research only; get it, under its own terms, from
https://smpl.is.tue.mpg.de (neutral model, SMPL_NEUTRAL.pkl). A file is `.npz`, or `.pkl` of plain
NumPy arrays:

    v_template (V, 3), shapedirs (V, 3, shapes), posedirs (V, 3, 207), J_regressor (24, V),
    weights (V, 24), kintree_table (2, 24): parents and joints, f (F, 3): triangles

Linear blend skinning, section 3 of the paper:

    shaped   = template + shape_directions β                                  (vertices, 3)
    joints   = joint_regressor shaped                                         (joints, 3)
    posed    = shaped + pose_directions vec(R_1 - I, …, R_J-1 - I)
    vertex i = Σ_j weights_ij (W_j (posed_i - joints_j) + p_j)

W_j and p_j are the rotation and position of joint j in the world, by forward kinematics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import array_namespace, device
from latentmotion.errors import FileFormatError
from latentmotion.kinematics.skeleton import BODY, Skeleton
from latentmotion.storage.array_files import read_arrays
from latentmotion.storage.files import sha256
from latentmotion.storage.limits import MOST_NUMBER

# Arrays of a model file; words are sizes that must agree.
_SHAPES = {
    "v_template": ("V", 3),
    "shapedirs": ("V", 3, "shapes"),
    "posedirs": ("V", 3, 9 * (len(BODY) - 1)),
    "J_regressor": (len(BODY), "V"),
    "weights": ("V", len(BODY)),
    "kintree_table": (2, len(BODY)),
    "f": ("F", 3),
}

_HOW = "bring a SMPL model file as .npz or .pkl from https://smpl.is.tue.mpg.de"


@dataclass(frozen=True, eq=False)
class SkinnedBody:
    """A skinned surface; NumPy or PyTorch arrays."""

    template: Float[Any, "vertices 3"]  # The surface in rest pose, meters, y up.
    # Change of the surface per unit of each shape parameter.
    shape_directions: Float[Any, "vertices 3 shapes"]
    # Change per unit of each entry of R - I of all joints but the root, row by row.
    pose_directions: Float[Any, "vertices 3 bends"]
    joint_regressor: Float[Any, "joints vertices"]  # Each joint as a weighted mean of vertices.
    weights: Float[Any, "vertices joints"]  # Skinning weights; rows sum to 1.
    parents: tuple[int, ...]  # Index of each joint's parent; -1 for the root, which is joint 0.

    def like(self, array: Any) -> SkinnedBody:
        """Returns the body as arrays of another one's library, precision and device."""
        xp, arrays = array_namespace(array), dict(vars(self))
        parents = arrays.pop("parents")
        kind = {"dtype": array.dtype, "device": device(array)}
        return SkinnedBody(**{k: xp.asarray(v, **kind) for k, v in arrays.items()}, parents=parents)

    def shaped(self, shape: Float[Any, " shapes"] | None = None) -> Float[Any, "vertices 3"]:
        """Returns the surface in rest pose; by default that of the mean person."""
        if shape is None:
            return self.template
        xp = array_namespace(self.template, shape)
        return self.template + xp.sum(self.shape_directions * shape, axis=-1)

    def rest_joints(self, shape: Float[Any, " shapes"] | None = None) -> Float[Any, "joints 3"]:
        """Returns the joint positions in rest pose, meters."""
        return self.joint_regressor @ self.shaped(shape)

    def posed(
        self, rotations: Float[Any, "*batch joints 3 3"], shape: Float[Any, " shapes"] | None = None
    ) -> Float[Any, "*batch vertices 3"]:
        """Returns the surface in a pose, the root joint where it is in rest pose.

        Args:
            rotations: Rotation of each joint relative to its parent; the root's is the body's.
            shape: The person; by default the mean one.
        """
        xp = array_namespace(self.template, rotations)
        joints = self.rest_joints(shape)
        turned = [rotations[..., 0, :, :]]
        placed = [joints[0] + xp.zeros_like(rotations[..., 0, :, 0])]
        for joint, parent in list(enumerate(self.parents))[1:]:
            offset = joints[joint] - joints[parent]
            placed.append(placed[parent] + xp.sum(turned[parent] * offset, axis=-1))
            turned.append(turned[parent] @ rotations[..., joint, :, :])
        world, positions = xp.stack(turned, axis=-3), xp.stack(placed, axis=-2)
        shifts = positions - xp.sum(world * joints[:, None, :], axis=-1)
        transforms = xp.concat([world, shifts[..., None]], axis=-1)  #  (…, joints, 3, 4)
        blended = self.weights @ xp.reshape(transforms, (*transforms.shape[:-2], 12))
        blended = xp.reshape(blended, (*blended.shape[:-1], 3, 4))
        identity = xp.eye(3, dtype=rotations.dtype, device=device(rotations))
        bends = rotations[..., 1:, :, :] - identity
        bends = xp.reshape(bends, (*bends.shape[:-3], -1))
        count = self.pose_directions.shape[-1]
        correctives = bends @ xp.reshape(self.pose_directions, (-1, count)).T
        correctives = xp.reshape(correctives, (*correctives.shape[:-1], -1, 3))
        surface = self.shaped(shape) + correctives
        return xp.sum(blended[..., :3] * surface[..., None, :], axis=-1) + blended[..., 3]


@dataclass(frozen=True, eq=False)
class SmplModel:
    """A SMPL model file in memory."""

    body: SkinnedBody  # Surface and bones, float32.
    faces: Int[np.ndarray, "faces 3"]  # Triangles of the surface.
    fingerprint: str  # Hash of the file.

    @property
    def skeleton(self) -> Skeleton:
        """The bones of the mean person."""
        joints = np.asarray(self.body.rest_joints(), dtype=np.float64)
        offsets = joints - joints[[max(parent, 0) for parent in self.body.parents]]
        return replace(BODY, name="smpl", parents=self.body.parents, offsets=offsets)


def load_smpl(path: str | Path) -> SmplModel:
    """Reads a model file.

    Raises:
        FileFormatError: It is missing, damaged, holds chumpy's arrays or is not of SMPL's shapes.
    """
    arrays = {name: np.asarray(value) for name, value in _content(Path(path)).items()}
    sizes: dict[str | int, int] = {}
    for name, shape in _SHAPES.items():
        if arrays[name].dtype.kind not in "fiu":
            raise FileFormatError(
                path, f"{name} holds {arrays[name].dtype}, expected numbers; {_HOW}"
            )
        actual = arrays[name].shape
        pairs = zip(shape, actual, strict=False)
        expected = tuple(sizes.setdefault(n, m) if isinstance(n, str) else n for n, m in pairs)
        if len(actual) != len(shape) or actual != expected:
            raise FileFormatError(
                path, f"{name} has the shape {actual}, expected {shape}; {_HOW} (SMPL, not SMPL-X)"
            )
        least = 2**32 if name == "kintree_table" else MOST_NUMBER  # the root's parent is 2³² - 1
        if not (np.abs(arrays[name].astype(np.float64)) <= least).all():
            raise FileFormatError(path, f"{name} holds numbers that are not finite; {_HOW}")
    faces = arrays["f"]
    if faces.size and not 0 <= faces.min() <= faces.max() < sizes["V"]:
        problem = f"a triangle names vertex {faces.max()} of {sizes['V']}, or one below 0"
        raise FileFormatError(path, problem)
    # The root's parent is the largest unsigned number, which is -1.
    parents = (-1, *(int(parent) for parent in arrays["kintree_table"][0, 1:]))
    if parents != BODY.parents:
        raise FileFormatError(path, f"joints with the parents {parents}, expected {BODY.parents}")
    floats = {name: arrays[name].astype(np.float32) for name in _SHAPES if name in arrays}
    body = SkinnedBody(
        template=floats["v_template"],
        shape_directions=floats["shapedirs"],
        pose_directions=floats["posedirs"],
        joint_regressor=floats["J_regressor"],
        weights=floats["weights"],
        parents=parents,
    )
    return SmplModel(body, arrays["f"].astype(np.int64), sha256(path))


def _content(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        raise FileFormatError(path, f"there is no such file; {_HOW}")
    if path.suffix.lower() == ".npz":
        try:
            content: Any = read_arrays(path, _SHAPES)
        except FileFormatError as error:
            raise FileFormatError(path, f"no .npz of plain arrays ({error}); {_HOW}") from error
    elif path.suffix.lower() == ".pkl":
        from latentmotion.storage import pickles  # the plain installation's chain reads none

        content = pickles.load(path)
    else:
        raise FileFormatError(path, f"the ending {path.suffix!r} is unknown; {_HOW}")
    if not isinstance(content, Mapping):
        raise FileFormatError(path, f"expected a dictionary, found a {type(content).__name__}")
    missing = [name for name in _SHAPES if name not in content]
    if missing:
        keys = ", ".join(map(str, content)) or "nothing"
        raise FileFormatError(path, f"lacks {', '.join(missing)}; found {keys}; {_HOW}")
    return {name: content[name] for name in _SHAPES}
