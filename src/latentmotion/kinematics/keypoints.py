"""Keypoints: what a tracker saw of a person over time, and which joints its names stand for.

Known are HumanML3D's 22 joints and the layouts of COCO (17), OpenPose (BODY_25) and MediaPipe (33).
A keypoint is a joint, or a weighted sum of joints: an ear lies above the head's joint, to the side
of it; the big toe beyond the foot's. Nose, eyes, mouth, heels and fingers are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError, hint
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.storage.limits import FARTHEST, LEAST_FPS, MOST_FPS, MOST_FRAMES


def _both(text: str) -> tuple[str, ...]:
    return tuple(
        name.replace("@", side)
        for name in text.split()
        for side in (("left", "right") if "@" in name else ("",))
    )


def _body_25() -> tuple[str, ...]:
    arms, legs = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
    names = ["nose", "mid_shoulder"]
    names += [f"{side}_{part}" for side in ("right", "left") for part in arms] + ["mid_hip"]
    names += [f"{side}_{part}" for side in ("right", "left") for part in legs]
    names += ["right_eye", "left_eye", "right_ear", "left_ear"]
    toes = ("big_toe", "small_toe", "heel")
    return (*names, *(f"{side}_{part}" for side in ("left", "right") for part in toes))


_LIMBS = "@_shoulder @_elbow @_wrist"
_LEGS = "@_hip @_knee @_ankle"
_SIDED_EYES = tuple(
    f"{side}_eye{part}" for side in ("left", "right") for part in ("_inner", "", "_outer")
)

LAYOUTS: Mapping[str, tuple[str, ...]] = {
    "humanml3d": HUMANML3D.names,
    "coco_17": ("nose", *_both(f"@_eye @_ear {_LIMBS} {_LEGS}")),
    "body_25": _body_25(),
    "mediapipe_33": (
        "nose",
        *_SIDED_EYES,
        *_both("@_ear mouth_@"),
        *_both(f"{_LIMBS} @_pinky @_index @_thumb {_LEGS} @_heel @_foot_index"),
    ),
}
"""Names of the keypoints of each layout, in order. OpenPose's Neck is `mid_shoulder`."""

UNREAD = frozenset(
    name
    for names in LAYOUTS.values()
    for name in names
    if re.search(r"nose|eye|mouth|pinky|index$|thumb|small_toe|heel", name)
    and not name.endswith("foot_index")
)
"""Keypoints that say too little about joints to be read."""

_TRUST = {"ear": 0.25, "big_toe": 0.5, "foot_index": 0.5, "hip": 0.7}
"""Weights of keypoints that are only near the joint whose name they have or stand for."""


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Points of one person in a recording.

    Raises:
        InputError: Sizes do not fit, a name is unknown, or a number is out of range.
    """

    points: Float[np.ndarray, "frames keypoints coordinates"]
    """Meters, y up; or pixels, right and down, where there are two coordinates. NaN: not seen."""
    confidence: Float[np.ndarray, "frames keypoints"]
    """0 where a point was not seen, up to 1."""
    fps: float
    """Frames per second."""
    names: tuple[str, ...]
    """One per keypoint."""
    size: tuple[float, float] | None = None
    """Width and height of the picture, pixels."""
    focal: float | None = None
    """Pixels for one meter at one meter's distance."""

    def __post_init__(self) -> None:
        points, confidence = (np.asarray(x, np.float64) for x in (self.points, self.confidence))
        names = canonical_names(self.names)
        if points.ndim != 3 or points.shape[2] not in (2, 3) or points.shape[1] != len(names):
            raise InputError(
                f"points of shape {points.shape}: expected (frames, {len(names)} keypoints, "
                "2 for pixels or 3 for meters)"
            )
        if not 2 <= len(points) <= MOST_FRAMES:
            raise InputError(f"{len(points):,} frames, expected 2 to {MOST_FRAMES:,}")
        if confidence.shape != points.shape[:2]:
            raise InputError(
                f"confidence of shape {confidence.shape}, expected {points.shape[:2]}: one number "
                "for each keypoint in each frame"
            )
        if not (np.nan_to_num(confidence) >= 0).all() or np.nan_to_num(confidence).max() > 1:
            raise InputError("a confidence is not from 0, not seen, to 1")
        if not LEAST_FPS <= self.fps <= MOST_FPS:
            raise InputError(f"fps is {self.fps}, expected {LEAST_FPS:g} to {MOST_FPS:,.0f}")
        seen = np.isfinite(points).all(axis=2) & (np.nan_to_num(confidence) > 0)
        if np.isinf(points[confidence > 0]).any() or np.abs(points[seen]).max(initial=0) > FARTHEST:
            raise InputError(f"a point is beyond {FARTHEST:,.0f}; write NaN where it was not seen")
        if self.size is not None and not all(0 < side <= FARTHEST for side in self.size):
            raise InputError(f"a picture of {self.size[0]:g} by {self.size[1]:g} pixels")
        if self.focal is not None and not 0 < self.focal <= FARTHEST:
            raise InputError(f"a focal length of {self.focal:g} pixels, expected a positive number")
        used = seen & np.array([name not in UNREAD for name in names])
        if used.sum() < 8:
            raise InputError(
                f"{used.sum()} points of joints were seen in {len(points)} frames, expected at "
                "least 8; is the mask the right way round? True and 1 mean seen"
            )
        object.__setattr__(self, "points", np.where(seen[..., None], points, np.nan))
        object.__setattr__(self, "confidence", np.where(seen, confidence, 0.0))
        object.__setattr__(self, "names", names)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def flat(self) -> bool:
        """True where the points are pixels."""
        return self.points.shape[2] == 2

    @property
    def weights(self) -> Float[np.ndarray, "frames keypoints"]:
        """Weight of each point: its confidence times the weight of its kind."""
        trust = [
            next((w for part, w in _TRUST.items() if name.endswith(part)), 1.0)
            if self.names != HUMANML3D.names
            else 1.0
            for name in self.names
        ]
        read = [name not in UNREAD for name in self.names]
        return self.confidence * np.where(read, trust, 0.0)


