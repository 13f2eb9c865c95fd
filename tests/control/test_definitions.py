"""Control by its definitions: seams, gaps of an edit, distances, curves, least squares."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.control.edit import TOKENS, Gap, gap_between, in_between
from latentmotion.control.exact import inertialized
from latentmotion.control.goals import (
    FASTEST,
    Goal,
    Heading,
    Pose,
    Reach,
    RootPath,
    TargetResidual,
    check_path,
    check_targets,
    frame_at,
    targets_of,
)
from latentmotion.control.path import Curve, bent, straight_points, straightened
from latentmotion.control.reach import lbfgs
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D, KIT, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn
from tests.support.walker import walker

FPS = 20.0


@pytest.fixture(scope="module")
def joints() -> np.ndarray:
    return walker(60).joints()


def bones(joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(joints[:, 1:] - joints[:, list(HUMANML3D.parents[1:])], axis=-1)


# Seams


def straight(frames: int, start: float, speed: float) -> np.ndarray:
    """A rigid body whose root goes along x at a constant speed, meters a frame."""
    body = HUMANML3D.rest_joints()[None].repeat(frames, axis=0)
    body[..., 0] += (start + speed * np.arange(frames))[:, None]
    return body


def test_a_piece_that_goes_on_as_before_is_not_changed() -> None:
    whole = straight(40, 0.0, 0.05)
    piece = inertialized(whole[10:30], whole[:10], whole[30:], HUMANML3D, 8)
    np.testing.assert_allclose(piece, whole[10:30], atol=1e-9)


@pytest.mark.parametrize("offset", [0.0, 0.4, -1.0])
@pytest.mark.parametrize("speed", [0.0, 0.03])
def test_position_and_velocity_go_on_over_a_seam(offset: float, speed: float) -> None:
    before, blend = straight(10, 0.0, 0.05), 20
    piece = inertialized(straight(30, offset, speed), before, before[:0], HUMANML3D, blend)
    root = np.concatenate([before[-2:, 0, 0], piece[:, 0, 0]])
    # An offset of 1 whose first and second derivative are zero leaves by at most 10 u³.
    reach = 10 * (2 / (blend + 1)) ** 3 * (abs(offset) + 1)
    assert abs(root[2] - (root[1] + 0.05)) < reach
    assert abs((root[3] - root[2]) - 0.05) < 2 * reach
    np.testing.assert_allclose(
        piece[blend:], straight(30, offset, speed)[blend:], atol=1e-9
    )  # decayed


def test_without_neighbors_in_time_only_the_offset_decays() -> None:
    piece = inertialized(
        straight(20, 1.0, 0.0), straight(1, 0.0, 0.0), straight(0, 0.0, 0.0), HUMANML3D, 9
    )
    u = np.clip(np.arange(1, 21) / 10, 0, 1)
    left = 1 - (10 * u**3 - 15 * u**4 + 6 * u**5)
    np.testing.assert_allclose(piece[:, 0, 0], 1 - left, atol=1e-9)


def test_bones_change_their_lengths_evenly_from_seam_to_seam(joints: np.ndarray) -> None:
    tall = 1.1 * joints
    piece = inertialized(joints[10:29], joints[:10], tall[29:], HUMANML3D, 6)
    share = np.linspace(0, 1, 21)[1:-1, None]
    expected = (1 - share) * bones(joints)[9] + share * bones(tall)[29]
    np.testing.assert_allclose(bones(piece), expected, rtol=1e-9)


def test_seams_do_not_depend_on_where_the_motion_is_nor_on_the_way_of_time(
    joints: np.ndarray,
) -> None:
    parts = joints[30:50] + 0.1, joints[:30], joints[50:]
    piece = inertialized(*parts, HUMANML3D, 8)
    angle, shift = np.array(0.7), np.array([3.0, 0.0, -2.0])
    moved = [turn(part, angle) + shift for part in parts]
    found = inertialized(*moved, HUMANML3D, 8)
    np.testing.assert_allclose(found, turn(piece, angle) + shift, atol=1e-9)
    back = inertialized(parts[0][::-1], parts[2][::-1], parts[1][::-1], HUMANML3D, 4)[::-1]
    forth = inertialized(*parts, HUMANML3D, 4)
    np.testing.assert_allclose(back, forth, atol=1e-6)  # four frames do not meet in the middle


# Gaps


@pytest.mark.parametrize("start", [0, 1, 2, 3, 4, 7, 20, 33, 60])
@pytest.mark.parametrize("length", [1, 3, 4, 10, 17])
def test_tokens_of_a_window_are_whole_and_inside(start: int, length: int) -> None:
    total = 80
    gap = Gap(start, start + length, total)
    first, last = gap.window
    assert 0 <= first <= gap.start and gap.end <= last <= total
    assert gap.before <= TOKENS and gap.after <= TOKENS
    if gap.before:
        assert gap.start - first == 4 * gap.before
    if gap.after:
        assert last - gap.resumes == 4 * gap.after
        assert (gap.resumes - gap.start) % 4 == 0 and 0 <= gap.resumes - gap.end < 4


def test_times_become_the_frames_between_them(joints: np.ndarray) -> None:
    motion = Motion(joints.astype("f4"))
    assert gap_between(motion, (1.0, 2.0)) == Gap(20, 40, 60)
    assert gap_between(motion, (0.0, 0.5)) == Gap(0, 10, 60)
    assert gap_between(motion, (2.0, 3.0)) == Gap(40, 60, 60)


@pytest.mark.parametrize(
    ("between", "reason"),
    [
        ((2.0, 1.0), "between 2 and 1 s: expected two ascending times from 0 to 3 s"),
        ((-0.1, 1.0), "between -0.1 and 1 s"),
        ((1.0, 3.2), "3.2 s: expected"),
        ((float("nan"), 1.0), "between nan"),
        ((1.001, 1.002), "there is no frame"),
        ((0.0, 3.0), "nothing of the motion would be left"),
    ],
)
def test_times_that_hold_no_gap_are_named(
    joints: np.ndarray, between: tuple[float, float], reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        gap_between(Motion(joints.astype("f4")), between)


def test_motions_with_room_between_them_keep_their_frames(joints: np.ndarray) -> None:
    start, end = Motion(joints[:20].astype("f4")), Motion(joints[40:].astype("f4"))
    together, gap = in_between(start, end, 1.0)
    assert gap == Gap(20, 40, 60)
    assert (together[:20] == start.joints).all() and (together[40:] == end.joints).all()
    assert not together[20:40].any()
    with pytest.raises(InputError, match=r"0.05 seconds between: expected 0.1 or more"):
        in_between(start, end, 0.05)
    with pytest.raises(InputError, match="inf seconds"):
        in_between(start, end, float("inf"))
    with pytest.raises(InputError, match=r"start has 20 frames per second .* end 10 of"):
        in_between(start, Motion(end.joints, fps=10.0), 1.0)


# Goals


@pytest.mark.parametrize(
    ("at", "frame"), [(0.0, 0), (0.024, 0), (0.026, 1), (2.95, 59), (3.0, 59), (-0.02, 0)]
)
def test_a_time_is_its_nearest_frame(at: float, frame: int) -> None:
    assert frame_at(at, 60, FPS) == frame


@pytest.mark.parametrize("at", [-0.03, 3.01, float("nan"), float("inf")])
def test_a_time_beyond_the_motion_is_told_its_length(at: float) -> None:
    with pytest.raises(InputError, match=r"the motion lasts from 0 to 2.95 s"):
        frame_at(at, 60, FPS)


def test_a_motions_own_places_leave_no_residual(joints: np.ndarray) -> None:
    goals: list[Goal] = [Pose(1.0, Motion(joints), 20)]
    facing = float(np.degrees(heading(joints[30], HUMANML3D)))
    targets = targets_of([*goals, Heading(1.5, facing)], 60, FPS, HUMANML3D, None)
    residual = TargetResidual(targets, HUMANML3D)(joints)
    assert residual.shape == (3 * 22 + 1,)
    np.testing.assert_allclose(residual, 0, atol=1e-6)
    shifted = TargetResidual(targets, HUMANML3D)(joints - (0, 0, 0.25))
    np.testing.assert_allclose(shifted[:-1].reshape(22, 3), [[0, 0, 0.25]] * 22, atol=1e-6)
    assert abs(shifted[-1]) < 1e-6


@pytest.mark.parametrize("degrees", [10.0, 190.0, 350.0, -170.0, 730.0])
def test_the_shorter_way_round_is_missing(joints: np.ndarray, degrees: float) -> None:
    still = turn(joints[:1], -heading(joints[:1], HUMANML3D)[:, None]).repeat(60, axis=0)
    targets = targets_of([Heading(1.0, degrees)], 60, FPS, HUMANML3D)
    (found,) = TargetResidual(targets, HUMANML3D)(still)
    shorter = (degrees + 180) % 360 - 180
    assert found == pytest.approx(0.3 * np.radians(shorter), abs=1e-6)


def test_free_coordinates_ask_for_nothing(joints: np.ndarray) -> None:
    targets = targets_of([Reach("left_wrist", 1.0, (None, 1.0, None))], 60, FPS, HUMANML3D)
    residual = TargetResidual(targets, HUMANML3D)
    wrist = HUMANML3D.names.index("left_wrist")
    np.testing.assert_allclose(residual(joints), [1.0 - joints[20, wrist, 1]])
    (gradient,) = residual.gradient(joints)
    assert gradient[20, wrist].tolist() == [0, 1, 0] and np.abs(gradient).sum() == 1


def test_a_runner_reaches_as_far_as_a_runner_can() -> None:
    def ask(far: float) -> None:
        check_targets(targets_of([Reach("pelvis", 1.0, (0, None, far))], 60, FPS, HUMANML3D, None),
                      FPS, HUMANML3D)  # fmt: skip

    ask(FASTEST + 0.09)
    with pytest.raises(InputError, match=r"pelvis at 1 s is 8.1 m from the start.*reaches 8.1 m"):
        ask(FASTEST + 0.11)


def test_a_pose_of_another_body_gives_the_joints_that_both_have() -> None:
    pose = Motion(KIT.rest_joints()[None].astype("f4"), skeleton=KIT)
    shared = [name for name in HUMANML3D.names if name in KIT.names]
    assert [reach.joint for reach in Pose(0.0, pose).reaches(HUMANML3D)] == shared
    with pytest.raises(InputError, match="frame 1 of a pose: its motion has 1"):
        Pose(0.0, pose, 1).reaches(HUMANML3D)
    worm = Skeleton("worm", ("head", "tail"), (-1, 0), np.array([[0, 0, 0], [0, 0, -1.0]]))
    with pytest.raises(InputError, match="'worm' shares 1 joints with 'humanml3d'"):
        Pose(0.0, Motion(np.zeros((1, 2, 3)), skeleton=worm)).reaches(HUMANML3D)


def test_the_speed_of_a_path_is_that_of_its_fastest_part() -> None:
    points, fast = [(0, 0), (0, 1), (0, 9.1)], FASTEST + 0.1
    check_path(RootPath(points, [0, 1, 2.1]), 60, FPS)
    with pytest.raises(InputError, match=rf"{fast:.1f} m/s from 1 to 2 s: people run 8 m/s"):
        check_path(RootPath(points, [0, 1, 2]), 60, FPS)
    with pytest.raises(InputError, match="points 1 and 2 of the path are at one place"):
        check_path(RootPath([(0, 0), (0, 0)]), 60, FPS)


# Curves


@pytest.fixture(scope="module")
def curve() -> Curve:
    return Curve.through(RootPath([(0, 0), (0.2, 1), (1, 2), (2.5, 2.2)], [0, 0.7, 1.5, 2.5]))


def test_a_curve_passes_its_points_at_its_marks(curve: Curve) -> None:
    found = curve.place(curve.marks, np.zeros(4))
    np.testing.assert_allclose(found, [(0, 0), (0.2, 1), (1, 2), (2.5, 2.2)], atol=2e-3)
    assert curve.marks[0] == 0 and curve.marks[-1] == pytest.approx(curve.length)
    polygon = np.linalg.norm(np.diff([(0, 0), (0.2, 1), (1, 2), (2.5, 2.2)], axis=0), axis=1).sum()
    assert polygon < curve.length < 1.1 * polygon


def test_a_straight_path_is_the_line_itself() -> None:
    line = Curve.through(RootPath([(0, 0), (0, 1), (0, 3)]))
    along, aside = np.array([-1.0, 0.5, 2.0, 5.0]), np.array([0.0, 0.3, -0.2, 1.0])
    np.testing.assert_allclose(
        line.place(along, aside), np.stack([aside, along], axis=1), atol=1e-9
    )
    np.testing.assert_allclose(line.direction(along), 0, atol=1e-12)
    assert line.length == pytest.approx(3)


def test_a_motion_bent_onto_a_straight_line_is_itself(joints: np.ndarray) -> None:
    still = np.repeat(joints[:1], 30, axis=0)
    still = turn(still, -heading(still, HUMANML3D)[:, None])
    still[..., ::2] -= still[:1, :1, ::2]
    still[..., 2] += np.linspace(0, 2, 30)[:, None]
    line = Curve.through(RootPath([(0, 0), (0, 2)]))
    np.testing.assert_allclose(bent(still, line, FPS, HUMANML3D), still, atol=1e-5)


def test_points_of_the_world_come_back_from_the_straight_line(curve: Curve) -> None:
    for along, aside in ((0.4, 0.0), (1.7, 0.05), (2.9, -0.1)):
        x, z = curve.place(np.array(along), np.array(aside))
        found = straightened((x, 0.9, z), (aside, along), along, curve)
        np.testing.assert_allclose(found, (aside, 0.9, along), atol=1e-9)


def test_times_of_a_path_are_its_own_or_the_whole_motion(curve: Curve) -> None:
    times, marks = straight_points(RootPath([(0, 0)], [0, 0.7, 1.5, 2.5]), curve, 60, FPS)
    assert times.tolist() == [0, 0.7, 1.5, 2.5] and (marks == curve.marks).all()
    times, marks = straight_points(RootPath([(0, 0)]), curve, 60, FPS)
    assert times.tolist() == [0, 59 / FPS] and marks.tolist() == [0, curve.length]


# Least squares


@pytest.mark.parametrize("count", [1, 2, 7])
def test_a_quadratic_has_its_minimum_where_the_equations_say(count: int) -> None:
    generator = np.random.default_rng(count)
    factor = generator.normal(size=(count + 3, count))
    goal = generator.normal(size=count + 3)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        gap = factor @ x - goal
        return 0.5 * float(gap @ gap) + 0.01, factor.T @ gap

    found = lbfgs(loss, np.zeros(count), 100)
    best = np.linalg.lstsq(factor, goal, rcond=None)[0]
    assert loss(found)[0] < loss(best)[0] * (1 + 1e-4)


def test_no_step_makes_it_worse_and_a_minimum_stays() -> None:
    values: list[float] = []

    def valley(x: np.ndarray) -> tuple[float, np.ndarray]:
        a, b = 1 - x[0], x[1] - x[0] ** 2
        return float(a * a + 100 * b * b), np.array([-2 * a - 400 * x[0] * b, 200 * b])

    for iterations in (0, 5, 10, 20, 40, 80):
        values.append(valley(lbfgs(valley, np.array([-1.2, 1.0]), iterations))[0])
    assert (np.diff(values) <= 0).all() and values[-1] < 1e-3 * values[0]
    np.testing.assert_allclose(lbfgs(valley, np.ones(2), 20), 1, atol=1e-9)
