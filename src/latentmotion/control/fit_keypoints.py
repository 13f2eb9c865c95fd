"""Keypoints become a motion: latents, place and camera are found of which a tracker would see that.

    start    smoothed keypoints → root, heading and joints → features → latents      (L-BFGS)
    refine   Huber's loss of the keypoints + what is likely by itself                (L-BFGS)
             noise is estimated, what is far beyond it is dropped, and it is refined again
    detail   what latents cannot express, as far as it stands out of the noise; short gaps are
             drawn toward a cubic curve

Likely are latents near 0 that change slowly, Σ (z_t - ρ z_{t-1})² / (1 - ρ²), and joints that keep
their speed. Recordings longer than the model's motions are fitted in windows that overlap.

Observation: keypoints beside the joints of a motion; how far off they are, with derivatives.

    joints of the motion → turned by yaw, tilted by pitch, shifted → in time between two frames
    → keypoints, weighted sums of joints → a camera's picture, if they are flat → Huber's loss

A camera is at the origin and looks along +z, y up; so its right is -x. What is off in its picture
counts in meters at the person's distance.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import ramp
from latentmotion.control.generator import Generator, decoders_of
from latentmotion.control.reach import (
    DecodedMotion,
    fit_features,
    joint_features,
    latent_width,
    lbfgs,
)
from latentmotion.errors import InputError, ReadingWarning
from latentmotion.kinematics.keypoints import (
    LIMBS,
    KeypointPaths,
    Keypoints,
    grounded,
    joint_weights,
    keypoints_of,
    limb_ratio,
)
from latentmotion.kinematics.skeleton import HUMANML3D, Joints
from latentmotion.motion import Motion
from latentmotion.representation.canonical import turn
from latentmotion.representation.humanml3d import HumanML3DRepresentation

Curve = Float[np.ndarray, " frames"]


# Correlation of a latent with the one before, in recordings of the test split: 0.7 to 0.95.
_LAG = 0.85

# Meters that latents are off recordings by themselves.
_EXPRESSED = 0.02

# Frames over which halves of what they are off last.
_LASTING = (3.0, 15.0)

# Meters by which a joint is elsewhere than where it would be at the speed of the frame before.
_PUSH = 0.01

# Meters between which the noise of a tracker is taken to be.
_LEAST_NOISE, _MOST_NOISE = 0.002, 0.3

# Frames that are fitted at once, and that two windows share.
_WINDOW, _OVERLAP = 160, 40

# Meters that a joint is off in a gap: by the latents, and by a curve over a gap of one second.
_UNSEEN, _BRIDGED = 0.04, 0.12

# Whose two sides show the heading of a body.
_TRUNK = ("hip", "shoulder")

# Whose two sides show it roughly.
_SIDES = ("knee", "ankle", "foot", "elbow", "wrist", "ear")

# Heights of pelvis and knees of a standing person, meters.
_PELVIS, _KNEE = 0.93, 0.45

# Share of its loss that counts where the floor is at 0, as it mostly is.
_COMMON = 0.95

# Meters of the pelvis above the middle of the hips.
_ABOVE_HIPS = 0.09

# Deviations beyond which a keypoint is taken for a mistake of the tracker.
_OUTLIER = 6.0

# Degrees that a picture of unknown focal length shows from side to side.
_FIELD_OF_VIEW = 60.0

# Bones that show how far away a person is, with their lengths in meters.
_UPRIGHT = (("mid_shoulder", "mid_hip", 0.5), ("mid_shoulder", "mid_ankle", 1.3))


def fit_motion(
    generator: Generator,
    joints: Float[np.ndarray, "frames keypoints coordinates"] | Keypoints,
    seen: np.ndarray | None = None,
    fps: float | None = None,
    names: Sequence[str] | None = None,
    noise: float | None = None,
) -> Motion:
    """Returns a clean motion near joints that were recorded with noise, gaps or one camera.

    Nothing is sampled: of all motions that the decoder can make, it is the likely one that explains
    what was seen. It lasts as long as the recording and is where that is, in the person's size.

    Args:
        generator: The model.
        joints: Meters, y up; or pixels, right and down. NaN is not seen. A `Keypoints` has names,
            frame rate and camera with it.
        seen: True, or a confidence up to 1, where a joint was seen; by default everywhere.
        fps: Frames per second of the recording; by default the model's.
        names: Of the keypoints: HumanML3D's, COCO's, OpenPose's or MediaPipe's; by default those
            of the layout with so many.
        noise: Deviation of what was recorded, meters; by default it is estimated.

    Raises:
        InputError: Shapes do not fit, a name is unknown, or hardly anything was seen; or the
            model's features are of another kind.
        ModelError: The model has no `pullback.onnx`.
    """
    motion, space = decoders_of(generator), generator.representation
    keypoints = keypoints_of(joints, seen, space.fps if fps is None else fps, names)
    joint_features(motion(1).representation)
    if space.skeleton.names != HUMANML3D.names:
        raise InputError(
            f"model {generator.card.name!r} moves {space.skeleton.name!r}: keypoints are fitted by "
            "models of HumanML3D's joints, such as fast"
        )
    shortest, longest = generator.card.frames
    capture = Capture.of(keypoints, space.fps, noise)
    length = min(_WINDOW, longest)
    pieces, about = [], []
    for start in range(0, max(1, capture.frames - _OVERLAP), max(1, length - _OVERLAP)):
        frames = min(length, capture.frames - start)
        window = capture.window(start, max(frames, shortest))
        joints, facts = _fitted_window(window, motion(window.frames))
        # A camera and the floor stay: later windows take them from those before.
        capture = replace(capture, pitch=facts["pitch"], floor=facts["floor"])
        pieces.append((start, joints[:frames]))
        about.append(facts)
    joints, pitch = np.zeros((capture.frames, *pieces[0][1].shape[1:])), about[0]["pitch"]
    for start, piece in pieces:  # where two windows overlap, one goes over to the other
        share = np.ones(len(piece))
        if start:
            shared = min(_OVERLAP, len(piece))
            share[:shared] = ramp(np.arange(1, shared + 1), 0, shared + 1)
        part = joints[start : start + len(piece)]
        part += share[:, None, None] * (piece - part)
    if capture.flat:
        # From the camera's axes to the floor: the motion starts above the origin.
        joints = tilt(joints, -pitch)
        joints -= [joints[0, 0, 0], np.percentile(joints[..., 1].min(axis=1), 10), joints[0, 0, 2]]
    notes: dict[str, Any] = {
        "noise": round(float(np.mean([window["noise"] for window in about])) / capture.scale, 4),
        "dropped": round(float(np.mean([window["dropped"] for window in about])), 4),
        "scale": round(capture.scale, 4),
    }
    if capture.flat:
        notes["camera"] = {"focal": capture.focal, "pitch": round(float(np.degrees(pitch)), 2)}
    card = generator.card
    metadata = {"model": card.name, **card.terms(), "fit": notes}
    joints = (joints / capture.scale).astype(np.float32)
    return Motion(joints, space.fps, space.skeleton, "", metadata)


# Deviations beyond which what is off counts by its size, no longer by its square.
_HUBER = 3.0

# Meters from the camera at which points nearer to it are taken to be.
_NEAREST = 0.3


@dataclass(frozen=True, eq=False)
class Observation:
    """Keypoints of one person in some frames of a motion."""

    # Meters; or what a camera of focal length 1 sees, right and down. 0 where not seen.
    points: Float[np.ndarray, "observed keypoints coordinates"]
    weights: Float[np.ndarray, "observed keypoints"]  # Weight of each; 0 where it was not seen.
    positions: Float[np.ndarray, " observed"]  # When each was observed, in frames of the motion.
    joints: Float[np.ndarray, "keypoints joints"]  # Each keypoint as a weighted sum of joints.
    frames: int  # Length of the motion.
    # Meters from the camera, roughly, where the points are flat.
    depth: Float[np.ndarray, " observed"] | None = None

    @cached_property
    def times(self) -> Float[np.ndarray, "observed frames"]:
        """Shares of the two frames between which each was observed."""
        before = np.clip(self.positions.astype(int), 0, max(self.frames - 2, 0))
        share, rows = np.clip(self.positions - before, 0, 1), np.arange(len(before))
        shares = np.zeros((len(before), self.frames))
        shares[rows, before] = 1 - share
        shares[rows, np.minimum(before + 1, self.frames - 1)] += share
        return shares

    def missing(self, placed: Joints) -> Float[np.ndarray, "observed keypoints coordinates"]:
        """Returns seen minus expected, meters, for joints where the tracker sees them."""
        expected = self._keypoints(placed)
        if self.depth is not None:
            expected = expected[..., :2] / -np.maximum(expected[..., 2:], _NEAREST)
            return (self.points - expected) * self.depth[:, None, None]
        return self.points - expected

    def loss(
        self, joints: Joints, placement: Float[np.ndarray, " 5"], noise: float
    ) -> tuple[float, Joints, Float[np.ndarray, " 5"]]:
        """Returns Huber's loss, and its derivatives by joints and placement.

        Args:
            joints: A motion as it is decoded.
            placement: Its yaw, x, y, z and pitch.
            noise: Deviation of what was observed, meters.
        """
        yaw, *_, pitch = placement
        turned = turn(joints, np.array(yaw))
        tilted = tilt(turned, pitch)
        placed = tilted + placement[1:4]
        off = self.missing(placed) / noise
        far = np.linalg.norm(off, axis=-1)
        value = np.where(far < _HUBER, 0.5 * far**2, _HUBER * (far - 0.5 * _HUBER))
        gradient = -(self.weights * robust(far))[..., None] * off / noise
        if self.depth is not None:
            points = self._keypoints(placed)
            depth = np.maximum(points[..., 2:], _NEAREST)
            flat = -gradient * self.depth[:, None, None] / depth
            ahead = -(flat * points[..., :2]).sum(axis=-1, keepdims=True) / depth
            ahead = np.where(points[..., 2:] > _NEAREST, ahead, 0)
            gradient = np.concatenate([flat, ahead], axis=-1)
        pull = np.einsum("okc,kj->ojc", gradient, self.joints)
        pull = np.tensordot(self.times, pull, (0, 0))
        around = tilted[..., 1] * pull[..., 2] - tilted[..., 2] * pull[..., 1]
        back = tilt(pull, -pitch)
        about = back[..., 0] * turned[..., 2] - back[..., 2] * turned[..., 0]
        of_placement = np.array([about.sum(), *pull.sum((0, 1)), around.sum()])
        if self.depth is None:
            of_placement[4] = 0
        return float((self.weights * value).sum()), turn(back, np.array(-yaw)), of_placement

    def _keypoints(self, placed: Joints) -> Float[np.ndarray, "observed keypoints 3"]:
        return np.einsum("kj,ojc->okc", self.joints, np.tensordot(self.times, placed, 1))


def robust(far: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Returns Huber's weights of distances, which are in deviations."""
    return _HUBER / np.maximum(far, _HUBER)


