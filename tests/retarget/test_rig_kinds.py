"""Rigs of programs that hang bones elsewhere, name ends otherwise, or are exported mid-clip."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import MIXAMO, RigShape, write_rig
from latentmotion import formats
from latentmotion.arrays import unit
from latentmotion.cli.main import main
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.bvh import BvhLayout, read_bvh, write_bvh
from latentmotion.formats.gltf_document import Document
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.motion import Motion
from latentmotion.retarget import Rig, read_rig, retarget
from latentmotion.retarget.transfer import write
from tests.support.bvh_kinds import walk, with_fingers

BONES = [
    (HUMANML3D.names.index(f"{side}_{upper}"), HUMANML3D.names.index(f"{side}_{lower}"))
    for side in ("left", "right")
    for upper, lower in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"))
]


def check_points_as(motion: Motion, rig: Rig, animation: Animation) -> None:
    """Checks that limbs point as the source's do, and that the arms stay at the body."""
    found = to_humanml3d(animation, rig.body.joint_map())
    for upper, lower in BONES:
        ours, theirs = (unit(one[:, lower] - one[:, upper]) for one in (found, motion.joints))
        assert np.degrees(np.arccos(np.clip((ours * theirs).sum(-1), -1, 1))).max() < 12
    lengths = np.linalg.norm(found[:, 16] - found[:, 9], axis=-1)
    assert np.ptp(lengths) < 0.05 * rig.leg
    assert abs(found[..., 1].min()) < 0.1 * rig.leg


def rigify() -> RigShape:
    """Returns the deforming bones of a generated rig: arms and legs hang on its root."""
    names = {
        **{"Hips": "DEF-spine", "Spine": "DEF-spine.001", "Spine1": "DEF-spine.002"},
        **{"Spine2": "DEF-spine.003", "Neck": "DEF-spine.004", "Head": "DEF-spine.006"},
        **{"@UpLeg": "DEF-thigh.@", "@Leg": "DEF-shin.@", "@Foot": "DEF-foot.@"},
        **{"@ToeBase": "DEF-toe.@", "@Shoulder": "DEF-shoulder.@", "@Arm": "DEF-upper_arm.@"},
        **{"@ForeArm": "DEF-forearm.@", "@Hand": "DEF-hand.@"},
    }
    table = {"HeadTop_End": "DEF-top"}
    for name, bone in names.items():
        for side in ("Left", "Right"):
            table[name.replace("@", side)] = bone.replace("@", side[0])
    tree = {"rig": (None, (0.0, 0.0, 0.0))}
    for name, (parent, place) in MIXAMO.tree.items():
        own = table.get(name.removeprefix("mixamorig:"))
        if own is None:
            continue
        above = "rig" if parent is None else table[parent.removeprefix("mixamorig:")]
        free = own.startswith(("DEF-upper_arm", "DEF-thigh", "DEF-shoulder"))
        tree[own] = ("rig" if free else above, place)
    return replace(MIXAMO, tree=tree)


def named(table: dict[str, str]) -> RigShape:
    def new(name: str) -> str:
        return table.get(name.removeprefix("mixamorig:"), name)

    return replace(
        MIXAMO, tree={new(n): (p and new(p), place) for n, (p, place) in MIXAMO.tree.items()}
    )


JAPANESE = {
    **{"Hips": "センター", "Spine": "上半身", "Spine2": "上半身2", "Neck": "首", "Head": "頭"},
    **{
        f"{side}{name}": mark + word
        for side, mark in (("Left", "左"), ("Right", "右"))
        for name, word in zip(
            ("UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand"),
            ("足", "ひざ", "足首", "つま先", "肩", "腕", "ひじ", "手首"),
            strict=True,
        )
    },
}
PALMS = {f"{side}Hand": f"{side}PalmA" for side in ("Left", "Right")} | {"LeftFoot": "Sole.L"}


@pytest.mark.parametrize(
    "shape", [rigify(), named(JAPANESE), named(PALMS)], ids=["Rigify", "MMD", "other ends"]
)
def test_a_walk_is_a_walk(shape: RigShape, tmp_path: Path) -> None:
    motion, rig = walk(), read_rig(write_rig(tmp_path / "a.glb", shape))
    check_points_as(motion, rig, retarget(motion, rig))
    write(tmp_path / "out.glb", rig, [motion], names=["walk"])
    again = formats.load(tmp_path / "out.glb")[0].joints
    for upper, lower in BONES:
        ours, theirs = (unit(one[:, lower] - one[:, upper]) for one in (again, motion.joints))
        assert np.degrees(np.arccos(np.clip((ours * theirs).sum(-1), -1, 1))).max() < 12


