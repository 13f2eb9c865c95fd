"""Fits: recordings with noise or without some joints, beside lines and smoothers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.directing.bench import CLIP, Bench, Rows, jitter
from benchmarks.directing.smoothers import kalman, spline
from latentmotion.control.fit_keypoints import fit_motion
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion

_LEGS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("knee", "ankle", "foot")
)
_SEEN = ("pelvis", "head", "left_wrist", "right_wrist")


@dataclass(frozen=True)
class Spoiled:
    """A way to spoil a recording."""

    noise: float  # Deviation of each coordinate, meters.
    gap: float = 0.0  # Seconds in the middle without some joints.
    unseen: tuple[str, ...] = HUMANML3D.names  # These joints.

    def seen(self, motion: Motion) -> Bool[np.ndarray, "frames joints"]:
        """Returns which joints of a motion are seen."""
        found, half = np.ones(motion.joints.shape[:2], bool), len(motion) // 2
        width = round(self.gap * motion.fps / 2)
        names = motion.skeleton.names
        found[half - width : half + width, [names.index(name) for name in self.unseen]] = False
        return found


CASES = {
    "noise 5 cm": Spoiled(0.05),
    "noise 5 cm, legs unseen 1 s": Spoiled(0.05, 1.0, _LEGS),
    "legs unseen 1 s": Spoiled(0.01, 1.0, _LEGS),
    "legs never seen": Spoiled(0.01, 100.0, _LEGS),
    "one arm never seen": Spoiled(0.01, 100.0, ("left_elbow", "left_wrist")),
    "all but head, hands and pelvis unseen": Spoiled(
        0.01, 100.0, tuple(name for name in HUMANML3D.names if name not in _SEEN)
    ),
    "nothing seen 0.5 s": Spoiled(0.01, 0.5),
    "nothing seen 1 s": Spoiled(0.01, 1.0),
}


def fit_rows(bench: Bench) -> Rows:
    """Measures how far fitted and cleaned motions are from what was recorded."""
    motions = [each.motion for each in bench.recordings(4.0, 5.0)[: max(2, bench.count // 5)]]
    rows = {"real motion": {"Jitter, m/s³": np.array([jitter(motion) for motion in motions])}}
    every, clip_of = bench.repeated(motions)
    for name, spoiled in CASES.items():
        found: dict[str, list[tuple[float, float]]] = {}
        for number, motion in enumerate(every):
            for method, values in _measured(bench, motion, spoiled, number).items():
                found.setdefault(method, []).append(values)
        rows |= {
            f"{name}: {method}": {
                "Off, cm": np.array([off for off, _ in values]),
                "Jitter, m/s³": np.array([shaken for _, shaken in values]),
                CLIP: clip_of,
            }
            for method, values in found.items()
        }
    return rows


def _measured(
    bench: Bench, motion: Motion, spoiled: Spoiled, number: int
) -> dict[str, tuple[float, float]]:
    """Returns error of the unseen joints, or of all, and jitter, by method."""
    real, seen = motion.joints.astype(np.float64), spoiled.seen(motion)
    noisy = real + np.random.default_rng(number).normal(0, spoiled.noise, real.shape)
    asked = seen if seen.all() else ~seen
    fitted = fit_motion(bench.generate, noisy, seen)
    cleaned = fitted.cleaned().joints.astype(np.float64)
    # Clean-up puts the figure on the floor, the recording's need not be there.
    cleaned[..., 1] += np.median(fitted.joints[:, 0, 1] - cleaned[:, 0, 1])
    methods: dict[str, Float[np.ndarray, "frames joints 3"]] = {}
    if seen.any(axis=0).all():
        methods = {
            "recorded" if seen.all() else "linear interpolation": _interpolated(noisy, seen),
            "spline": spline(noisy, seen, spoiled.noise),
            "Kalman smoother": kalman(noisy, seen, spoiled.noise, motion.fps),
        }
    methods |= {"fit": fitted.joints.astype(np.float64), "fit, cleaned": cleaned}
    return {
        name: (
            100 * float(np.linalg.norm(joints - real, axis=-1)[asked].mean()),
            jitter(Motion(joints.astype(np.float32), motion.fps, motion.skeleton)),
        )
        for name, joints in methods.items()
    }


def _interpolated(
    joints: Float[np.ndarray, "frames joints 3"], seen: Bool[np.ndarray, "frames joints"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints that go straight from where they were last seen to where they are next."""
    made, frames = joints.copy(), np.arange(len(joints))
    for joint in np.flatnonzero(~seen.all(axis=0) & seen.any(axis=0)):
        own = seen[:, joint]
        for axis in range(3):
            made[:, joint, axis] = np.interp(frames, frames[own], joints[own, joint, axis])
    return made
