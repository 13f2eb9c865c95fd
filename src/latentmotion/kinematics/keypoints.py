"""Keypoints: tracked points of a person over time, and the joints that their names mean.

Known are HumanML3D's 22 joints and the layouts of COCO (17, OpenPose's 18, 133 of the whole body),
Halpe (26, 136), OpenPose's BODY_25, MediaPipe (33) and Human3.6M (17).
A keypoint is a joint, or a weighted sum of joints: an ear lies above the head's joint, to the side
of it; the big toe beyond the foot's. Nose, eyes, mouth, heels and fingers are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError, named
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.storage.limits import FARTHEST, LEAST_FPS, MOST_FPS, MOST_FRAMES
from latentmotion.storage.reading import packaged_toml

# Where keypoints are; a third number of 2D ones is 0.
KeypointPaths = Float[np.ndarray, "frames keypoints 3"]


def _names(text: str) -> tuple[str, ...]:
    """Returns the names of a layout: `@` is left, then right; `face*68` counts from 0."""
    names: list[str] = []
    for word in text.split():
        name, _, count = word.partition("*")
        names += [f"{name}_{number}" for number in range(int(count))] if count else []
        if not count:
            names += [name.replace("@", side) for side in (SIDES if "@" in name else ("",))]
    return tuple(names)


# Names of the keypoints of each layout, in order.
LAYOUTS: Mapping[str, tuple[str, ...]] = {
    "humanml3d": HUMANML3D.names,
    **{name: _names(text) for name, text in packaged_toml(__file__, "keypoints.toml").items()},
}

# Keypoints that say too little about joints to be read.
UNREAD = frozenset(
    name
    for names in LAYOUTS.values()
    for name in names
    if re.search(r"nose|eye|mouth|pinky|index$|thumb|small_toe|heel|spine|face|hand_", name)
    and not name.endswith("foot_index")
    and name not in HUMANML3D.names
)

# Weights of keypoints that are only near the joint whose name they have or stand for.
_TRUST = {"ear": 0.25, "head_top": 0.25, "big_toe": 0.5, "foot_index": 0.5, "hip": 0.7}


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Points of one person in a recording.

    Raises:
        InputError: Sizes do not fit, a name is unknown, or a number is out of range.
    """

    # Meters, y up; or pixels, right and down, where there are two coordinates. NaN: not seen.
    points: Float[np.ndarray, "frames keypoints coordinates"]
    confidence: Float[np.ndarray, "frames keypoints"]  # 0 where a point was not seen, up to 1.
    fps: float  # Frames per second.
    names: tuple[str, ...]  # One per keypoint.
    size: tuple[float, float] | None = None  # Width and height of the picture, pixels.
    focal: float | None = None  # Pixels for one meter at one meter's distance.

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
        visible = np.isfinite(points).all(axis=2) & (np.nan_to_num(confidence) > 0)
        if (
            np.isinf(points[confidence > 0]).any()
            or np.abs(points[visible]).max(initial=0) > FARTHEST
        ):
            raise InputError(f"a point is beyond {FARTHEST:,.0f}; write NaN where it was not seen")
        if self.size is not None and not all(0 < side <= FARTHEST for side in self.size):
            raise InputError(f"a picture of {self.size[0]:g} by {self.size[1]:g} pixels")
        if self.focal is not None and not 0 < self.focal <= FARTHEST:
            raise InputError(f"a focal length of {self.focal:g} pixels, expected a positive number")
        readable = visible & np.array([name not in UNREAD for name in names])
        if readable.sum() < 8:
            raise InputError(
                f"{readable.sum()} points of joints were seen in {len(points)} frames, expected at "
                "least 8; is the mask the right way round? True and 1 mean seen"
            )
        object.__setattr__(self, "points", np.where(visible[..., None], points, np.nan))
        object.__setattr__(self, "confidence", np.where(visible, confidence, 0.0))
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
        points: Points as in `Keypoints`; a `Keypoints` is returned as it is.
        seen: True or a confidence where a point was seen; by default everywhere.
        fps: Frames per second.
        names: Names of the keypoints; by default those of the layout of this number.

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
        names = layout_of(points.shape[1], points.shape[2])
    return Keypoints(points, confidence, fps, tuple(names))


