"""How alive motions look: sharpness, rest, ends, feet, support and travel, beside real motion.

    python -m benchmarks.quality.dynamics files walk.npz hand.glb --data data/starter.pack
    python -m benchmarks.quality.dynamics model fast --data data/starter.pack

`files` reads whatever `latentmotion load` reads; each motion is at first resampled to 20 frames a
second, since jerk and spectra depend on the rate. `model` makes the 140 prompts of `prompts()` as
the command does. Each motion has a matched real one: the test clip whose caption is nearest to its
own by the scorer, or, without a caption, the clip that is nearest itself. Columns have intervals of
95 %, by 200 draws of motions with replacement.

    jerk       99th percentile of |third difference| of all joints, m/s³
    >3, >5 Hz  share of the energy of joint velocities above, after their mean is taken away
    rest       frames whose joints move by less than 0.12 m/s on average and whose pelvis by less
               than 0.15
    start, end speed in the first and last 0.3 s by the mean speed, median of motions
    slide      height-weighted speed of feet, cm/s (`kinematics/plausibility.py`)
    way        mean way of a toe in one contact, cm: below 5 cm, not rising
    no support frames with a slow pelvis that does not fall, and nothing within 5 cm of the floor
               (12 where the body lies, as joints are not skin); share of the slow frames
    hang       motions with half a second of it
    travel     way of the pelvis over the floor, m, mean of motions
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.quality.default_path import default_motion
from latentmotion import Motion, MotionPipeline, formats
from latentmotion.data.dataset import Dataset, Item, items_of
from latentmotion.data.store import COMPOSED
from latentmotion.kinematics.plausibility import foot_sliding
from latentmotion.measure.signals import spans
from latentmotion.progress import counted
from latentmotion.ranking.scorer import Scorer, shipped_scorer

FPS = 20.0  # Rate at which everything is measured.

ENDS = 0.3  # Seconds at either end.

# Height of a support, m; speed of a pelvis that needs one, m/s; seconds that are seen.
LOW, SLOW, LONG = 0.05, 0.3, 0.5

# Height of the pelvis of a body that lies, and of the joints that may carry it, m.
LYING, FLESH = 0.4, 0.12

SHORTEST = 30  # Frames of the shortest real clip.

HERE = Path(__file__).parent

Joints = Float[np.ndarray, "frames joints 3"]


@dataclass(frozen=True, eq=False)
class Dynamics:
    """What is measured of one motion; sums and samples, so that motions can be pooled."""

    jerk: Float[np.ndarray, " samples"]  # Of all joints, m/s³.
    energy: Float[np.ndarray, " 3"]  # Of velocities: all, above 3 Hz, above 5 Hz.
    # Steps between frames: all, at rest, slow, slow without support.
    frames: Float[np.ndarray, " 4"]
    ends: Float[np.ndarray, " 2"]  # Speed at start and end by the mean speed.
    slide: float  # Speed of feet on the floor, cm/s.
    ways: Float[np.ndarray, " contacts"]  # Way of a toe in each contact, cm.
    travel: float  # Meters.
    hangs: bool  # Whether it lacks support for long.

    @classmethod
    def of(cls, motion: Motion) -> Dynamics:
        """Measures a motion of `FPS` frames a second."""
        joints = np.asarray(motion.joints, np.float64)
        velocity = FPS * np.diff(joints, axis=0)
        jerk = np.linalg.norm(np.diff(joints, n=3, axis=0), axis=-1).ravel() * FPS**3
        spectrum = np.abs(np.fft.rfft(velocity - velocity.mean(axis=0), axis=0)) ** 2
        power = spectrum.sum(axis=(1, 2)) / len(velocity)
        hertz = np.fft.rfftfreq(len(velocity), 1 / FPS)
        speed = np.linalg.norm(velocity, axis=-1)
        body, pelvis, few = speed.mean(axis=1), speed[:, 0], round(ENDS * FPS)
        rest = (body < 0.12) & (pelvis < 0.15)
        slow, hanging = support(joints)
        skeleton = motion.skeleton
        left, right = skeleton.left_foot[-1], skeleton.right_foot[-1]
        return cls(
            jerk,
            np.array([power.sum(), power[hertz >= 3].sum(), power[hertz >= 5].sum()]),
            np.array([len(rest), rest.sum(), slow.sum(), hanging.sum()], float),
            np.array([body[:few].mean(), body[-few:].mean()]) / max(body.mean(), 1e-9),
            100 * foot_sliding(joints, FPS, skeleton),
            np.array([*_ways(joints[:, left]), *_ways(joints[:, right])]),
            float(np.linalg.norm(velocity[:, 0, ::2], axis=-1).sum() / FPS),
            any(end - start >= LONG * FPS for start, end in spans(hanging)),
        )


def support(joints: Joints) -> tuple[np.ndarray, np.ndarray]:
    """Returns in which frames the pelvis is slow, and in which of these nothing carries it."""
    pelvis = np.gradient(joints[:, 0], 1 / FPS, axis=0)
    slow = (np.linalg.norm(pelvis, axis=-1) < SLOW) & (np.abs(pelvis[:, 1]) < SLOW / 3)
    low = np.where(joints[:, 0, 1] < LYING, FLESH, LOW)
    return slow, slow & (joints[..., 1].min(axis=1) > low)


def _ways(toe: Float[np.ndarray, "frames 3"]) -> list[float]:
    """Returns the way over the floor of each contact of a toe, cm."""
    steps = FPS * np.diff(toe, axis=0)
    touches = (np.maximum(toe[1:, 1], toe[:-1, 1]) < LOW) & (steps[:, 1] < 0.1)
    way = 100 / FPS * np.linalg.norm(steps[:, ::2], axis=-1)
    return [float(way[start:end].sum()) for start, end in spans(touches, 2)]


def _share(part: int, whole: int = 0) -> Callable[[Sequence[Dynamics]], float]:
    def share(motions: Sequence[Dynamics]) -> float:
        total = np.sum([motion.frames for motion in motions], axis=0)
        return 100 * total[part] / max(total[whole], 1)

    return share


def _energy(part: int) -> Callable[[Sequence[Dynamics]], float]:
    def share(motions: Sequence[Dynamics]) -> float:
        total = np.sum([motion.energy for motion in motions], axis=0)
        return total[part] / total[0]

    return share


# Name, format and value of each column, of some motions together.
COLUMNS: dict[str, tuple[str, Callable[[Sequence[Dynamics]], float]]] = {
    "jerk": (".0f", lambda ms: float(np.percentile(np.concatenate([m.jerk for m in ms]), 99))),
    ">3 Hz": (".3f", _energy(1)),
    ">5 Hz": (".4f", _energy(2)),
    "rest %": (".1f", _share(1)),
    "start": (".2f", lambda ms: float(np.median([m.ends[0] for m in ms]))),
    "end": (".2f", lambda ms: float(np.median([m.ends[1] for m in ms]))),
    "slide": (".2f", lambda ms: float(np.mean([m.slide for m in ms]))),
    "way": (".1f", lambda ms: float(np.mean(np.concatenate([m.ways for m in ms])))),
    "no support %": (".2f", _share(3, 2)),
    "hang %": (".0f", lambda ms: 100 * float(np.mean([m.hangs for m in ms]))),
    "travel": (".1f", lambda ms: float(np.mean([m.travel for m in ms]))),
}


def table(rows: dict[str, Sequence[Motion]], draws: int = 200) -> list[str]:
    """Returns the lines of a table, a row for each set of motions, with intervals."""
    lines = [f"| | n | {' | '.join(COLUMNS)} |", "|---" * (2 + len(COLUMNS)) + "|"]
    for name, motions in rows.items():
        measured = [Dynamics.of(motion) for motion in motions]
        generator = np.random.default_rng(0)
        cells = []
        drawn = [generator.integers(len(measured), size=len(measured)) for _ in range(draws)]
        for kind, value in COLUMNS.values():
            cell = f"{value(measured):{kind}}"
            if len(measured) > 1:
                values = [value([measured[n] for n in rows]) for rows in drawn]
                low, high = np.percentile(values, [2.5, 97.5])
                cell += f" ({low:{kind}}–{high:{kind}})"
            cells.append(cell)
        lines.append(f"| {name} | {len(motions)} | {' | '.join(cells)} |")
    return lines


def prompts() -> list[str]:
    """Returns the 140 prompts: 60 of the picture sheet, 80 in users' words for known acts."""
    files = (HERE / "sheet_60.txt").read_text("utf-8"), (HERE / "acts/known.tsv").read_text("utf-8")
    sheet, known = ([line for line in text.splitlines() if line.strip()] for text in files)
    return [*sheet, *known[1:81]]


