"""PA-MPJPE: the joint error that is left after each pose is laid over the true one.

Per frame, the similarity (rotation, translation and scale; no reflection) that minimizes the
squared error is applied first: orthogonal Procrustes. Gower 1975; used so by Kanazawa et al. 2018,
"End-to-end recovery of human shape and pose", section 4.

    M = Σ_j (q_j − q̄)(p_j − p̄)ᵀ = U S Vᵀ,   R = U D Vᵀ,   D = diag(1, 1, det U Vᵀ),
    s = tr(S D) / Σ_j |p_j − p̄|²,   error = |s R (p − p̄) − (q − q̄)|
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def pa_errors(
    predicted: Float[np.ndarray, "*frames joints 3"], true: Float[np.ndarray, "*frames joints 3"]
) -> Float[np.ndarray, "*frames"]:
    """Returns the mean joint error of each frame after alignment, in the unit of the joints."""
    p, q = _centered(predicted), _centered(true)
    u, s, vt = np.linalg.svd(np.swapaxes(q, -1, -2) @ p)
    s[..., 2] *= np.sign(np.linalg.det(u @ vt))
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    size = np.maximum((p**2).sum(axis=(-2, -1)), np.finfo(np.float64).tiny)
    scale = (s.sum(axis=-1) / size)[..., None, None]
    laid = scale * (p @ np.swapaxes(u @ vt, -1, -2))
    return np.linalg.norm(laid - q, axis=-1).mean(axis=-1)


def pa_mpjpe(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> float:
    """Returns the mean joint error after alignment in millimeters, for joints in meters."""
    return 1000 * float(pa_errors(predicted, true).mean())


def _centered(joints: Float[np.ndarray, "*frames joints 3"]) -> Float[np.ndarray, "*frames _ 3"]:
    joints = np.asarray(joints, np.float64)
    return joints - joints.mean(axis=-2, keepdims=True)
