"""Between a file and a training set: recordings as joints, or as features that others computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import TaggedSentence
from latentmotion.data.clip import Split


@dataclass(frozen=True)
class Label:
    """What is known about a recording besides its motion."""

    id: str
    """Unique name of the clip that becomes of it."""
    source: str
    """Name of its source."""
    origin: str
    """The file it was cut from and where."""
    split: Split
    """The part of the data it belongs to."""
    sentences: tuple[TaggedSentence, ...] = ()
    """What happens in it."""
    mirrored_sentences: tuple[TaggedSentence, ...] = ()
    """What happens in its mirror image."""
    action: str | None = None
    """Action label."""
    mirrored_action: str | None = None
    """Action label of its mirror image."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion as joints, cut, at the frame rate of the data set."""

    label: Label
    """What is known about it."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Joint positions, meters, y up; body proportions as recorded."""


@dataclass(frozen=True, eq=False)
class EncodedRecording:
    """A motion as features: of a recording, or as an official processed folder holds them."""

    label: Label
    """What is known about it."""
    features: Float[np.ndarray, "frames features"]
    """Features, not normalized."""
    round_trip_mm: float | None = None
    """Largest distance of a joint after joints → features → joints, where there were joints."""


@dataclass(frozen=True)
class Dropped:
    """Something that does not get into the training set."""

    id: str
    """The clip, or the file."""
    what: str
    """`clip`, `part` of one (the rest is kept) or `caption`."""
    reason: str
    """Why."""
