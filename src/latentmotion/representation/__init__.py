"""Joints and features: how a pose becomes numbers a network can learn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from latentmotion.errors import named

if TYPE_CHECKING:
    from latentmotion.representation.interface import Representation


def representation_named(name: str) -> Representation:
    """Returns one of the representations that files and model cards name.

    Raises:
        InputError: There is none of that name.
    """
    from latentmotion.representation.humanml3d import (
        HANDS_FEATURES,
        HUMANML3D_FEATURES,
        KIT_FEATURES,
    )
    from latentmotion.representation.smpl import SMPL_FEATURES

    representations = {
        each.name: each
        for each in (HUMANML3D_FEATURES, HANDS_FEATURES, KIT_FEATURES, SMPL_FEATURES)
    }
    return named("representation", name, representations)
