"""What a training set is made of: sources, clips and the captions that say what happens in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Split = Literal["train", "val", "test"]

SPLITS: tuple[Split, ...] = ("train", "val", "test")


@dataclass(frozen=True)
class Source:
    """Where motions come from and what their owner asks."""

    name: str
    """Short name, e.g. `cmu`."""
    license: str
    """The owner's terms."""
    credit: str
    """Whom to name, in the owner's words where there are such."""
    url: str = ""
    """Where the data can be had."""


@dataclass(frozen=True)
class Caption:
    """One sentence about a clip, or about a part of it."""

    text: str
    """The sentence."""
    start_frame: int
    """First frame that it tells of."""
    end_frame: int
    """One past the last frame that it tells of."""
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
    """The part of the data that it belongs to."""
    captions: tuple[Caption, ...]
    """Sentences, already mirrored in a mirrored copy; none where nobody wrote any."""
    action: str | None
    """Action label, already mirrored in a mirrored copy."""
    mirrored: bool
    """Whether left and right are swapped."""
    frames: int
    """Number of feature frames."""
    origin: str = ""
    """The recording and, where it is a part, the frames at the data set's rate."""
