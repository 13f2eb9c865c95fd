"""The contents of a data set: sources, clips and their captions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Split = Literal["train", "val", "test"]

SPLITS: tuple[Split, ...] = ("train", "val", "test")


@dataclass(frozen=True)
class Source:
    """The origin of motions, with the terms of their owner."""

    name: str
    """Short name, e.g. `cmu`."""
    license: str
    """The owner's terms."""
    credit: str
    """The credit line, in the owner's words where there are such."""
    url: str = ""
    """Address from which the data can be downloaded."""


@dataclass(frozen=True)
class Caption:
    """One sentence about a clip, or about a part of it."""

    text: str
    """The sentence."""
    start_frame: int
    """First frame that it describes."""
    end_frame: int
    """One past the last frame that it describes."""
    tokens: str = ""
    """HumanML3D's `word/POS` tokens, separated by spaces; empty where there are none."""


@dataclass(frozen=True)
class Clip:
    """One motion of a prepared folder; `Dataset.features` gives its frames."""

    id: str
    """Unique name; a mirrored copy has `M` before the name of the clip it was made from."""
    source: str
    """Name of its source."""
    split: Split
    """Its split."""
    captions: tuple[Caption, ...]
    """Sentences, already mirrored in a mirrored copy; none if there are none."""
    action: str | None
    """Action label, already mirrored in a mirrored copy."""
    mirrored: bool
    """Whether left and right are swapped."""
    frames: int
    """Number of feature frames."""
    origin: str = ""
    """The recording and, where it is a part, the frames at the data set's rate."""
