"""The representations that files and model cards name."""

from __future__ import annotations

from latentmotion.errors import InputError, hint
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
from latentmotion.representation.interface import Representation
from latentmotion.representation.smpl import SMPL_FEATURES

REPRESENTATIONS: dict[str, Representation] = {
    part.name: part for part in (HUMANML3D_FEATURES, KIT_FEATURES, SMPL_FEATURES)
}
"""Each representation by its name."""


def representation_named(name: str) -> Representation:
    """Returns a representation.

    Raises:
        InputError: There is none of that name.
    """
    if name in REPRESENTATIONS:
        return REPRESENTATIONS[name]
    raise InputError(f"unknown representation {name!r}; {hint(name, REPRESENTATIONS)}")
