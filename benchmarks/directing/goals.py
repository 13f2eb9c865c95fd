"""Goals: joints of test clips as goals of their own sentence, and paths."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.directing.bench import CLIP, Bench, Recording, Rows, Values, beside
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.control.exact import distances
from latentmotion.control.goals import Goal, Heading, Reach, RootPath, targets_of
from latentmotion.errors import InputError
from latentmotion.kinematics.plausibility import foot_sliding
from latentmotion.motion import Motion
from latentmotion.pipeline import cleaned_up
from latentmotion.representation.canonical import heading

# Joints that have a goal each; none: the pelvis all along.
SETS = {
    "pelvis, 5 goals": ("pelvis",) * 5,
    "wrist, 2 goals": ("right_wrist",) * 2,
    "wrist, pelvis twice, foot, head": ("right_wrist", "pelvis", "pelvis", "left_foot", "head"),
    "pelvis, each quarter of a second": ("pelvis",) * 0,
}

# Of the evaluation, in which a joint counts the less the higher it is; nothing above 2.5 cm.
_BY_HEIGHT = "Sliding by height, cm/s"

_RATIOS = ("FID", "Sliding, cm/s", _BY_HEIGHT)

WALK, BACK = "a person walks forward", "a person walks backward"


def goal_rows(bench: Bench) -> Rows:
    """Measures goals beside no goals, moved motions and real ones; then paths."""
    clips = bench.recordings()
    recordings, clip_of = bench.repeated(clips)
    texts = [each.text for each in recordings]
    free, spent = _timed(bench, recordings, [()] * len(recordings))
    first = next(iter(SETS))
    goals = {name: _goals_of(recordings, names) for name, names in SETS.items()}
    without = {**_measured(bench, free, texts), CLIP: clip_of}
    real, told = [each.motion for each in clips], [each.text for each in clips]
    rows: dict[str, Values] = {
        "real motion": _measured(bench, real, told),
        "real motion, cleaned": _measured(bench, clean_batch(real), told),
        "no goals": {"Off before exact, cm": _off(free, goals[first]), **without, "CPU ms": spent},
    }
    moved = [_moved(motion, own) for motion, own in zip(free, goals[first], strict=True)]
    rows["no goals, moved linearly to pelvis, 5 goals"] = {
        "Off, mm, worst": 10 * _off(moved, goals[first]),
        **beside(_measured(bench, moved, texts), without, "no goals", _RATIOS),
        CLIP: clip_of,
    }
    for name, own in goals.items():
        made, spent = _timed(bench, recordings, own)
        kept = [number for number, motion in enumerate(made) if "goals" in motion.metadata]
        some = [made[number] for number in kept]
        same = {column: values[kept] for column, values in without.items()}
        usual = _measured(bench, some, [texts[number] for number in kept])
        rows[name] = {
            **_reported(some),
            **beside(usual, same, "no goals", _RATIOS),
            "CPU ms": spent[kept],
            CLIP: clip_of[kept],
        }
    rows |= {f"no path: {prompt}": _path_row(bench, prompt, (), 3.2) for prompt in (WALK, BACK)}
    return rows | {name: _path_row(bench, *course) for name, course in courses().items()}


def _measured(bench: Bench, motions: Sequence[Motion], texts: Sequence[str]) -> Values:
    """Returns the usual columns, and sliding by the evaluation's measure."""
    speeds = [100 * foot_sliding(each.joints, each.fps, each.skeleton) for each in motions]
    return {_BY_HEIGHT: np.array(speeds), **bench.usual_columns(motions, texts)}


def courses() -> dict[str, tuple[str, tuple[Goal, ...], float]]:
    """Returns paths to be walked, by name: the prompt, the goals and seconds."""
    angles = np.linspace(0, 1.5 * np.pi, 8)
    circle = np.stack([2 * (1 - np.cos(angles)), 2 * np.sin(angles)], axis=1)
    z = np.linspace(0, 6, 8)
    shapes = {
        "path: circle": (circle, 1.1),
        "path: S": (np.stack([0.8 * np.sin(1.2 * z), z], axis=1), 1.1),
        "path: right angle": (np.array([[0, 0], [0, 1.5], [0, 3], [1.5, 3], [3, 3]]), 1.1),
    }
    line = np.array([[0.0, 0], [0, 1], [0, 2], [0, 3]])
    shapes |= {f"path: {speed:g} m/s": (line, speed) for speed in (0.5, 1.0, 1.5, 2.0)}
    found: dict[str, tuple[str, tuple[Goal, ...], float]] = {}
    for name, (points, speed) in shapes.items():
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        seconds = min(max(float(lengths.sum()) / speed + 0.05, 1.0), 9.5)
        times = np.concatenate([[0], np.cumsum(lengths)]) / lengths.sum() * (seconds - 0.05)
        path = RootPath([(float(x), float(z)) for x, z in points], times.tolist())
        found[name] = WALK, (path,), seconds
    steps = tuple(Reach("pelvis", at, (0, None, -0.6 * at)) for at in (1.0, 2.0, 3.0))
    found["backwards, 0.6 m/s"] = (BACK, (*steps, Heading(3.0, 0.0)), 3.2)
    return found


