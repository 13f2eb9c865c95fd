"""Fit: how far motions are off that were fitted to noise, gaps and one camera's keypoints.

    python -m benchmarks.quality.fit --data FOLDER --count 8

Recordings of the test split are spoiled. Beside the fit stand what was recorded, a smoothing spline
(cubic) and a Kalman smoother (constant velocity, Rauch-Tung-Striebel), which are told the true
noise; of five strengths of the Kalman smoother the one that is best on each row is taken. Errors
are mean distances of joints, cm; in gaps those of the joints and frames that were not seen.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, UnivariateSpline

from latentmotion import Dataset, MotionPipeline
from latentmotion.control.fit_keypoints import fit_motion, tilt
from latentmotion.kinematics.keypoints import LAYOUTS, Keypoints, joint_weights
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.canonical import turn

FPS, FRAMES = 20.0, 100
LEGS = [HUMANML3D.names.index(f"{s}_{p}") for s in ("left", "right") for p in ("knee", "ankle")]
LEGS += [HUMANML3D.names.index(f"{s}_foot") for s in ("left", "right")]
STRENGTHS = (1.0, 3.0, 10.0, 30.0, 100.0)  # Accelerations of the Kalman smoother, m/s² in a frame.


@dataclass(frozen=True)
class Spoiled:
    """A way to spoil a recording."""

    name: str
    noise: float  # Deviation, meters.
    gap: float = 0.0  # Seconds in the middle without the joints.
    joints: tuple[int, ...] = tuple(range(22))  # Joints that the gap lacks.


ROWS = (
    *(Spoiled(f"noise {100 * n:.0f} cm", n) for n in (0.02, 0.05, 0.1)),
    *(Spoiled(f"legs unseen {s:g} s", 0.01, s, tuple(LEGS)) for s in (0.5, 1.0, 2.0)),
    *(Spoiled(f"nothing seen {s:g} s", 0.01, s) for s in (0.5, 1.0, 2.0)),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="prepared folder")
    parser.add_argument("--model", default="fast")
    parser.add_argument("--count", type=int, default=8, help="recordings of a row")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rows", nargs="*", help="numbers of rows; by default all")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    generate = MotionPipeline.from_pretrained(options.model, threads=options.threads)
    motions = recordings(options.data, options.count)
    wanted = [int(row) for row in options.rows or range(len(ROWS) + 1)]
    for line in table(generate, motions, wanted):
        print(line, flush=True)


def recordings(folder: Path, count: int) -> list[np.ndarray]:
    """Returns the first 5 s of recordings of the test split, each of another trial."""
    data = Dataset.load(folder)
    clips = {clip.origin.split("[")[0]: clip for clip in data.clips("test")}
    order = np.random.default_rng(0).permutation(len(clips))
    found = []
    for number in order:
        features = data.features(list(clips.values())[number])
        if len(features) >= FRAMES and len(found) < count:
            found.append(data.representation.decode(features[:FRAMES].astype(np.float64)))
    return found


def table(generate: MotionPipeline, motions: list[np.ndarray], wanted: list[int]) -> Iterable[str]:
    yield "| | recorded | spline | Kalman | fitted | cleaned | better than both | CPU s |"
    yield "|---|" + "--:|" * 7
    for number in wanted:
        if number == len(ROWS):
            yield from camera_rows(generate, motions)
            continue
        spoiled = ROWS[number]
        rows = [row(generate, motion, spoiled, n) for n, motion in enumerate(motions)]
        kalman = min(range(len(STRENGTHS)), key=lambda k: sum(r[1][k] for r in rows))
        plain = np.array([[r[0][0], r[0][1], r[1][kalman], *r[0][2:]] for r in rows])
        best = int((plain[:, 3] < plain[:, 1:3].min(axis=1)).sum())
        mean = np.nanmean(plain, axis=0)
        cells = " | ".join("–" if np.isnan(v) else f"{v:.2f}" for v in mean[:5])
        yield f"| {spoiled.name} | {cells} | {best} of {len(rows)} | {mean[5]:.1f} |"


def row(
    generate: MotionPipeline, motion: np.ndarray, spoiled: Spoiled, number: int
) -> tuple[list[float], list[float]]:
    noisy = motion + np.random.default_rng(number).normal(0, spoiled.noise, motion.shape)
    seen = np.ones(motion.shape[:2], bool)
    if spoiled.gap:
        first = (FRAMES - round(spoiled.gap * FPS)) // 2
        seen[first : first + round(spoiled.gap * FPS), list(spoiled.joints)] = False
    asked = ~seen if spoiled.gap else seen
    start = time.process_time()
    fitted = fit_motion(generate, noisy, seen)
    cpu = time.process_time() - start
    cleaned = fitted.cleaned()
    shift = np.zeros(3)
    shift[1] = np.median(fitted.joints[:, 0, 1] - cleaned.joints[:, 0, 1])

    def off(joints: np.ndarray) -> float:
        return 100 * float(np.linalg.norm(joints - motion, axis=-1)[asked].mean())

    smooth = off(spline(noisy, seen, spoiled.noise))
    recorded = np.nan if spoiled.gap else off(noisy)
    filters = [off(kalman(noisy, seen, spoiled.noise, strength)) for strength in STRENGTHS]
    return [recorded, smooth, off(fitted.joints), off(cleaned.joints + shift), cpu], filters


def spline(joints: np.ndarray, seen: np.ndarray, noise: float) -> np.ndarray:
    """Returns cubic splines through what was seen, as near as the noise allows."""
    found, frames = joints.copy(), np.arange(len(joints))
    for joint in range(joints.shape[1]):
        own = seen[:, joint]
        for axis in range(3):
            y = joints[own, joint, axis]
            weights = np.full(own.sum(), 1 / max(noise, 1e-3))
            smooth = UnivariateSpline(frames[own], y, weights, s=own.sum())
            found[:, joint, axis] = smooth(frames)
            if not np.isfinite(found[:, joint, axis]).all():
                found[:, joint, axis] = CubicSpline(frames[own], y)(frames)
    return found


def kalman(joints: np.ndarray, seen: np.ndarray, noise: float, strength: float) -> np.ndarray:
    """Returns the Rauch-Tung-Striebel smoother's positions, constant velocity."""
    dt, count = 1 / FPS, joints.shape[1]
    step = np.array([[1, dt], [0, 1]])
    push = strength**2 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    mean = np.zeros((len(joints), count, 2, 3))
    cov = np.zeros((len(joints), count, 2, 2))
    ahead_mean, ahead_cov = mean.copy(), cov.copy()
    m, c = np.stack([joints[0], np.zeros((count, 3))], axis=1), np.zeros((count, 2, 2))
    c[:] = np.diag([noise**2, 4.0])
    for frame, (y, own) in enumerate(zip(joints, seen, strict=True)):
        if frame:
            m, c = step @ m, step @ c @ step.T + push
        ahead_mean[frame], ahead_cov[frame] = m, c
        gain = c[:, :, 0] / (c[:, 0, 0] + noise**2)[:, None] * own[:, None]
        m = m + gain[:, :, None] * (y - m[:, 0])[:, None]
        c = c - gain[:, :, None] * c[:, :1]
        mean[frame], cov[frame] = m, c
    for frame in range(len(joints) - 2, -1, -1):
        gain = cov[frame] @ step.T @ np.linalg.inv(ahead_cov[frame + 1])
        mean[frame] += gain @ (mean[frame + 1] - ahead_mean[frame + 1])
    return mean[:, :, 0]


