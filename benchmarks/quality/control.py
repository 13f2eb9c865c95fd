"""Directing: how near joints get to their goals, what becomes of feet, what an edit's seams do.

    python -m benchmarks.quality.control goals --model fast --count 24
    python -m benchmarks.quality.control paths --model fast
    python -m benchmarks.quality.control edits --model fast walk.bvh run.bvh

Goals are places where joints of another motion of the same prompt are, so that they can be met.
Paths are a circle, an S, a right angle and speeds from 0.5 to 2 m/s. Edits replace the middle of
real motions; their jerk, the largest third difference of a joint within 0.25 s of a seam, stands
beside that of the same frames of the recording.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from latentmotion import Motion, MotionPipeline, Reach, RootPath, read_bvh, to_humanml3d
from latentmotion.cleanup import CleanUp
from latentmotion.control.direct import sliding_in_contact
from latentmotion.control.edit import generate_edited
from latentmotion.pipeline import cleaned_up
from latentmotion.representation.canonical import heading
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES

PROMPTS = (
    "a person walks forward",
    "a person runs forward",
    "a person kicks with the right foot",
    "a person waves with both arms",
    "a person jumps",
    "a person turns around and walks",
)
SETS = {
    "pelvis, 5 goals": (("pelvis", 5),),
    "wrist, 2 goals": (("right_wrist", 2),),
    "5 goals": (("right_wrist", 1), ("pelvis", 2), ("left_foot", 1), ("head", 1)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", choices=["goals", "paths", "edits"])
    parser.add_argument(
        "motions", nargs="*", type=Path, help="BVH files of real motions, for edits"
    )
    parser.add_argument("--unit", default="cmu", help="of these BVH files")
    parser.add_argument("--model", default="fast")
    parser.add_argument("--count", type=int, default=24, help="motions of a row")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    generate = MotionPipeline.from_pretrained(options.model, threads=options.threads)
    warnings.simplefilter("ignore")
    tables = {"goals": goals_table, "paths": paths_table}
    if options.table == "edits":
        lines = edits_table(generate, options.motions, options.unit)
    else:
        lines = tables[options.table](generate, options.count)
    for line in lines:
        print(line, flush=True)


def goals_table(generate: MotionPipeline, count: int) -> Iterable[str]:
    yield (
        "| goals | missed, generated, cm | cleaned, cm | exact, mm, worst | sliding, cm/s | "
        "without goals | jitter, m/s³ | without | ms | without | CPU ms |"
    )
    yield "|---|" + "--:|" * 10
    for name, kinds in SETS.items():
        rows = [goals_row(generate, kinds, number) for number in range(count)]
        rows = [row for row in rows if row is not None]
        mean, worst = np.mean(rows, axis=0), np.max(rows, axis=0)
        middle = np.median(rows, axis=0)
        yield (
            f"| {name} | {mean[0]:.3f} | {mean[1]:.2f} | {worst[2]:.4f} | {mean[3]:.2f} | "
            f"{mean[4]:.2f} | {mean[5]:.0f} | {mean[6]:.0f} | {middle[7]:.0f} | {middle[8]:.0f} | "
            f"{middle[9]:.0f} |"
        )


def goals_row(
    generate: MotionPipeline, kinds: tuple[tuple[str, int], ...], number: int
) -> list[float] | None:
    prompt, draw = PROMPTS[number % len(PROMPTS)], np.random.default_rng(number)
    other = generate(prompt, 4.0, 1000 + number, takes=1)
    frames = draw.choice(np.arange(15, 80), sum(n for _, n in kinds), replace=False)
    names = [name for name, n in kinds for _ in range(n)]
    goals = []
    for name, frame in zip(names, sorted(frames.tolist()), strict=True):
        x, y, z = other.joints[frame, other.skeleton.names.index(name)].tolist()
        goals.append(Reach(name, frame / 20, (x, None if name == "pelvis" else y, z)))
    generate.raw_motions([prompt], 4.0, [number])
    start = time.perf_counter()
    free = generate.raw_motions([prompt], 4.0, [number])
    free_ms = 1e3 * (time.perf_counter() - start)
    start, cpu = time.perf_counter(), time.process_time()
    made = generate.raw_motions([prompt], 4.0, [number], goals=goals)
    ms, cpu_ms = 1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - cpu)
    cleaned, without = cleaned_up([*made, *free], CleanUp())
    found = cleaned.metadata["goals"]
    return [
        1e2 * float(np.mean([goal["before"] for goal in made[0].motion.metadata["goals"]])),
        1e2 * float(np.mean([goal["before"] for goal in found])),
        1e3 * max(goal["after"] for goal in found),
        1e2 * sliding_in_contact(cleaned),
        1e2 * sliding_in_contact(without),
        jitter(cleaned),
        jitter(without),
        ms,
        free_ms,
        cpu_ms,
    ]


@dataclass(frozen=True)
class Course:
    """A path to be walked."""

    name: str
    points: tuple[tuple[float, float], ...]
    speed: float


def courses() -> list[Course]:
    angles = np.linspace(0, 1.5 * np.pi, 8)
    circle = tuple((float(2 * (1 - np.cos(a))), float(2 * np.sin(a))) for a in angles)
    wave = tuple((float(0.8 * np.sin(1.2 * z)), float(z)) for z in np.linspace(0, 6, 8))
    corner = ((0.0, 0.0), (0.0, 1.5), (0.0, 3.0), (1.5, 3.0), (3.0, 3.0))
    shapes = [Course("circle", circle, 1.1), Course("S", wave, 1.1), Course("corner", corner, 1.1)]
    straight = tuple((0.0, float(z)) for z in (0, 1, 2, 3))
    return [*shapes, *(Course(f"{v:g} m/s", straight, v) for v in (0.5, 1.0, 1.5, 2.0))]


def paths_table(generate: MotionPipeline, count: int) -> Iterable[str]:
    yield "| path | exact, mm, worst | before, cm | facing off, degrees | sliding, cm/s |"
    yield "|---|--:|--:|--:|--:|"
    for course in courses():
        lengths = np.linalg.norm(np.diff(course.points, axis=0), axis=1)
        seconds = min(max(lengths.sum() / course.speed + 0.05, 1.0), 9.5)
        times = np.concatenate([[0], np.cumsum(lengths)]) / lengths.sum() * (seconds - 0.05)
        rows = []
        for seed in range(min(count, 4)):
            path = RootPath(course.points, times.tolist())
            motion = generate(PROMPTS[0], seconds, seed, goals=[path], takes=1)
            found = motion.metadata["goals"]
            rows.append(
                [
                    1e3 * max(goal["after"] for goal in found),
                    1e2 * float(np.mean([goal["before"] for goal in found])),
                    facing_error(motion),
                    1e2 * sliding_in_contact(motion),
                ]
            )
        mean, worst = np.mean(rows, axis=0), np.max(rows, axis=0)
        yield (
            f"| {course.name} | {worst[0]:.4f} | {mean[1]:.2f} | {mean[2]:.1f} | {mean[3]:.2f} |"
        )


def facing_error(motion: Motion) -> float:
    joints = motion.joints.astype(float)
    way = np.gradient(joints[:, 0, ::2], axis=0) * motion.fps
    off = heading(joints, motion.skeleton) - np.arctan2(way[:, 0], way[:, 1])
    off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
    moving = np.linalg.norm(way, axis=1) > 0.3
    return float(np.degrees(off[moving].mean())) if moving.any() else 0.0


def edits_table(generate: MotionPipeline, files: list[Path], unit: str) -> Iterable[str]:
    yield "| motion | other frames, mm | jerk at seams, m | same frames recorded | ratio | ms |"
    yield "|---|--:|--:|--:|--:|--:|"
    ratios = []
    for file in files:
        animation = read_bvh(file, unit)
        joints = HUMANML3D_FEATURES.retarget(to_humanml3d(animation))
        joints[..., 1] -= joints[..., 1].min()
        motion = Motion(joints.astype(np.float32), animation.fps).resampled(20)
        motion = replace(motion, joints=motion.joints[:100])
        if len(motion) < 60:
            continue
        middle = motion.seconds / 2
        start = time.perf_counter()
        edited = generate_edited(generate, motion, PROMPTS[0], (middle - 0.6, middle + 0.6))
        ms = 1e3 * (time.perf_counter() - start)
        first, last = round((middle - 0.6) * 20), round((middle + 0.6) * 20)
        rest = np.r_[0:first, last : len(motion)]
        kept = 1e3 * float(np.abs(edited.joints[rest] - motion.joints[rest]).max())
        ours, real = (seam_jerk(m.joints, (first, last)) for m in (edited, motion))
        ratios.append((ours, real))
        yield f"| {file.stem} | {kept:g} | {ours:.3f} | {real:.3f} | {ours / real:.2f} | {ms:.0f} |"
    ours, real = np.mean(ratios, axis=0)
    yield f"| mean of {len(ratios)} | 0 | {ours:.3f} | {real:.3f} | {ours / real:.2f} | |"


def seam_jerk(joints: np.ndarray, seams: tuple[int, int]) -> float:
    third = np.abs(np.diff(joints.astype(float), n=3, axis=0)).sum(axis=-1).max(axis=-1)
    return float(max(third[max(0, seam - 5) : seam + 5].max() for seam in seams))


def jitter(motion: Motion) -> float:
    third = np.diff(motion.joints.astype(float), n=3, axis=0) * motion.fps**3
    return float(np.linalg.norm(third, axis=-1).mean())


if __name__ == "__main__":
    main()
