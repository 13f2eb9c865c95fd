"""The channels of glTF's animations, sampled: steps, straight lines and great arcs, cubic splines.

Between keys k and k + 1, d seconds apart, at the share s of the way, glTF's cubic spline is
Hermite's with the tangents d b_k and d a_{k+1}; its keys are triples (in-tangent a, value, b).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.formats.bones import even_rate
from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.rotations import slerp

_PATHS = ("translation", "rotation", "scale")


@dataclass(frozen=True, eq=False)
class Track:
    """One property of one node over time."""

    node: int
    """Whose it is."""
    path: str
    """`translation`, `rotation` or `scale`."""
    times: Float[np.ndarray, " keys"]
    """Seconds, rising."""
    values: Float[np.ndarray, "rows values"]
    """One row a key, or three of a cubic spline; quaternions are (x, y, z, w)."""
    interpolation: str
    """`LINEAR`, `STEP` or `CUBICSPLINE`."""

    def sample(self, times: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames values"]:
        """Returns its values at any times; before the first and after the last key it holds."""
        last = max(len(self.times) - 2, 0)
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, last)
        after = np.minimum(before + 1, len(self.times) - 1)
        span = self.times[after] - self.times[before]
        share = (times - self.times[before]) / np.where(span > 0, span, 1)
        share = np.clip(np.where(span > 0, share, 0), 0, 1)
        if self.interpolation == "CUBICSPLINE":
            return self._cubic(before, after, span[:, None], share[:, None])
        if self.interpolation == "STEP":
            return self.values[np.where(share > 1 - 1e-6, after, before)]
        start, end = self.values[before], self.values[after]
        if self.path == "rotation":
            return slerp(start, end, share)
        return start + share[:, None] * (end - start)

    def _cubic(
        self, before: np.ndarray, after: np.ndarray, span: np.ndarray, s: np.ndarray
    ) -> Float[np.ndarray, "frames values"]:
        keys = self.values.reshape(len(self.times), 3, -1)
        start, end = keys[before, 1], keys[after, 1]
        leave, arrive = span * keys[before, 2], span * keys[after, 0]
        return (
            (2 * s**3 - 3 * s**2 + 1) * start
            + (s**3 - 2 * s**2 + s) * leave
            + (3 * s**2 - 2 * s**3) * end
            + (s**3 - s**2) * arrive
        )


def read_tracks(document: Document, animation: Mapping[str, Any]) -> list[Track]:
    """Returns the channels of one animation that move nodes; shapes that morph are left out."""
    tracks = []
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        if "node" in target and target["path"] in _PATHS:
            times, values = (document.array(sampler[side]) for side in ("input", "output"))
            kind = sampler.get("interpolation", "LINEAR")
            tracks.append(_track(target["node"], target["path"], times, values, kind))
    return tracks


def clock(tracks: Sequence[Track]) -> tuple[float, Float[np.ndarray, " frames"]]:
    """Returns the rate at which all keys fall on frames, and the time of each frame."""
    times = [track.times for track in tracks]
    return even_rate(np.unique(np.concatenate(times)) if times else np.zeros(0))


def _track(node: int, path: str, times: np.ndarray, values: np.ndarray, kind: str) -> Track:
    rows, width = len(times) * (3 if kind == "CUBICSPLINE" else 1), 4 if path == "rotation" else 3
    if values.shape != (rows, width) or not len(times):
        raise ValueError(f"{path} of node {node} has {values.shape}, expected {(rows, width)}")
    times, values = times.astype(np.float64), values.astype(np.float64)
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise ValueError(f"{path} of node {node} has NaN, or times that do not rise")
    return Track(node, path, times, values, kind)