def camera_rows(generate: MotionPipeline, motions: list[np.ndarray]) -> Iterable[str]:
    """Yields errors from one camera: of poses about the pelvis, and of the path."""
    yield ""
    yield "| camera | poses, cm | turned to fit, cm | path, cm a meter walked | CPU s |"
    yield "|---|--:|--:|--:|--:|"
    layout = LAYOUTS["coco_17"]
    for name, focal in (("focal length known", 1500.0), ("unknown", None)):
        found = []
        for number, motion in enumerate(motions):
            draw = np.random.default_rng(number)
            middle = motion[:, 0].mean(axis=0) * (1, 0, 1)
            seen = tilt(turn(motion - middle, np.array(draw.uniform(-3.14, 3.14))), 0.1)
            seen += [0, -1.4, 5 + float(np.abs(motion - middle).max())]
            points = np.einsum("kj,tjc->tkc", joint_weights(layout), seen)
            pixels = np.array([640, 360]) - 1500 * points[..., :2] / points[..., 2:]
            pixels += draw.normal(0, 3, pixels.shape)
            keypoints = Keypoints(
                pixels, np.ones(pixels.shape[:2]), FPS, layout, (1280, 720), focal
            )
            start = time.process_time()
            fitted = fit_motion(generate, keypoints).joints.astype(np.float64)
            cpu = time.process_time() - start
            real = tilt(seen, -0.1)
            found.append([*camera_errors(fitted, real), cpu])
        mean = np.mean(found, axis=0)
        yield f"| {name} | {mean[0]:.1f} | {mean[1]:.1f} | {mean[2]:.1f} | {mean[3]:.1f} |"
        yield f"| its worst | {max(f[0] for f in found):.1f} | {max(f[1] for f in found):.1f} | | |"


def camera_errors(fitted: np.ndarray, real: np.ndarray) -> list[float]:
    """Returns the error of poses about the pelvis, the same rotated to fit, and of the path."""
    own, other = fitted - fitted[:, :1], real - real[:, :1]
    poses = 100 * float(np.linalg.norm(own - other, axis=-1).mean())
    u, _, vt = np.linalg.svd(np.einsum("tji,tjk->tik", own, other))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    turned = 100 * float(np.linalg.norm(own @ (u @ vt) - other, axis=-1).mean())
    way, path = fitted[:, 0] - fitted[0, 0], real[:, 0] - real[0, 0]
    walked = max(float(np.linalg.norm(np.diff(real[:, 0], axis=0), axis=1).sum()), 1.0)
    return [poses, turned, 100 * float(np.linalg.norm(way - path, axis=1).mean()) / walked]


if __name__ == "__main__":
    main()
