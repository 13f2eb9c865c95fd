"""Lines, numbers, tables, units and rates of text files; names of takes; bare arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats import bvh, npz, numbered
from latentmotion.formats.bvh import BvhLayout, continuous_euler, hierarchy_lines, read_hierarchy
from latentmotion.formats.checks import (
    numbers,
    read_lines,
    table,
    whole_rate,
)
from latentmotion.formats.takes import SkeletonTake, motion_of
from latentmotion.kinematics.rotations import matrix_from_axis_angle, matrix_from_euler
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Animation, Skeleton
from latentmotion.motion import Motion
from tests.support.simple_motions import figure


@pytest.mark.parametrize(
    ("content", "lines"),
    [
        (b"a\nb\n", ["a", "b"]),
        (b"a\r\nb\rc", ["a", "b", "c"]),
        (b"\xef\xbb\xbfa\n\n b \n\n", ["a", "", " b"]),
        ("Müller".encode("latin-1"), ["Müller"]),
        ("Müller".encode(), ["Müller"]),
        (b"a\x0cb\nc", ["a\x0cb", "c"]),
    ],
)
def test_lines_of_any_program(tmp_path: Path, content: bytes, lines: list[str]) -> None:
    path = tmp_path / "file.txt"
    path.write_bytes(content)
    assert read_lines(path) == lines


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["1", "2"], r"found 2 numbers, expected 3"),
        (["1", "x", "y"], r"found 'x', expected a finite number"),
        (["1", "nan", "2"], r"found 'nan'"),
        (["1", "2", "1e999"], r"found '1e999'"),
    ],
)
def test_a_line_of_other_numbers_is_named(words: list[str], problem: str) -> None:
    with pytest.raises(FileFormatError, match=rf"^a\.bvh:7: {problem}") as error:
        numbers("a.bvh", 7, words, 3)
    assert (error.value.line, error.value.path) == (7, Path("a.bvh"))


def test_a_table_names_the_line_of_a_mistake() -> None:
    rows = [(2, ["1", "2"]), (4, ["3", "4e1"]), (5, ["5", "6"])]
    assert table("a", rows, 2).tolist() == [[1, 2], [3, 40], [5, 6]]
    assert table("a", [], 2).shape == (0, 2)
    for broken in ("5", "5 6 7", "5 inf"):
        with pytest.raises(FileFormatError, match=r"^a:5: "):
            table("a", [*rows[:2], (5, broken.split()), (6, ["7", "8"])], 2)


@pytest.mark.parametrize(
    ("fps", "whole"),
    [(1 / 0.0083333, 120), (1 / 0.033333, 30), (29.97, 29.97), (119.95, 120), (0.4, 0.4)],
)
def test_rounded_times_are_whole_rates(fps: float, whole: float) -> None:
    assert whole_rate(fps) == pytest.approx(whole)
    assert (whole_rate(fps) == whole) is True


@pytest.mark.parametrize(
    ("name", "count", "names"),
    [
        ("a.bvh", 1, ["a.bvh"]),
        ("a.bvh", 2, ["a-1.bvh", "a-2.bvh"]),
        ("a.b.bvh", 2, ["a.b-1.bvh", "a.b-2.bvh"]),
        ("a.amass.npz", 2, ["a-1.amass.npz", "a-2.amass.npz"]),
        ("a.SMPL.npz", 2, ["a-1.SMPL.npz", "a-2.SMPL.npz"]),
        ("a", 2, ["a-1", "a-2"]),
    ],
)
def test_takes_are_numbered_before_their_ending(name: str, count: int, names: list[str]) -> None:
    assert numbered(Path("folder", name), count) == [Path("folder", each) for each in names]


@pytest.mark.parametrize("skeleton", [HUMANML3D, KIT, BODY], ids=lambda skeleton: skeleton.name)
def test_our_own_skeletons_are_known_by_their_joints(skeleton: Skeleton) -> None:
    rotations = np.tile(np.eye(3), (2, len(skeleton), 1, 1))
    animation = Animation(skeleton, rotations, np.ones((2, 3)), 25.0)
    found = motion_of(SkeletonTake(animation, {"caption": 7, "fps": 1, "seed": 3}))
    assert found.skeleton is skeleton and found.fps == 25
    assert found.caption == "7" and dict(found.metadata) == {"seed": 3}
    np.testing.assert_allclose(found.joints[1], skeleton.rest_joints() + 1, atol=1e-6)


def test_takes_as_bvh_files(tmp_path: Path) -> None:
    motions = [Motion(figure(0.5, turn=turn).astype("f4"), 20.0) for turn in (0.0, 40.0)]
    paths = bvh.write(tmp_path / "out.bvh", motions)
    assert [path.name for path in paths] == ["out-1.bvh", "out-2.bvh"]
    for path, motion in zip(paths, motions, strict=True):
        (back,) = formats.load(path)
        assert back.skeleton is HUMANML3D
        np.testing.assert_allclose(back.joints, motion.joints, atol=2e-3)


def test_several_takes_in_one_array_file(tmp_path: Path) -> None:
    joints = [figure(seconds).astype("f4") for seconds in (0.5, 0.2, 0.3)]
    motions = [
        Motion(j, 10.0 * n, HUMANML3D, f"take {n}", {"n": n}) for n, j in enumerate(joints, 1)
    ]
    npz.write(tmp_path / "a.npz", motions)
    found = npz.read(tmp_path / "a.npz")
    assert [(m.fps, m.caption, dict(m.metadata)) for m in found] == [
        (10.0 * n, f"take {n}", {"n": n}) for n in (1, 2, 3)
    ]
    for one, other in zip(found, joints, strict=True):
        np.testing.assert_array_equal(one.joints, other)
    other = Motion(np.zeros((2, len(KIT), 3), "f4"), 10.0, KIT)
    with pytest.raises(InputError, match="must share a skeleton"):
        npz.write(tmp_path / "b.npz", [motions[0], other])
    assert not (tmp_path / "b.npz").exists()


@pytest.mark.parametrize(("skeleton", "fps"), [(HUMANML3D, 20.0), (KIT, 12.5)])
def test_bare_arrays_have_the_rate_of_their_data_set(tmp_path: Path, skeleton, fps) -> None:
    np.save(tmp_path / "a.npy", np.tile(skeleton.rest_joints(), (4, 1, 1)))
    (found,) = npz.read_joints(tmp_path / "a.npy")
    assert (found.fps, found.skeleton, len(found)) == (fps, skeleton, 4)


@pytest.mark.parametrize("shape", [(4,), (4, 23, 3), (0, 22, 3), (22, 3)])
def test_bare_arrays_of_something_else(tmp_path: Path, shape: tuple[int, ...]) -> None:
    np.save(tmp_path / "a.npy", np.zeros(shape))
    with pytest.raises(FileFormatError, match=r"expected an array \(frames, 22 or 21, 3\)"):
        npz.read_joints(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("name", "message"),
    [("a.bhv", r"mean \.bvh\?"), ("a", r"known are \.npz"), ("a.xyz", r"known are \.npz")],
)
def test_endings_that_cannot_be_written(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        formats.check_ending(tmp_path / name)


def test_a_hierarchy_there_and_back(tmp_path: Path) -> None:
    offsets = np.array([[0, 0, 0], [0.1, 0.2, 0], [0, -0.5, 0.25], [-0.1, 0.2, 0.0]])
    skeleton = Skeleton("s", ("hips", "a", "a_end", "b"), (-1, 0, 1, 0), offsets, end_sites=(2,))
    lines = ["HIERARCHY", *hierarchy_lines(skeleton, {0, 3}, BvhLayout()), "MOTION"]
    nodes, start = read_hierarchy(tmp_path, lines)
    assert start == len(lines)
    joints = [node for node in nodes if not node.is_end]
    assert [node.name for node in joints] == ["hips", "a", "b"]
    assert [len(node.channels) for node in joints] == [6, 3, 6]
    assert {node.order for node in joints} == {"ZXY"}
    np.testing.assert_allclose([node.offset for node in joints], 100 * offsets[[0, 1, 3]])
    assert [node.parent for node in joints[1:]] == [0, 0]


@pytest.mark.parametrize("order", ["ZXY", "XYZ", "YZX"])
def test_angles_follow_a_spin_over_many_turns(order: str) -> None:
    """One axis turns four times; the angle about it rises to 8 π and the others stay."""
    axis = "XYZ".index(order[0])
    vectors = np.zeros((90, 1, 3))
    vectors[:, 0, axis] = np.linspace(0, 8 * np.pi, 90)
    rotations = matrix_from_axis_angle(vectors)
    angles = continuous_euler(rotations, order)
    np.testing.assert_allclose(angles[:, 0, 0], vectors[:, 0, axis], atol=1e-9)
    np.testing.assert_allclose(angles[:, 0, 1:], 0, atol=1e-9)
    np.testing.assert_allclose(matrix_from_euler(angles, order), rotations, atol=1e-9)
