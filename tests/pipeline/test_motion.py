"""Motion and the choice of a format by the ending; .npz, .npy and .bvh there and back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.errors import FileFormatError, InputError
from latentmotion.kinematics.skeleton import HUMANML3D, KIT
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading
from tests.support.walker import walker


@pytest.fixture(scope="module")
def motion() -> Motion:
    person = walker(30)
    return Motion(person.joints().astype("f4"), caption="jemand läuft", metadata={"seed": 7})


def test_length(motion: Motion):
    assert len(motion) == 30
    assert motion.seconds == 1.5


@pytest.mark.parametrize(
    ("joints", "says"),
    [
        (np.zeros((0, 22, 3), "f4"), "frames ≥ 1"),
        (np.zeros((5, 21, 3), "f4"), "22, 3"),
        (np.full((5, 22, 3), np.nan, "f4"), "5 of 5 frames hold NaN"),
    ],
)
def test_bad_joints_are_refused(joints: np.ndarray, says: str):
    with pytest.raises(InputError, match=says):
        Motion(joints)


def test_bad_frame_rate_is_refused():
    with pytest.raises(InputError, match="fps"):
        Motion(np.zeros((5, 22, 3), "f4"), fps=0.0)


def test_npz_keeps_everything(motion: Motion, tmp_path: Path):
    assert motion.save(tmp_path / "a.npz") == [tmp_path / "a.npz"]
    read = Motion.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(read.joints, motion.joints)
    assert (read.caption, read.fps, read.metadata) == ("jemand läuft", 20.0, {"seed": 7})
    assert read.skeleton is HUMANML3D


def test_npz_holds_several_takes_and_no_pickle(motion: Motion, tmp_path: Path):
    short = Motion(motion.joints[:9], fps=30.0)
    formats.save(tmp_path / "a.npz", [motion, short])
    read = formats.load(tmp_path / "a.npz")
    assert [len(take) for take in read] == [30, 9]
    assert [take.fps for take in read] == [20.0, 30.0]
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


def test_npz_of_another_skeleton(tmp_path: Path):
    kit = Motion(np.tile(KIT.rest_joints(), (4, 1, 1)).astype("f4"), fps=12.5, skeleton=KIT)
    kit.save(tmp_path / "kit.npz")
    assert Motion.load(tmp_path / "kit.npz").skeleton is KIT


def test_bare_joints(motion: Motion, tmp_path: Path):
    np.save(tmp_path / "joints.npy", motion.joints)
    np.testing.assert_array_equal(Motion.load(tmp_path / "joints.npy").joints, motion.joints)


def test_bvh_there_and_back(motion: Motion, tmp_path: Path):
    written = formats.save(tmp_path / "a.bvh", [motion, motion])
    assert written == [tmp_path / "a-1.bvh", tmp_path / "a-2.bvh"]
    read = Motion.load(written[1])
    assert read.fps == pytest.approx(20.0, abs=0.01)
    np.testing.assert_allclose(read.joints, motion.joints, atol=0.001)


@pytest.mark.parametrize(
    ("name", "says"),
    [("a.bhv", r"\.bvh"), ("a", "no ending"), ("a.max", "known are"), ("a.npy", "npz")],
)
def test_unknown_endings_name_the_known(motion: Motion, tmp_path: Path, name: str, says: str):
    with pytest.raises(InputError, match=says):
        motion.save(tmp_path / name)
    with pytest.raises(InputError, match=says):
        formats.check_ending(name)
    assert not list(tmp_path.iterdir())


def test_nothing_to_write(tmp_path: Path):
    with pytest.raises(InputError, match="no motion"):
        formats.save(tmp_path / "a.npz", [])


def test_folders_that_cannot_be_written(motion: Motion, tmp_path: Path):
    with pytest.raises(InputError, match="does not exist"):
        motion.save(tmp_path / "none" / "a.npz")
    (tmp_path / "a.npz").mkdir()
    with pytest.raises(InputError, match="folder"):
        motion.save(tmp_path / "a.npz")


def test_damaged_files_are_named(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.npz")
    whole = (tmp_path / "a.npz").read_bytes()
    for content in (b"", b"not a zip", whole[: len(whole) // 2]):
        (tmp_path / "b.npz").write_bytes(content)
        with pytest.raises(FileFormatError, match=r"b\.npz"):
            Motion.load(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", other=np.zeros(3))
    with pytest.raises(FileFormatError, match=r"not a motion file.* lacks 'names'; .*\.npy"):
        Motion.load(tmp_path / "c.npz")
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, motion.joints)
    with pytest.raises(FileFormatError, match=r"no \.npz at all"):
        Motion.load(tmp_path / "array.npz")
    np.save(tmp_path / "d.npy", np.zeros((4, 5)))
    with pytest.raises(FileFormatError, match="22 or 21"):
        Motion.load(tmp_path / "d.npy")
    with pytest.raises(InputError, match="no file"):
        Motion.load(tmp_path / "e.npz")


def test_shows_itself_in_a_notebook(motion: Motion, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("latentmotion.formats.notebook._is_shown", False)
    first, second = (motion._repr_mimebundle_() for _ in range(2))
    assert first["image/png"] in second["text/html"] and "jemand läuft" in second["text/html"]
    assert len(second["text/html"]) < 150_000 < len(first["text/html"]) < 500_000
    assert "</script>" not in first["text/html"].removesuffix("</script>")


def test_motions_are_shown_in_a_line() -> None:
    motion = Motion(walker(30).joints(), caption="a person walks")
    assert repr(motion) == (
        "Motion('a person walks', 1.50 s, 30 frames at 20 per second, humanml3d)"
    )


def test_cuts_are_the_frames_between_two_times() -> None:
    motion = Motion(walker(30).joints(), caption="a person walks")
    part = motion.cut(0.5, 1.0)
    assert np.array_equal(part.joints, motion.joints[10:20]) and part.caption == motion.caption
    assert len(motion.cut(1.0)) == 10 and len(motion.cut(end=1.0)) == 20
    for times in [(1.0, 0.5), (0.0, 2.0), (-0.1, 1.0), (0.5, 0.5)]:
        with pytest.raises(InputError, match=r"expected times in order, from 0 to 1\.5 s"):
            motion.cut(*times)


def test_what_is_joined_goes_on_where_and_as_the_first_ends() -> None:
    motion = Motion(walker(30).joints(), caption="a person walks")
    turned = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    other = Motion(motion.joints @ turned + [3, 0, 5], caption="a person walks on")
    joined = motion.joined(other)
    assert len(joined) == 60 and joined.caption == "a person walks, then a person walks on"
    assert np.array_equal(joined.joints[:30], motion.joints)
    pelvis = joined.joints[:, 0, [0, 2]]
    assert np.allclose(pelvis[30], pelvis[29], atol=1e-5)
    skeleton = motion.skeleton
    angles = heading(joined.joints[[29, 30]].astype(float), skeleton)
    assert np.isclose(*angles, atol=1e-3)
    lengths = [
        np.linalg.norm(j[:, 1] - j[:, 2], axis=-1) for j in (other.joints, joined.joints[30:])
    ]
    assert np.allclose(*lengths, atol=1e-5)
    with pytest.raises(InputError, match="call resampled first"):
        motion.joined(motion.resampled(30))


def test_marks_of_a_motion_are_not_those_of_its_parts() -> None:
    about = {"seed": 3, "goals": [{}], "spans": [{}], "foot_sliding": 0.1}
    motion = Motion(walker(30).joints(), metadata=about)
    for edited in (motion.cut(0.5), motion.joined(motion), motion.mirrored()):
        assert edited.metadata == {"seed": 3}


def test_twice_as_fast_is_half_as_long(motion: Motion) -> None:
    fast = motion.at_speed(2)
    assert len(fast) == 15 and fast.fps == motion.fps and fast.caption == motion.caption
    np.testing.assert_allclose(fast.joints, motion.joints[::2], atol=1e-3)
    np.testing.assert_allclose(fast.at_speed(0.5).joints[::2], fast.joints, atol=1e-3)
    for speed in (0, -1, 11, float("nan")):
        with pytest.raises(InputError, match=r"expected 0\.1 to 10 times"):
            motion.at_speed(speed)


def test_contacts_of_feet_are_events(tmp_path: Path) -> None:
    joints = np.repeat(walker(1).joints(), 40, axis=0)
    left = [HUMANML3D.names.index(name) for name in ("left_ankle", "left_foot")]
    joints[10:20, left, 1] += 0.3
    motion = Motion(joints.astype("f4"))
    (path,) = motion.save(tmp_path / "a.contacts.json")
    content = json.loads(path.read_text())
    assert content["seconds"] == 2 and content["fps"] == 20
    events = [(one["event"], one["time"]) for one in content["events"]]
    assert [name for name, _ in events] == ["left_foot_up", "left_foot_down"]
    np.testing.assert_allclose([time for _, time in events], [0.5, 1.0], atol=0.11)
    paths = formats.save(tmp_path / "b.contacts.csv", [motion, motion])
    assert [path.name for path in paths] == ["b-1.contacts.csv", "b-2.contacts.csv"]
    rows = [f"{time:g},{name}" for name, time in events]
    assert paths[0].read_text().splitlines() == ["time,event", *rows]


def test_mirror_images_swap_sides_of_body_and_caption() -> None:
    motion = Motion(walker(30).joints(), caption="a person kicks with the left leg")
    mirrored = motion.mirrored()
    left, right = (motion.skeleton.names.index(f"{side}_ankle") for side in ("left", "right"))
    assert np.allclose(mirrored.joints[:, left], motion.joints[:, right] * [-1, 1, 1])
    assert mirrored.caption == "a person kicks with the right leg"
    assert np.array_equal(mirrored.mirrored().joints, motion.joints)
