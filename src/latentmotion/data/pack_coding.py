"""Features of many clips to one block of bytes and back.

A clip of n feature frames has n + 1 frames of joints: the velocities tell where the last one is.
Its features are made anew from joints and heading, so neither floor nor start has to be guessed.
Root and heading are second differences on a grid; contacts are the bits in which the given labels
differ from those that the joints make, mostly none.

A bone of known length is a direction, two numbers instead of three. Extrapolate d̂ ∝ a + m (a - b)
from its last directions a and b, span the plane across d̂ by e₁ and e₂, and keep the angles

    (u, v) = θ / sin θ (d·e₁, d·e₂),  cos θ = d·d̂,  in steps of quantum / length.

Writing aims each bone from where reading will put its parent, so errors do not add up along limbs.

Numbers are 16 bits, the sign last, all high bytes before all low ones, column after column (xz).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import turn
from latentmotion.representation.humanml3d import HumanML3DRepresentation

Clips = Sequence[Float[np.ndarray, "_ features"]]

Counts = Int[np.ndarray, " clips"]  # Frames of each clip.
Numbers = Int[np.ndarray, "rows n"]
Vectors = Float[np.ndarray, "*batch 3"]

_CONTACTS = 4

# Fraction of its last rotation that a bone repeats; fewest bytes on CMU's and HDM05's clips.
_MOMENTUM = 0.9


@dataclass(frozen=True)
class BoneCoder:
    """Positions of joints to whole numbers and back."""

    skeleton: Skeleton  # Skeleton of the joints, with the lengths of all bones.
    quantum: float  # Step of a bone's end across the bone, meters.

    @property
    def lengths(self) -> Float[np.ndarray, " bones"]:
        """Length of each joint's bone but the root's, meters."""
        return np.linalg.norm(self.skeleton.offsets[1:], axis=-1)

    def encode(
        self,
        joints: Float[np.ndarray, "rows joints 3"],
        root: Float[np.ndarray, "rows 3"],
        frames: Counts,
    ) -> Int[np.ndarray, "rows bones 2"]:
        """Returns the numbers of each bone.

        Args:
            joints: Global positions, clip after clip, meters.
            root: Position of the root as it will be read.
            frames: Rows of each clip.
        """
        numbers = np.zeros((len(joints), len(self.lengths), 2), np.int64)
        decoded = np.zeros_like(joints)
        decoded[:, 0] = root
        for rows, last, before in _steps(frames, self._rest(len(frames))):
            guess = _extrapolated(last, before)
            for bone, parent in enumerate(self.skeleton.parents[1:]):
                aim = joints[rows, bone + 1] - decoded[rows, parent]
                direction = aim / np.linalg.norm(aim, axis=-1, keepdims=True)
                across = np.stack(
                    [(direction * axis).sum(axis=-1) for axis in _plane(guess[:, bone])], axis=-1
                )
                sine = np.linalg.norm(across, axis=-1, keepdims=True)
                angle = np.arctan2(sine, (direction * guess[:, bone]).sum(axis=-1, keepdims=True))
                angles = across * (angle / np.maximum(sine, 1e-12))
                numbers[rows, bone] = np.rint(angles * self.lengths[bone] / self.quantum)
                rounded = numbers[rows, bone] * (self.quantum / self.lengths[bone])
                before[:, bone] = last[:, bone]
                last[:, bone] = _tilted(guess[:, bone], rounded)
                decoded[rows, bone + 1] = decoded[rows, parent] + self.lengths[bone] * last[:, bone]
        return numbers

    def decode(
        self,
        numbers: Int[np.ndarray, "rows bones 2"],
        root: Float[np.ndarray, "rows 3"],
        frames: Counts,
    ) -> Float[np.ndarray, "rows joints 3"]:
        """Returns the global positions that `encode` was given, to half a quantum per bone."""
        angles = numbers * (self.quantum / self.lengths[:, None])
        directions = np.zeros((*numbers.shape[:2], 3))
        for rows, last, before in _steps(frames, self._rest(len(frames))):
            turned = _tilted(_extrapolated(last, before), angles[rows])
            before[:], last[:] = last, turned
            directions[rows] = turned
        joints = [root]
        for bone, parent in enumerate(self.skeleton.parents[1:]):
            joints.append(joints[parent] + self.lengths[bone] * directions[:, bone])
        return np.stack(joints, axis=1)

    def _rest(self, clips: int) -> Float[np.ndarray, "clips bones 3"]:
        directions = self.skeleton.offsets[1:] / self.lengths[:, None]
        return np.repeat(directions[None], clips, axis=0)


@dataclass(frozen=True)
class MotionCoder:
    """Features to bytes and back, to a stated precision."""

    representation: HumanML3DRepresentation  # Representation of the features.
    quantum: float  # Step of positions, meters.
    turn_quantum: float  # Step of the heading, radians.

    @property
    def columns(self) -> int:
        """Numbers of 16 bits per frame: root, heading, two per bone."""
        return 4 + 2 * (len(self.representation.skeleton) - 1)

    def size(self, frames: Sequence[int]) -> int:
        """Returns how many bytes clips of so many feature frames become."""
        return (2 * self.columns + 1) * sum(count + 1 for count in frames)

    def encode(self, clips: Clips) -> bytes:
        """Returns one block.

        Raises:
            DataError: A motion goes or turns too fast for 16 bits.
        """
        poses = [posed(clip, self.representation) for clip in clips]
        joints, yaw = (np.concatenate(parts) for parts in zip(*poses, strict=True))
        frames = np.array([len(clip) + 1 for clip in clips])
        grid = np.rint(np.column_stack([joints[:, 0] / self.quantum, yaw / self.turn_quantum]))
        moves = _differences(_differences(grid.astype(np.int64), frames), frames)
        bones = self._bones.encode(joints, grid[:, :3] * self.quantum, frames)
        numbers = np.concatenate([moves, bones.reshape(len(bones), -1)], axis=1)
        if np.abs(numbers).max() >= 2**15:
            raise DataError("a motion jumps too far for 16 bits; check it or take a larger quantum")
        signless = ((numbers << 1) ^ (numbers >> 63)).astype(np.uint16)
        planes = [signless >> 8, signless & 255]
        contacts, flips = self.representation.blocks["contacts"], []
        for original, decoded in zip(clips, self._features(numbers, frames), strict=True):
            differ = (original[:, contacts] > 0.5) ^ (decoded[:, contacts] > 0.5)
            flips += [differ @ (1 << np.arange(_CONTACTS)), np.zeros(1, np.int64)]
        arrays = [*(plane.T for plane in planes), np.concatenate(flips)]
        return b"".join(array.astype(np.uint8).tobytes() for array in arrays)

    def decode(self, block: bytes, frames: Sequence[int]) -> list[Float[np.ndarray, "_ features"]]:
        """Returns the features of the clips of a block, float32.

        Args:
            block: Result of `encode`, uncompressed.
            frames: Feature frames of each clip.
        """
        counts = np.array(frames) + 1
        rows = int(counts.sum())
        planes = np.frombuffer(block, np.uint8)
        high, low = planes[: 2 * self.columns * rows].reshape(2, self.columns, rows)
        signless = (high.astype(np.int64) << 8 | low).T
        clips = self._features((signless >> 1) ^ -(signless & 1), counts)
        flips = planes[2 * self.columns * rows :]
        for clip, bits in zip(clips, _split(flips, counts), strict=True):
            contacts = clip[:, self.representation.blocks["contacts"]]
            contacts[:] = (contacts > 0.5) ^ (((bits[:-1, None] >> np.arange(_CONTACTS)) & 1) == 1)
        return clips

    @property
    def _bones(self) -> BoneCoder:
        return BoneCoder(self.representation.skeleton, self.quantum)

    def _features(
        self, numbers: Int[np.ndarray, "rows columns"], frames: Counts
    ) -> list[Float[np.ndarray, "_ features"]]:
        grid = _sums(_sums(numbers[:, :4], frames), frames)
        root, yaw = grid[:, :3] * self.quantum, grid[:, 3] * self.turn_quantum
        bones = numbers[:, 4:].reshape(len(numbers), -1, 2)
        joints = self._bones.decode(bones, root, frames)
        pairs = zip(_split(joints, frames), _split(yaw, frames), strict=True)
        return [self.representation.describe(*pair) for pair in pairs]


def posed(
    features: Float[np.ndarray, "frames features"], representation: HumanML3DRepresentation
) -> tuple[Float[np.ndarray, "frames_and_one joints 3"], Float[np.ndarray, " frames_and_one"]]:
    """Returns joints and heading of a clip, one frame more than its features have."""
    features = features.astype(np.float64)
    yaw = -2 * np.concatenate([[0.0], np.cumsum(features[:, 0])])
    joints = representation.decode(features)
    steps = features[-1, representation.blocks["velocities"]].reshape(-1, 3)
    last = joints[-1] + turn(steps, np.full(len(steps), yaw[-2]))
    return np.concatenate([joints, last[None]]), yaw


def _differences(values: Numbers, frames: Counts) -> Numbers:
    """Each row less the one before it; the first of a clip stays."""
    result = np.diff(values, axis=0, prepend=0)
    starts = np.cumsum(frames) - frames
    result[starts] = values[starts]
    return result


def _sums(values: Numbers, frames: Counts) -> Numbers:
    return np.concatenate([np.cumsum(part, axis=0) for part in _split(values, frames)])


def _split(values: np.ndarray, frames: Counts) -> list[np.ndarray]:
    return np.split(values, np.cumsum(frames)[:-1])


def _steps(
    frames: Counts, rest: Float[np.ndarray, "clips bones 3"]
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


def _extrapolated(last: Vectors, before: Vectors) -> Vectors:
    ahead = last + _MOMENTUM * (last - before)
    return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)


def _tilted(guess: Vectors, angles: Float[np.ndarray, "*batch 2"]) -> Vectors:
    first, second = _plane(guess)
    angle = np.linalg.norm(angles, axis=-1, keepdims=True)
    across = angles[..., :1] * first + angles[..., 1:] * second
    return np.cos(angle) * guess + np.sinc(angle / np.pi) * across


def _plane(normal: Vectors) -> tuple[Vectors, Vectors]:
    """Two unit vectors across a third (Duff et al., "Building an Orthonormal Basis, Revisited")."""
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return first, np.stack([b, sign + y * y * a, -y], axis=-1)
