"""Retargeting: bones point as the source's do on any rig, feet stand, files keep all but motion."""

from __future__ import annotations

import json
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import CHILD, MIXAMO, RIGS, UNREAL, RigShape, write_rig
from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.formats.gltf_document import Document
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.draft import draft_map
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.motion import Motion
from latentmotion.retarget import Rig, find_humanoid, read_rig, retarget
from latentmotion.retarget.flesh import flesh_of
from latentmotion.retarget.rig import SourceCharacter
from latentmotion.retarget.rig_files import open_rig
from latentmotion.retarget.transfer import write
from tests.support.walker import t_pose, walker

ARMS = [("shoulder", "elbow"), ("elbow", "wrist")]
LEGS = [("hip", "knee"), ("knee", "ankle")]


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(40).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), caption="a person walks")


@pytest.fixture(scope="module", params=sorted(RIGS))
def rig(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return read_rig(write_rig(tmp_path_factory.mktemp("rig") / "a.glb", RIGS[request.param]))


def angles(motion: Motion, animation: Animation, rig: Rig, bones: list) -> np.ndarray:
    actor, joints, found = SourceCharacter.of(motion), animation.joints(), []
    for side in ("left", "right"):
        for upper, lower in bones:
            seen = actor.position(f"{side}_{lower}") - actor.position(f"{side}_{upper}")
            a, b = (joints[:, rig.body.joints[f"{side}_{name}"]] for name in (upper, lower))
            cosine = (seen * (b - a)).sum(-1) / np.linalg.norm(seen, axis=-1)
            found.append(
                np.degrees(np.arccos(np.clip(cosine / np.linalg.norm(b - a, axis=-1), -1, 1)))
            )
    return np.stack(found)


def test_limbs_point_as_the_source_does(motion: Motion, rig: Rig):
    animation = retarget(motion, rig)
    assert angles(motion, animation, rig, ARMS).max() < 0.1
    assert angles(motion, animation, rig, LEGS).mean() < 6


def test_bones_keep_their_lengths_and_others_rest(motion: Motion, rig: Rig):
    animation = retarget(motion, rig)
    joints, rest = animation.joints(), rig.rest()
    for joint, parent in list(enumerate(rig.skeleton.parents))[1:]:
        if joint != rig.root_motion_bone:
            length = np.linalg.norm(joints[:, joint] - joints[:, parent], axis=-1)
            np.testing.assert_allclose(
                length, np.linalg.norm(rest[joint] - rest[parent]), atol=1e-6
            )
    moving = {*rig.body.joints.values(), rig.body.pelvis, *rig.body.spine, *rig.body.neck}
    resting = [joint for joint in range(len(rest)) if joint not in moving]
    still = np.broadcast_to(np.eye(3), (len(joints), len(resting), 3, 3))
    np.testing.assert_allclose(animation.rotations[:, resting], still, atol=1e-9)


def test_who_stands_in_t_pose_stands_in_t_pose(rig: Rig):
    pose = t_pose().skeleton.rest_joints()
    pose[:, 1] += 0.02 - pose[:, 1].min()
    standing = Motion(np.repeat(pose[None], 8, axis=0).astype("f4"))
    joints = retarget(standing, rig).joints()
    at = {name: joints[0, joint] for name, joint in rig.body.joints.items()}
    flesh = flesh_of(rig)
    assert flesh is not None
    for side, sign in (("left", 1), ("right", -1)):
        across = at[f"{side}_wrist"] - at[f"{side}_shoulder"]
        np.testing.assert_allclose(across / np.linalg.norm(across), [sign, 0, 0], atol=1e-3)
        for name in (f"{side}_ankle", f"{side}_foot"):
            # HumanML3D's right leg is a centimeter shorter.
            standing = rig.rest()[rig.body.joints[name], 1] - flesh.sole
            assert abs(at[name][1] - standing) < 0.012
        assert at[f"{side}_foot"][2] > at[f"{side}_ankle"][2] + 0.05


def test_our_own_skeleton_moves_as_before(motion: Motion, tmp_path: Path):
    write_bvh(tmp_path / "ours.bvh", motion.animation())
    home = read_rig(tmp_path / "ours.bvh")
    found, meant = retarget(motion, home), motion.animation()
    upper = ["spine1", "spine2", "spine3", "neck", "left_shoulder", "right_elbow", "left_wrist"]
    for name in upper:
        a, b = (x.skeleton.names.index(name) for x in (found, meant))
        np.testing.assert_allclose(found.rotations[:, a], meant.rotations[:, b], atol=1e-4)
    off = found.joints()[:, [found.skeleton.names.index(n) for n in meant.skeleton.names]]
    off = off - meant.joints()
    off[..., 1] -= off[..., 1].mean()
    assert np.linalg.norm(off, axis=-1).mean() < 0.01


def test_there_and_back(motion: Motion, rig: Rig, tmp_path: Path):
    write_bvh(tmp_path / "ours.bvh", motion.animation())
    home, animation = read_rig(tmp_path / "ours.bvh"), retarget(motion, rig)
    back = retarget(animation, home)
    assert angles(motion, back, home, ARMS).max() < 0.5
    read = to_humanml3d(animation, rig.body.joint_map())
    assert read.shape == (len(motion), 22, 3)


def test_planted_feet_stay(rig: Rig):
    joints = np.repeat(t_pose().joints(), 30, axis=0)
    joints[..., 1] += 0.02 - joints[..., 1].min()
    names = t_pose().skeleton.names
    upper = [j for j, n in enumerate(names) if not n.endswith(("knee", "ankle", "foot"))]
    joints[:, upper] += 0.04 * np.sin(np.arange(30) / 5)[:, None, None] * (1, 0, 1) - (0, 0.05, 0)
    animation = retarget(Motion(joints.astype("f4")), rig)
    for name in ("left_foot", "right_foot"):
        place = animation.joints()[:, rig.body.joints[name]]
        assert np.ptp(place, axis=0).max() < 0.006


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_the_file_keeps_all_but_its_motion(motion: Motion, rig: Rig, tmp_path: Path, ending: str):
    out = tmp_path / f"out{ending}"
    write(out, rig, [motion, replace(motion, caption="again")], fps=30)
    before, after = (Document.read(path).json for path in (rig.file.path, out))
    for kind in ("nodes", "meshes", "skins", "materials", "scenes"):
        assert before[kind] == after[kind]
    assert before["accessors"] == after["accessors"][: len(before["accessors"])]
    assert [a["name"] for a in after["animations"]] == ["a person walks", "again"]
    meant = retarget(motion.resampled(30), rig)
    found = read_animations(out)[0]
    assert found.fps == 30
    there = rig.in_file(meant).joints()
    assert np.linalg.norm(found.joints() - there, axis=-1).max() < 1e-4
    write(out, read_rig(out), [motion])
    assert [a["name"] for a in Document.read(out).json["animations"]] == ["again", "a person walks"]


def z_up(path: Path, unit: float) -> Path:
    """Writes the Mixamo rig as BVH in another unit, z up, facing -y, as Blender does."""
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) / unit
    tree = {name: (parent, place) for name, (parent, place) in MIXAMO.tree.items()}

    def block(name: str, start: np.ndarray) -> list[str]:
        x, y, z = turn @ (np.array(tree[name][1]) - start)
        inside = [f"OFFSET {x} {y} {z}"]
        moves = "6 Xposition Yposition Zposition" if tree[name][0] is None else "3"
        inside.append(f"CHANNELS {moves} Xrotation Yrotation Zrotation")
        below = [child for child, (parent, _) in tree.items() if parent == name]
        for child in below:
            inside += block(child, np.array(tree[name][1]))
        inside += [] if below else ["End Site", "{", "OFFSET 0 0 0", "}"]
        word = "ROOT" if tree[name][0] is None else "JOINT"
        return [f"{word} {name}", "{", *inside, "}"]

    lines = ["HIERARCHY", *block("mixamorig:Hips", np.zeros(3)), "MOTION"]
    columns = sum(int(line.split()[1]) for line in lines if line.startswith("CHANNELS"))
    rest = " ".join(["0"] * columns)
    path.write_text("\n".join([*lines, "Frames: 1", "Frame Time: 0.05", rest]) + "\n")
    return path