def tilt(points: Float[np.ndarray, "*batch 3"], pitch: float) -> Float[np.ndarray, "*batch 3"]:
    """Rotates points about x; a positive angle, radians, moves +y toward +z."""
    c, s = np.cos(pitch), np.sin(pitch)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Capture(Observation):
    """A whole recording in the model's frames and size."""

    names: tuple[str, ...]  # Of the keypoints.
    scale: float = 1.0  # Size of the model's body beside the person's.
    noise: float  # Deviation of what was observed, meters in the model's size.
    focal: float | None = None  # Focal length of the camera, pixels.
    pitch: float | None = None  # Tilt of the camera, radians, once it is known.
    floor: float | None = None  # Height of the floor, meters, once it is known.

    @classmethod
    def of(cls, keypoints: Keypoints, fps: float, noise: float | None) -> Capture:
        """Returns a recording in the model's frames.

        Raises:
            InputError: Bones have no length that people have.
        """
        points, weights, names = keypoints.points, keypoints.weights, keypoints.names
        positions = np.arange(len(points)) * fps / keypoints.fps
        frames = int((len(points) - 1) * fps / keypoints.fps + 1e-6) + 1
        if not keypoints.flat:
            points, guessed = grounded(points, names, keypoints.fps)
            if guessed:
                warnings.warn(
                    "a guess: the hips of all points are at the origin, so the path along the "
                    "floor is what keeps standing feet in place",
                    ReadingWarning,
                    stacklevel=3,
                )
            deviation = white_noise(points)
            scale = body_scale(points, names, deviation)
            deviation = deviation * scale if noise is None else noise * scale
            observed = (
                np.nan_to_num(points) * scale,
                weights,
                positions,
                joint_weights(names),
                frames,
            )
            return cls(*observed, names=names, scale=scale, noise=deviation)
        width, height = keypoints.size or np.nanmax(points, axis=(0, 1))
        focal = keypoints.focal or width / 2 / np.tan(np.radians(_FIELD_OF_VIEW / 2))
        points = (points - np.array([width, height]) / 2) / focal
        depth = camera_distance(points, names, fps=keypoints.fps)
        deviation = white_noise(points * depth[:, None, None]) if noise is None else noise
        observed = np.nan_to_num(points), weights, positions, joint_weights(names), frames, depth
        return cls(*observed, names=names, noise=deviation, focal=focal)

    @property
    def flat(self) -> bool:
        """True where the points are a camera's."""
        return self.depth is not None

    def window(self, start: int, frames: int) -> Capture:
        """Returns so many frames from a frame on."""
        inside = (self.positions >= start) & (self.positions <= start + frames - 1)
        return replace(
            self,
            points=self.points[inside],
            weights=self.weights[inside],
            positions=self.positions[inside] - start,
            depth=None if self.depth is None else self.depth[inside],
            frames=frames,
        )


