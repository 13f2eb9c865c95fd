"""The hinge of a limb over time: about which axis elbow or knee bends, also while it is straight.

Let m_t be the normal of the plane of both bones, w_t = sin²(bend) = |m_t|², p_t a weak prior from
rest pose and toes. Two steps, both exact:

1. Signs. Real mocap shows elbows up to 30° beyond straight, where m_t points the wrong way. The
   signs s_t = ±1 minimize, by dynamic programming (Viterbi 1967),

       − Σ s_t w_t (w_t + μ p_t·m_t)  −  κ Σ s_t s_{t−1} min(w_t, w_{t−1}) m_t·m_{t−1}

   (m and p as unit vectors): a joint bends the way it is made to, near the rest pose, and the
   plane does not flip from one frame to the next.

2. Directions. The hinge n_t minimizes

       Σ w_t |n_t − s_t m_t|² + |p_t| |n_t − p_t|² + λ Σ |n_t − n_{t−1}|²,

   in axes that are carried along the bone without turning about it (parallel transport), so that
   λ resists twist alone.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.rotations import quaternion_between, quaternion_rotate

_PRIOR, _CONTINUITY = 0.1, 5.0
"""μ and κ."""


def hinge(
    axis: Float[np.ndarray, "frames 3"],
    normal: Float[np.ndarray, "frames 3"],
    prior: Float[np.ndarray, "frames 3"],
    stiffness: float,
) -> Float[np.ndarray, "frames 3"]:
    """Returns the hinge of a limb, a unit vector normal to its upper bone in every frame.

    Args:
        axis: Direction of the upper bone, in its parent's frame.
        normal: Normal of the plane of both bones, as long as the sine of the bend.
        prior: What the hinge is where the limb is straight, as long as it weighs.
        stiffness: λ, per frame.
    """
    first = _transport(axis)
    frame = np.stack([first, np.cross(axis, first)], axis=1)
    weight, trust = (normal**2).sum(-1), np.linalg.norm(prior, axis=-1)
    plane, prior = (_unit(np.einsum("tij,tj->ti", frame, x)) for x in (normal, prior))
    signed = plane * (weight * _signs(plane, weight, prior))[:, None]
    found = _solve_chain(weight + trust, stiffness, signed + prior * trust[:, None])
    return np.einsum("tij,ti->tj", frame, _unit(found))


def _transport(axis: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
    """Carries a normal along a turning axis by the smallest rotation from frame to frame."""
    across = np.eye(3)[np.argmin(np.abs(axis[0]))]
    carried = [_unit(np.cross(axis[0], across))]
    for step in quaternion_between(axis[:-1], axis[1:]):
        carried.append(quaternion_rotate(step, carried[-1]))
    return np.stack(carried)


def _signs(
    plane: Float[np.ndarray, "frames 2"],
    weight: Float[np.ndarray, " frames"],
    prior: Float[np.ndarray, "frames 2"],
) -> Float[np.ndarray, " frames"]:
    """Chooses for each frame: the limb bends as it is made to (1), or beyond straight (-1)."""
    natural = weight * (weight + _PRIOR * (plane * prior).sum(-1))
    pull = _CONTINUITY * np.minimum(weight[1:], weight[:-1]) * (plane[1:] * plane[:-1]).sum(-1)
    signs = np.array([1.0, -1.0])
    best, came = -natural[0] * signs, []
    for unary, pair in zip(natural[1:], pull, strict=True):
        cost = best[:, None] - pair * np.outer(signs, signs)
        came.append(cost.argmin(0))
        best = cost.min(0) - unary * signs
    path = [int(best.argmin())]
    for before in reversed(came):
        path.append(int(before[path[-1]]))
    return signs[path[::-1]]


def _solve_chain(
    weight: Float[np.ndarray, " frames"], stiffness: float, wanted: Float[np.ndarray, "frames 2"]
) -> Float[np.ndarray, "frames 2"]:
    """Solves the tridiagonal system (diag(w) + λ·Laplacian) x = wanted, by Thomas' algorithm."""
    frames = len(weight)
    neighbors = np.full(frames, 2.0)
    neighbors[[0, -1]] = 1.0 if frames > 1 else 0.0
    diagonal, right = weight + stiffness * neighbors, wanted.copy()
    for t in range(1, frames):
        factor = stiffness / diagonal[t - 1]
        diagonal[t] -= factor * stiffness
        right[t] += factor * right[t - 1]
    right[-1] /= diagonal[-1]
    for t in range(frames - 2, -1, -1):
        right[t] = (right[t] + stiffness * right[t + 1]) / diagonal[t]
    return right


def _unit(vectors: Float[np.ndarray, "*batch width"]) -> Float[np.ndarray, "*batch width"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
