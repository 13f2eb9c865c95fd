"""The steps of a clean-up in their order, and the settings that choose among them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.bone_lengths import constant_bones
from latentmotion.cleanup.contacts import Contacts, foot_contacts
from latentmotion.cleanup.floor import Floor, align_floor
from latentmotion.cleanup.foot_lock import lock_feet
from latentmotion.cleanup.foot_shift import FootLock
from latentmotion.cleanup.leg_ik import find_legs, keep_knee_direction
from latentmotion.cleanup.smoothing import gaussian, smooth
from latentmotion.errors import InputError
from latentmotion.motion import Motion


class CleanUpWarning(UserWarning):
    """A step was left out, or had to move joints far."""


_FAR = 0.25
"""Meters that a joint may be moved for its bones without a warning."""


@dataclass(frozen=True)
class CleanUp:
    """Which steps are taken, and how.

    Raises:
        InputError: The cutoff is not a positive number.
    """

    smooth: bool = True
    """Take out shaking."""
    bones: bool = True
    """Give every bone one length."""
    floor: bool = True
    """Put the figure on the floor."""
    feet: bool = True
    """Hold feet that stand."""
    in_place: bool = False
    """Take away the path along the floor, as game engines like it."""
    cutoff: float = 5.0
    """Hertz up to which movement counts as meant and not as shaking."""
    contacts: Contacts = field(default_factory=Contacts)
    """What counts as standing."""
    lock: FootLock = field(default_factory=FootLock)
    """How feet are held."""
    ground: Floor = field(default_factory=Floor)
    """How the floor is found."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.cutoff) and self.cutoff > 0):
            raise InputError(f"cutoff {self.cutoff}: expected hertz, a positive number such as 5")


def clean(motion: Motion, steps: CleanUp = CleanUp()) -> Motion:
    """Returns the motion cleaned up, as long as it was.

    Warns:
        CleanUpWarning: The skeleton has no feet that could be held; all other steps are taken.
            Or bones were so wrong that joints had to be moved far.
    """
    fps, skeleton = motion.fps, motion.skeleton
    joints = motion.joints.astype(np.float64)
    if steps.smooth:
        joints = keep_knee_direction(smooth(joints, fps, steps.cutoff), joints, skeleton)
    if steps.bones:
        joints = _keep_bones(joints, motion)
    if steps.floor:
        joints = align_floor(joints, fps, skeleton, steps.ground)
    if steps.feet:
        joints = _hold_feet(joints, motion, steps)
    if steps.in_place:
        joints = in_place(joints, fps)
    return replace(motion, joints=joints.astype(np.float32))


def _keep_bones(
    joints: Float[np.ndarray, "frames joints 3"], motion: Motion
) -> Float[np.ndarray, "frames joints 3"]:
    moved = constant_bones(joints, motion.fps, motion.skeleton)
    ways = np.linalg.norm(moved - joints, axis=-1)
    frame, joint = np.unravel_index(ways.argmax(), ways.shape)
    if ways.max() > _FAR:
        warnings.warn(
            f"bones were drawn so long or short that {motion.skeleton.names[joint]} was moved by "
            f"{100 * ways.max():.0f} cm at {frame / motion.fps:.1f} s to give them one length",
            CleanUpWarning,
            stacklevel=3,
        )
    return moved


def _hold_feet(
    joints: Float[np.ndarray, "frames joints 3"], motion: Motion, steps: CleanUp
) -> Float[np.ndarray, "frames joints 3"]:
    if not find_legs(motion.skeleton):
        warnings.warn(
            f"skeleton {motion.skeleton.name!r} names no feet below hip and knee; "
            "feet were left as they are",
            CleanUpWarning,
            stacklevel=3,
        )
        return joints
    contacts = foot_contacts(joints, motion.fps, motion.skeleton, steps.contacts)
    return lock_feet(joints, contacts, motion.fps, motion.skeleton, steps.lock)


def ground_path(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, seconds: float = 0.25
) -> Float[np.ndarray, "frames 3"]:
    """Returns the path of the root along the floor, without the sway of its steps.

    Args:
        joints: Positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
        seconds: Deviation of the Gaussian that takes out the sway; 0 keeps it.
    """
    return gaussian(joints[:, 0] * (1, 0, 1), seconds * fps)


def in_place(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, seconds: float = 0.25
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns the joints with the path taken away: the figure stays above the origin."""
    return joints - ground_path(joints, fps, seconds)[:, None]
