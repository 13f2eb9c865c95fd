"""VRM animation (`.vrma`): a movement of VRM's humanoid, which any VRM avatar can play.

It is glTF without a mesh, whose extension names the nodes that are VRM's bones. The nodes rest in a
T-pose; only the hips move. Read as glTF is (`gltf_reader.py`).
Source: https://github.com/vrm-c/vrm-specification, VRMC_vrm_animation-1.0
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from latentmotion.errors import InputError
from latentmotion.formats.gltf import make_document
from latentmotion.formats.takes import numbered
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion

_BONES = {
    **{"pelvis": "hips", "spine1": "spine", "spine2": "chest", "spine3": "upperChest"},
    **{"neck": "neck", "head": "head"},
    **{
        f"{side}_{ours}": side + bone
        for side in SIDES
        for ours, bone in (
            *(("hip", "UpperLeg"), ("knee", "LowerLeg"), ("ankle", "Foot"), ("foot", "Toes")),
            *(("collar", "Shoulder"), ("shoulder", "UpperArm"), ("elbow", "LowerArm")),
            ("wrist", "Hand"),
        )
    },
}
"""HumanML3D's joint → VRM's bone."""


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes a file for each motion: `out.vrma`, or `out-1.vrma`, `out-2.vrma` and so on.

    Raises:
        InputError: The joints are others than HumanML3D's, or the folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    for target, motion in zip(paths, motions, strict=True):
        if motion.skeleton.names[: len(HUMANML3D)] != HUMANML3D.names:
            raise InputError(
                f"cannot write {target}: VRM's bones are known for HumanML3D's joints, not for "
                f"those of {motion.skeleton.name!r}"
            )
        document = make_document([motion], mesh=False)
        bones = {bone: {"node": motion.skeleton.names.index(ours)} for ours, bone in _BONES.items()}
        animation_extension = {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
        document.json |= {
            "extensionsUsed": ["VRMC_vrm_animation"],
            "extensions": {"VRMC_vrm_animation": animation_extension},
        }
        document.write(target)
    return paths
