"""Animation: how the joints of any skeleton turn over time; what mocap files hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Animation:
    """Local rotations of a skeleton over time."""

    skeleton: Skeleton
    """Whose joints turn."""
    rotations: Float[np.ndarray, "frames joints 3 3"]
    """Rotation of each joint relative to its parent; identity is the rest pose."""
    root_positions: Float[np.ndarray, "frames 3"]
    """Position of the root joint, meters, y up."""
    fps: float
    """Frames per second."""
    translations: Float[np.ndarray, "frames joints 3"] | None = None
    """Animated offsets in place of the skeleton's, in files that move more than the root."""

    def __len__(self) -> int:
        return len(self.rotations)

    def joints(self) -> Float[np.ndarray, "frames joints 3"]:
        """Returns global joint positions, meters."""
        return self.skeleton.forward_kinematics(
            self.rotations, self.root_positions, self.translations
        )
