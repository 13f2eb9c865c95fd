"""The hinge of a limb over time: the axis about which elbow or knee bends, even while straight.

Let m_t be the normal of the plane of both bones, w_t = sin²(bend) = |m_t|², p_t a weak prior from
rest pose and toes. Two steps, both exact:

1. Signs. Real mocap shows elbows up to 30° beyond straight, where m_t points the wrong way. The
   signs s_t = ±1 minimize, by dynamic programming (Viterbi 1967),

       − Σ s_t w_t (w_t + μ p_t·m_t)  −  κ Σ s_t s_{t−1} min(w_t, w_{t−1}) m_t·m_{t−1}

   (m and p as unit vectors): a joint bends in its natural direction, near the rest pose, and the
   plane does not flip from one frame to the next.

2. Directions. The hinge n_t minimizes

       Σ w_t |n_t − s_t m_t|² + |p_t| |n_t − p_t|² + λ Σ |n_t − n_{t−1}|²,

   in axes that follow the bone without rotating about it (parallel transport), so that λ resists
   twist alone.

3. Pace. Where n_t turns faster than the motion of the bones explains, the same chain is solved
   again for its angle φ_t, with λ_t raised until the turn is spread over enough frames:

       Σ (w_t + |p_t|) (φ_t − angle n_t)²  +  Σ λ_t (φ_t − φ_{t−1})²

   A limb that passes through straight then turns gradually, while its elbow bends a little off its
   hinge. The joints stay where they are.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.kinematics.rotations import matrix_between

_PRIOR, _CONTINUITY = 0.1, 5.0
"""μ and κ."""

_ROUNDS = 8
"""Greatest number of times that λ_t is raised."""

_SHARE = 0.5
"""Share of a raised λ_t that the steps before and after get, so that the turn spreads to them."""

_TOLERANCE = 1.1
"""Ratio to the pace above which a turn is slowed down."""


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
        prior: Expected hinge of a straight limb; its length is its weight.
        stiffness: λ, per frame.
        pace: Greatest turn about the bone from each frame to the next, radians.
    """
    carried = [unit(np.cross(axis[0], np.eye(3)[np.argmin(np.abs(axis[0]))]))]
    for step in matrix_between(axis[:-1], axis[1:]):  # parallel transport
        carried.append(step @ carried[-1])
    first = np.stack(carried)
    frame = np.stack([first, np.cross(axis, first)], axis=1)
    weight, trust = (normal**2).sum(-1), np.linalg.norm(prior, axis=-1)
    plane, prior = (unit(np.einsum("tij,tj->ti", frame, x)) for x in (normal, prior))
    signed = plane * (weight * _signs(plane, weight, prior))[:, None]
    every = np.full(len(pace), stiffness)
    direction = _solve_chain(weight + trust, every, signed + prior * trust[:, None])
    wanted = angle = np.unwrap(np.arctan2(direction[:, 1], direction[:, 0]))
    resistance = np.zeros_like(every)
    for _ in range(_ROUNDS):  # turns faster than the pace are spread over the frames around them
        excess = np.abs(np.diff(angle)) / pace
        if not (excess > _TOLERANCE).any():
            break
        raised = np.maximum(resistance, every) * np.minimum(excess, 4) ** 2
        resistance = np.where(excess > 1, raised, resistance)
        before, after = np.append(resistance[1:], 0), np.append(0, resistance[:-1])
        resistance = np.maximum(resistance, _SHARE * np.maximum(before, after))
        right = ((weight + trust) * wanted)[:, None]
        angle = _solve_chain(weight + trust, resistance, right)[:, 0]
    return np.einsum("tij,ti->tj", frame, np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def _signs(
    plane: Float[np.ndarray, "frames 2"],
    weight: Float[np.ndarray, " frames"],
    prior: Float[np.ndarray, "frames 2"],
) -> Float[np.ndarray, " frames"]:
    """Chooses for each frame: the limb bends naturally (1), or beyond straight (-1)."""
    natural = weight * (weight + _PRIOR * (plane * prior).sum(-1))
    pull = _CONTINUITY * np.minimum(weight[1:], weight[:-1]) * (plane[1:] * plane[:-1]).sum(-1)
    signs = np.array([1.0, -1.0])
    best, choices = -natural[0] * signs, []
    for unary, pair in zip(natural[1:], pull, strict=True):
        cost = best[:, None] - pair * np.outer(signs, signs)
        choices.append(cost.argmin(0))
        best = cost.min(0) - unary * signs
    path = [int(best.argmin())]
    for before in reversed(choices):
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
    columns = wanted.T.tolist()
    for column in columns:
        for t, factor in enumerate(factors, start=1):
            column[t] += factor * column[t - 1]
        column[:] = [value / pivot for value, pivot in zip(column, diagonal, strict=True)]
        for t in range(len(factors) - 1, -1, -1):
            column[t] += factors[t] * column[t + 1]
    return np.stack([np.array(column) for column in columns], axis=1)
