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

3. Pace. Where n_t turns faster than its neighbors give reason to, the same chain is solved again
   for its angle φ_t, with λ_t raised until the turn is spread over enough frames:

       Σ (w_t + |p_t|) (φ_t − angle n_t)²  +  Σ λ_t (φ_t − φ_{t−1})²

   A limb that passes through straight then turns in its own time; its elbow bends a little beside
   its hinge meanwhile. The joints stay where they are.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.kinematics.rotations import matrix_between

_PRIOR, _CONTINUITY = 0.1, 5.0
"""μ and κ."""

_ROUNDS = 8
"""How often λ_t is raised at most."""

_SHARE = 0.5
"""Of a raised λ_t that the steps before and after get, so that the turn spreads to them."""

_TOLERANCE = 1.1
"""Share of the pace that is fast enough to be slowed down."""


def hinge(
    axis: Float[np.ndarray, "frames 3"],
    normal: Float[np.ndarray, "frames 3"],
    prior: Float[np.ndarray, "frames 3"],
    stiffness: float,
    pace: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, "frames 3"]:
    """Returns the hinge of a limb, a unit vector normal to its upper bone in every frame.

    Args:
        axis: Direction of the upper bone, in its parent's frame.
        normal: Normal of the plane of both bones, as long as the sine of the bend.
        prior: What the hinge is where the limb is straight, as long as it weighs.
        stiffness: λ, per frame.
        pace: How far it may turn about the bone from each frame to the next, radians.
    """
    first = _transport(axis)
    frame = np.stack([first, np.cross(axis, first)], axis=1)
    weight, trust = (normal**2).sum(-1), np.linalg.norm(prior, axis=-1)
    plane, prior = (unit(np.einsum("tij,tj->ti", frame, x)) for x in (normal, prior))
    signed = plane * (weight * _signs(plane, weight, prior))[:, None]
    every = np.full(len(pace), stiffness)
    found = _solve_chain(weight + trust, every, signed + prior * trust[:, None])
    angle = _spread(np.unwrap(np.arctan2(found[:, 1], found[:, 0])), weight + trust, every, pace)
    turned = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.einsum("tij,ti->tj", frame, turned)


def _spread(
    angle: Float[np.ndarray, " frames"],
    weight: Float[np.ndarray, " frames"],
    stiffness: Float[np.ndarray, " steps"],
    pace: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, " frames"]:
    """Spreads turns that are faster than `pace` over the frames around them."""
    found, resistance = angle, np.zeros_like(stiffness)
    for _ in range(_ROUNDS):
        excess = np.abs(np.diff(found)) / pace
        if not (excess > _TOLERANCE).any():
            break
        raised = np.maximum(resistance, stiffness) * np.minimum(excess, 4) ** 2
        resistance = np.where(excess > 1, raised, resistance)
        before, after = np.append(resistance[1:], 0), np.append(0, resistance[:-1])
        resistance = np.maximum(resistance, _SHARE * np.maximum(before, after))
        found = _solve_chain(weight, resistance, (weight * angle)[:, None])[:, 0]
    return found


def _transport(axis: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
    """Carries a normal along a turning axis by the smallest rotation from frame to frame."""
    across = np.eye(3)[np.argmin(np.abs(axis[0]))]
    carried = [unit(np.cross(axis[0], across))]
    for step in matrix_between(axis[:-1], axis[1:]):
        carried.append(step @ carried[-1])
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
    weight: Float[np.ndarray, " frames"],
    stiffness: Float[np.ndarray, " steps"],
    wanted: Float[np.ndarray, "frames width"],
) -> Float[np.ndarray, "frames width"]:
    """Solves the tridiagonal system (diag(w) + Laplacian of λ) x = wanted, by Thomas' algorithm."""
    links = np.concatenate([[0.0], stiffness, [0.0]])
    diagonal = (weight + links[:-1] + links[1:]).tolist()
    factors = []
    for t, link in enumerate(stiffness.tolist(), start=1):
        factors.append(link / diagonal[t - 1])
        diagonal[t] -= factors[-1] * link
    return np.stack([_substitute(diagonal, factors, x) for x in wanted.T.tolist()], axis=1)


def _substitute(diagonal: list[float], factors: list[float], right: list[float]) -> list[float]:
    for t, factor in enumerate(factors, start=1):
        right[t] += factor * right[t - 1]
    right = [value / pivot for value, pivot in zip(right, diagonal, strict=True)]
    for t in range(len(factors) - 1, -1, -1):
        right[t] += factors[t] * right[t + 1]
    return right