def white_noise(points: Float[np.ndarray, "frames keypoints n"]) -> float:
    """Returns the deviation of noise that differs from frame to frame, within plausible bounds."""
    third = np.diff(points, n=3, axis=0)
    third = np.abs(third[np.isfinite(third)])
    # The variance of the third difference of white noise is 20 times its own.
    deviation = float(np.median(third)) / 0.6745 / np.sqrt(20) if len(third) else _EXPRESSED
    return float(np.clip(deviation, _LEAST_NOISE, _MOST_NOISE))


def body_scale(points: KeypointPaths, names: tuple[str, ...], noise: float) -> float:
    """Returns the size of the model's body beside the person's, by the lengths of limbs.

    Raises:
        InputError: They are such that the points cannot be meters.
    """
    ratio = limb_ratio(points, names, noise)
    scale = 1 / ratio if ratio else 1.0
    if not 0.5 < scale < 2.5:
        raise InputError(
            f"limbs are {1 / scale:.3g} times as long as an adult's: expected points in meters, "
            "y up: give the unit of a file with --unit; for pixels give two coordinates"
        )
    return scale if abs(scale - 1) > max(0.03, noise) else 1.0


def camera_distance(
    points: Float[np.ndarray, "frames keypoints 2"], names: tuple[str, ...], fps: float
) -> Curve:
    """Returns how far away a person is, meters, by the size that a camera sees.

    Raises:
        InputError: Neither trunk nor limbs were seen.
    """
    lengths = np.linalg.norm(HUMANML3D.offsets, axis=-1)
    pairs = [(a, b, lengths[HUMANML3D.names.index(b)]) for a, b in LIMBS if {a, b} <= set(names)]
    sizes = [
        np.linalg.norm(points[:, names.index(b)] - points[:, names.index(a)], axis=-1) / length
        for a, b, length in pairs
    ]
    for a, b, length in _UPRIGHT:
        ends = [_middle(points, names, name) for name in (a, b)]
        sizes.append(np.linalg.norm(ends[1] - ends[0], axis=-1) / length)
    table = np.stack(sizes)
    visible = np.isfinite(table).any(axis=0)
    if not visible.any():
        raise InputError("neither trunk nor limbs were seen: how far away the person is, is open")
    # What is seen from the side looks shorter, nothing looks longer.
    size = np.nanpercentile(np.where(visible, table, 1.0), 80, axis=0)
    frames = np.arange(len(points), dtype=float)
    size = np.interp(frames, frames[visible], size[visible])
    return (
        1 / np.maximum(_smoothed(size[:, None], np.ones(len(size)), frames, 0.3 * fps), 1e-3)[:, 0]
    )


