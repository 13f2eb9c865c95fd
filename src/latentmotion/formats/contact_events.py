"""Contact events, when feet come down and leave the floor: `.contacts.csv` and `.contacts.json`.

csv   time,event          0.35,left_foot_down      a row for each event, seconds
json  {"fps": 20, "seconds": 4.0, "events": [{"time": 0.35, "event": "left_foot_down"}, …]}
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.cleanup.contacts import contact_intervals, foot_contacts
from latentmotion.cleanup.loops import is_loop, unrolled
from latentmotion.formats.takes import numbered
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_file


def contact_events(motion: Motion) -> list[dict[str, Any]]:
    """Returns when feet come down and leave the floor: `time` in seconds, and `event`.

    Args:
        motion: A motion; a loop's feet go on beyond its ends.
    """
    if not (motion.skeleton.left_foot or motion.skeleton.right_foot):
        return []
    count = len(motion) - 1 if is_loop(motion) else len(motion)
    whole = unrolled(motion, 1, 1) if is_loop(motion) else motion
    first = count if is_loop(motion) else 0
    standing = foot_contacts(whole.joints.astype(np.float64), whole.fps, whole.skeleton)
    half = len(whole.skeleton.left_foot)
    events: list[dict[str, Any]] = []
    for side, feet in (("left", standing[:, :half]), ("right", standing[:, half:])):
        for start, end in contact_intervals(np.asarray(feet.any(axis=1))):
            for frame, kind in ((start, "down"), (end, "up")):
                if first <= frame < first + count and frame > 0:
                    time = round((frame - first) / motion.fps, 4)
                    events.append({"time": time, "event": f"{side}_foot_{kind}"})
    return sorted(events, key=lambda event: event["time"])


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes the events of each motion: `a.contacts.csv`, or `a-1.contacts.csv` and so on.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    for target, motion in zip(paths, motions, strict=True):
        events = contact_events(motion)
        if target.suffix.lower() == ".csv":
            rows = [f"{one['time']:g},{one['event']}" for one in events]
            text = "\n".join(["time,event", *rows])
        else:
            whole = {"fps": motion.fps, "seconds": motion.seconds, "events": events}
            text = json.dumps(whole, indent=1)
        with atomic_file(target) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    return paths
