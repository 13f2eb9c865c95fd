"""Retargeting: a motion transferred to the skeleton that a user brings.

    file → rig  (names → humanoid, rest pose → size, axes, floor)
    motion + rig → rotations of the rig's bones → feet on the floor → the user's file with animation

NumPy only.
"""

from latentmotion.kinematics.humanoid import Humanoid, find_humanoid
from latentmotion.retarget.rig import Rig, read_rig
from latentmotion.retarget.transfer import retarget

__all__ = ["Humanoid", "Rig", "find_humanoid", "read_rig", "retarget"]
