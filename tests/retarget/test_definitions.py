"""Retargeting by its definitions: onto itself, elsewhere, turned, larger, twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import MIXAMO, write_rig
from latentmotion.cleanup import CleanUpWarning
from latentmotion.errors import DataError, InputError
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.kinematics.standing import RestPose
from latentmotion.motion import Motion
from latentmotion.representation.canonical import turn
from latentmotion.retarget import Rig, find_humanoid, read_rig, retarget
from latentmotion.retarget.hands import place_hands, point_of
from latentmotion.retarget.rig import RigPose, SourceCharacter
from latentmotion.retarget.transfer import check_output, write
from tests.support.walker import walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(24).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), caption="a person walks")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return read_rig(write_rig(tmp_path_factory.mktemp("rig") / "a.glb", MIXAMO))


@pytest.fixture(scope="module")
def home(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """Our own skeleton as a rig."""
    path = tmp_path_factory.mktemp("home") / "ours.bvh"
    write_bvh(path, motion.animation())
    return read_rig(path)


@pytest.fixture(scope="module")
def moved(motion: Motion, rig: Rig) -> Animation:
    return retarget(motion, rig)


def test_a_rig_retargeted_onto_itself_moves_as_before(moved: Animation, rig: Rig) -> None:
    again = retarget(moved, rig, rig.body)
    joints = [rig.body.joints[name] for name in rig.body.joints]
    upper = [rig.body.joints[f"{side}_{name}"] for side in ("left", "right")
             for name in ("shoulder", "elbow", "wrist")]  # fmt: skip
    turns = [animation.skeleton.world_rotations(animation.rotations)[:, upper]
             for animation in (moved, again)]  # fmt: skip
    np.testing.assert_allclose(*turns, atol=1e-6)
    off = again.joints()[:, joints] - moved.joints()[:, joints]
    assert np.linalg.norm(off, axis=-1).max() < 0.03
    assert again.fps == moved.fps and len(again.rotations) == len(moved.rotations)


def test_it_does_not_matter_where_one_is_nor_which_way_one_faces(
    motion: Motion, moved: Animation, rig: Rig
) -> None:
    angle, shift = np.array(0.8), np.array([2.0, 0.0, -1.0])
    scale = rig.leg / SourceCharacter.of(motion).leg
    elsewhere = replace(motion, joints=(turn(motion.joints, angle) + shift).astype("f4"))
    found = retarget(elsewhere, rig).joints()
    np.testing.assert_allclose(found, turn(moved.joints(), angle) + scale * shift, atol=2e-3)


def test_bones_have_the_rigs_lengths(moved: Animation, rig: Rig) -> None:
    joints, parents = moved.joints(), list(rig.skeleton.parents[1:])
    rigid = [joint for joint, parent in enumerate(rig.skeleton.parents) if parent >= 0
             and joint != rig.root_motion_bone]  # fmt: skip
    bones = np.linalg.norm(joints[:, 1:] - joints[:, parents], axis=-1)
    lengths = np.linalg.norm(rig.skeleton.offsets[1:], axis=-1)
    chosen = [joint - 1 for joint in rigid]
    np.testing.assert_allclose(bones[:, chosen], np.tile(lengths[chosen], (len(joints), 1)),
                               atol=1e-9)  # fmt: skip


def test_a_figure_at_rest_keeps_the_rigs_rest_pose(rig: Rig) -> None:
    hips = np.mean([rig.rest()[rig.body.joints[f"{side}_hip"]] for side in ("left", "right")], 0)
    pose = RigPose(rig, {}, np.tile(hips, (3, 1)))
    np.testing.assert_allclose(pose.joints, np.tile(rig.rest(), (3, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(
        pose.moved({}, np.tile(hips + np.array([0, 1, 0]), (3, 1))).joints[0, rig.body.pelvis],
        rig.rest()[rig.body.pelvis] + np.array([0, 1, 0]),
        atol=1e-9,
    )


def test_a_pose_has_its_hips_where_it_was_told(rig: Rig) -> None:
    generator = np.random.default_rng(0)
    hips = generator.normal(size=(4, 3))
    turns = np.linalg.qr(generator.normal(size=(4, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    pose = RigPose(rig, {rig.body.pelvis: turns}, hips)
    middle = (pose.position("left_hip") + pose.position("right_hip")) / 2
    np.testing.assert_allclose(middle, hips, atol=1e-9)
    np.testing.assert_allclose(pose.world[:, rig.body.pelvis], turns)


def test_axes_and_unit_of_the_file_come_back(moved: Animation, rig: Rig) -> None:
    inside = rig.in_file(moved)
    joints = inside.joints() * rig.meters @ rig.axes - (0, rig.floor, 0)
    np.testing.assert_allclose(joints, moved.joints(), atol=1e-6)
    np.testing.assert_allclose(rig.axes @ rig.axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rig.axes) == pytest.approx(1)


@pytest.mark.parametrize(
    ("meters", "name"), [(1.0, "meters"), (0.01, "centimeters"), (0.0254, "inches"), (0.5, "0.5 m")]
)
def test_units_have_their_names(rig: Rig, meters: float, name: str) -> None:
    assert replace(rig, meters=meters).unit() == name


# Bodies


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_a_body_of_any_size_stands_upright(size: float) -> None:
    larger = replace(HUMANML3D, offsets=size * HUMANML3D.offsets)
    pose = RestPose.of(find_humanoid(larger))
    np.testing.assert_allclose(pose.axes, np.eye(3), atol=1e-9)
    assert pose.leg == pytest.approx(size * RestPose.of(find_humanoid(HUMANML3D)).leg)


@pytest.mark.parametrize(
    "axes",
    [
        np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),  # z up
        np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),  # facing x
        np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
    ],
)
def test_axes_are_found_from_the_joints_alone(axes: np.ndarray) -> None:
    assert np.linalg.det(axes) == 1
    turned = replace(HUMANML3D, offsets=HUMANML3D.offsets @ axes.T)
    np.testing.assert_allclose(RestPose.of(find_humanoid(turned)).axes, axes, atol=1e-9)


def test_bodies_that_cannot_stand_say_why() -> None:
    def rest_of(joint: str, offset: tuple[float, float, float]) -> None:
        offsets = HUMANML3D.offsets.copy()
        offsets[HUMANML3D.names.index(joint)] = offset
        RestPose.of(find_humanoid(replace(HUMANML3D, offsets=offsets)))

    with pytest.raises(DataError, match="a bone of length 0"):
        rest_of("left_knee", (0, 0, 0))
    backward = replace(HUMANML3D, offsets=HUMANML3D.offsets * (1, 1, -1))
    with pytest.raises(DataError, match="toes point backward"):
        RestPose.of(find_humanoid(backward))


def test_our_joints_are_found_by_their_own_names() -> None:
    body = find_humanoid(HUMANML3D)
    for name, joint in body.joints.items():
        assert HUMANML3D.names[joint] == name
    names = HUMANML3D.names
    assert names[body.pelvis] == "pelvis" and names[body.chest] == "spine3"
    assert [names[joint] for joint in body.spine] == ["spine1", "spine2", "spine3"]
    assert [names[joint] for joint in body.neck] == ["neck"]
    again = find_humanoid(HUMANML3D, joint_map=body.joint_map())
    assert {name: again.joints[name] for name in body.joints} == dict(body.joints)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"left_knee": "left_kne"},
            "is none of the skeleton's 22 joints; nearest are 'left_knee', ",
        ),
        ({"left_nee": "left_knee"}, "the joint map has 'left_nee', .* nearest are 'left_knee', "),
        (
            {"left_ankle": "right_ankle"},
            r"left_ankle \('right_ankle'\) does not hang on left_knee",
        ),
        ({"left_knee": "right_knee"}, r"left_knee \('right_knee'\) does not hang on left_hip"),
    ],
)
def test_maps_that_do_not_fit_name_the_joint(changes: dict[str, str], message: str) -> None:
    right = find_humanoid(HUMANML3D).joint_map()
    assert find_humanoid(HUMANML3D, joint_map={**right, "_remark": "mine"}).pelvis == 0
    with pytest.raises(DataError, match=message):
        find_humanoid(HUMANML3D, joint_map={**right, **changes})
    lacking = {name: joint for name, joint in right.items() if name != "left_hip"}
    with pytest.raises(
        DataError, match=r"found no left_hip in the rig .* nearest: 'left_hip'; draft"
    ):
        find_humanoid(HUMANML3D, joint_map=lacking)


def test_endings_that_a_rig_cannot_have_are_told(rig: Rig, motion: Motion, tmp_path: Path) -> None:
    for name in ("a.obj", "b"):
        with pytest.raises(InputError, match=r"expected \.gl.* or \.bvh"):
            check_output(rig, tmp_path / name)
    with pytest.raises(InputError, match="no motion to write"):
        write(tmp_path / "a.bvh", rig, [])
    assert not list(tmp_path.iterdir())
    assert len(write(tmp_path / "a.bvh", rig, [motion, motion], fps=10)) == 2


# Hands


def test_palms_of_the_character_are_at_the_goals_of_the_motion(motion: Motion, rig: Rig) -> None:
    rest = RigPose(rig, {}, np.zeros((1, 3)))

    def palms(animation: Animation) -> list[np.ndarray]:
        joints, found = animation.joints(), []
        world = rig.skeleton.world_rotations(animation.rotations)
        for side in ("right", "left"):
            wrist = rig.body.joints[f"{side}_wrist"]
            beyond = (point_of(rest, f"{side}_hand") - rest.joints[:, wrist])[0]
            found.append(joints[:, wrist] + world[:, wrist] @ beyond)
        return found

    free = palms(retarget(motion, rig))[0]
    place = (free[8] + (0.0, 0.1, 0.05)).tolist()
    times = {"at": 8 / motion.fps, "until": 9 / motion.fps}
    goals = [
        {"joint": "left_hand", **times, "to": [0.2, 0, 0], "relative_to": "right_hand"},
        {"joint": "right_hand", "at": 8 / motion.fps, "to": place},
    ]
    right, left = palms(retarget(replace(motion, metadata={"goals": goals}), rig))
    np.testing.assert_allclose(right[8], place, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(left - right, axis=-1)[8:10], 0.2, atol=1e-4)
    far = [{"joint": "right_hand", "at": 0.2, "to": [9, 1, 9]}]
    with pytest.warns(CleanUpWarning, match="right_hand at 0.2 s: .* cm too short"):
        retarget(replace(motion, metadata={"goals": far}), rig)


def test_hands_below_the_floor_are_lifted_onto_it(motion: Motion, rig: Rig) -> None:
    source = SourceCharacter.of(motion)
    hips = np.tile((0.0, 1.0, 0.0), (len(motion), 1))
    pose = RigPose(rig, {}, hips)
    low = pose.moved({}, hips - point_of(pose, "left_fingertips") * (0, 1, 0) - (0, 0.06, 0))
    lifted = place_hands(low, source)
    for side in ("left", "right"):
        assert point_of(low, f"{side}_fingertips")[:, 1].max() < -0.05
        assert point_of(lifted, f"{side}_fingertips")[:, 1].min() > -0.01
    sunk = SourceCharacter.of(replace(motion, joints=motion.joints - np.float32([0, 2, 0])))
    flat = place_hands(low, sunk)  # hands of a motion on all fours are bent at the wrist
    for side in ("left", "right"):
        assert np.allclose(low.position(f"{side}_wrist"), flat.position(f"{side}_wrist"))
        assert point_of(flat, f"{side}_fingertips")[:, 1].min() > -0.01
