"""Features of many clips to one block of bytes and back.

A clip of n feature frames has n + 1 frames of joints: the velocities tell where the last one is.
Its features are made anew from joints and heading, so neither floor nor start has to be guessed.
Root and heading are second differences on a grid, bones are coded by `directions`; contacts are the
bits in which the given labels differ from those that the joints make, mostly none.

Numbers are 16 bits, the sign last, all high bytes before all low ones, column after column (xz).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from latentmotion.data.pack.directions import BoneCoder
from latentmotion.errors import DataError
from latentmotion.representation.canonical import turn
from latentmotion.representation.humanml3d import HumanML3DRepresentation

Clips = Sequence[Float[np.ndarray, "_ features"]]

_CONTACTS = 4


@dataclass(frozen=True)
class MotionCoder:
    """Features to bytes and back, to a stated exactness."""

    representation: HumanML3DRepresentation
    """What the features are."""
    quantum: float
    """Step of positions, meters."""
    turn_quantum: float
    """Step of the heading, radians."""

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
        flips = self._flips(clips, self._features(joints_of=numbers, frames=frames))
        return b"".join(p.astype(np.uint8).T.tobytes() for p in planes) + flips.tobytes()

    def decode(self, block: bytes, frames: Sequence[int]) -> list[Float[np.ndarray, "_ features"]]:
        """Returns the features of the clips of a block, float32.

        Args:
            block: As `encode` made it; `size` says how long it is.
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
            contacts[:] = (contacts > 0.5) ^ _bits(bits[:-1])
        return clips

    @property
    def _bones(self) -> BoneCoder:
        return BoneCoder(self.representation.skeleton, self.quantum)

    def _features(
        self, joints_of: Int[np.ndarray, "rows columns"], frames: Int[np.ndarray, " clips"]
    ) -> list[Float[np.ndarray, "_ features"]]:
        grid = _sums(_sums(joints_of[:, :4], frames), frames)
        root, yaw = grid[:, :3] * self.quantum, grid[:, 3] * self.turn_quantum
        bones = joints_of[:, 4:].reshape(len(joints_of), -1, 2)
        joints = self._bones.decode(bones, root, frames)
        pairs = zip(_split(joints, frames), _split(yaw, frames), strict=True)
        return [self.representation.describe(*pair) for pair in pairs]

    def _flips(self, given: Clips, made: list[Float[np.ndarray, "_ features"]]) -> np.ndarray:
        """One byte per frame: the contacts in which two versions of each clip differ."""
        block, parts = self.representation.blocks["contacts"], []
        for one, other in zip(given, made, strict=True):
            differ = (one[:, block] > 0.5) ^ (other[:, block] > 0.5)
            parts += [differ @ (1 << np.arange(_CONTACTS)), np.zeros(1, np.int64)]
        return np.concatenate(parts).astype(np.uint8)


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


def _differences(
    values: Int[np.ndarray, "rows n"], frames: Int[np.ndarray, " clips"]
) -> Int[np.ndarray, "rows n"]:
    """Each row less the one before it; the first of a clip stays."""
    result = np.diff(values, axis=0, prepend=0)
    starts = np.cumsum(frames) - frames
    result[starts] = values[starts]
    return result


def _sums(
    values: Int[np.ndarray, "rows n"], frames: Int[np.ndarray, " clips"]
) -> Int[np.ndarray, "rows n"]:
    return np.concatenate([np.cumsum(part, axis=0) for part in _split(values, frames)])


def _split(values: np.ndarray, frames: Int[np.ndarray, " clips"]) -> list[np.ndarray]:
    return np.split(values, np.cumsum(frames)[:-1])


def _bits(values: UInt8[np.ndarray, " frames"]) -> Bool[np.ndarray, "frames 4"]:
    return (values[:, None] >> np.arange(_CONTACTS)) & 1 == 1