def keypoints_of(
    points: Float[np.ndarray, "frames keypoints coordinates"] | Keypoints,
    seen: np.ndarray | None,
    fps: float,
    names: Sequence[str] | None,
) -> Keypoints:
    """Returns arrays as keypoints.

    Args:
        points: As `Keypoints` has them; one that is given is returned.
        seen: True or a confidence where a point was seen; by default everywhere.
        fps: Frames per second.
        names: Of the keypoints; by default those of the layout with so many.

    Raises:
        InputError: Sizes do not fit, a name is unknown, or a number is out of range.
    """
    if isinstance(points, Keypoints):
        if seen is not None or names is not None:
            raise InputError("keypoints have names and confidence of their own: leave the others")
        return points
    points = np.asarray(points, np.float64)
    if points.ndim != 3:
        raise InputError(f"points of shape {points.shape}: expected (frames, keypoints, 2 or 3)")
    confidence = np.ones(points.shape[:2]) if seen is None else np.asarray(seen, np.float64)
    if names is None:
        names = layout_of(points.shape[1])
    return Keypoints(points, confidence, fps, tuple(names))


def canonical_names(names: Sequence[str]) -> tuple[str, ...]:
    """Returns names of keypoints as they are known here, OpenPose's among them.

    Raises:
        InputError: A name is unknown or given twice.
    """
    openpose = "MidHip" in names
    found = []
    for name in names:
        plain = re.sub(r"^([LR])(?=[A-Z])", lambda m: {"L": "left_", "R": "right_"}[m[1]], name)
        plain = re.sub(r"(?<=[a-z])(?=[A-Z])|[ -]+", "_", plain.strip()).lower()
        found.append("mid_shoulder" if openpose and plain == "neck" else plain)
    known = dict.fromkeys(name for layout in LAYOUTS.values() for name in layout)
    for name in found:
        if name not in known:
            raise InputError(f"unknown keypoint {name!r}: {hint(name, known)}")
    if len(set(found)) < len(found):
        twice = next(name for name in found if found.count(name) > 1)
        raise InputError(f"the keypoint {twice} is given twice")
    return tuple(found)


def layout_of(count: int) -> tuple[str, ...]:
    """Returns the names of the layout of so many keypoints.

    Raises:
        InputError: No known layout has so many.
    """
    for names in LAYOUTS.values():
        if len(names) == count:
            return names
    known = ", ".join(f"{len(names)} ({layout})" for layout, names in LAYOUTS.items())
    raise InputError(f"{count} keypoints without names: known are {known}; give their names")


def joint_weights(names: Sequence[str]) -> Float[np.ndarray, "keypoints joints"]:
    """Returns each keypoint as a weighted sum of HumanML3D's joints; 0 where it is not read.

    Args:
        names: Canonical names.
    """
    found = np.zeros((len(names), len(HUMANML3D)))
    for row, name in zip(found, names, strict=True):
        side, part = name.split("_")[0], name.removeprefix("mid_")
        weights: dict[str, float] = {}
        if name in HUMANML3D.names:
            weights = {name: 1.0}
        elif name in ("mid_hip", "mid_shoulder"):
            weights = {f"left_{part}": 0.5, f"right_{part}": 0.5}
        elif name.endswith("_ear"):
            other = {"left": "right", "right": "left"}[side]
            aside = {f"{side}_shoulder": 0.19, f"{other}_shoulder": -0.19}
            weights = {"head": 1.5, "neck": -0.5, **aside}
        elif name.endswith(("_big_toe", "_foot_index")):
            weights = {f"{side}_foot": 1.33, f"{side}_ankle": -0.33}
        for joint, weight in weights.items():
            row[HUMANML3D.names.index(joint)] += weight
    return found