@pytest.mark.filterwarnings("ignore:.*a guess:latentmotion.errors.ReadingWarning")
@pytest.mark.parametrize(
    ("unit", "name"), [(0.01, "centimeters"), (0.0254, "inches"), (1, "meters")]
)
def test_bvh_of_any_axes_and_unit_keeps_its_head(
    motion: Motion, tmp_path: Path, unit: float, name: str
):
    rig = read_rig(z_up(tmp_path / "z.bvh", unit))
    assert rig.unit() == name
    out = tmp_path / "out.bvh"
    assert write(out, rig, [motion]) == [out]
    heads = [path.read_text().partition("MOTION")[0] for path in (rig.file.path, out)]
    assert heads[0] == heads[1]
    found = read_bvh(out, unit=1.0).joints() * unit
    meant = rig.in_file(retarget(motion, rig)).joints() * unit
    assert np.linalg.norm(found - meant, axis=-1).max() < 1e-3
    # It walks upright along the file's own z, in a circle of the scaled size.
    assert np.ptp(found[:, 0, 2]) < 0.2
    assert np.ptp(found[:, 0, 0]) > 1.5


def unnamed(shape: RigShape) -> RigShape:
    number = {name: f"bone{n:02}" for n, name in enumerate(shape.tree)}
    tree = {
        number[name]: (None if parent is None else number[parent], place)
        for name, (parent, place) in shape.tree.items()
    }
    return replace(shape, tree=tree)