def _middle(
    points: Float[np.ndarray, "frames keypoints n"], names: tuple[str, ...], name: str
) -> Float[np.ndarray, "frames n"]:
    """Returns a keypoint such as `mid_hip`, itself or from both sides; NaN where it is not seen."""
    if name in names:
        return points[:, names.index(name)]
    sides = [f"{side}_{name.removeprefix('mid_')}" for side in ("left", "right")]
    if not set(sides) <= set(names):
        return np.full(points[:, 0].shape, np.nan)
    return points[:, [names.index(side) for side in sides]].mean(axis=1)


def _smoothed(
    points: Float[np.ndarray, "observed n"],
    weights: Float[np.ndarray, " observed"],
    at: Float[np.ndarray, " observed"],
    width: float,
    frames: int | None = None,
) -> Float[np.ndarray, "frames n"]:
    """Returns points at each frame: Gaussian means of what is near, straight lines elsewhere."""
    times = at if frames is None else np.arange(frames)
    near = np.exp(-0.5 * ((times[:, None] - at) / width) ** 2) * weights
    total = near.sum(axis=1)
    supported = total > 0.1 * weights.max(initial=1e-9)
    means = near @ points / np.maximum(total, 1e-12)[:, None]
    if not supported.any():
        return np.full(means.shape, np.nan)
    return np.stack([np.interp(times, times[supported], row[supported]) for row in means.T], axis=1)


