"""A model file with SMPL's arrays around the skeleton that ships: a cube of skin at each joint."""

from __future__ import annotations

import pickle
from itertools import product
from pathlib import Path

import numpy as np

from latentmotion.kinematics.skeleton import BODY

# Eight vertices around a joint, whose mean it is.
CORNERS = 0.04 * np.array(list(product((-1, 1), repeat=3)))


def synthetic_arrays(seed: int = 0) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    joints, count = BODY.rest_joints(), 8 * len(BODY)
    template = (joints[:, None] + CORNERS).reshape(count, 3)
    follows = np.eye(len(BODY))
    above = follows[[max(parent, 0) for parent in BODY.parents]]
    weights = np.repeat(0.7 * follows + 0.3 * above, 8, axis=0)
    parents = np.array(BODY.parents, dtype=np.int64)
    return {
        "v_template": template,
        "shapedirs": random.normal(0, 0.01, (count, 3, 10)),
        "posedirs": random.normal(0, 0.003, (count, 3, 207)),
        "J_regressor": np.repeat(np.eye(len(BODY)) / 8, 8, axis=1),
        "weights": weights,
        "kintree_table": np.stack([parents, np.arange(24)]).astype(np.uint32),
        "f": random.integers(0, count, (300, 3)).astype(np.uint32),
    }


def write_synthetic_smpl(path: Path, **changes: object) -> Path:
    """Writes `.npz`, or `.pkl`; arrays can be replaced, or left out by None."""
    arrays = synthetic_arrays() | changes
    arrays = {name: value for name, value in arrays.items() if value is not None}
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        path.write_bytes(pickle.dumps(arrays | {"bs_type": "lrotmin"}, protocol=2))
    return path
