"""BVH: poses worked out by hand, bvhio as a foreign reader, damage of every kind, a CMU trial."""

from __future__ import annotations

import tarfile
import warnings
from itertools import permutations

import numpy as np
import pytest

from latentmotion.errors import FileFormatError, InputError, ReadingWarning
from latentmotion.formats.bvh import read_bvh, write_bvh
from latentmotion.kinematics.rotations import matrix_from_euler
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton

# An arm of 20 cm, on a shoulder 10 cm to the left of the hips.
ARM = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Upper Arm
  {
    OFFSET 10 0 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 20 0 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0083333
0 90 0 0 0 0 0 0 0
1 2 3 90 0 0 90 0 0
"""


def put(tmp_path, content, name="some.bvh"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def random_animation(frames=40, skeleton=HUMANML3D, translations=None, seed=0):
    """Smooth, with turns of more than half a circle and no regard for gimbal lock."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(scale=0.3, size=(frames, len(skeleton), 3))
    rotations = matrix_from_euler(np.cumsum(steps, axis=0), "XYZ")
    rotations[:, list(skeleton.end_sites)] = np.eye(3)
    root = np.cumsum(rng.normal(scale=0.02, size=(frames, 3)), axis=0)
    return Animation(skeleton, rotations, root, 20.0, translations)


def test_positions_worked_out_by_hand(tmp_path):
    animation = read_bvh(put(tmp_path, ARM))
    assert animation.skeleton.names == ("Hips", "Upper Arm", "Upper Arm_end")
    assert animation.skeleton.parents == (-1, 0, 1)
    assert animation.skeleton.end_sites == (2,)
    assert animation.fps == 120.0
    assert animation.translations is None
    rest = [[0, 0.9, 0], [0.1, 0.9, 0], [0.3, 0.9, 0]]
    # The hips roll the arm up; then the arm swings forward about its own y: x goes to -z.
    turned = [[0.01, 0.02, 0.03], [0.01, 0.12, 0.03], [0.01, 0.12, -0.17]]
    np.testing.assert_allclose(animation.joints(), [rest, turned], atol=1e-12)


@pytest.mark.parametrize("order", ["".join(o) for n in (1, 2, 3) for o in permutations("XYZ", n)])
def test_any_rotation_order(tmp_path, order):
    channels = f"{len(order)} " + " ".join(f"{axis}rotation" for axis in order)
    angles = np.array([30.0, -50.0, 70.0])[: len(order)]
    text = ARM.replace("3 Yrotation Zrotation Xrotation", channels)
    head = text.split("Frames")[0]
    row = " ".join(map(str, [0, 0, 0, 0, 0, 0, *angles]))
    path = put(tmp_path, f"{head}Frames: 1\nFrame Time: 0.05\n{row}\n")
    expected = np.eye(3)
    for axis, angle in zip(order, angles, strict=True):
        expected = expected @ matrix_from_euler(np.deg2rad([angle]), axis)
    np.testing.assert_allclose(read_bvh(path).rotations[0, 1], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("unit", "meters"), [("meters", 10), ("cmu", 10 * 0.0254 / 0.45), ("inches", 0.254), (2.0, 20)]
)
def test_units(tmp_path, unit, meters):
    animation = read_bvh(put(tmp_path, ARM), unit=unit)
    assert animation.skeleton.offsets[1, 0] == pytest.approx(meters)
    assert animation.root_positions[0, 1] == pytest.approx(9 * meters)


@pytest.mark.parametrize("unit", ["furlongs", 0, -1.0, float("nan"), "0", "-0.01"])
def test_unknown_unit(tmp_path, unit):
    with pytest.raises(InputError, match="meters"):
        read_bvh(put(tmp_path, ARM), unit=unit)


def test_joints_that_move(tmp_path):
    text = ARM.replace("3 Yrotation Zrotation", "4 Yposition Yrotation Zrotation")
    text = text.replace("0 0 0 0 0 0 0\n", "0 0 0 0 5 0 0 0\n").replace("90 0 0\n", "5 0 0 0\n")
    animation = read_bvh(put(tmp_path, text))
    assert animation.translations is not None
    # The channel replaces y only; x keeps its offset.
    np.testing.assert_allclose(animation.translations[0, 1], [0.1, 0.05, 0])
    np.testing.assert_allclose(animation.joints()[0, 1], [0.1, 0.95, 0])


def test_root_without_positions_stays_at_its_offset(tmp_path):
    text = ARM.replace("6 Xposition Yposition Zposition", "3").replace(
        "OFFSET 0 0 0", "OFFSET 0 7 0"
    )
    text = text.replace("0 90 0 0 0 0 0", "0 0 0 0").replace("1 2 3 90", "90")
    animation = read_bvh(put(tmp_path, text))
    np.testing.assert_allclose(animation.root_positions, [[0, 0.07, 0]] * 2)
    np.testing.assert_allclose(animation.skeleton.offsets[0], 0)


def test_layouts_found_in_the_wild(tmp_path):
    """Windows line ends, a byte order mark, tabs, one line for several statements, lower case."""
    expected = read_bvh(put(tmp_path, ARM)).joints()
    wild = ARM.replace("\n  {\n", " {").replace("\n    CHANNELS", " channels")
    wild = wild.replace("Frame Time: ", "Frame Time:\t").replace("rotation", "ROTATION")
    wild = "\ufeff" + wild.replace("\n", "\r\n") + "\r\n\r\n"
    np.testing.assert_allclose(read_bvh(put(tmp_path, wild, "wild.bvh")).joints(), expected)


def test_end_sites_with_the_same_parent_have_names_of_their_own(tmp_path):
    end = "    End Site\n    {\n      OFFSET 20 0 0\n    }\n"
    animation = read_bvh(put(tmp_path, ARM.replace(end, 2 * end)))
    assert animation.skeleton.names[2:] == ("Upper Arm_end", "Upper Arm_end_2")


DAMAGE = {
    "empty": ("", None, "empty"),
    "binary": (b"\x00\x01\x02HIERARCHY", None, "binary"),
    "something else": ("hello\n", 1, "HIERARCHY"),
    "truncated in the hierarchy": (ARM[: ARM.index("End Site")], 9, "truncated"),
    "truncated before motion": (ARM[: ARM.index("MOTION")], 15, "truncated"),
    "truncated after motion": (ARM[: ARM.index("Frames")], 16, "truncated"),
    "frames missing": (ARM.replace("Frames: 2", "Frames: 4"), 20, "found 2 frames, expected 4"),
    "frames too many": (ARM + 2 * "1 2 3 90 0 0 90 0 0\n", 22, "found 4 frames, expected 2"),
    "a frame cut short": (ARM[:-7], 20, "found 6 numbers, expected 9"),
    "too many channels": (ARM.replace("1 2 3", "1 2 3 4"), 20, "found 10 numbers, expected 9"),
    "not a number": (ARM.replace("1 2 3", "1 2 x"), 20, "'x'"),
    "nan": (ARM.replace("1 2 3", "1 nan 3"), 20, "'nan'"),
    "infinity": (ARM.replace("1 2 3", "1 1e999 3"), 20, "'1e999'"),
    "nan in an offset": (ARM.replace("OFFSET 10", "OFFSET nan"), 8, "'nan'"),
    "short offset": (ARM.replace("OFFSET 10", "OFFSET"), 8, "found 2 numbers, expected 3"),
    "no offset": (ARM.replace("    OFFSET 10 0 0\n", ""), 13, "Upper Arm has no 'OFFSET'"),
    "wrong channel count": (ARM.replace("CHANNELS 3", "CHANNELS 4"), 9, "says 4, but 3"),
    "unknown channel": (ARM.replace("Yrotation Z", "Wrotation Z"), 9, "Wrotation"),
    "brace missing": (ARM.replace("  }\n}\n", "}\n", 1), 15, "before the last '}'"),
    "brace too many": (ARM.replace("MOTION", "}\nMOTION"), 16, "outside the braces"),
    "joint without a block": (ARM.replace("  {\n    OFFSET 10", "    OFFSET 10"), 7, "place"),
    "two roots": (ARM.replace("JOINT", "ROOT"), 6, "second 'ROOT'"),
    "unknown keyword": (ARM.replace("JOINT", "JOINED"), 6, "JOINED"),
    "no frames": (ARM.replace("Frames: 2", "Frames: 0"), 17, "Frames"),
    "no frame time": (ARM.replace("Frame Time: 0.0083333\n", ""), 18, "Frame Time"),
    "frame time of zero": (ARM.replace("0.0083333", "0"), 18, "frame time"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named_with_file_and_line(tmp_path, damage):
    content, line, message = DAMAGE[damage]
    path = put(tmp_path, content)
    with pytest.raises(FileFormatError, match=message) as error:
        read_bvh(path)
    assert error.value.path == path
    assert error.value.line == line
    assert str(error.value).startswith(f"{path}:" if line is None else f"{path}:{line}:")


@pytest.mark.parametrize("stated", [1, 3])
def test_frames_that_are_one_more_or_less_than_stated_are_all_read(tmp_path, stated):
    path = put(tmp_path, ARM.replace("Frames: 2", f"Frames: {stated}"))
    with pytest.warns(ReadingWarning, match=f"found 2 frames, of which 'Frames:' says {stated}"):
        assert len(read_bvh(path)) == 2


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileFormatError, match="No such file"):
        read_bvh(tmp_path / "none.bvh")
    with pytest.raises(InputError, match="folder"):
        write_bvh(tmp_path / "none" / "out.bvh", random_animation(2))


@pytest.mark.parametrize("frames", [1, 2, 40])
def test_written_files_read_back_equal(tmp_path, frames):
    animation = random_animation(frames)
    write_bvh(tmp_path / "out.bvh", animation)
    back = read_bvh(tmp_path / "out.bvh")
    places = [back.skeleton.names.index(name) for name in HUMANML3D.names]
    assert back.fps == animation.fps
    np.testing.assert_allclose(back.joints()[:, places], animation.joints(), atol=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == ["out.bvh"]


def test_joints_that_move_and_end_sites_read_back_equal(tmp_path):
    offsets = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [0, 0.2, 0]])
    skeleton = Skeleton("arm", ("a", "b", "c", "d"), (-1, 0, 1, 0), offsets, end_sites=(2, 3))
    moved = np.tile(offsets, (30, 1, 1))
    moved[:, 1] += np.random.default_rng(1).normal(scale=0.1, size=(30, 3))
    animation = random_animation(30, skeleton, moved)
    write_bvh(tmp_path / "out.bvh", animation)
    back = read_bvh(tmp_path / "out.bvh")
    assert back.skeleton.names == ("a", "b", "b_end", "a_end")
    assert back.skeleton.end_sites == skeleton.end_sites
    np.testing.assert_allclose(back.joints(), animation.joints(), atol=1e-6)


def test_written_angles_never_jump(tmp_path):
    """A knee that somersaults through the singularity and turns three times about its z."""
    time = np.linspace(0, 1, 400)
    angles = np.stack([6 * np.pi * time, 7 * time, np.sin(5 * time)], axis=-1)
    rotations = np.tile(np.eye(3), (400, 22, 1, 1))
    rotations[:, 5] = matrix_from_euler(angles, "ZXY")
    write_bvh(tmp_path / "out.bvh", Animation(HUMANML3D, rotations, np.zeros((400, 3)), 120.0))
    lines = (tmp_path / "out.bvh").read_text().split("Frame Time")[1].splitlines()[1:]
    rows = np.array([line.split() for line in lines], dtype=float)
    written = rows[:, np.ptp(rows, axis=0) > 0]
    np.testing.assert_allclose(
        np.diff(np.deg2rad(written), axis=0), np.diff(angles, axis=0), atol=1e-6
    )


def test_a_foreign_reader_sees_the_same_positions(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bvhio = pytest.importorskip("bvhio")
    animation = random_animation(5)
    write_bvh(tmp_path / "out.bvh", animation)
    root = bvhio.readAsHierarchy(str(tmp_path / "out.bvh"))
    joints = animation.joints()
    for frame in range(5):
        root.loadPose(frame)
        seen = {joint.Name: joint.PositionWorld for joint, _, _ in root.layout()}
        places = np.array([list(seen[name]) for name in HUMANML3D.names]) / 100
        np.testing.assert_allclose(places, joints[frame], atol=1e-5)


def test_a_real_trial(shared, tmp_path):
    with tarfile.open(shared / "data" / "cmu_bvh.tar.xz", "r|xz") as tar:
        member = next(m for m in tar if m.name.endswith(".bvh"))
        content = tar.extractfile(member).read()
    animation = read_bvh(put(tmp_path, content))
    joints = animation.joints()
    names = animation.skeleton.names
    assert animation.fps == 120
    assert "lFoot_end" in names
    # The first frame is a T-pose, facing +z with the left hand at +x, some 1.7 m tall.
    left = joints[0, names.index("lHand")] - joints[0, names.index("rHand")]
    assert left[0] > 1.0
    ahead = joints[0, names.index("lFoot_end")] - joints[0, names.index("lFoot")]
    assert ahead[2] > 0.1
    assert 1.3 < np.ptp(joints[0, :, 1]) < 1.8
    write_bvh(tmp_path / "again.bvh", animation)
    again = read_bvh(tmp_path / "again.bvh")
    assert again.skeleton.names == names
    np.testing.assert_allclose(again.joints(), joints, atol=1e-6)