def _fitted_window(capture: Capture, motion: DecodedMotion) -> tuple[Joints, dict[str, float]]:
    """Returns the joints of one window where the tracker sees them, and what was found."""
    width = latent_width(motion)
    if not (capture.weights > 0).any():
        raise InputError(
            f"nothing was seen for {capture.frames / motion.representation.fps:.1f} s: cut the "
            "recording there"
        )
    noise = float(np.hypot(capture.noise, _EXPRESSED))
    candidates = []
    space, (joints, observed) = motion.representation, rough_joints(capture)
    assert isinstance(space, HumanML3DRepresentation)
    for yaw, floor in product(_headings(capture), _floors(capture)):
        # Latents and placement to begin with, from smoothed keypoints.
        place = np.array([joints[0, 0, 0], floor, joints[0, 0, 2]])
        local = turn(joints - place, -yaw[:1, None])
        local = np.concatenate([local, 2 * local[-1:] - local[-2:-1]])
        ahead = np.concatenate([yaw, yaw[-1:]]) - yaw[0]
        features = space.describe(local, ahead)[:, : joint_features(space)]
        weights = np.ones(features.shape)
        weights[:, space.blocks["positions"]] = np.repeat(observed[:, 1:], 3, axis=1)
        z = fit_features(motion, features, weights, 0.2, 30)
        start = np.concatenate([z.ravel(), yaw[:1], place, [capture.pitch or 0.0]])
        value, p = _refined(capture, motion, start, noise, 30 if capture.flat else 100)
        candidates.append((value * (1.0 if floor else _COMMON), p))
    _, p = min(candidates, key=lambda candidate: candidate[0])
    joints = _placed(motion, p, width)
    off = np.linalg.norm(capture.missing(joints), axis=-1)
    visible = capture.weights > 0
    # Medians of the lengths of normal vectors of deviation 1 in three and two dimensions.
    spread = float(np.median(off[visible])) / (1.177 if capture.flat else 1.538)
    noise = float(np.clip(spread, 0.5 * _EXPRESSED, _MOST_NOISE))
    inliers = off < _OUTLIER * noise
    observation = replace(capture, weights=capture.weights * inliers)
    _, p = _refined(observation, motion, p, noise, 80)
    joints = _placed(motion, p, width)
    if not capture.flat:
        joints = joints + _detail(observation, joints, capture.noise)
        joints = _bridged(observation, joints, motion.representation.fps)
    dropped = float((visible & ~inliers).sum() / visible.sum())
    facts = {"noise": capture.noise, "dropped": dropped}
    return joints, facts | {"floor": float(p[-3]), "pitch": float(p[-1])}