@pytest.mark.parametrize("name", sorted(RIGS))
def test_a_draft_finds_limbs_without_names(name: str, tmp_path: Path):
    named = read_rig(write_rig(tmp_path / "named.glb", RIGS[name]))
    file = open_rig(write_rig(tmp_path / "a.glb", unnamed(RIGS[name])))
    with pytest.raises(DataError, match=r"unknown names of joints.* 'bone\d+'.*--draft-map"):
        read_rig(tmp_path / "a.glb")
    drafted = {part: guess.joint for part, guess in draft_map(file.skeleton).items()}
    right = {part: joint for part, joint in named.body.joints.items() if "_" in part}
    wrong = {part for part, joint in right.items() if drafted.get(part) != joint}
    # Collars that start in the chest, and toes beyond twists, are for people to check.
    assert not wrong - {"left_collar", "right_collar", "left_foot", "right_foot"}


def test_a_draft_is_a_map(motion: Motion, tmp_path: Path, capsys: pytest.CaptureFixture):
    rig = write_rig(tmp_path / "a.glb", unnamed(UNREAL))
    motion.save(tmp_path / "walk.npz")
    draft, out = tmp_path / "map.json", tmp_path / "out.glb"
    main(["retarget", "--to", str(rig), "--draft-map", str(draft)])
    assert "left_knee" in capsys.readouterr().out
    walk = str(tmp_path / "walk.npz")
    main(["retarget", walk, "--to", str(rig), "--map", str(draft), "-o", str(out)])
    assert "wrote" in capsys.readouterr().out
    assert len(read_animations(out)[0]) == len(motion)
    entries = json.loads(draft.read_text())
    entries["left_knee"] = "bone99"
    draft.write_text(json.dumps(entries))
    with pytest.raises(SystemExit):
        main(["retarget", walk, "--to", str(rig), "--map", str(draft), "-o", str(out)])
    assert "'left_knee' is 'bone99'" in (said := capsys.readouterr().err)
    assert "nearest are 'bone" in said


