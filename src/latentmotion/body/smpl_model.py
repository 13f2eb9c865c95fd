"""SMPL model files that users bring: `.npz`, or `.pkl` of plain NumPy arrays.

None ships with this package: SMPL is free for research alone; get it, under its own terms, from
https://smpl.is.tue.mpg.de (neutral model, SMPL_NEUTRAL.pkl).

    v_template (V, 3), shapedirs (V, 3, shapes), posedirs (V, 3, 207), J_regressor (24, V),
    weights (V, 24), kintree_table (2, 24): parents and joints, f (F, 3): triangles
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from latentmotion.errors import FileFormatError
from latentmotion.kinematics.skeleton import BODY, Skeleton
from latentmotion.kinematics.smpl import Body
from latentmotion.representation.smpl import SMPL_FEATURES, SmplRepresentation
from latentmotion.storage import pickles
from latentmotion.storage.files import sha256

_SHAPES = {
    "v_template": ("V", 3),
    "shapedirs": ("V", 3, "shapes"),
    "posedirs": ("V", 3, 9 * (len(BODY) - 1)),
    "J_regressor": (len(BODY), "V"),
    "weights": ("V", len(BODY)),
    "kintree_table": (2, len(BODY)),
    "f": ("F", 3),
}
"""Arrays of a model file; words are sizes that must agree."""

_HOW = "bring a SMPL model file as .npz or .pkl from https://smpl.is.tue.mpg.de"


@dataclass(frozen=True, eq=False)
class SmplModel:
    """A SMPL model file in memory."""

    body: Body
    """Surface and bones, float32."""
    faces: Int[np.ndarray, "faces 3"]
    """Triangles of the surface."""
    fingerprint: str
    """Hash of the file."""

    @property
    def skeleton(self) -> Skeleton:
        """The bones of the mean person."""
        joints = np.asarray(self.body.rest_joints(), dtype=np.float64)
        offsets = joints - joints[[max(parent, 0) for parent in self.body.parents]]
        return replace(BODY, name="smpl", parents=self.body.parents, offsets=offsets)

    @property
    def representation(self) -> SmplRepresentation:
        """The features `smpl`, whose joints are those of this model."""
        return replace(SMPL_FEATURES, skeleton=self.skeleton, body=self.fingerprint)


def load_smpl(path: str | Path) -> SmplModel:
    """Reads a model file.

    Raises:
        FileFormatError: It is missing, damaged, holds chumpy's arrays or is not of SMPL's shapes.
    """
    arrays = {name: _array(path, name, value) for name, value in _content(Path(path)).items()}
    _check(path, arrays)
    floats = {name: arrays[name].astype(np.float32) for name in _SHAPES if name in arrays}
    body = Body(
        template=floats["v_template"],
        shape_directions=floats["shapedirs"],
        pose_directions=floats["posedirs"],
        joint_regressor=floats["J_regressor"],
        weights=floats["weights"],
        parents=_parents(path, arrays["kintree_table"]),
    )
    return SmplModel(body, arrays["f"].astype(np.int64), sha256(path))


def _content(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        raise FileFormatError(path, f"there is no such file; {_HOW}")
    if path.suffix.lower() == ".npz":
        content: Any = _npz(path)
    elif path.suffix.lower() == ".pkl":
        content = pickles.load(path)
    else:
        raise FileFormatError(path, f"the ending {path.suffix!r} is unknown; {_HOW}")
    if not isinstance(content, Mapping):
        raise FileFormatError(path, f"expected a dictionary, found a {type(content).__name__}")
    missing = [name for name in _SHAPES if name not in content]
    if missing:
        found = ", ".join(map(str, content)) or "nothing"
        raise FileFormatError(path, f"lacks {', '.join(missing)}; found {found}; {_HOW}")
    return {name: content[name] for name in _SHAPES}


def _npz(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files if name in _SHAPES}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(path, f"no .npz of plain arrays ({error}); {_HOW}") from error


def _array(path: str | Path, name: str, value: Any) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise FileFormatError(path, f"{name} holds {array.dtype}, expected numbers; {_HOW}")
    return array


def _check(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    sizes: dict[str | int, int] = {}
    for name, shape in _SHAPES.items():
        found = arrays[name].shape
        pairs = zip(shape, found, strict=False)
        wanted = tuple(sizes.setdefault(n, m) if isinstance(n, str) else n for n, m in pairs)
        if len(found) != len(shape) or found != wanted:
            raise FileFormatError(
                path, f"{name} has the shape {found}, expected {shape}; {_HOW} (SMPL, not SMPL-X)"
            )
        if not np.isfinite(arrays[name]).all():
            raise FileFormatError(path, f"{name} holds numbers that are not finite; {_HOW}")
    if arrays["f"].size and arrays["f"].max() >= sizes["V"]:
        raise FileFormatError(path, f"a triangle names vertex {arrays['f'].max()} of {sizes['V']}")


def _parents(path: str | Path, table: np.ndarray) -> tuple[int, ...]:
    # The root's parent is the largest unsigned number, which is -1.
    parents = (-1, *(int(parent) for parent in table[0, 1:]))
    if parents != BODY.parents:
        raise FileFormatError(path, f"joints with the parents {parents}, expected {BODY.parents}")
    return parents
