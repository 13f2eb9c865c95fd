"""Directions of bones as whole numbers, each told from where the two frames before it point.

A bone of known length is a direction, two numbers instead of three. Extrapolate d̂ ∝ a + m (a - b)
from its last directions a and b, span the plane across d̂ by e₁ and e₂, and keep the angles

    (u, v) = θ / sin θ (d·e₁, d·e₂),  cos θ = d·d̂,  in steps of quantum / length.

Writing aims each bone from where reading will put its parent, so errors do not add up along limbs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import Skeleton

_MOMENTUM = 0.9
"""How much of its last turn a bone is taken to repeat; fewest bytes on CMU's and HDM05's clips."""


@dataclass(frozen=True)
class BoneCoder:
    """Positions of joints to whole numbers and back."""

    skeleton: Skeleton
    """Whose joints these are, with the lengths of all bones."""
    quantum: float
    """Step of a bone's end across the bone, meters."""

    @property
    def lengths(self) -> Float[np.ndarray, " bones"]:
        """Length of each joint's bone but the root's, meters."""
        return np.linalg.norm(self.skeleton.offsets[1:], axis=-1)

    def encode(
        self,
        joints: Float[np.ndarray, "rows joints 3"],
        root: Float[np.ndarray, "rows 3"],
        frames: Int[np.ndarray, " clips"],
    ) -> Int[np.ndarray, "rows bones 2"]:
        """Returns the numbers of each bone.

        Args:
            joints: Global positions, clip after clip, meters.
            root: Position of the root as it will be read.
            frames: Rows of each clip.
        """
        numbers = np.zeros((len(joints), len(self.lengths), 2), np.int64)
        found = np.zeros_like(joints)
        found[:, 0] = root
        for rows, last, before in _steps(frames, self._rest(len(frames))):
            guess = _extrapolated(last, before)
            for bone, parent in enumerate(self.skeleton.parents[1:]):
                aim = joints[rows, bone + 1] - found[rows, parent]
                angles = _angles(guess[:, bone], aim / np.linalg.norm(aim, axis=-1, keepdims=True))
                numbers[rows, bone] = np.rint(angles * self.lengths[bone] / self.quantum)
                taken = numbers[rows, bone] * (self.quantum / self.lengths[bone])
                before[:, bone] = last[:, bone]
                last[:, bone] = _turned(guess[:, bone], taken)
                found[rows, bone + 1] = found[rows, parent] + self.lengths[bone] * last[:, bone]
        return numbers

    def decode(
        self,
        numbers: Int[np.ndarray, "rows bones 2"],
        root: Float[np.ndarray, "rows 3"],
        frames: Int[np.ndarray, " clips"],
    ) -> Float[np.ndarray, "rows joints 3"]:
        """Returns the global positions that `encode` was given, to half a quantum per bone."""
        angles = numbers * (self.quantum / self.lengths[:, None])
        directions = np.zeros((*numbers.shape[:2], 3))
        for rows, last, before in _steps(frames, self._rest(len(frames))):
            turned = _turned(_extrapolated(last, before), angles[rows])
            before[:], last[:] = last, turned
            directions[rows] = turned
        joints = [root]
        for bone, parent in enumerate(self.skeleton.parents[1:]):
            joints.append(joints[parent] + self.lengths[bone] * directions[:, bone])
        return np.stack(joints, axis=1)

    def _rest(self, clips: int) -> Float[np.ndarray, "clips bones 3"]:
        directions = self.skeleton.offsets[1:] / self.lengths[:, None]
        return np.repeat(directions[None], clips, axis=0)


def _steps(
    frames: Int[np.ndarray, " clips"], rest: Float[np.ndarray, "clips bones 3"]
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yields for each frame the rows of all clips that have it and their last two directions."""
    longest_first = np.argsort(-frames, kind="stable")
    starts = (np.cumsum(frames) - frames)[longest_first]
    sorted_frames = frames[longest_first]
    last, before = rest.copy(), rest.copy()
    for frame in range(int(frames.max())):
        count = int(np.count_nonzero(sorted_frames > frame))
        yield starts[:count] + frame, last[:count], before[:count]
        if frame == 0:  # the turn from the rest pose is none that goes on
            before[:] = last


def _extrapolated(
    last: Float[np.ndarray, "*batch 3"], before: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    ahead = last + _MOMENTUM * (last - before)
    return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)


def _angles(
    guess: Float[np.ndarray, "*batch 3"], direction: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 2"]:
    across = np.stack([(direction * axis).sum(axis=-1) for axis in _plane(guess)], axis=-1)
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (direction * guess).sum(axis=-1, keepdims=True))
    return across * (angle / np.maximum(sine, 1e-12))


def _turned(
    guess: Float[np.ndarray, "*batch 3"], angles: Float[np.ndarray, "*batch 2"]
) -> Float[np.ndarray, "*batch 3"]:
    first, second = _plane(guess)
    angle = np.linalg.norm(angles, axis=-1, keepdims=True)
    across = angles[..., :1] * first + angles[..., 1:] * second
    return np.cos(angle) * guess + np.sinc(angle / np.pi) * across


def _plane(
    normal: Float[np.ndarray, "*batch 3"],
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Two unit vectors across a third (Duff et al., "Building an Orthonormal Basis, Revisited")."""
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return first, np.stack([b, sign + y * y * a, -y], axis=-1)