def test_vrm_says_its_bones_itself(tmp_path: Path):
    words = {
        "hips": "J_Bip_C_Hips", "head": "J_Bip_C_Head", "neck": "J_Bip_C_Neck",
        **{f"{s}{ours}": f"J_Bip_{s[0].upper()}_{theirs}" for s in ("left", "right")
           for ours, theirs in {
               "UpperLeg": "UpperLeg", "LowerLeg": "LowerLeg", "Foot": "Foot", "Toes": "ToeBase",
               "UpperArm": "UpperArm", "LowerArm": "LowerArm", "Hand": "Hand",
           }.items()},
    }  # fmt: skip
    nodes = {word: {"node": list(CHILD.tree).index(name) + 1} for word, name in words.items()}
    extension = {"extensions": {"VRMC_vrm": {"humanoid": {"humanBones": nodes}}}}
    path = write_rig(tmp_path / "a.glb", replace(unnamed(CHILD), extensions=extension))
    named = read_rig(write_rig(tmp_path / "named.glb", CHILD)).body
    found = read_rig(path).body
    assert found.names == "VRM"
    assert formats.load(path)[0].joints.shape == (1, 22, 3)
    assert all(named.joints[name] == joint for name, joint in found.joints.items())


@pytest.mark.parametrize(
    ("prefix", "number"), [("Armature|", ""), ("mixamorig1:", "_07"), ("Bob:", "")]
)
def test_prefixes_and_numbers_do_not_matter(prefix: str, number: str, tmp_path: Path):
    def other(name: str) -> str:
        return f"{prefix}{name.removeprefix('mixamorig:')}{number}"

    tree = {
        other(name): (None if parent is None else other(parent), place)
        for name, (parent, place) in MIXAMO.tree.items()
    }
    body = read_rig(write_rig(tmp_path / "a.glb", replace(MIXAMO, tree=tree))).body
    assert (body.names, len(body.joints), len(body.spine)) == ("Mixamo", 19, 3)


@pytest.mark.parametrize(
    ("known", "limbs", "sides"),
    [
        ("Daz Genesis", "@ThighBend @Shin @Foot @ShldrBend @ForearmBend @Hand", "lr"),
        ("Daz Genesis", "@_thigh @_shin @_foot @_upperarm @_forearm @_hand", "lr"),
        ("Rigify", "DEF-thigh.@ DEF-shin.@ DEF-foot.@ DEF-upper_arm.@ DEF-forearm.@ hand.@", "LR"),
        ("SMPL", "@_Hip @_Knee @_Ankle @_Shoulder @_Elbow @_Wrist", "LR"),
        (
            "Biped",
            "Bip01@Thigh Bip01@Calf Bip01@Foot Bip01@UpperArm Bip01@Forearm Bip01@Hand",
            "LR",
        ),
        ("VRM", "@UpperLeg @LowerLeg @Foot @UpperArm @LowerArm @Hand", ("left", "right")),
    ],
)
def test_names_of_other_programs(known: str, limbs: str, sides: str | tuple):
    words = [limbs.replace("@", side).split() for side in sides]
    names = ("all", "thigh.L", *words[0], *words[1])
    parents = (-1, 0, *(0, 2, 3, 0, 5, 6), *(0, 8, 9, 0, 11, 12))
    body = find_humanoid(Skeleton("a", names, parents, np.ones((14, 3))))
    assert body.names == known
    found = [names[body.joints[f"left_{part}"]] for part in ("hip", "ankle", "wrist")]
    assert found == [words[0][0], words[0][2], words[0][5]]
    assert (body.pelvis, body.chest, body.spine) == (0, 0, ())


