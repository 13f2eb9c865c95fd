"""APE and AVE: errors of position and of its variance, by part of the motion.

    APE = mean over frames of |p_t − q_t|
    AVE = |σ²(p) − σ²(q)|,   σ² per coordinate over the frames of a motion (unbiased)

of four parts: root, its trajectory on the floor, the pose (joints but the root, root at the
origin, facing +z), and all joints in the world. Ghosh et al. 2021, "Synthesis of compositional
animations from textual descriptions", section 4; TEMOS (Petrovich et al. 2022), section 4. Meters.

Motions start above the origin facing +z, as a representation decodes them. The authors' own
figures on HumanML3D (`TemosMetric`) are in other units, with sides swapped (mld.md §8), and
compare with nobody's.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from latentmotion.representation.facing import heading, turn
from latentmotion.skeleton import Skeleton

Parts = Mapping[str, Float[np.ndarray, "frames points axes"]]


def parts_of(joints: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton) -> Parts:
    """Returns what of a motion is compared, by name."""
    joints = np.asarray(joints, np.float64)
    root = joints[:, :1]
    pose = turn(joints[:, 1:] - root, -heading(joints, skeleton)[:, None])
    return {"root": root, "trajectory": root[..., [0, 2]], "pose": pose, "joints": joints}


def ape(predicted: Parts, true: Parts) -> dict[str, float]:
    """Returns the mean position error of each part, in the unit of the joints."""
    return {
        name: float(np.linalg.norm(predicted[name] - part, axis=-1).mean())
        for name, part in true.items()
    }


def ave(predicted: Parts, true: Parts) -> dict[str, float]:
    """Returns the error of each part's variance over time, in the squared unit of the joints."""
    return {
        name: float(np.linalg.norm(_variance(predicted[name]) - _variance(part), axis=-1).mean())
        for name, part in true.items()
    }


def _variance(
    part: Float[np.ndarray, "frames points axes"],
) -> Float[np.ndarray, "points axes"]:
    return part.var(axis=0, ddof=1) if len(part) > 1 else np.zeros(part.shape[1:])
