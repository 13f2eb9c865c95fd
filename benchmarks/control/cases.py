"""The cases: 200 of each kind, drawn by a seed, so that every machine writes the same file.

    root_path       the pelvis is on a curve in every half second, at the speed of its prompt
    waypoints       the pelvis is at two to four places
    joints          wrists, feet or the head are at one to five places
    keyframes       the whole body is in one to three poses, of `poses.json`
    end_effectors   a hand or a foot is at a place and stays there for a second

Places are in meters, y up; a motion starts above the origin and faces +z. null leaves a coordinate
free. No recording was used: curves and places are drawn within what a walking or standing body
reaches, poses are of generated motions. Everything here is dedicated to the public (CC0 1.0).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

KINDS = ("root_path", "waypoints", "joints", "keyframes", "end_effectors")
EACH = 200
SEED = 20261126
POSES = Path(__file__).with_name("poses.json")

_GAITS = (("a person walks forward", 1.1), ("a person walks slowly", 0.8), ("a person jogs", 2.2))
_STANDING = ("a person stands still", "a person stretches the arms", "a person dances in place")
# Places beside the middle of the body that a joint reaches: x, y and z, from and to.
_REACH = {
    "left_wrist": ((0.15, 0.5), (0.85, 1.6), (0.1, 0.45)),
    "right_wrist": ((-0.5, -0.15), (0.85, 1.6), (0.1, 0.45)),
    "head": ((-0.1, 0.1), (1.3, 1.6), (-0.05, 0.2)),
    "left_foot": ((0.05, 0.2), (0.03, 0.25), (-0.1, 0.3)),
    "right_foot": ((-0.2, -0.05), (0.03, 0.25), (-0.1, 0.3)),
}

Case = dict[str, Any]


def cases() -> list[Case]:
    """Returns all cases, those of a kind one after the other."""
    makers = (_root_paths, _waypoints, _joints, _keyframes, _end_effectors)
    every = []
    for kind, make in zip(KINDS, makers, strict=True):
        draw = Random(f"{SEED} {kind}")
        for number, case in zip(range(EACH), make(draw), strict=False):
            every.append({"id": f"{kind}-{number:03d}", "kind": kind, "seed": number, **case})
    return every


def file_content() -> str:
    """Returns the cases as the text of a JSON file, a line for each."""
    lines = [json.dumps(case, separators=(",", ":")) for case in cases()]
    head = '{"format":1,"license":"CC0-1.0","poses":' + json.dumps(poses(), separators=(",", ":"))
    return head + ',"cases":[\n' + ",\n".join(lines) + "\n]}\n"


def poses() -> list[list[list[float]]]:
    """Returns the poses: joints of HumanML3D's skeleton, meters, pelvis above the origin."""
    packed = json.loads(POSES.read_text(encoding="utf-8"))["millimeters"]
    return [
        [[row[n] / 1000, row[n + 1] / 1000, row[n + 2] / 1000] for n in range(0, len(row), 3)]
        for row in packed
    ]


def _root_paths(draw: Random) -> Iterator[Case]:
    while True:
        prompt, speed = draw.choice(_GAITS)
        speed *= draw.uniform(0.8, 1.2)
        seconds, bend = draw.choice((3.0, 4.0, 5.0, 6.0)), draw.uniform(-0.5, 0.5)
        swing = draw.choice((0.0, draw.uniform(-0.6, 0.6)))
        x = z = yaw = 0.0
        points, times = [[0.0, 0.0]], [0.0]
        for step in range(1, round(seconds * 20)):
            meters = step / 20 * speed
            yaw += (bend + swing * math.cos(1.5 * meters)) * speed / 20
            x, z = x + math.sin(yaw) * speed / 20, z + math.cos(yaw) * speed / 20
            if step % 10 == 0:
                points.append([round(x, 3), round(z, 3)])
                times.append(step / 20)
        yield {"prompt": prompt, "seconds": seconds, "path": {"points": points, "at": times}}


def _waypoints(draw: Random) -> Iterator[Case]:
    for case in _root_paths(draw):
        points = list(zip(case["path"]["points"], case["path"]["at"], strict=True))[2:]
        chosen = sorted(draw.sample(points, draw.randint(2, 4)), key=lambda pair: pair[1])
        goals = [{"joint": "pelvis", "at": at, "to": [x, None, z]} for (x, z), at in chosen]
        yield {"prompt": case["prompt"], "seconds": case["seconds"], "goals": goals}


def _joints(draw: Random) -> Iterator[Case]:
    while True:
        prompt, speed = draw.choice((*_GAITS[:2], *((words, 0.0) for words in _STANDING)))
        seconds = draw.choice((3.0, 4.0, 5.0))
        times = draw.sample(range(15, round(20 * seconds) - 5, 8), draw.randint(1, 5))
        goals = [_place(draw, draw.choice(list(_REACH)), at / 20, speed) for at in sorted(times)]
        yield {"prompt": prompt, "seconds": seconds, "goals": goals}


def _keyframes(draw: Random) -> Iterator[Case]:
    count = len(poses())
    while True:
        prompt, speed = draw.choice(_GAITS[:2])
        seconds, number = draw.choice((4.0, 5.0, 6.0)), draw.randint(1, 3)
        frames = sorted(draw.sample(range(30, round(20 * seconds) - 10, 30), min(number, 2)))
        frames = [0, *frames] if number == 3 else frames
        placed = [
            {
                "pose": draw.randrange(count),
                "at": frame / 20,
                "to": [0.0, round(speed * frame / 20, 3)],
                "degrees": 0.0 if frame == 0 else round(draw.uniform(-25, 25), 1),
            }
            for frame in frames
        ]
        yield {"prompt": prompt, "seconds": seconds, "keyframes": placed}


def _end_effectors(draw: Random) -> Iterator[Case]:
    while True:
        seconds, at = draw.choice((3.0, 4.0, 5.0)), draw.choice((1.0, 1.25, 1.5))
        names = draw.sample(("left_wrist", "right_wrist"), draw.randint(1, 2))
        goals = [{**_place(draw, name, at, 0.0), "until": at + 1.0} for name in names]
        yield {"prompt": draw.choice(_STANDING), "seconds": seconds, "goals": goals}


def _place(draw: Random, joint: str, at: float, speed: float) -> Case:
    x, y, z = (draw.uniform(*span) for span in _REACH[joint])
    return {"joint": joint, "at": at, "to": [round(x, 3), round(y, 3), round(z + speed * at, 3)]}