def test_bad_rigs_say_what_is_wrong(motion: Motion, tmp_path: Path):
    torso = {
        n: v
        for n, v in MIXAMO.tree.items()
        if "Leg" not in n and "Foot" not in n and "Toe" not in n
    }
    path = write_rig(tmp_path / "torso.glb", replace(MIXAMO, tree=torso))
    with pytest.raises(
        DataError, match=r"found no left_hip.*names of Mixamo.*nearest: .*--draft-map"
    ):
        read_rig(path)
    with pytest.raises(DataError, match="no pair of legs"):
        draft_map(open_rig(path).skeleton)
    whole = write_rig(tmp_path / "a.glb", MIXAMO)
    names = read_rig(whole).body.joint_map()
    swapped = {
        n.translate({}): names[
            n.replace("left", "@").replace("right", "left").replace("@", "right")
        ]
        for n in names
    }
    with pytest.raises(DataError, match="toes point backward"):
        read_rig(whole, swapped)
    with pytest.raises(DataError, match=r"the joint map has 'left_kne',.* nearest are 'left_knee'"):
        read_rig(whole, {"left_kne": "mixamorig:LeftLeg"})
    with pytest.raises(DataError, match=r"left_knee .* does not hang on left_hip"):
        read_rig(
            whole, {**names, "left_hip": "mixamorig:LeftLeg", "left_knee": "mixamorig:LeftUpLeg"}
        )
    with pytest.raises(InputError, match=r"cannot be written as \.obj; expected \.glb or"):
        write(tmp_path / "out.obj", read_rig(whole), [motion])
    (tmp_path / "cut.glb").write_bytes(whole.read_bytes()[:5000])
    with pytest.raises(FileFormatError, match="truncated"):
        read_rig(tmp_path / "cut.glb")
    document = Document.read(whole)
    del document.json["skins"]
    document.write(tmp_path / "noskin.glb")
    with pytest.raises(FileFormatError, match="neither a skin nor an animation"):
        read_rig(tmp_path / "noskin.glb")
    for name in ("none.glb", "walk.txt"):
        with pytest.raises(InputError):
            read_rig(tmp_path / name)


# Feet hang on the root, where IK moves them, as in three.js' RobotExpressive.
ROBOT = RigShape(
    {
        "Bone": (None, (0, 0, 0)),
        "Body": ("Bone", (0, 0.9, 0)),
        "Hips": ("Body", (0, 0.9, 0)),
        "Torso": ("Body", (0, 1.1, 0)),
        "Neck": ("Torso", (0, 1.5, 0)),
        "Head": ("Neck", (0, 1.6, 0)),
        **{
            f"{name}.{mark}": (
                above if above in ("Bone", "Hips", "Torso") else f"{above}.{mark}",
                (sign * x, y, z),
            )
            for mark, sign in (("L", 1), ("R", -1))
            for name, above, (x, y, z) in (
                ("Foot", "Bone", (0.12, 0.1, 0)),
                ("PoleTarget", "Bone", (0.12, 0.5, 1)),
                ("UpperLeg", "Hips", (0.12, 0.9, 0)),
                ("LowerLeg", "UpperLeg", (0.12, 0.5, 0.02)),
                ("LowerLeg_end", "LowerLeg", (0.12, 0.1, 0)),
                ("Shoulder", "Torso", (0.1, 1.45, 0)),
                ("UpperArm", "Shoulder", (0.2, 1.45, 0)),
                ("LowerArm", "UpperArm", (0.5, 1.45, 0)),
                ("Palm2", "LowerArm", (0.75, 1.45, 0)),
            )
        },
    },
    along=(0, 1, 0),
)


def test_feet_that_hang_on_the_root_go_with_their_legs(motion: Motion, tmp_path: Path):
    path = write_rig(tmp_path / "a.glb", ROBOT)
    rig = read_rig(path)
    assert rig.skeleton.names[rig.body.pelvis] == "Body"
    out = tmp_path / "out.glb"
    write(out, rig, [motion])
    found, at = read_animations(out)[0].joints(), open_rig(out).skeleton.names.index
    assert np.ptp(found[:, at("Foot.L")], axis=0).max() > 0.5
    for side in "LR":
        foot, end = (found[:, at(f"{name}.{side}")] for name in ("Foot", "LowerLeg_end"))
        np.testing.assert_allclose(foot, end, atol=1e-4)
    again = to_humanml3d(read_animations(out)[0])
    assert np.isfinite(again).all()
    np.testing.assert_allclose(again[:, 7], found[:, at("Foot.L")], atol=1e-9)