def _path_row(
    bench: Bench, prompt: str, goals: Sequence[Goal], seconds: float
) -> dict[str, np.ndarray]:
    seeds = range(max(2, bench.count // 5))
    made = [bench.generate(prompt, seconds, seed, goals=goals, takes=1) for seed in seeds]
    usual = _measured(bench, made, ())
    return {
        **(_reported(made) if goals else {}),
        **{name: usual[name] for name in (_BY_HEIGHT, "Sliding, cm/s", "Jitter, m/s³")},
        "Facing off, °": np.array([_facing(motion, prompt == BACK) for motion in made]),
    }


def _goals_of(recordings: Sequence[Recording], names: Sequence[str]) -> list[tuple[Reach, ...]]:
    """Returns places of joints of each recording, at random times, as goals."""
    found = []
    for number, each in enumerate(recordings):
        motion, draw = each.motion, np.random.default_rng(number)
        if names:
            drawn = np.sort(draw.choice(np.arange(10, len(motion) - 1), len(names), replace=False))
            pairs = list(zip(names, drawn.tolist(), strict=True))
        else:
            pairs = [("pelvis", frame) for frame in range(5, len(motion) - 1, 5)]
        goals = []
        for name, frame in pairs:
            x, y, z = motion.joints[frame, motion.skeleton.names.index(name)].tolist()
            place = (x, None if name == "pelvis" else y, z)
            goals.append(Reach(name, frame / motion.fps, place))
        found.append(tuple(goals))
    return found


def _timed(
    bench: Bench, recordings: Sequence[Recording], goals: Sequence[Sequence[Reach]]
) -> tuple[list[Motion], np.ndarray]:
    """Returns a cleaned motion for each recording and its CPU time; without goals where refused."""
    made, spent = [], []
    for seed, (each, own) in enumerate(zip(recordings, goals, strict=True)):
        start = time.process_time()
        try:
            raw = bench.generate.raw_motions([each.text], each.motion.seconds, [seed], goals=own)
        except InputError:
            raw = bench.generate.raw_motions([each.text], each.motion.seconds, [seed])
        missed = [goal["before"] for goal in raw[0].motion.metadata.get("goals", [])]
        (cleaned,) = cleaned_up(raw, CleanUp())
        spent.append(1e3 * (time.process_time() - start))
        made.append(replace(cleaned, metadata={**cleaned.metadata, "missed": missed}))
    return made, np.array(spent)


def _reported(motions: Sequence[Motion]) -> dict[str, np.ndarray]:
    """Returns how far joints were and are off, as the motions themselves report."""
    goals = [motion.metadata["goals"] for motion in motions]
    missed = [motion.metadata.get("missed") or [np.nan] for motion in motions]
    found = {"Off in the sample, cm": np.array([100 * np.mean(each) for each in missed])}
    if not np.isfinite(found["Off in the sample, cm"]).all():
        found = {}
    return {
        **found,
        "Off before exact, cm": np.array([100 * np.mean([g["before"] for g in e]) for e in goals]),
        "Off, mm, worst": np.array([1000 * max(g["after"] for g in each) for each in goals]),
    }


def _off(motions: Sequence[Motion], goals: Sequence[Sequence[Reach]]) -> np.ndarray:
    """Returns how far joints are from goals on average, cm."""
    found = []
    for motion, own in zip(motions, goals, strict=True):
        targets = targets_of(own, len(motion), motion.fps, motion.skeleton, None)
        found.append(100 * float(distances(motion.joints, targets, motion.skeleton).mean()))
    return np.array(found)


def _moved(motion: Motion, goals: Sequence[Reach]) -> Motion:
    """Returns a motion whose pelvis is put at its goals, all joints moved with it linearly."""
    frames = [0, *(round(goal.at * motion.fps) for goal in goals)]
    offsets = np.zeros((len(frames), 3))
    for number, goal in enumerate(goals, 1):
        (x, _, z), own = goal.to, motion.joints[frames[number], 0]
        assert x is not None and z is not None
        offsets[number] = x - own[0], 0, z - own[2]
    every = np.arange(len(motion))
    shift = np.stack([np.interp(every, frames, axis) for axis in offsets.T], axis=1)
    return replace(motion, joints=(motion.joints + shift[:, None]).astype(np.float32))


def _facing(motion: Motion, backwards: bool) -> float:
    """Returns how far the body faces off its way where it moves, degrees on average."""
    joints = motion.joints.astype(np.float64)
    way = np.gradient(joints[:, 0, ::2], axis=0) * motion.fps * (-1 if backwards else 1)
    off = heading(joints, motion.skeleton) - np.arctan2(way[:, 0], way[:, 1])
    off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
    moving = np.linalg.norm(way, axis=1) > 0.3
    return float(np.degrees(off[moving].mean())) if moving.any() else 0.0