class RealMotion:
    """The real motion of a test split, to be matched.

    Args:
        data: Prepared data.
        scorer: Compares sentences and motions.
    """

    def __init__(self, data: Path, scorer: Scorer) -> None:
        self._dataset, self._scorer = Dataset.load(data), scorer
        clips = [c for c in self._dataset.clips("test") if c.source != COMPOSED]
        self._items = [
            item for item in items_of(clips) if item.captions and item.frames >= SHORTEST
        ]
        pairs = [(n, text) for n, item in enumerate(self._items) for text in item.captions]
        self._owner = np.array([n for n, _ in pairs])
        self._texts = scorer.texts([text for _, text in pairs])

    def matched(self, motions: Sequence[Motion]) -> list[Motion]:
        """Returns the real motion of each motion."""
        captions = [motion.caption for motion in motions]
        if all(captions):
            near = self._scorer.texts(captions) @ self._texts.T
            return [self._motion(self._items[self._owner[row.argmax()]]) for row in near]
        every = [self._motion(item) for item in self._items]
        near = self._scorer.motions(motions) @ self._scorer.motions(every).T
        return [every[row.argmax()] for row in near]

    def _motion(self, item: Item) -> Motion:
        part = self._dataset.representation
        features = self._dataset.features(item.clip)[item.start : item.start + item.frames]
        return Motion(part.decode(features), part.fps, part.skeleton, item.captions[0])


