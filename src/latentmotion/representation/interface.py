"""Representation: the interface between joint positions and the features that networks learn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from jaxtyping import Float

from latentmotion.errors import InputError, hint
from latentmotion.kinematics.skeleton import Skeleton


@runtime_checkable
class Representation(Protocol):
    """Converts joints to features and back; NumPy and PyTorch arrays alike."""

    @property
    def name(self) -> str:
        """Its name in files."""
        ...

    @property
    def skeleton(self) -> Skeleton:
        """The joints it describes."""
        ...

    @property
    def fps(self) -> float:
        """Frames per second of its velocities."""
        ...

    @property
    def width(self) -> int:
        """Features per frame."""
        ...

    @property
    def normalized(self) -> bool:
        """Whether networks see its features normalized, or as they are."""
        ...

    @property
    def blocks(self) -> Mapping[str, slice]:
        """The range of each block of features, by name; they cover the width once, in order."""
        ...

    def encode(
        self, joints: Float[Any, "frames joints 3"]
    ) -> Float[Any, "frames_less_one features"]:
        """Returns the features of a clip, whatever its position and heading; one frame less."""
        ...

    def decode(
        self, features: Float[Any, "*batch frames features"]
    ) -> Float[Any, "*batch frames joints 3"]:
        """Returns joints that start above the origin; differentiable in PyTorch."""
        ...

    def retarget(self, joints: Float[Any, "frames _ 3"]) -> Float[Any, "frames joints 3"]:
        """Gives a body of any size the skeleton's bone lengths."""
        ...

    def canonicalize(self, joints: Float[Any, "frames joints 3"]) -> Float[Any, "frames joints 3"]:
        """Moves the lowest point to the floor and the start to the origin, facing +z."""
        ...

    def restart(
        self, features: Float[Any, "*batch frames features"]
    ) -> Float[Any, "*batch frames features"]:
        """Returns features cut from a longer clip as those of a clip that begins with them."""
        ...

    def mirror(
        self, features: Float[Any, "*batch frames features"]
    ) -> Float[Any, "*batch frames features"]:
        """Swaps left and right of the body and of its path."""
        ...


def representation_named(name: str) -> Representation:
    """Returns one of the representations that files and model cards name.

    Raises:
        InputError: There is none of that name.
    """
    from latentmotion.representation.humanml3d import HUMANML3D_FEATURES, KIT_FEATURES
    from latentmotion.representation.smpl import SMPL_FEATURES

    known = {each.name: each for each in (HUMANML3D_FEATURES, KIT_FEATURES, SMPL_FEATURES)}
    if name in known:
        return known[name]
    raise InputError(f"unknown representation {name!r}; {hint(name, known)}")