def test_root_motion_moves_what_is_asked_for(motion: Motion, tmp_path: Path):
    rig = read_rig(write_rig(tmp_path / "a.glb", UNREAL))
    pelvis, found = rig.body.pelvis, {}
    for where in ("pelvis", "root", "none"):
        write(tmp_path / f"{where}.glb", rig, [motion], root_motion=where)
        found[where] = read_animations(tmp_path / f"{where}.glb")[0].joints()
    travelled = {where: np.ptp(joints[:, [0, pelvis]], axis=0).max(-1)
                 for where, joints in found.items()}  # fmt: skip
    assert travelled["pelvis"][0] == 0 and travelled["pelvis"][1] > 2
    assert travelled["root"][0] > 1
    assert travelled["none"][0] == 0 and travelled["none"][1] < 0.7
    # The body is where it was, whatever bone carries it there; the root stays on the floor.
    body = list(rig.body.joints.values())
    np.testing.assert_allclose(found["root"][:, body], found["pelvis"][:, body], atol=1e-4)
    np.testing.assert_allclose(found["root"][:, 0, 1], found["pelvis"][:, 0, 1], atol=1e-6)
    apart = np.linalg.norm((found["root"][:, pelvis] - found["root"][:, 0])[:, [0, 2]], axis=-1)
    assert apart.max() < 0.7


def test_rigs_without_a_root_bone_say_so(motion: Motion, tmp_path: Path):
    rig = read_rig(write_rig(tmp_path / "a.glb", MIXAMO))
    with pytest.raises(DataError, match="no root bone above the pelvis: 'mixamorig:Hips'"):
        write(tmp_path / "out.glb", rig, [motion], root_motion="root")
    write(tmp_path / "out.glb", rig, [motion], root_motion="none")
    assert np.ptp(read_animations(tmp_path / "out.glb")[0].joints()[:, 0, [0, 2]]) < 0.7


def test_two_skins_are_one_body(motion: Motion, tmp_path: Path):
    document = Document.read(write_rig(tmp_path / "a.glb", MIXAMO))
    first = document.json["skins"][0]
    half = {"joints": first["joints"][:12]}
    document.json["skins"] = [half, {"joints": first["joints"][9:]}]
    document.write(tmp_path / "two.glb")
    rig = read_rig(tmp_path / "two.glb")
    assert len(rig.body.joints) == 19
    assert np.isfinite(retarget(motion, rig).joints()).all()


def first_file(archive: Path, ending: str, folder: Path) -> Path:
    """Takes the first file with this ending out of an archive."""
    with tarfile.open(archive, "r|xz") as tar:
        member = next(member for member in tar if member.name.endswith(ending))
        content = tar.extractfile(member)
        assert content is not None
        (folder / f"real{ending}").write_bytes(content.read())
    return folder / f"real{ending}"


def test_real_skeletons_of_cmu(motion: Motion, shared: Path, tmp_path: Path):
    rig = read_rig(first_file(shared / "data" / "cmu_bvh.tar.xz", ".bvh", tmp_path))
    animation = retarget(motion, rig)
    assert angles(motion, animation, rig, ARMS).max() < 0.1
    assert write(tmp_path / "out.bvh", rig, [motion])


def test_a_vrm_is_a_character(motion: Motion, tmp_path: Path):
    rig = read_rig(write_rig(tmp_path / "a.glb", CHILD).rename(tmp_path / "a.vrm"))
    (written,) = write(tmp_path / "moving.glb", rig, [motion])
    (animation,) = read_animations(written)
    assert len(animation) == len(motion)
