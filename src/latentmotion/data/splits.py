"""Which recordings are held out for validation and test: fixed lists, and a hash for the rest."""

from __future__ import annotations

import hashlib

from latentmotion.data.clip import Split

VAL, TEST = 0.05, 0.10
"""Parts of the recordings that are held out where no list names them."""


def split_of(source: str, recording: str) -> Split:
    """Returns the split of a recording, the same on every machine and whatever else is there."""
    digest = hashlib.sha256(f"{source}/{recording}".encode()).digest()
    part = int.from_bytes(digest[:4], "big") / 2**32
    if part < TEST:
        return "test"
    return "val" if part < TEST + VAL else "train"
