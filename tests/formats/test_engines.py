"""Figures for game engines: the same body under other names, carried by a root bone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.errors import InputError
from latentmotion.formats import engines
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.kinematics.bone_names import match_names
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn
from latentmotion.retarget import find_humanoid
from tests.support.walker import walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(24).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), caption="a person walks")


@pytest.mark.parametrize(
    ("name", "known"), [("unreal", "Unreal"), ("unity", "VRM"), ("godot", "VRM")]
)
def test_the_body_is_the_same_and_its_root_on_the_floor(
    name: engines.EngineName, known: str, motion: Motion, tmp_path: Path
) -> None:
    figure = engines.for_engine(motion, name)
    assert match_names(figure.skeleton.names).convention == known
    assert find_humanoid(figure.skeleton).pelvis == 1
    np.testing.assert_allclose(figure.joints[:, 1:], motion.joints, atol=1e-5)
    assert (figure.joints[:, 0, 1] == 0).all()
    path = figure.joints[:, 0] - figure.joints[:, 1]
    assert np.linalg.norm(path[:, [0, 2]], axis=-1).max() < 0.7
    assert np.ptp(figure.joints[:, 0], axis=0).max() > 0.5
    formats.save(tmp_path / "a.glb", [figure, figure])
    found = read_animations(tmp_path / "a.glb")
    assert len(found) == 2 and found[0].skeleton.names == figure.skeleton.names
    np.testing.assert_allclose(found[0].joints(), figure.joints, atol=1e-5)
    again = formats.load(tmp_path / "a.glb")[0]
    np.testing.assert_allclose(again.joints, motion.joints, atol=1e-5)


def turning(motion: Motion, degrees: float) -> Motion:
    """Returns the motion on a curve by which it turns so far."""
    joints, angle = motion.joints.astype(float), np.radians(np.linspace(0, degrees, len(motion)))
    steps = turn(np.diff(joints[:, 0], axis=0, prepend=joints[:1, 0]) * (1, 0, 1), angle)
    around = turn(joints - joints[:, :1] * (1, 0, 1), angle[:, None])
    return Motion((around + np.cumsum(steps, axis=0)[:, None]).astype("f4"))


@pytest.mark.parametrize("name", ["unreal", "unity", "godot"])
def test_clips_played_by_their_root_motion_end_where_the_joined_motion_ends(
    name: engines.EngineName, motion: Motion, tmp_path: Path
) -> None:
    clips = [turning(motion, 70), turning(motion, -110), turning(motion, 180)]
    formats.save(tmp_path / "a.glb", [engines.for_engine(clip, name) for clip in clips])
    place, played = np.eye(4), []
    for animation in read_animations(tmp_path / "a.glb"):
        root = np.tile(np.eye(4), (len(animation), 1, 1))
        root[:, :3, :3], root[:, :3, 3] = animation.rotations[:, 0], animation.root_positions
        world = place @ np.linalg.inv(root[0]) @ root
        joints = animation.joints()[:, 1:]
        local = np.einsum("fba,fjb->fja", root[:, :3, :3], joints - root[:, None, :3, 3])
        played.append(np.einsum("fab,fjb->fja", world[:, :3, :3], local) + world[:, None, :3, 3])
        place = world[-1]
        yaw = np.arctan2(root[:, 0, 2], root[:, 2, 2])
        assert np.ptp(np.unwrap(yaw)) > np.radians(50)  # the root turns, not the pelvis alone
    facing = turn(np.eye(3), np.array(heading(clips[0].joints[0], clips[0].skeleton))).T
    joined = clips[0].joined(*clips[1:]).joints
    start = clips[0].joints[0, 0] * (1, 0, 1)
    expected = np.einsum("ba,fjb->fja", facing, joined - start)
    np.testing.assert_allclose(np.concatenate(played), expected, atol=2e-4)


def test_mixamo_has_its_names_and_no_root_bone(motion: Motion, tmp_path: Path) -> None:
    figure = engines.for_engine(motion, "mixamo")
    assert figure.skeleton.names[0] == "mixamorig:Hips"
    assert match_names(figure.skeleton.names).convention == "Mixamo"
    np.testing.assert_allclose(figure.joints, motion.joints, atol=1e-5)
    formats.save(tmp_path / "a.glb", [figure])
    again = formats.load(tmp_path / "a.glb")[0]
    np.testing.assert_allclose(again.joints, motion.joints, atol=1e-5)
    assert len(engines.mannequin_of(figure.skeleton).vertices) > 500


def test_the_mannequin_stays_the_mannequin(motion: Motion) -> None:
    figure = engines.for_engine(motion, "unreal").animation().skeleton
    ours, theirs = (engines.mannequin_of(s) for s in (motion.animation().skeleton, figure))
    np.testing.assert_allclose(theirs.vertices - figure.offsets[1], ours.vertices, atol=1e-9)
    np.testing.assert_array_equal(theirs.joints, ours.joints + 1)


def test_what_has_no_such_bones_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    kit = Motion(np.random.default_rng(0).normal(size=(4, 21, 3)).astype("f4"), skeleton=KIT)
    with pytest.raises(InputError, match="not for 'kit'"):
        engines.for_engine(kit, "unity")
    with pytest.raises(SystemExit):
        main(["generate", "a", "--preset", "unity", "-o", str(tmp_path / "a.npz")])
    assert "--preset unity cannot be written as" in capsys.readouterr().err
