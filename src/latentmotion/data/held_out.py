"""Clips held out for validation and test: fixed lists, so that figures stay comparable.

`splits/val.txt` and `splits/test.txt` name source, clip and frames of joints. HumanML3D and HDM05
have rules of their own, which the lists repeat; takes of Seoul National University are drawn by
hash and cut where the lists say, even if the rules for cutting change.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from latentmotion.data.clip import Split

VAL, TEST = 0.05, 0.10
"""Fractions of the recordings that are held out where no list names them."""


@dataclass(frozen=True)
class HeldOut:
    """One clip that never trains."""

    source: str
    """Name of its source."""
    split: Split
    """`val` or `test`."""
    frames: int
    """Its length in joints, one more than in features."""


@cache
def held_out() -> Mapping[str, HeldOut]:
    """Returns the fixed clips of val and test, by id."""
    clips = {}
    splits: tuple[Split, ...] = ("val", "test")
    for split in splits:
        file = resources.files("latentmotion.data").joinpath(f"splits/{split}.txt")
        for line in file.read_text(encoding="utf-8").splitlines():
            source, name, frames = line.split()
            clips[name] = HeldOut(source, split, int(frames))
    return clips


def pieces_of(prefix: str) -> list[tuple[int, int]]:
    """Returns the fixed pieces of a take whose clips are called `{prefix}-{first frame}`."""
    clips = ((name.rpartition("-"), clip.frames) for name, clip in held_out().items())
    starts = [(int(start), frames) for (take, _, start), frames in clips if take == prefix]
    return sorted((start, start + frames) for start, frames in starts)


def split_of(source: str, recording: str) -> Split:
    """Returns the split of a recording, the same on every machine."""
    digest = hashlib.sha256(f"{source}/{recording}".encode()).digest()
    draw = int.from_bytes(digest[:4], "big") / 2**32
    if draw < TEST:
        return "test"
    return "val" if draw < TEST + VAL else "train"