def canonical_names(names: Sequence[str]) -> tuple[str, ...]:
    """Returns names of keypoints as they are known here, OpenPose's among them.

    Raises:
        InputError: A name is unknown or given twice.
    """
    openpose = "MidHip" in names
    canonical = []
    for name in names:
        plain = re.sub(r"^([LR])(?=[A-Z])", lambda m: {"L": "left_", "R": "right_"}[m[1]], name)
        plain = re.sub(r"(?<=[a-z])(?=[A-Z])|[ -]+", "_", plain.strip()).lower()
        canonical.append("mid_shoulder" if openpose and plain == "neck" else plain)
    vocabulary = dict.fromkeys(name for layout in LAYOUTS.values() for name in layout)
    for name in canonical:
        named("keypoint", name, vocabulary)
    if len(set(canonical)) < len(canonical):
        twice = next(name for name in canonical if canonical.count(name) > 1)
        raise InputError(f"the keypoint {twice} is given twice")
    return tuple(canonical)


def layout_of(count: int, coordinates: int = 2) -> tuple[str, ...]:
    """Returns the names of the layout of so many keypoints.

    Args:
        count: Number of keypoints.
        coordinates: 2 for pixels, 3 for meters.

    Raises:
        InputError: No known layout has so many, or several do.
    """
    fitting = {layout: names for layout, names in LAYOUTS.items() if len(names) == count}
    if coordinates == 3 and len(fitting) > 1:
        # What lifts pictures writes Human3.6M's 17 in 3D, in COCO's number and another order.
        raise InputError(
            f"{count} points in 3D are {' or '.join(fitting)}, which have other orders; say which "
            "with --layout or names="
        )
    if fitting:
        return fitting.get("coco_17", next(iter(fitting.values())))
    layouts = ", ".join(f"{len(names)} ({layout})" for layout, names in LAYOUTS.items())
    raise InputError(
        f"{count} keypoints without names: known are {layouts}; give their names, or --layout"
    )


def joint_weights(names: Sequence[str]) -> Float[np.ndarray, "keypoints joints"]:
    """Returns each keypoint as a weighted sum of HumanML3D's joints; 0 where it is not read.

    Args:
        names: Canonical names.
    """
    matrix = np.zeros((len(names), len(HUMANML3D)))
    for row, name in zip(matrix, names, strict=True):
        side, part = name.split("_")[0], name.removeprefix("mid_")
        weights: dict[str, float] = {}
        if name in HUMANML3D.names:
            weights = {name: 1.0}
        elif name in ("mid_hip", "mid_shoulder"):
            weights = {f"left_{part}": 0.5, f"right_{part}": 0.5}
        elif name == "head_top":
            # Beyond the head joint, which is at the skull's base, by nearly the length of the neck.
            weights = {"head": 1.9, "neck": -0.9}
        elif name.endswith("_ear"):
            other = {"left": "right", "right": "left"}[side]
            aside = {f"{side}_shoulder": 0.19, f"{other}_shoulder": -0.19}
            weights = {"head": 1.5, "neck": -0.5, **aside}
        elif name.endswith(("_big_toe", "_foot_index")):
            # HumanML3D's foot joint is the ball; the toe's tip is a third of the foot's length
            # beyond.
            weights = {f"{side}_foot": 1.33, f"{side}_ankle": -0.33}
        for joint, weight in weights.items():
            row[HUMANML3D.names.index(joint)] += weight
    return matrix


# Limbs by which a body is measured.
LIMBS = tuple(
    (f"{side}_{start}", f"{side}_{end}")
    for side in ("left", "right")
    for limb in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
    for start, end in pairwise(limb)
)


