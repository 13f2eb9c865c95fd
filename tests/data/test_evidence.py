"""What motions show, by figures that do one thing; calibration poses and jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.quality import find_glitch, without_blend, without_t_poses
from latentmotion.data.recording import every, whole_step
from latentmotion.data.sources.snu import EVIDENCE, floor_of, shows
from latentmotion.kinematics.skeleton import HUMANML3D, interpolate
from tests.support.mocap_folders import swaying
from tests.support.simple_motions import FPS, figure, mirrored, raised

DOWN = 0.92 - 0.6 * np.linspace(0, 1, 40)


WAVE = np.sin(np.pi * np.arange(40) / 39) ** 2


def bowed() -> np.ndarray:
    angles = np.zeros((40, 3))
    angles[:, 0] = 1.2 * WAVE
    return figure(2, swings={"spine1": angles})


FIGURES: dict[str, tuple[np.ndarray, str]] = {
    "stand": (figure(2), "stays"),
    "walk": (figure(4, speed=1.2), "moves steps stirs"),
    "run": (figure(4, speed=2.5), "moves runs steps stirs"),
    "turn left": (figure(2, turn=100), "stays turns_left"),
    "turn right": (figure(2, turn=-100), "stays turns_right"),
    "turn round": (figure(2, turn=175), "stays turns turns_left"),
    "left arm": (figure(2, swings={"left_shoulder": raised(40, 2.6)}), "stays stirs hands_up"),
    "bow": (bowed(), "stays bends"),
    "squat": (figure(2, height=0.92 - 0.6 * WAVE), "stays lowers down_up"),
    "jump": (figure(2, height=0.92 + 0.3 * WAVE), "stays jumps"),
    "lie down": (
        figure(2, height=DOWN),
        "stays lowers down descends",
    ),
    "get up": (figure(2, height=DOWN[::-1]), "stays lowers up climbs"),
}


CHECKED = ("moves", "stays", "runs", "steps", "turns", "turns_left", "turns_right", "bends",
           "jumps", "lowers", "down", "up", "down_up", "hands_up", "halts")  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_figures_show_what_they_do_and_nothing_else(name: str) -> None:
    joints, expected = FIGURES[name]
    floor = float(figure(2)[0, :, 1].min())
    assert shows(expected, joints, floor, whole=False), [
        one for one in expected.split() if not shows(one, joints, floor, False)
    ]
    shown = {one for one in CHECKED if shows(one, joints, floor, whole=False)}
    assert shown <= {*expected.split(), *(("jumps",) if name == "get up" else ())}


@pytest.mark.parametrize("height", [-0.3, 0.7])
def test_the_height_of_the_floor_is_no_evidence(height: float) -> None:
    joints = FIGURES["jump"][0] + np.array([0.0, height, 0.0])
    floor = floor_of(joints)
    assert floor == pytest.approx(floor_of(FIGURES["jump"][0]) + height)
    assert shows("jumps stays", joints, floor, whole=False)
    assert not shows("jumps whole", joints, floor, whole=False)
    assert shows("jumps whole", joints, floor, whole=True)


@pytest.mark.parametrize(
    "evidence", [name for name in EVIDENCE if "left" not in name and "right" not in name]
)
def test_evidence_without_a_side_is_the_same_in_a_mirror(evidence: str) -> None:
    found = [shows(evidence, joints, 0.0, True) for joints, _ in FIGURES.values()]
    assert found == [shows(evidence, mirrored(joints), 0.0, True) for joints, _ in FIGURES.values()]


def test_who_walks_stands_and_walks_on_halts() -> None:
    joints = figure(6, speed=1.0)
    assert not shows("halts", joints, 0.0, whole=True)
    still = joints.copy()
    still[40:70] = still[40]
    still[70:] -= still[70, :1] - still[40, :1]
    assert shows("halts", still, 0.0, whole=True)


def posed(frames: int, *spans: tuple[int, int]) -> np.ndarray:
    """A figure with hanging arms that holds the T-pose in some spans."""
    held = np.zeros((frames, 1))
    for first, last in spans:
        held[first:last] = np.pi / 2
    arms = {f"{side}_shoulder": held * [0, 0, n] for side, n in (("left", 1), ("right", -1))}
    return figure(frames / FPS, swings=arms)


@pytest.mark.parametrize(
    ("spans", "kept"),
    [
        ([], [(0, 100)]),
        ([(0, 3)], [(13, 100)]),
        ([(40, 47)], [(0, 100)]),
        ([(40, 48)], [(0, 30), (58, 100)]),
        ([(97, 100)], [(0, 87)]),
        ([(4, 6), (50, 70)], [(16, 40), (80, 100)]),
        ([(5, 7)], [(0, 100)]),
        ([(0, 100)], []),
    ],
)
def test_calibration_poses_go_with_the_way_in_and_out(spans: list, kept: list) -> None:
    assert without_t_poses(posed(100, *spans)) == kept


def test_a_take_shorter_than_the_blend_stays() -> None:
    joints = swaying(2, fps=20).joints()
    assert without_blend(joints, 120, 20) is joints


@pytest.mark.parametrize(("jump", "clean"), [(0.15, True), (0.3, False)])
def test_jumps_of_a_wrist_are_judged_in_meters(jump: float, clean: bool) -> None:
    """One frame off by d makes second differences of 2 d: 800 d m/s² at 20 frames per second."""
    joints = figure(2)
    joints[20, HUMANML3D.names.index("left_wrist"), 2] += jump
    found = find_glitch(joints, FPS)
    assert (found is None) is clean


@pytest.mark.parametrize(
    ("native", "step"), [(120, 6), (119.9, 6), (118, None), (20, 1), (25, None), (10, None)]
)
def test_whole_steps(native: float, step: int | None) -> None:
    assert whole_step(20, native) == step


@pytest.mark.parametrize(
    ("step", "start", "frames"), [(1, 0, 10), (3, 0, 4), (3, 2, 3), (20, 0, 1)]
)
def test_every_nth_frame_has_the_rate_of_it(step: int, start: int, frames: int) -> None:
    animation = swaying(10)
    moved = replace(animation, translations=np.arange(10 * 22 * 3.0).reshape(10, 22, 3))
    found = every(moved, step, start)
    assert len(found) == frames and found.fps == pytest.approx(120 / step)
    assert found.translations is not None
    np.testing.assert_array_equal(found.translations[0], moved.translations[start])


def test_interpolation_ends_with_the_last_frame_that_is_there() -> None:
    joints = np.arange(5.0)[:, None, None] * np.ones((1, 2, 3))
    assert interpolate(joints, 2.0)[:, 0, 0].tolist() == [0, 2, 4]
    assert interpolate(joints, 3.0)[:, 0, 0].tolist() == [0, 3]
    assert interpolate(joints, 0.5)[:, 0, 0].tolist() == [n / 2 for n in range(9)]