def test_nodes_in_the_middle_of_a_clip_rest_as_their_skin_was_bound(tmp_path: Path) -> None:
    straight = write_rig(tmp_path / "a.glb", MIXAMO)
    document = Document.read(straight)
    for node in document.json["nodes"]:
        if node["name"] in ("mixamorig:Spine1", "mixamorig:Neck"):
            node["rotation"] = [0.38, 0.0, 0.0, 0.925]
    document.write(tmp_path / "bent.glb")
    motion = walk()
    rigs = [read_rig(path) for path in (straight, tmp_path / "bent.glb")]
    places = [rig.rest() for rig in rigs]
    np.testing.assert_allclose(places[1], places[0], atol=1e-5)
    for number, rig in enumerate(rigs):
        write(tmp_path / f"{number}.glb", rig, [motion], names=["walk"])
    found = [formats.load(tmp_path / f"{number}.glb")[0].joints for number in (0, 1)]
    np.testing.assert_allclose(found[1], found[0], atol=1e-4)


def test_a_mirrored_rig_is_told_to_be_one(tmp_path: Path) -> None:
    path = write_rig(tmp_path / "a.glb", replace(MIXAMO, above={"scale": [-1, 1, 1]}))
    with pytest.raises(DataError, match=r"the rig is mirrored: .* negative scale"):
        read_rig(path)


def test_an_extension_that_must_be_known_is_named(tmp_path: Path) -> None:
    document = Document.read(write_rig(tmp_path / "a.glb", MIXAMO))
    document.json["extensionsRequired"] = ["KHR_materials_unlit", "EXT_meshopt_compression"]
    document.write(tmp_path / "b.glb")
    with pytest.raises(FileFormatError, match="requires the glTF extension EXT_meshopt_comp"):
        read_rig(tmp_path / "b.glb")


def test_parts_without_a_skin_follow_the_bones_that_vrm_names(tmp_path: Path) -> None:
    document = Document.read(write_rig(tmp_path / "a.glb", MIXAMO))
    words = {
        **{"Hips": "hips", "Spine": "spine", "Spine2": "chest", "Neck": "neck", "Head": "head"},
        **{"UpLeg": "UpperLeg", "Leg": "LowerLeg", "Foot": "Foot", "ToeBase": "Toes"},
        **{"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"},
    }
    bones = {}
    for number, node in enumerate(document.json["nodes"]):
        plain = node["name"].removeprefix("mixamorig:")
        side = next((side for side in ("Left", "Right") if plain.startswith(side)), "")
        if plain.removeprefix(side) in words:
            bones[side.lower() + words[plain.removeprefix(side)]] = {"node": number}
        node.pop("skin", None)
    del document.json["skins"]
    document.json["extensions"] = {"VRMC_vrm": {"humanoid": {"humanBones": bones}}}
    document.write(tmp_path / "a.vrm")
    motion, rig = walk(), read_rig(tmp_path / "a.vrm")
    check_points_as(motion, rig, retarget(motion, rig))


def bend(found: Animation, other: Animation) -> np.ndarray:
    """Returns by how many degrees the local rotations of one skeleton differ at most."""
    change = np.swapaxes(found.rotations, -1, -2) @ other.rotations
    cosines = (np.trace(change, axis1=-2, axis2=-1) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).max(axis=0)


