"""Names of bones: the rigs of many programs are known, and no twist is taken for a limb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.errors import DataError
from latentmotion.kinematics.bone_names import REQUIRED, match_names, name_maps, nearest
from latentmotion.kinematics.draft import draft_map
from latentmotion.kinematics.humanoid import find_humanoid, to_humanml3d
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton

PARTS = ["hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist"]

RIGS = {
    # The names of hip, knee, ankle, toes, collar, shoulder, elbow, wrist; then of other bones.
    "Mixamo": (
        "Left Right",
        "mixamorig5:@UpLeg mixamorig5:@Leg mixamorig5:@Foot mixamorig5:@ToeBase "
        "mixamorig5:@Shoulder mixamorig5:@Arm mixamorig5:@ForeArm mixamorig5:@Hand",
        "mixamorig5:Hips mixamorig5:Spine mixamorig5:HeadTop_End mixamorig5:@Toe_End "
        "mixamorig5:@HandThumb1",
    ),
    "Mixamo, as MotionBuilder characterizes": (
        "Left Right",
        "Character1_@UpLeg Character1_@Leg Character1_@Foot Character1_@ToeBase "
        "Character1_@Shoulder Character1_@Arm Character1_@ForeArm Character1_@Hand",
        "Character1_Hips Character1_@UpLegRoll Character1_@LegRoll Character1_@ArmRoll",
    ),
    "Mixamo, with a suffix": (
        "Left Right",
        "@UpLeg_jnt @Leg_jnt @Foot_jnt @ToeBase_jnt @Shoulder_jnt @Arm_jnt @ForeArm_jnt @Hand_jnt",
        "Hips_jnt @ForeArmTwist_jnt @HandIK_jnt",
    ),
    "Mixamo, numbered by an exporter": (
        "Left Right",
        "@UpLeg_055 @Leg_056 @Foot_057 @ToeBase_058 @Shoulder_07 @Arm_08 @ForeArm_09 @Hand_010",
        "Hips_00 Spine_01",
    ),
    "Blender .L of RobotExpressive": (
        "L R",
        "UpperLeg.@ LowerLeg.@ Foot.@ - Shoulder.@ UpperArm.@ LowerArm.@ Palm2.@",
        "Bone Body Hips Abdomen Torso Neck Head PoleTarget.@ LowerLeg.@_end Palm1.@ Thumb.@",
    ),
    "Blender .L through three.js": (
        "L R",
        "UpperLeg@ LowerLeg@ Foot@ - Shoulder@ UpperArm@ LowerArm@ Palm2@",
        "Hips Abdomen Torso Neck Head PoleTarget@",
    ),
    "Character Creator": (
        "L R",
        "CC_Base_@_Thigh CC_Base_@_Calf CC_Base_@_Foot CC_Base_@_ToeBase CC_Base_@_Clavicle "
        "CC_Base_@_Upperarm CC_Base_@_Forearm CC_Base_@_Hand",
        "CC_Base_BoneRoot CC_Base_Hip CC_Base_Pelvis CC_Base_Waist CC_Base_NeckTwist01 "
        "CC_Base_@_ThighTwist01 CC_Base_@_CalfTwist02 CC_Base_@_UpperarmTwist01 "
        "CC_Base_@_ForearmTwist02 CC_Base_@_KneeShareBone CC_Base_@_ToeBaseShareBone",
    ),
    "Rokoko": (
        "Left Right",
        "@Thigh @Shin @Foot @Toe @Shoulder @Arm @ForeArm @Hand",
        "Hips Spine1 Spine2 Spine3 Spine4 Neck Head @ToeTip",
    ),
    "Xsens MVN": (
        "Left Right",
        "@UpperLeg @LowerLeg @Foot @Toe @Shoulder @UpperArm @ForeArm @Hand",
        "Pelvis L5 L3 T12 T8 Neck Head",
    ),
    "Xsens BVH": (
        "Left Right",
        "@Hip @Knee @Ankle @Toe @Collar @Shoulder @Elbow @Wrist",
        "Hips Chest Chest2 Chest3 Chest4 Neck Head",
    ),
    "OptiTrack": (
        "L R",
        "@Thigh @Shin @Foot @Toe @Shoulder @UArm @FArm @Hand",
        "Hip Ab Chest Neck Head @Thumb1",
    ),
    "OptiTrack with an actor's name": (
        "L R",
        "Bob_@Thigh Bob_@Shin Bob_@Foot Bob_@Toe Bob_@Shoulder Bob_@UArm Bob_@FArm Bob_@Hand",
        "Bob_Hip Bob_Ab Bob_Chest Bob_Neck Bob_Head",
    ),
    "VRoid": (
        "L R",
        "J_Bip_@_UpperLeg J_Bip_@_LowerLeg J_Bip_@_Foot J_Bip_@_ToeBase J_Bip_@_Shoulder "
        "J_Bip_@_UpperArm J_Bip_@_LowerArm J_Bip_@_Hand",
        "Root J_Bip_C_Hips J_Bip_C_Head J_Sec_@_Bust1 J_Adj_@_FaceEye J_Sec_@_TopsUpperArm_01",
    ),
    "VRM": (
        "Left Right",
        "@UpperLeg @LowerLeg @Foot @Toes @Shoulder @UpperArm @LowerArm @Hand",
        "Hips Spine Chest UpperChest Neck Head @Eye Jaw",
    ),
    "Unreal 5": (
        "l r",
        "thigh_@ calf_@ foot_@ ball_@ clavicle_@ upperarm_@ lowerarm_@ hand_@",
        "root pelvis spine_05 neck_01 neck_02 head thigh_twist_01_@ thigh_twist_02_@ "
        "calf_twist_01_@ upperarm_twist_01_@ lowerarm_twist_02_@ ik_foot_@ ik_hand_@ "
        "clavicle_out_@ ankle_bck_@",
    ),
    "ARKit": (
        "left right",
        "@_upLeg_joint @_leg_joint @_foot_joint @_toes_joint @_shoulder_1_joint @_arm_joint "
        "@_forearm_joint @_hand_joint",
        "root hips_joint spine_7_joint neck_1_joint head_joint @_toesEnd_joint",
    ),
    "Rigify, metarig": (
        "L R",
        "thigh.@ shin.@ foot.@ toe.@ shoulder.@ upper_arm.@ forearm.@ hand.@",
        "spine spine.001 spine.004 spine.006 pelvis.@ breast.@ heel.02.@ palm.01.@",
    ),
    "Rigify": (
        "L R",
        "DEF-thigh.@ DEF-shin.@ DEF-foot.@ DEF-toe.@ DEF-shoulder.@ DEF-upper_arm.@ "
        "DEF-forearm.@ DEF-hand.@",
        "ORG-thigh.@ ORG-shin.@ ORG-foot.@ ORG-hand.@ MCH-thigh.@ thigh_fk.@ shin_fk.@ foot_fk.@ "
        "hand_ik.@ DEF-thigh.@.001 DEF-shin.@.001 DEF-upper_arm.@.001 DEF-forearm.@.001 DEF-spine",
    ),
    "Daz Genesis 8": (
        "l r",
        "@ThighBend @Shin @Foot @Toe @Collar @ShldrBend @ForearmBend @Hand",
        "hip pelvis abdomenLower chestUpper neckLower head @ThighTwist @ShldrTwist @ForearmTwist "
        "@Metatarsals @SmallToe1",
    ),
    "Daz Genesis 9": (
        "l r",
        "@_thigh @_shin @_foot @_toes @_shoulder @_upperarm @_forearm @_hand",
        "hip pelvis spine1 neck1 head @_thightwist1 @_upperarmtwist2 @_forearmtwist1",
    ),
    "Biped": (
        "L R",
        "Bip001_@_Thigh Bip001_@_Calf Bip001_@_Foot Bip001_@_Toe0 Bip001_@_Clavicle "
        "Bip001_@_UpperArm Bip001_@_Forearm Bip001_@_Hand",
        "Bip001 Bip001_Pelvis Bip001_Spine Bip001_Neck Bip001_Head Bip001_@_ThighTwist "
        "Bip001_@_ForeTwist Bip001_@_CalfTwist Bip001_@_Finger0",
    ),
    "Biped of Valve": (
        "L R",
        "ValveBiped.Bip01_@_Thigh ValveBiped.Bip01_@_Calf ValveBiped.Bip01_@_Foot "
        "ValveBiped.Bip01_@_Toe0 ValveBiped.Bip01_@_Clavicle ValveBiped.Bip01_@_UpperArm "
        "ValveBiped.Bip01_@_Forearm ValveBiped.Bip01_@_Hand",
        "ValveBiped.Bip01_Pelvis ValveBiped.Bip01_@_Bicep ValveBiped.Bip01_@_Ulna",
    ),
    "Azure Kinect": (
        "LEFT RIGHT",
        "HIP_@ KNEE_@ ANKLE_@ FOOT_@ CLAVICLE_@ SHOULDER_@ ELBOW_@ WRIST_@",
        "PELVIS SPINE_CHEST NECK HEAD HAND_@ HANDTIP_@",
    ),
    "Advanced Skeleton": (
        "L R",
        "Hip_@ Knee_@ Ankle_@ Toes_@ Scapula_@ Shoulder_@ Elbow_@ Wrist_@",
        "Root_M Spine1_M Chest_M Neck_M Head_M HipPart1_@ ShoulderPart2_@ ToesEnd_@",
    ),
    "MakeHuman": (
        "L R",
        "upperleg01.@ lowerleg01.@ foot.@ toe1-1.@ clavicle.@ upperarm01.@ lowerarm01.@ wrist.@",
        "root spine05 neck01 head upperleg02.@ lowerleg02.@ upperarm02.@ shoulder01.@",
    ),
}  # fmt: skip


def expected_and_all(rig: str) -> tuple[dict[str, str], list[str]]:
    marks, limbs, others = RIGS[rig]
    expected = {
        f"{side}_{part}": word.replace("@", mark)
        for side, mark in zip(("left", "right"), marks.split(), strict=True)
        for part, word in zip(PARTS, limbs.split(), strict=True)
        if word != "-"
    }
    others = [
        word.replace("@", mark)
        for word in others.split()
        for mark in (marks.split() if "@" in word else "-")
    ]
    return expected, [*others, *expected.values()]


@pytest.mark.parametrize("rig", RIGS)
def test_names_of_each_program_are_known(rig: str) -> None:
    expected, names = expected_and_all(rig)
    for order in (names, names[::-1]):
        match = match_names(order)
        found = {name: order[joint] for name, joint in match.joints.items()}
        sided = {name: joint for name, joint in found.items() if "_" in name}
        assert sided == expected
        assert not match.missing
    assert match.convention.split()[0] == rig.replace(",", " ").split()[0]


def test_twists_alone_are_no_limbs() -> None:
    twists = [
        f"{side}{part}Twist" for side in "LR" for part in ("Thigh", "Calf", "Foot", "UpperArm")
    ]
    assert len(match_names(twists).missing) == len(REQUIRED)


@pytest.mark.parametrize("convention", name_maps())
def test_no_convention_is_taken_for_another(convention: str) -> None:
    names = [words[0] for words in name_maps()[convention].values()]
    match = match_names(names)
    assert [names[match.joints[name]] for name in REQUIRED] == [
        name_maps()[convention][name][0] for name in REQUIRED
    ]


def test_ten_names_are_named_however_many_there_are() -> None:
    said = nearest([*(f"bone_{n}_{'x' * 100}" for n in range(2000)), "my_thigh"])
    assert said.startswith("'my_thigh', ") and said.count("'") == 20 and len(said) < 500


# Bodies


def renamed(names: dict[str, str], without: tuple[str, ...] = ()) -> Skeleton:
    """Our skeleton under other names; the joints left out have none that says what they are."""
    new = [names.get(n, n) if n not in without else f"bone{i}" for i, n in
           enumerate(HUMANML3D.names)]  # fmt: skip
    return replace(HUMANML3D, names=tuple(new))


def test_positions_are_read_from_any_known_names() -> None:
    expected, _ = expected_and_all("Rokoko")
    skeleton = renamed(expected, ("pelvis", "spine1", "spine2", "spine3", "neck", "head"))
    rotations = np.tile(np.eye(3), (2, 22, 1, 1))
    animation = Animation(skeleton, rotations, np.zeros((2, 3)), 20.0)
    body, meant = to_humanml3d(animation)[0], HUMANML3D.rest_joints()
    alike = [n for n, name in enumerate(HUMANML3D.names) if name not in ("neck", "head")]
    np.testing.assert_allclose(body[alike], meant[alike], atol=1e-9)


def test_joints_that_a_rig_lacks_lie_between_its_neighbors() -> None:
    names = ("pelvis", "chest", "Neck", "Head")
    limbs = [f"{side}{part}" for side in ("Left", "Right")
             for part in ["Thigh", "Shin", "Foot", "Arm", "ForeArm", "Hand"]]  # fmt: skip
    parents = (-1, 0, 1, 2, *(0, 4, 5, 1, 7, 8), *(0, 10, 11, 1, 13, 14))
    side = np.array([[0.1, -0.1, 0], [0, -0.4, 0], [0, -0.4, 0],
                     [0.2, 0.15, 0], [0.3, 0, 0], [0.3, 0, 0]])  # fmt: skip
    middle = [[0, 0, 0], [0, 0.3, 0], [0, 0.2, 0], [0, 0.1, 0]]
    offsets = np.concatenate([middle, side, side * (-1, 1, 1)])
    skeleton = Skeleton("short", (*names, *limbs), parents, offsets)
    rest = np.tile(np.eye(3), (1, 16, 1, 1))
    joints = to_humanml3d(Animation(skeleton, rest, np.zeros((1, 3)), 20.0))[0]
    at = dict(zip(HUMANML3D.names, joints, strict=True))
    heights = [at[n][1] for n in ("pelvis", "spine1", "spine2", "spine3", "neck", "head")]
    np.testing.assert_allclose(heights, [0, 0.1, 0.2, 0.3, 0.5, 0.6], atol=1e-9)
    assert at["left_collar"][0] == pytest.approx(0.09) and 0.3 < at["left_collar"][1] < 0.45


def test_a_map_may_leave_out_what_the_tree_tells() -> None:
    skeleton = renamed({}, HUMANML3D.names)
    index = HUMANML3D.names.index
    short = {name: f"bone{index(name)}" for name in (*REQUIRED, "head")}
    body = find_humanoid(skeleton, joint_map={"_": "a remark", **short})
    assert [skeleton.names[joint] for joint in (body.pelvis, body.chest)] == ["bone0", "bone9"]
    with pytest.raises(DataError, match="'bone99', which is none of the skeleton's 22 joints"):
        find_humanoid(skeleton, joint_map={**short, "left_hip": "bone99"})


def test_a_draft_takes_the_names_that_are_known() -> None:
    expected, _ = expected_and_all("Rokoko")
    guesses = draft_map(renamed(expected))
    for name in REQUIRED:
        assert HUMANML3D.names[guesses[name].joint] == name
        assert guesses[name].reason == "its name, as in Rokoko"
