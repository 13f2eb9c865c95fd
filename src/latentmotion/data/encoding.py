"""Recordings of joints → features: glitches told, bodies retargeted, the way back measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float

from latentmotion.data.glitches import find_glitch
from latentmotion.data.recording import Dropped, EncodedRecording, Recording
from latentmotion.representation.interface import Representation

MIN_FRAMES = 10
"""Shortest clip that is kept; half a second holds a hop, or one turn of the arms."""


def encode_all(
    items: Iterable[Recording | Dropped], representation: Representation
) -> Iterator[EncodedRecording | Dropped]:
    """Encodes what a source yields; what is too short or glitchy comes out with the reason."""
    for item in items:
        yield item if isinstance(item, Dropped) else encode(item, representation)


def encode(recording: Recording, representation: Representation) -> EncodedRecording | Dropped:
    """Encodes one recording, or tells why it cannot be used."""
    joints = recording.joints
    if len(joints) < MIN_FRAMES:
        reason: str | None = f"{len(joints)} frames, fewer than {MIN_FRAMES}"
    else:
        reason = find_glitch(joints, representation.fps)
    if reason:
        return Dropped(recording.label.id, "clip", reason)
    joints = representation.retarget(joints)
    features = representation.encode(joints)
    error = _round_trip(joints, features, representation)
    return EncodedRecording(recording.label, features, error)


def _round_trip(
    joints: Float[np.ndarray, "frames joints 3"],
    features: Float[np.ndarray, "frames_less_one features"],
    representation: Representation,
) -> float:
    expected = representation.canonicalize(joints[:-1])
    found = representation.canonicalize(representation.decode(features))
    return float(np.linalg.norm(found - expected, axis=-1).max() * 1000)