def limb_ratio(points: KeypointPaths, names: Sequence[str], noise: float = 0.0) -> float | None:
    """Returns how long limbs are beside an adult's; None where none is seen.

    Args:
        points: The keypoints.
        names: Their names.
        noise: Their deviation, which makes bones longer.
    """
    lengths, ratios = np.linalg.norm(HUMANML3D.offsets, axis=-1), []
    for start, end in LIMBS:
        if start in names and end in names:
            bone = points[:, names.index(end)] - points[:, names.index(start)]
            square = float(np.median(np.nan_to_num((bone**2).sum(axis=1), nan=np.inf)))
            # Noise of both ends lengthens a limb: 3 coordinates of 2 points, each of variance
            # noise².
            length = np.sqrt(max(square - 6 * noise**2, 1e-12))
            ratios.append(length / lengths[HUMANML3D.names.index(end)])
    ratios = [ratio for ratio in ratios if np.isfinite(ratio) and ratio < 1e9]
    return float(np.median(ratios)) if ratios else None


def upward(points: KeypointPaths, names: Sequence[str]) -> Float[np.ndarray, "frames 3"]:
    """Returns unit vectors from the legs to the shoulders or the head; NaN where not seen."""
    low, high = (_middle(points, names, parts) for parts in (_LOW, _HIGH))
    line = high - low
    with np.errstate(invalid="ignore"):
        return line / np.linalg.norm(line, axis=1, keepdims=True)


_LOW, _HIGH = ("ankle", "knee", "hip"), ("shoulder", "ear", "head")


def _middle(points: np.ndarray, names: Sequence[str], parts: Sequence[str]) -> np.ndarray:
    for part in parts:
        columns = [n for n, name in enumerate(names) if name.split("_")[-1] == part]
        if columns:
            return points[:, columns].mean(axis=1)
    return np.full(points[:, 0].shape, np.nan)


def grounded(points: KeypointPaths, names: Sequence[str], fps: float) -> tuple[KeypointPaths, bool]:
    """Returns points whose origin is between the hips, as MediaPipe's, with their path, y up.

    The lower foot stands: it does not move, so that the body does. The lowest point of both is on
    the floor, at height 0.

    Args:
        points: Meters, y up.
        names: Their names.
        fps: Frames per second.

    Returns:
        The points, as they are where their origin is elsewhere; and whether a path was estimated.
    """
    feet = [
        [n for n, name in enumerate(names) if re.fullmatch(rf"{side}_({_FOOT})", name)]
        for side in ("left", "right")
    ]
    hips = np.linalg.norm(_middle(points, names, ("hip",)), axis=-1)
    if not all(feet) or not np.median(np.nan_to_num(hips, nan=np.inf)) < _CENTERED:
        return points, False
    frames = np.arange(len(points), dtype=float)
    width = max(1, round(_STEADY * fps))
    kernel = np.hanning(2 * width + 1)
    smooth = np.empty((len(points), 3, len(names)))
    columns = [*feet[0], *feet[1]]
    for column in columns:
        finite = np.isfinite(points[:, column]).all(axis=1)
        for axis in range(3):
            track = np.zeros(len(points))
            if finite.any():
                track = np.interp(frames, frames[finite], points[finite, column, axis])
            padded = np.pad(track, width, mode="edge")
            smooth[:, axis, column] = np.convolve(padded, kernel / kernel.sum(), "valid")
    standing = np.stack([smooth[:, :, foot].mean(axis=2) for foot in feet])
    heights = (standing[:, 1:, 1] + standing[:, :-1, 1]) / 2
    weights = np.exp(-(heights - heights.min(axis=0)) / _FADING)[..., None]
    steps = (np.diff(standing, axis=1) * weights).sum(axis=0) / weights.sum(axis=0)
    path = np.zeros((len(points), 3))
    path[1:] = -np.cumsum(steps, axis=0)
    ankles = all(names[column].endswith("ankle") for column in columns)
    path[:, 1] = (_ANKLE if ankles else 0.0) - smooth[:, 1][:, columns].min(axis=1)
    return points + path[:, None], True


_FOOT = "ankle|heel|foot_index|big_toe|small_toe|foot"

# Meters from the origin up to which hips are at it.
_CENTERED = 0.03

# Seconds over which feet are smoothed; meters by which a foot is higher than the other to count a
# third of it; height of the ankle of a standing person, meters.
_STEADY, _FADING, _ANKLE = 0.1, 0.003, 0.08
