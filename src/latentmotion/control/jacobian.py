"""Gradients of joints to gradients of HumanML3D's features: the pullback of its `decode`.

    yaw_t = -2 Σ_{s<t} half_s        path_t = Σ_{1≤s≤t} turn(step_{s-1}, yaw_s)
    joint = turn(local, yaw) + path  turn'(v) = (v_z, 0, -v_x) for v turned already

So a joint pulls on its own features in its frame, and on turns and steps of the root before it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.representation.canonical import turn
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.representation.interface import Representation


def joint_features(representation: Representation) -> int:
    """Returns how many of the features, the first ones, say where joints are.

    Raises:
        InputError: The representation is not HumanML3D's or KIT's.
    """
    if not isinstance(representation, HumanML3DRepresentation):
        raise InputError(
            f"goals need a model of HumanML3D's or KIT's features; this one makes "
            f"{representation.name!r}"
        )
    return representation.blocks["positions"].stop


def joints_pullback(
    representation: Representation,
    features: Float[np.ndarray, "frames features"],
    joints: Float[np.ndarray, "frames joints 3"],
    gradient: Float[np.ndarray, "rows frames joints 3"],
) -> Float[np.ndarray, "rows frames first_features"]:
    """Returns the gradients of the features that say where joints are, in their own units.

    Args:
        representation: What the features mean.
        features: Of one motion.
        joints: What `decode` makes of them.
        gradient: Gradients of the joints, a row for each number to be differentiated.
    """
    rows, frames = gradient.shape[:2]
    blocks = representation.blocks
    yaw = -2 * np.concatenate([[0.0], np.cumsum(features[:-1, blocks["yaw_velocity"]][:, 0])])
    found = np.zeros((rows, frames, joint_features(representation)))
    local = turn(gradient, -yaw[:, None])
    found[..., blocks["root_height"]] = local[:, :, :1, 1]
    found[..., blocks["positions"]] = local[:, :, 1:].reshape(rows, frames, -1)

    root = joints[:, 0] * (1, 0, 1)
    around = joints - root[:, None]
    of_yaw = np.einsum("rtj,tj->rt", gradient[..., 0], around[..., 2])
    of_yaw -= np.einsum("rtj,tj->rt", gradient[..., 2], around[..., 0])
    # A step of the root moves all that follows.
    follows = np.cumsum(gradient.sum(axis=2)[:, ::-1], axis=1)[:, ::-1]
    steps = np.diff(root, axis=0)
    of_yaw[:, 1:] += follows[:, 1:, 0] * steps[:, 2] - follows[:, 1:, 2] * steps[:, 0]
    found[:, :-1, blocks["root_velocity"]] = turn(follows[:, 1:], -yaw[1:])[..., ::2]
    later = np.cumsum(of_yaw[:, ::-1], axis=1)[:, ::-1]
    found[:, :-1, blocks["yaw_velocity"]] = -2 * later[:, 1:, None]
    return found
