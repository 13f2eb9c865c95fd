"""How well motions are carried to rigs of other proportions, rest poses and axes.

    python -m benchmarks.quality.retargeting PREPARED_FOLDER [RIG.glb ...]

fills the table of lab/diary/retargeting.md.

Besides the three rigs that the tests build, rigs of your own (or of CMU: 07.asf, 07_03.bvh) can be
named. For each rig, over clips of the test split, cleaned up as `latentmotion clean` does:

    arms, legs      angle between a bone of the source and the rig's, mean and 95 % of frames
    height          toe and ankle joints of feet that stand: off their standing height, compared
                    with the source's at the rig's scale
    below           how far feet, sole down, are below the floor at most, where the source's are not
    sliding         horizontal speed of toes that stand, at the source's scale, and the source's own
    back            the rig's motion carried back to our skeleton: joints off the source's
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.quality.rigs import RIGS, write_rig
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.data.dataset import Dataset
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.skeleton import Animation
from latentmotion.motion import Motion
from latentmotion.retarget import Rig, read_rig, retarget
from latentmotion.retarget.rig import SourceCharacter

SIDES = ("left", "right")
ARMS = (("shoulder", "elbow"), ("elbow", "wrist"))
LEGS = (("hip", "knee"), ("knee", "ankle"))


@dataclass(frozen=True)
class Row:
    """What one motion on one rig gives, arrays over frames and bones."""

    arms: np.ndarray  # Degrees.
    legs: np.ndarray  # Degrees.
    height: np.ndarray  # Meters that standing feet are off where the source's are at scale, signed.
    # Meters that feet, sole down, are below the floor where the source's are not.
    below: np.ndarray
    sliding: np.ndarray  # Meters per second, at the source's scale.
    source_sliding: np.ndarray  # Meters per second.
    back: np.ndarray  # Meters.


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", help="prepared folder")
    parser.add_argument("rigs", nargs="*", type=Path, help="more rigs")
    parser.add_argument("--clips", type=int, default=30)
    arguments = parser.parse_args()
    motions = _motions(Dataset.load(arguments.data), arguments.clips)
    with tempfile.TemporaryDirectory() as folder:
        paths = {n: write_rig(Path(folder) / f"{n}.glb", shape) for n, shape in RIGS.items()}
        paths |= {path.name: path for path in arguments.rigs}
        homes = [_home(motion, Path(folder) / "ours.bvh") for motion in motions]
        frames = sum(map(len, motions))
        print(f"{len(motions)} motions, {frames} frames\n")
        print(
            "| rig | arms, ° | legs, ° | standing feet off, mm | below, mm | sliding, mm/s | "
            "source's | back, mm | ms / 196 frames |\n|---|---|---|---|---|---|---|---|---|"
        )
        for name, path in paths.items():
            print(_line(name, read_rig(path), homes, motions), flush=True)


def _motions(dataset: Dataset, count: int) -> list[Motion]:
    clips = [clip for clip in dataset.clips("test") if len(dataset.features(clip)) >= 20]
    chosen = clips[:: max(1, len(clips) // count)][:count]
    decoded = [dataset.representation.decode(dataset.features(clip)) for clip in chosen]
    return [Motion(joints.astype("f4")).cleaned() for joints in decoded]


def _home(motion: Motion, path: Path) -> Rig:
    """Returns the motion's own skeleton as a rig."""
    write_bvh(path, motion.animation())
    return read_rig(path)


def _line(name: str, rig: Rig, homes: list[Rig], motions: Sequence[Motion]) -> str:
    for motion in motions:
        motion.animation()
    start = time.process_time()
    animations = [retarget(motion, rig) for motion in motions]
    seconds = (time.process_time() - start) / sum(map(len, motions))
    pairs = zip(motions, animations, homes, strict=True)
    rows = [_measure(motion, animation, rig, home) for motion, animation, home in pairs]

    def all_of(what: str) -> np.ndarray:
        return np.concatenate([getattr(row, what).ravel() for row in rows])

    arms, legs = all_of("arms"), all_of("legs")
    off, below = np.abs(all_of("height")).mean(), all_of("below").max(initial=0)
    return (
        f"| {name} | {arms.mean():.2f} / {np.percentile(arms, 95):.2f} "
        f"| {legs.mean():.2f} / {np.percentile(legs, 95):.2f} "
        f"| {1e3 * off:.1f} | {1e3 * below:.1f} | {1e3 * all_of('sliding').mean():.1f} "
        f"| {1e3 * all_of('source_sliding').mean():.1f} | {1e3 * all_of('back').mean():.1f} "
        f"| {196e3 * seconds:.0f} |"
    )


def _measure(motion: Motion, animation: Animation, rig: Rig, home: Rig) -> Row:
    actor, scale = SourceCharacter.of(motion), rig.leg / SourceCharacter.of(motion).leg
    joints, fps = animation.joints(), motion.fps
    contacts = foot_contacts(actor.joints, fps, motion.skeleton)
    heights, below, sliding, source_sliding = [], [], [], []
    for number, name in enumerate(("left_ankle", "left_foot", "right_ankle", "right_foot")):
        if name not in rig.body.joints:
            continue
        rested = rig.rest()[rig.body.joints[name], 1]
        place, seen = joints[:, rig.body.joints[name]], actor.position(name)
        lift = scale * (seen[:, 1] - actor.standing_height(name.partition("_")[2]))
        standing = contacts[:, number]
        heights.append((place[:, 1] - rested - lift)[standing])
        upright = actor.world[:, actor.body.joints[name], 1, 1] > 0.5
        below.append((np.minimum(lift, 0) - (place[:, 1] - rested))[upright])
        if name.endswith("foot"):
            still = standing[1:] & standing[:-1]
            sliding.append(_speeds(place, fps)[still] / scale)
            source_sliding.append(_speeds(seen, fps)[still])
    return Row(
        _angles(actor, joints, rig, ARMS),
        _angles(actor, joints, rig, LEGS),
        np.concatenate(heights),
        np.concatenate(below),
        np.concatenate(sliding),
        np.concatenate(source_sliding),
        _back(motion, animation, rig, home),
    )


def _angles(
    actor: SourceCharacter, joints: Float[np.ndarray, "frames joints 3"], rig: Rig, bones: Sequence
) -> np.ndarray:
    angles = []
    for side in SIDES:
        for upper, lower in bones:
            names = f"{side}_{upper}", f"{side}_{lower}"
            a, b = (joints[:, rig.body.joints[name]] for name in names)
            seen = actor.position(names[1]) - actor.position(names[0])
            bone = b - a
            across = np.linalg.norm(np.cross(seen, bone), axis=-1)
            angles.append(np.degrees(np.arctan2(across, (seen * bone).sum(-1))))
    return np.stack(angles)


def _back(motion: Motion, animation: Animation, rig: Rig, home: Rig) -> np.ndarray:
    """Carries the rig's motion back to the motion's own skeleton."""
    returned = retarget(animation, home, rig.body).joints()
    places = [home.skeleton.names.index(name) for name in motion.skeleton.names]
    source = SourceCharacter.of(motion)
    off = returned[:, places] * (source.leg / home.leg) - motion.animation().joints()
    # The floor of a file without a figure is a guess: one height for all frames.
    off[..., 1] -= off[..., 1].mean()
    return np.linalg.norm(off, axis=-1)


def _speeds(points: Float[np.ndarray, "frames 3"], fps: float) -> Float[np.ndarray, " steps"]:
    return np.linalg.norm(np.diff(points, axis=0)[:, ::2], axis=-1) * fps


if __name__ == "__main__":
    main()
