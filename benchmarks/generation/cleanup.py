"""How long clean-up takes, step by step, beside the network that made the motions.

    python -m benchmarks.generation.cleanup

One motion, and sixteen of the same length together. Each step has the joints that it has in
`latentmotion.cleanup`; milliseconds are of one thread.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.harness.contest import Times, figure, table, take_turns, whole
from benchmarks.harness.stopwatch import Laps, Stopwatch
from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup.bones import constant_bones
from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.floor import align_floor
from latentmotion.cleanup.foot_lock import FootLock, lock_feet
from latentmotion.cleanup.leg_ik import keep_knee_direction
from latentmotion.cleanup.pipeline import clean_batch
from latentmotion.cleanup.smoothing import smooth

PROMPTS = ("a person walks forward", "a person kicks with the right foot", "a person jumps")
CUTOFF = 5.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="fast")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--together", type=int, default=16)
    parser.add_argument("--turns", type=int, default=50)
    options = parser.parse_args(arguments)
    print(report(options.model, options.seconds, options.together, options.turns))


def report(model: str, seconds: float, together: int, turns: int) -> str:
    """Returns the table.

    Args:
        model: Name of the model.
        seconds: Length of the motions.
        together: Motions of the batch.
        turns: Turns that count.
    """
    generate = MotionPipeline.from_pretrained(model, "onnxruntime", threads=1)
    prompts = [PROMPTS[n % len(PROMPTS)] for n in range(together)]
    motions = generate.batch(prompts, seconds)
    contenders = {}
    for count in (1, together):
        some = motions[:count]
        network = partial(generate.batch, prompts[:count], seconds)
        contenders[f"steps {count}"] = partial(_steps, some)
        contenders[f"all {count}"] = whole(partial(clean_batch, some))
        contenders[f"network {count}"] = whole(network)
    times = take_turns(contenders, turns)
    rows = []
    for step in times.turns["steps 1"][0].laps:
        rows.append([step, *(figure(times.part(f"steps {n}", step)) for n in (1, together))])
    for name, key in (
        ("`clean_batch`, all of it", "all"),
        ("the network, text to joints", "network"),
    ):
        rows.append([name, *(figure(times.whole(f"{key} {n}")) for n in (1, together))])
    rows.append(["clean-up : network", *(f"{_ratio(times, n):.2f}" for n in (1, together))])
    return f"{times}\n\n{table(['step', 'one motion, ms', f'{together} together, ms'], rows)}"


def _ratio(times: Times, count: int) -> float:
    return times.ratio(f"network {count}", f"all {count}")


def _steps(motions: Sequence[Motion]) -> Laps:
    fps, skeleton = motions[0].fps, motions[0].skeleton
    watch = Stopwatch()
    joints = np.stack([motion.joints for motion in motions], axis=1).astype(np.float64)
    joints = keep_knee_direction(smooth(joints, fps, CUTOFF), joints, skeleton)
    watch.lap("smoothing")
    joints = constant_bones(joints, fps, skeleton)
    watch.lap("bones")
    joints = align_floor(joints, fps, skeleton)
    watch.lap("floor")
    contacts = foot_contacts(joints, fps, skeleton)
    watch.lap("contacts")
    lock_feet(joints, contacts, fps, skeleton, FootLock())
    watch.lap("feet")
    return watch.laps


if __name__ == "__main__":
    main()
