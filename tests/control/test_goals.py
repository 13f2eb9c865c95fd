"""Goals: what becomes of them, and which are refused with which reason."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from latentmotion.control.goals import (
    Goal,
    Heading,
    Pose,
    Reach,
    RootPath,
    TargetResidual,
    check_path,
    instants,
    targets_of,
)
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion
from tests.support.walker import walker


def test_goals_become_coordinates_in_frames() -> None:
    pose = Pose(1.0, Motion(walker(5).joints()), 3)
    goals = [Reach("right_wrist", 2.51, (0.3, None, 1)), Heading(0.5, 90), pose]
    targets = targets_of(goals, 80, 20.0, HUMANML3D)
    assert targets.frames.tolist() == [50] + [20] * 22
    assert targets.joints.tolist() == [21, *range(22)]
    assert targets.fixed[0].tolist() == [True, False, True]
    assert np.allclose(targets.places[1:], walker(5).joints()[3], atol=1e-6)
    assert (targets.turned.tolist(), targets.headings.tolist()) == ([10], [np.pi / 2])


REFUSED: list[tuple[Sequence[Goal], str]] = [
    ([Reach("right_palm", 1, (0, 1, 0))], "right_palm.*right_"),
    ([Reach("head", 2, (0, 1.5, 0), 1)], "end after its beginning"),
    ([Reach("head", 2, (0, 1.5, 0), 9)], "lasts from 0"),
    ([Reach("head", 1, (0, 1.5, 0), 3), Reach("head", 2, (0, 1.4, 0))], "two goals for head"),
    ([Reach("right_hand", 1, (0, 1, 2), 2, "left_hand")], "2.24 m from left_hand: the bones"),
    ([Heading(1, 0, 2), Heading(1.5, 5)], "two headings"),
    ([Reach("head", 4.2, (0, 1, 0))], "lasts from 0 to 3.95 s"),
    ([Reach("head", -1, (0, 1, 0))], "lasts from 0"),
    ([Reach("head", 1, (0, 3.4, 0))], "m high"),
    ([Reach("left_foot", 1, (0, -0.4, 0))], "m high"),
    ([Reach("head", 1, (None, None, None))], "expected meters"),
    ([Reach("pelvis", 1, (0, None, 9))], "runs 8 m/s"),
    ([Reach("head", 1, (0, 1, 0)), Reach("head", 1.01, (0, 1, 0.1))], "two goals for head"),
    ([Heading(1, 0), Heading(1, 5)], "two headings"),
    ([Reach("left_wrist", 1, (0, 1, 0)), Reach("right_wrist", 1, (0, 1, 3))], "3.0 m apart"),
    ([Reach("pelvis", 3, (0, None, 4)), Reach("pelvis", 3.2, (0, None, -2))], "apart"),
    ([Pose(1, Motion(walker(5).joints()), 5)], "its motion has 5"),
]


def test_a_goal_that_holds_is_a_target_of_each_frame() -> None:
    goals = [Reach("right_hand", 1, (0.3, 1, 1), 1.5), Heading(2, 90, 2.2)]
    targets = targets_of(goals, 80, 20.0, HUMANML3D)
    assert targets.frames.tolist() == list(range(20, 31))
    assert targets.turned.tolist() == [40, 41, 42, 43, 44]
    assert [goal.at for goal in instants(goals, 80, 20.0, 3)] == [1, 1.25, 1.5, 2, 2.1, 2.2]


def test_derivatives_of_hands_and_of_places_beside_a_joint() -> None:
    joints, draw = walker(5).joints().astype(float), np.random.default_rng(0)
    goals = [Reach("right_hand", 0.1, (0.3, None, 1)), Heading(0.15, 20)]
    goals += [Reach("left_wrist", 0.1, (0.2, 0.1, 0.3), None, "spine3")]
    residual = TargetResidual(targets_of(goals, 5, 20.0, HUMANML3D, None), HUMANML3D)
    step = 1e-5 * draw.normal(size=joints.shape)
    step[:, :20] = 0  # of wrists alone: the body keeps its direction
    change = residual(joints) - residual(joints + step)
    expected = np.einsum("rtjc,tjc->r", residual.gradient(joints), step)
    assert np.abs(change[:5] - expected[:5]).max() < 0.35 * np.abs(expected[:5]).max()
    assert np.abs(change[2:5] - expected[2:5]).max() < 1e-9


@pytest.mark.parametrize(("goals", "reason"), REFUSED)
def test_goals_that_nobody_meets_are_refused(goals: Sequence[Goal], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        targets_of(goals, 80, 20.0, HUMANML3D)


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        (RootPath([(0, 0)]), "two points"),
        (RootPath([(0, 0), (0, 0)]), "are at one place"),
        (RootPath([(0, 0), (0, 9)], [0, 1]), r"9.0 m/s from 0 to 1 s: people run 8"),
        (RootPath([(0, 0), (0, 40)]), "m/s"),
        (RootPath([(0, 0), (0, 1)], [1, 0]), "starts at 1 s"),
        (RootPath([(0, 0), (0, 1), (0, 2)], [0, 2, 1]), "ascend"),
        (RootPath([(0, 0), (0, 1)], [0, 1, 2]), "3 times for 2"),
        (RootPath([(0, 0), (0, 1)], [0, 9]), "lasts from 0"),
        (RootPath([(0, 0), (0, 1)], [0, 1], 1.0), "either times or a pace"),
        (RootPath([(0, 0), (0, 1)], pace=[1.0, 1.0, 1.0]), "3 paces for 2"),
        (RootPath([(0, 0), (0, 1)], pace=0.0), "above 0"),
    ],
)
def test_paths_that_nobody_walks_are_refused(path: RootPath, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        check_path(path, 80, 20.0)