def resampled(motion: Motion) -> Motion:
    """Returns a motion at `FPS` frames a second, by straight lines between frames."""
    if motion.fps == FPS:
        return motion
    last = (len(motion) - 1) / motion.fps
    times = np.arange(int(last * FPS) + 1) / FPS * motion.fps
    before = np.minimum(times.astype(int), len(motion) - 2)
    part = (times - before)[:, None, None]
    joints = (1 - part) * motion.joints[before] + part * motion.joints[before + 1]
    return replace(motion, joints=joints.astype(np.float32), fps=FPS)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["files", "model"])
    parser.add_argument("names", nargs="+", help="files of motions, or names of models")
    parser.add_argument("--data", type=Path, required=True, help="prepared data with a test split")
    parser.add_argument("--takes", type=int, help="as the command makes them by default")
    parser.add_argument("--prompts", type=Path, help="a line each, with seconds after a tab")
    options = parser.parse_args()
    rows: dict[str, Sequence[Motion]] = {}
    if options.what == "files":
        for name in options.names:
            rows[Path(name).name] = [resampled(motion) for motion in formats.load(name)]
        if len(rows) > 1:
            rows["all files"] = [motion for motions in rows.values() for motion in motions]
    else:
        asked = options.prompts.read_text("utf-8").splitlines() if options.prompts else prompts()
        for name in options.names:
            rows[name] = generated(name, [line for line in asked if line.strip()], options.takes)
    real = RealMotion(options.data, shipped_scorer())
    rows["real, matched"] = real.matched(list(rows.values())[-1])
    print("\n".join(table(rows)))


def generated(name: str, asked: Sequence[str], takes: int | None) -> list[Motion]:
    """Returns a motion for each line of prompts, each from a seed of its own."""
    pipeline, motions = MotionPipeline.from_pretrained(name, threads=1), []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed, line in enumerate(counted(asked, "prompts")):
            prompt, _, seconds = line.partition("\t")
            length = float(seconds) if seconds else None
            motions.append(default_motion(pipeline, prompt, seed, takes, seconds=length))
    return motions


if __name__ == "__main__":
    main()
