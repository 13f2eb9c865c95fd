"""What each step of the clean-up does to generated motions and to real clips.

    python -m benchmarks.quality.cleanup PREPARED_FOLDER  # lab/diary/cleanup.md

Feet are measured four ways; the first two judge the same frames before and after:

    contacts   speed of a foot, mm/s, while it stands in the motion as it was before, by its height
               and speed: of the slower of its joints in contact, since feet roll
    by model   the same where the contact features of the motion, the model's own, say that it
               stands
    sliding    height-weighted speed of foot joints (`kinematics/plausibility.py`), mm/s
    skating    share of steps with a foot below 5 cm that moves faster than 0.5 m/s

`knees` is the highest angular acceleration of knees but for one frame in 1000, rad/s²; `back`
counts frames in which a knee was turned backward: over 1 cm, and 5 mm farther than it was. `body`
and `legs` are how far joints are moved on average: legs are knees, ankles and toes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import fmean

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.quality.starter_motions import starter_features
from latentmotion.cleanup import CleanUp, clean
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.data.dataset import Dataset
from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration, skating_ratio
from latentmotion.motion import Motion
from latentmotion.representation.interface import Representation

LEGS = (4, 5, 7, 8, 10, 11)
COLUMNS = (
    *("contacts", "by model", "sliding", "skating", "jitter", "knees", "back", "below floor"),
    *("body", "legs"),
)
_CHAINS = ((1, 4, 7), (2, 5, 8))
_NONE = partial(CleanUp, smooth=False, bones=False, floor=False, feet=False)
STEPS = {
    "before": _NONE(),
    "smoothing": _NONE(smooth=True),
    "bones": _NONE(bones=True),
    "floor": _NONE(floor=True),
    "feet": _NONE(feet=True),
    "all": CleanUp(),
}

Joints = Float[np.ndarray, "frames joints 3"]


@dataclass(frozen=True)
class Take:
    """A motion and what its features say of its feet."""

    motion: Motion  # The joints.
    contacts: Bool[np.ndarray, "frames feet"]  # Whether each foot joint stands by the features.
    stands: Bool[np.ndarray, "frames feet"]  # Whether it does by height and speed.

    @classmethod
    def of(cls, representation: Representation, features: Float[np.ndarray, "frames n"]) -> Take:
        """Decodes features."""
        joints = representation.decode(features)
        contacts = features[:, representation.blocks["contacts"]] > 0.5
        motion = Motion(joints, representation.fps, representation.skeleton)
        exact = np.asarray(motion.joints, dtype=np.float64)
        return cls(motion, contacts, foot_contacts(exact, motion.fps, motion.skeleton))

    def slides(self, joints: Joints, contacts: Bool[np.ndarray, "frames feet"]) -> list[float]:
        """Returns the horizontal speeds of feet in contact, mm/s."""
        skeleton = self.motion.skeleton
        feet = joints[:, [*skeleton.left_foot, *skeleton.right_foot]]
        speed = np.linalg.norm(np.diff(feet[..., ::2], axis=0), axis=-1) * self.motion.fps
        stands = contacts[1:] & contacts[:-1]
        slowest = np.where(stands, speed, np.inf).reshape(len(speed), 2, -1).min(axis=-1)
        return (1000 * slowest[np.isfinite(slowest)]).tolist()


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", help="prepared folder")
    dataset = Dataset.load(parser.parse_args().data)
    representation = dataset.representation
    real = [clip for split in ("train", "val", "test") for clip in dataset.clips(split)]
    sets = {
        "starter": [Take.of(representation, f) for f in starter_features(dataset)],
        "real": [Take.of(representation, dataset.features(clip)) for clip in real],
    }
    for name, takes in sets.items():
        print(f"\n{len(takes)} motions, {name}\n")
        print(f"| step | {' | '.join(COLUMNS)} |")
        print("|---|" + len(COLUMNS) * "---|")
        for step, settings in STEPS.items():
            print(_row(step, takes, settings))
        print(f"\n{_still(takes)}\n{_cost(takes)}")


def _row(step: str, takes: Sequence[Take], settings: CleanUp) -> str:
    cleaned = [_cleaned(take, settings) for take in takes]
    moved = [
        np.linalg.norm(joints - take.motion.joints, axis=-1).mean(axis=0)
        for joints, take in zip(cleaned, takes, strict=True)
    ]
    fps = takes[0].motion.fps
    body = [joint for joint in range(len(moved[0])) if joint not in LEGS]
    pairs = list(zip(takes, cleaned, strict=True))
    cells = (
        f"{fmean(x for t, joints in pairs for x in t.slides(joints, t.stands)):.0f}",
        f"{fmean(x for t, joints in pairs for x in t.slides(joints, t.contacts)):.0f}",
        f"{1000 * fmean(foot_sliding(joints, fps) for joints in cleaned):.2f}",
        f"{100 * fmean(skating_ratio(joints, fps) for joints in cleaned):.1f} %",
        f"{fmean(jitter(joints, fps) for joints in cleaned):.1f}",
        f"{np.percentile(np.concatenate([_knees(j, fps) for j in cleaned]), 99.9):.0f}",
        f"{sum(_turned_back(take.motion.joints, joints) for take, joints in pairs)}",
        f"{1000 * fmean(penetration(joints) for joints in cleaned):.2f} mm",
        f"{1000 * fmean(m[body].mean() for m in moved):.1f} mm",
        f"{1000 * fmean(m[list(LEGS)].mean() for m in moved):.1f} mm",
    )
    return f"| {step} | {' | '.join(cells)} |"


def _knees(joints: Joints, fps: float) -> Float[np.ndarray, " values"]:
    """Returns the angular accelerations of knees, rad/s²."""
    angles = []
    for hip, knee, ankle in _CHAINS:
        thigh, shank = joints[:, knee] - joints[:, hip], joints[:, ankle] - joints[:, knee]
        sine = np.linalg.norm(np.cross(thigh, shank), axis=-1)
        angles.append(np.arctan2(sine, (thigh * shank).sum(axis=-1)))
    return np.abs(np.diff(angles, n=2)).ravel() * fps**2


def _turned_back(before: Joints, after: Joints) -> int:
    """Counts frames in which a knee was turned backward."""
    old, new = _ahead(before), _ahead(after)
    return int(((new < -0.01) & (new < old - 0.005)).sum())


def _ahead(joints: Joints) -> Float[np.ndarray, "legs frames"]:
    """Returns how far knees are ahead of the line from hip to ankle, seen across the hips."""
    found, across = [], joints[:, 1] - joints[:, 2]
    for hip, knee, ankle in _CHAINS:
        ahead = np.cross(across, joints[:, hip] - joints[:, ankle])
        ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
        found.append(((joints[:, knee] - joints[:, hip]) * ahead).sum(axis=-1))
    return np.stack(found)


def _still(takes: Sequence[Take]) -> str:
    """Says how far legs are moved where feet hardly slide: in the half that slides least."""
    rated = [(fmean(t.slides(t.motion.joints, t.stands) or [0.0]), t) for t in takes]
    calm = [take for _, take in sorted(rated, key=lambda pair: pair[0])[: len(takes) // 2]]
    moved = [np.linalg.norm(_cleaned(t, CleanUp()) - t.motion.joints, axis=-1) for t in calm]
    way = 1000 * fmean(m[:, LEGS].mean() for m in moved)
    return f"legs moved by {way:.1f} mm in the half of the motions in which feet slide least"


def _cleaned(take: Take, settings: CleanUp) -> Joints:
    return np.asarray(clean(take.motion, settings).joints, dtype=np.float64)


def _cost(takes: Sequence[Take]) -> str:
    """Says how long cleaning takes, and how well rotations reach the joints before and after."""
    start = time.process_time()
    cleaned = [clean(take.motion) for take in takes]
    seconds = (time.process_time() - start) / sum(len(motion) for motion in cleaned)
    before, after = _misses([take.motion for take in takes]), _misses(cleaned)
    return (
        f"{196e3 * seconds:.0f} ms of one core for 196 frames; forward kinematics of the "
        f"rotations off by {before} before, {after} after"
    )


def _misses(motions: Sequence[Motion]) -> str:
    errors = [np.linalg.norm(solve(m.joints, m.fps).joints() - m.joints, axis=-1) for m in motions]
    mean = fmean(float(error.mean()) for error in errors)
    return f"{1000 * mean:.2f} mm (at most {1000 * max(e.max() for e in errors):.1f} mm)"


if __name__ == "__main__":
    main()
