"""Other frame rates: constant turns in closed form, bones that keep their lengths, true speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.motion import Motion
from tests.support.walker import walker


def turning(fps: float, seconds: float = 2.0) -> Animation:
    """All joints turn at constant speeds, and the root goes straight ahead."""
    times = np.arange(round(seconds * fps) + 1) / fps
    speeds = np.random.default_rng(0).normal(size=(len(HUMANML3D), 3)) * 2
    rotations = matrix_from_axis_angle(times[:, None, None] * speeds)
    return Animation(HUMANML3D, rotations, times[:, None] * np.array([0.1, 0.2, 1.3]), fps)


@pytest.mark.parametrize("fps", [24, 25, 30, 60, 120, 12.5, 50])
def test_constant_turns_in_closed_form(fps: float):
    found, meant = turning(20).resampled(fps), turning(fps)
    assert (found.fps, len(found)) == (fps, len(meant))
    np.testing.assert_allclose(found.rotations, meant.rotations, atol=1e-9)
    np.testing.assert_allclose(found.root_positions, meant.root_positions, atol=1e-12)


def test_up_and_down_again_is_the_same():
    there = walker(41).resampled(120)
    back = there.resampled(20)
    np.testing.assert_allclose(back.rotations, walker(41).rotations, atol=1e-12)
    np.testing.assert_allclose(back.joints(), walker(41).joints(), atol=1e-12)


@pytest.mark.parametrize("fps", [24, 25, 30, 60, 120])
def test_a_walk_keeps_its_bones_and_its_time(fps: float):
    person = walker(80)
    joints = person.resampled(fps).joints()
    parents = list(person.skeleton.parents[1:])
    lengths = np.linalg.norm(joints[:, 1:] - joints[:, parents], axis=-1)
    expected = np.linalg.norm(person.skeleton.offsets[1:], axis=-1)
    np.testing.assert_allclose(lengths, np.tile(expected, (len(joints), 1)), atol=1e-12)
    motion = Motion(person.joints().astype("f4"))
    assert abs(motion.resampled(fps).seconds - motion.seconds) <= 1 / 20
    pace = np.linalg.norm(np.diff(joints[:, 0], axis=0), axis=-1).mean() * fps
    assert pace == pytest.approx(
        np.linalg.norm(np.diff(person.root_positions, axis=0), axis=-1).mean() * 20, rel=1e-3
    )


def test_translations_go_by_straight_lines():
    person = walker(3)
    moved = np.tile(person.skeleton.offsets, (3, 1, 1))
    moved[1] += 0.1
    track = replace(person, translations=moved).resampled(40).translations
    assert track is not None
    np.testing.assert_allclose(track[1], person.skeleton.offsets + 0.05, atol=1e-12)


def test_one_frame_and_the_same_rate():
    person = walker(1)
    assert len(person.resampled(60)) == 1
    np.testing.assert_allclose(person.resampled(60).joints(), person.joints(), atol=1e-12)
    motion = Motion(walker(4).joints().astype("f4"))
    assert motion.resampled(20) is motion


@pytest.mark.parametrize("fps", [0, -1, float("nan"), float("inf"), 1e9])
def test_what_is_no_rate_is_refused(fps: float, tmp_path: Path):
    with pytest.raises(InputError, match="fps is"):
        walker(3).resampled(fps)
    with pytest.raises(InputError, match="fps is"):
        Motion(walker(3).joints().astype("f4")).save(tmp_path / "a.npz", fps)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".npz", ".bvh", ".glb"])
def test_files_at_another_rate(tmp_path: Path, ending: str):
    motion = Motion(walker(40).joints().astype("f4"), caption="a walk")
    formats.save(tmp_path / f"a{ending}", [motion], fps=120)
    read = Motion.load(tmp_path / f"a{ending}")
    assert (len(read), read.fps) == (235, pytest.approx(120))
    assert np.abs(read.joints[::6] - motion.joints).max() < 1e-3


def test_a_resampled_motion_keeps_what_is_known():
    motion = Motion(walker(9).joints().astype("f4"), caption="a walk", metadata={"seed": 3})
    faster = motion.resampled(60)
    assert (faster.caption, faster.metadata, faster.skeleton) == ("a walk", {"seed": 3}, HUMANML3D)
    assert faster.animation().fps == 60
    np.testing.assert_allclose(faster.animation().joints(), faster.joints, atol=1e-6)
    moved = replace(faster, joints=faster.joints + 1)
    np.testing.assert_allclose(moved.animation().joints(), moved.joints, atol=2e-3)
