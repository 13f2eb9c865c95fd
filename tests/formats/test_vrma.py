"""VRM animations: written with VRM's bones, read by them, whatever the nodes are called."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from tests.support.bvh_kinds import walk


def test_what_is_written_is_read(tmp_path: Path) -> None:
    motion = walk()
    (path,) = formats.save(tmp_path / "a.vrma", [motion])
    np.testing.assert_allclose(Motion.load(path).joints, motion.joints, atol=1e-4)
    document = Document.read(path)
    told = document.json["extensions"]["VRMC_vrm_animation"]
    assert told["specVersion"] == "1.0" and "VRMC_vrm_animation" in document.json["extensionsUsed"]
    bones = told["humanoid"]["humanBones"]
    assert {"hips", "spine", "head", "leftUpperLeg", "rightHand"} <= set(bones)
    assert not {"meshes", "skins"} & set(document.json)
    moved = {
        channel["target"]["node"]
        for channel in document.json["animations"][0]["channels"]
        if channel["target"]["path"] == "translation"
    }
    assert bones["hips"]["node"] in moved


def test_bones_are_those_that_the_extension_names(tmp_path: Path) -> None:
    (path,) = formats.save(tmp_path / "a.vrma", [walk()])
    document = Document.read(path)
    for number, node in enumerate(document.json["nodes"]):
        node["name"] = f"node {number}"
    document.write(tmp_path / "b.vrma.glb")
    (tmp_path / "b.vrma.glb").rename(tmp_path / "b.vrma")
    np.testing.assert_allclose(Motion.load(tmp_path / "b.vrma").joints, walk().joints, atol=0.02)


def test_other_joints_and_markers_are_refused(tmp_path: Path) -> None:
    kit = Motion(np.zeros((3, len(KIT), 3), "f4"), 12.5, KIT)
    with pytest.raises(InputError, match="VRM's bones are known for HumanML3D's joints"):
        formats.save(tmp_path / "a.vrma", [kit])
    (tmp_path / "a.c3d").write_bytes(b"x")
    with pytest.raises(InputError, match="C3D holds markers on the skin, not joints: solve"):
        formats.load(tmp_path / "a.c3d")
