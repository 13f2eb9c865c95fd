"""Retargeting: a motion moves the skeleton that a user brings.

    file → rig  (names → body, rest pose → size, axes, floor)
    motion + rig → turns of the rig's bones → feet on the floor → the user's file, animated

NumPy only.
"""

from latentmotion.retarget.humanoid import Body, find_body
from latentmotion.retarget.rig import Rig, read_rig
from latentmotion.retarget.transfer import retarget

__all__ = ["Body", "Rig", "find_body", "read_rig", "retarget"]