def _refined(
    observation: Observation,
    motion: DecodedMotion,
    start: Float[np.ndarray, " numbers"],
    noise: float,
    iterations: int,
) -> tuple[float, Float[np.ndarray, " numbers"]]:
    """Returns the loss of latents and placement near given ones, and these."""
    space, width = motion.representation, latent_width(motion)

    def loss(p: Float[np.ndarray, " numbers"]) -> tuple[float, Float[np.ndarray, " numbers"]]:
        z = p[:-5].reshape(-1, width)
        features = motion.decode(z)
        joints = space.decode(features)
        value, pull, of_placement = observation.loss(joints, p[-5:], noise)
        push = np.diff(joints, n=2, axis=0) / _PUSH**2
        value += 0.5 * _PUSH**2 * float((push**2).sum())
        pull[:-2] += push
        pull[1:-1] -= 2 * push
        pull[2:] += push
        of_latents = motion.rows(z, features, joints, pull[None])[0].astype(np.float64)
        unlikely, slope = unlikeliness(z)
        return value + unlikely, np.concatenate([(of_latents + slope).ravel(), of_placement])

    solution = lbfgs(loss, start, iterations, memory=40)
    return loss(solution)[0], solution


def unlikeliness(
    z: Float[np.ndarray, "tokens width"],
) -> tuple[float, Float[np.ndarray, "tokens width"]]:
    """Returns what latents count by themselves, in the denoiser's scale, and its derivative."""
    change, room = z[1:] - _LAG * z[:-1], 1 - _LAG**2
    slope = np.zeros_like(z)
    slope[0] = z[0]
    slope[1:] += change / room
    slope[:-1] -= _LAG * change / room
    return 0.5 * float((z[0] ** 2).sum() + (change**2).sum() / room), slope


def _placed(motion: DecodedMotion, p: Float[np.ndarray, " numbers"], width: int) -> Joints:
    joints = turn(motion.joints(p[:-5].reshape(-1, width)), np.array(p[-5]))
    return tilt(joints, float(p[-1])) + p[-4:-1]


def _floors(capture: Capture) -> list[float]:
    """Returns heights of the floor to begin with: one, or those that are as likely."""
    joints, observed = rough_joints(capture)
    high = joints[:, 0, 1]
    if capture.flat:
        return [float(np.median(high)) - 0.9]
    parts = {
        HUMANML3D.names[joint].split("_")[-1] for joint in np.flatnonzero(observed.any(axis=0))
    }
    lowest = float(np.percentile(joints[:, observed.any(axis=0), 1], 2))
    if parts & {"ankle", "foot"}:
        return [lowest]
    if capture.floor is not None:
        return [capture.floor]
    # Somebody stands for a while at least; or sits or lies, and the floor is at 0.
    standing = lowest - _KNEE if "knee" in parts else float(np.percentile(high, 80)) - _PELVIS
    near = abs(standing) < 0.1 or not 0 < standing + _PELVIS < 1.4
    return [standing] if near else [standing, 0.0]