@pytest.mark.filterwarnings("ignore:.*a guess:latentmotion.errors.ReadingWarning")
@pytest.mark.parametrize("unit_of_length", [0.01, 0.0254])
def test_a_clip_on_its_own_skeleton_keeps_every_rotation(
    unit_of_length: float, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    source, out = str(tmp_path / "a.bvh"), str(tmp_path / "out.bvh")
    write_bvh(source, with_fingers(), BvhLayout("ZYX", unit_of_length))
    main(["retarget", source, "--to", source, "-o", out])
    assert bend(read_bvh(source, 1.0), read_bvh(out, 1.0)).max() < 0.01
    main(["clean", source, "-o", out, "--no-smooth", "--no-feet"])
    assert read_bvh(out).skeleton.names == read_bvh(source).skeleton.names
    assert bend(read_bvh(source, 1.0), read_bvh(out, 1.0)).max() < 1
    assert "joints moved 0.0 cm on average" in capsys.readouterr().out
    main(["clean", source, "-o", out, "--trim", "0.5", "1", "--speed", "0.5", "--mirror"])
    mirrored = read_bvh(out, 1.0)
    assert mirrored.skeleton.names == read_bvh(source).skeleton.names and len(mirrored) == 19
    main(["clean", source, "-o", out, "--skeleton", "ours"])
    assert read_bvh(out).skeleton.names[0] == "pelvis"


def test_our_own_skeleton_keeps_what_it_has_of_heads_and_hands(tmp_path: Path) -> None:
    write_bvh(tmp_path / "a.bvh", with_fingers())
    motion = Motion.load(tmp_path / "a.bvh")
    animation, plain = motion.animation(), motion.with_recorded(None).animation()
    np.testing.assert_allclose(animation.joints(), motion.joints, atol=1e-5)
    first = np.repeat(animation.rotations[:1], len(animation), axis=0)
    head = HUMANML3D.names.index("head")
    assert bend(replace(animation, rotations=first), animation)[head] == pytest.approx(70, abs=8)
    assert bend(plain, animation)[HUMANML3D.names.index("right_knee")] < 0.1
    (path,) = motion.save(tmp_path / "a.glb")
    again = Motion.load(path).animation()
    np.testing.assert_allclose(again.rotations[:, head], animation.rotations[:, head], atol=1e-4)


def test_heads_forearms_and_fingers_turn_on_other_bodies_too(tmp_path: Path) -> None:
    write_bvh(tmp_path / "a.bvh", with_fingers())
    motion = Motion.load(tmp_path / "a.bvh")
    tree = dict(MIXAMO.tree)
    for side, x in (("Left", 0.8), ("Right", -0.8)):
        above = f"mixamorig:{side}Hand"
        for number in (1, 2, 3):
            name = f"mixamorig:{side}HandIndex{number}"
            tree[name] = (above, (x + np.sign(x) * 0.04 * number, 1.44, -0.02))
            above = name
    rig = read_rig(write_rig(tmp_path / "a.glb", replace(MIXAMO, tree=tree, along=(0, 1, 0))))
    animation = retarget(motion, rig)
    names = rig.skeleton.names
    first = np.repeat(animation.rotations[:1], len(animation), axis=0)
    turns = bend(replace(animation, rotations=first), animation)
    assert turns[names.index("mixamorig:Head")] == pytest.approx(70, abs=8)
    assert turns[names.index("mixamorig:LeftHandIndex2")] == pytest.approx(80, abs=8)
    assert turns[names.index("mixamorig:RightHandIndex2")] < 1


def test_a_map_is_for_the_files_that_have_its_joints(tmp_path: Path) -> None:
    odd = with_fingers()
    names = tuple(f"bone{n}" for n in range(len(odd.skeleton)))
    joints = Motion.load(write_and_name(tmp_path / "known.bvh", odd)).recorded
    assert joints is not None
    own = [joints.body.skeleton.names[joint] for joint in joints.body.joints.values()]
    places = [names[odd.skeleton.names.index(name)] for name in own]
    table = dict(zip(joints.body.joints, places, strict=True))
    (tmp_path / "map.json").write_text(json.dumps(table))
    odd = replace(odd, skeleton=replace(odd.skeleton, names=names))
    source = str(write_and_name(tmp_path / "odd.bvh", odd))
    rig = str(write_rig(tmp_path / "a.glb", MIXAMO))
    with pytest.raises(SystemExit):
        main(["clean", source, "-o", str(tmp_path / "b.npz")])
    for words in (["clean", source], ["retarget", source, "--to", rig]):
        out = tmp_path / f"{words[0]}.glb"
        main([*words, "-o", str(out), "--map", str(tmp_path / "map.json")])
        assert len(formats.load(out)[0]) == len(odd)


def write_and_name(path: Path, animation: Animation) -> Path:
    write_bvh(path, animation)
    return path
