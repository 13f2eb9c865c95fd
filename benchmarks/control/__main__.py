"""Directed motion: how near to its goals, at what cost for feet, jerk and time, by kind of goal.

    python -m benchmarks.control cases -o cases.json
    python -m benchmarks.control run --model fast --kind joints -o results
    python -m benchmarks.control score motions/ -o results

`run` generates the motion of every case, one take as a user gets it, cleaned up, and appends its
figures to OUTPUT/run.jsonl; cases that are there already are left out. `score` measures
motions of any other model: FOLDER/ID.npz (or .bvh, .glb) with HumanML3D's joints at 20 fps.
Error: mean distance from the goals' places, over all frames of a goal that holds. Sliding: mean
speed of feet that stand. Jerk: mean over joints and frames. Beside them: the same without goals.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.control.cases import KINDS, Case, cases, file_content, poses
from latentmotion import Motion, MotionPipeline, Pose, Reach, RootPath
from latentmotion.control.direct import sliding_in_contact
from latentmotion.control.exact import distances
from latentmotion.control.goals import Goal, targets_of
from latentmotion.errors import InputError
from latentmotion.kinematics.plausibility import jitter
from latentmotion.representation.canonical import turn


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("job", choices=["cases", "run", "score"])
    parser.add_argument("folder", nargs="?", type=Path, help="motions to score")
    parser.add_argument("--model", default="fast")
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--count", type=int, default=200, help="cases of each kind")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=1e6, help="run again to resume")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if options.job == "cases":
        content = file_content().encode()
        options.output.write_bytes(content)
        print(f"{len(cases())} cases, SHA-256 {hashlib.sha256(content).hexdigest()}")
        return
    warnings.simplefilter("ignore")
    kinds = options.kind or KINDS
    chosen = [case for case in cases() if case["kind"] in kinds and case["seed"] < options.count]
    options.output.mkdir(parents=True, exist_ok=True)
    results = options.output / f"{options.job}.jsonl"
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    rows = {row["id"]: row for row in map(json.loads, lines)}
    chosen = [case for case in chosen if case["id"] not in rows]
    if options.job == "run":
        generate = MotionPipeline.from_pretrained(options.model, threads=options.threads)
        generate("a person walks", 3.0, 0, takes=1)
    end = time.monotonic() + 60 * options.minutes
    with results.open("a", encoding="utf-8") as file:
        for case in chosen:
            if time.monotonic() > end:
                break
            if options.job == "run":
                row = generated(generate, case)
            else:
                row = _scored(case, _read(options.folder, case))
            rows[case["id"]] = row
            print(json.dumps(row), file=file, flush=True)
    print("\n".join(table([row for row in rows.values() if row["kind"] in kinds])))


def generated(generate: MotionPipeline, case: Case) -> dict[str, Any]:
    """Returns the figures of a case that a model makes."""
    goals, about = goals_of(case), (case["prompt"], case["seconds"], case["seed"])
    free = generate(*about, takes=1)
    start, cpu = time.perf_counter(), time.process_time()
    try:
        made = generate(*about, goals=goals, takes=1)
    except InputError as error:
        return {"id": case["id"], "kind": case["kind"], "refused": str(error)}
    wall, used = time.perf_counter() - start, time.process_time() - cpu
    before = np.mean([goal["before"] for goal in made.metadata["goals"]])
    figures = {"ms": 1e3 * wall, "cpu_ms": 1e3 * used, "before_cm": 1e2 * float(before)}
    figures |= {"free_sliding": 1e2 * sliding_in_contact(free), "free_jerk": _jerk(free)}
    return {**_scored(case, made), **figures}


def goals_of(case: Case) -> list[Goal]:
    """Returns the goals of a case for a pipeline."""
    goals: list[Goal] = [
        Reach(goal["joint"], goal["at"], tuple(goal["to"]), goal.get("until"))
        for goal in case.get("goals", ())
    ]
    if "path" in case:
        goals.append(RootPath([(x, z) for x, z in case["path"]["points"]], case["path"]["at"]))
    for key in case.get("keyframes", ()):
        joints = np.array(poses()[key["pose"]])
        joints = turn(joints, np.array(np.radians(key["degrees"])))
        joints = joints + np.array([key["to"][0], 0.0, key["to"][1]])
        goals.append(Pose(key["at"], Motion(joints[None].astype(np.float32))))
    return goals


def _scored(case: Case, motion: Motion | None) -> dict[str, Any]:
    """Returns error, sliding and jerk of a motion."""
    about = {"id": case["id"], "kind": case["kind"]}
    if motion is None:
        return {**about, "refused": "no such file"}
    goals = []
    for goal in goals_of(case):
        if isinstance(goal, RootPath):
            assert goal.at is not None
            pairs = list(zip(goal.points, goal.at, strict=True))[1:]
            goals += [Reach("pelvis", at, (x, None, z)) for (x, z), at in pairs]
        else:
            goals.append(goal)
    targets = targets_of(goals, len(motion), motion.fps, motion.skeleton, None)
    missed = distances(motion.joints.astype(np.float64), targets, motion.skeleton)
    figures = {"error_cm": 1e2 * float(missed.mean()), "worst_cm": 1e2 * float(missed.max())}
    return {**about, **figures, "sliding": 1e2 * sliding_in_contact(motion), "jerk": _jerk(motion)}


def _jerk(motion: Motion) -> float:
    return jitter(motion.joints, motion.fps)


def _read(folder: Path | None, case: Case) -> Motion | None:
    files = sorted(folder.glob(f"{case['id']}.*")) if folder is not None else []
    return Motion.load(files[0]) if files else None


COLUMNS: Mapping[str, tuple[str, Callable[[np.ndarray], np.floating]]] = {
    "error, cm": ("error_cm", np.mean),
    "worst, cm": ("worst_cm", np.max),
    "before the last step, cm": ("before_cm", np.mean),
    "sliding, cm/s": ("sliding", np.mean),
    "without goals": ("free_sliding", np.mean),
    "jerk, m/s³": ("jerk", np.mean),
    "without": ("free_jerk", np.mean),
    "ms, median": ("ms", np.median),
    "CPU ms": ("cpu_ms", np.median),
}


def table(rows: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    """Yields a Markdown table, a row for each kind."""
    yield "| goals | cases | refused | " + " | ".join(COLUMNS) + " |"
    yield "|---|--:|--:|" + "--:|" * len(COLUMNS)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        every = [row for row in rows if row["kind"] == kind]
        met = [row for row in every if "refused" not in row]
        cells = []
        for name, of in COLUMNS.values():
            values = [row[name] for row in met if name in row]
            cells.append(f"{of(np.array(values)):.3g}" if values else "–")
        yield f"| {kind} | {len(every)} | {len(every) - len(met)} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