def rough_joints(capture: Capture) -> tuple[Joints, Bool[np.ndarray, "frames joints"]]:
    """Returns smoothed joints in each frame, and which were seen; others are at the pelvis."""
    fps_ratio = float(np.diff(capture.positions).mean()) if len(capture.positions) > 1 else 1.0
    width = max(1.2, 0.6 * fps_ratio)
    points = capture.points
    if capture.depth is not None:
        flat = points * capture.depth[:, None, None]
        ahead = np.broadcast_to(capture.depth[:, None, None], (*flat.shape[:2], 1))
        points = np.concatenate([-flat, ahead], axis=-1)
    frames = capture.frames
    tracks = np.full((frames, len(capture.names), 3), np.nan)
    for k in np.flatnonzero((capture.weights > 0).any(axis=0)):
        visible = capture.weights[:, k] > 0
        tracks[:, k] = _smoothed(
            points[visible, k],
            capture.weights[visible, k],
            capture.positions[visible],
            width,
            frames,
        )
    hips, shoulders = (
        _middle(tracks, capture.names, f"mid_{part}") for part in ("hip", "shoulder")
    )
    whole = np.nanmean(tracks, axis=1)
    pelvis = np.where(
        np.isfinite(hips), hips + np.array([0, _ABOVE_HIPS, 0]), shoulders - np.array([0, 0.5, 0])
    )
    pelvis = np.where(np.isfinite(pelvis), pelvis, whole)
    if "pelvis" in capture.names:
        track = tracks[:, capture.names.index("pelvis")]
        pelvis = np.where(np.isfinite(track), track, pelvis)
    joints = np.repeat(pelvis[:, None], len(HUMANML3D), axis=1)
    observed = np.zeros(joints.shape[:2], bool)
    observed[:, 0] = True
    if capture.flat:
        return joints, observed
    # Where keypoints were seen within a frame or two.
    gaps = np.abs(np.arange(frames)[:, None] - capture.positions)
    seen_near = (gaps <= max(1.0, fps_ratio)).astype(float) @ (capture.weights > 0) > 0
    for k, row in enumerate(capture.joints):
        if (row == 1).sum() == 1 and np.isfinite(tracks[:, k]).all():
            joint = int(row.argmax())
            joints[:, joint], observed[:, joint] = tracks[:, k], seen_near[:, k]
    return joints, observed


def _headings(capture: Capture) -> list[Curve]:
    """Returns the headings of the body to begin with: one, or those that are as likely."""
    across = _across(capture, _TRUNK, 2.0)
    if not capture.flat:
        if across.any():
            return [_heading_of(-across[:, 0], across[:, 2])]
        across = _across(capture, _SIDES, 10.0)
        headings = [_heading_of(-across[:, 0], across[:, 2])] if across.any() else []
        headings += _headings_of_path(capture)
        return headings or [np.full(capture.frames, yaw) for yaw in np.arange(4) * np.pi / 2]
    assert capture.depth is not None
    # In the picture the right side is at -x; how wide hips and shoulders look says how far turned.
    depth = _smoothed(
        capture.depth[:, None], np.ones(len(capture.depth)), capture.positions, 2.0, capture.frames
    )
    wide = np.clip(across[:, 0] * depth[:, 0] / 0.55, -1, 1)
    away = np.sqrt(1 - wide**2)
    return [_heading_of(wide, sign * away) for sign in (1.0, -1.0)] + _headings_of_path(capture)


def _across(
    capture: Capture, parts: tuple[str, ...], width: float
) -> Float[np.ndarray, "frames coordinates"]:
    """Returns how far the right side is from the left one, smoothed and summed; 0 if not seen."""
    total = np.zeros((capture.frames, capture.points.shape[2]))
    for part in parts:
        sides = [f"{side}_{part}" for side in ("right", "left")]
        if set(sides) <= set(capture.names):
            k = [capture.names.index(side) for side in sides]
            both = capture.weights[:, k].min(axis=1)
            if (both > 0).any():
                step = capture.points[:, k[0]] - capture.points[:, k[1]]
                total += _smoothed(step, both, capture.positions, width, capture.frames)
    return total


def _headings_of_path(capture: Capture) -> list[Curve]:
    """Returns the heading of a person walking ahead, or nothing if the pelvis stays."""
    path = rough_joints(capture)[0][:, 0]
    if np.linalg.norm(path[-1] - path[0]) <= 0.5:
        return []
    way = np.gradient(path, axis=0)
    way = _smoothed(way, np.ones(len(way)), np.arange(len(way), dtype=float), 6.0)
    return [_heading_of(way[:, 2], way[:, 0])]


def _heading_of(ahead: Curve, aside: Curve) -> Curve:
    """Returns the angle about y that turns +z that way, without leaps."""
    return np.unwrap(np.arctan2(aside, ahead))


def _detail(observation: Observation, joints: Joints, noise: float) -> Joints:
    """Returns what is to be added to joints: what latents do not express, without the noise.

    Residuals of joints are a Gaussian process (Matérn 3/2) and noise; its mean goes to 0 in gaps.
    """
    off, added = observation.missing(joints), np.zeros(joints.shape)
    share, frames = observation.times, np.arange(len(joints))
    between = np.sqrt(3) * np.abs(frames[:, None] - frames)
    expected = np.zeros(between.shape)
    for apart in (between / frames_long for frames_long in _LASTING):
        expected += _EXPRESSED**2 / len(_LASTING) * (1 + apart) * np.exp(-apart)
    spread = np.linalg.norm(off, axis=-1) / np.hypot(noise, _EXPRESSED)
    weights = observation.weights * robust(spread)
    for k, row in enumerate(observation.joints):
        if (row == 1).sum() != 1 or not (weights[:, k] > 0).any():
            continue
        count = share.T @ weights[:, k]
        visible = count > 0.05
        mean = (share.T @ (weights[:, k, None] * off[:, k]))[visible] / count[visible, None]
        both = expected[np.ix_(visible, visible)] + np.diag(noise**2 / count[visible])
        added[:, int(row.argmax())] = expected[:, visible] @ np.linalg.solve(both, mean)
    return added


def _bridged(observation: Observation, joints: Joints, fps: float) -> Joints:
    """Returns joints that are drawn, in short gaps, toward a curve that keeps their speed.

    What a cubic curve is off grows with the square of the gap; what latents are off hardly does.
    """
    bridged, count = joints.copy(), observation.times.T @ (observation.weights > 0)
    for k, row in enumerate(observation.joints):
        visible = np.flatnonzero(count[:, k] > 0)
        if (row == 1).sum() != 1:
            continue
        joint = int(row.argmax())
        for last, first in pairwise(visible):
            length = int(first - last)
            if length < 3 or last < 2 or first + 2 >= len(joints):
                continue
            off = _BRIDGED * (length / fps) ** 2
            share = _UNSEEN**2 / (_UNSEEN**2 + off**2)
            before = (joints[last, joint] - joints[last - 2, joint]) / 2
            after = (joints[first + 2, joint] - joints[first, joint]) / 2
            t = np.arange(1, length)[:, None] / length
            ends = (2 * t**3 - 3 * t**2 + 1, 3 * t**2 - 2 * t**3)
            curve = ends[0] * joints[last, joint] + ends[1] * joints[first, joint]
            curve += length * ((t**3 - 2 * t**2 + t) * before + (t**3 - t**2) * after)
            bridged[last + 1 : first, joint] += share * (curve - joints[last + 1 : first, joint])
    return bridged
