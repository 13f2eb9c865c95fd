"""Strips, GIFs and videos: the figure is there, where it belongs, and moves."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.render.mannequin import make_mannequin
from latentmotion.render.painter import camera_around
from tests.support.walker import walker

Image = pytest.importorskip("PIL.Image")
av = pytest.importorskip("av")

from PIL import ImageFont  # noqa: E402

from latentmotion.render import strip, video  # noqa: E402
from latentmotion.render.painter import font_for  # noqa: E402


@pytest.fixture(scope="module")
def motion() -> Motion:
    joints = walker(12).joints()
    in_place = joints - joints[:, :1] * (1, 0, 1)
    return Motion(in_place.astype("f4"), caption="a person walks and turns")


def painted(picture) -> np.ndarray:
    """Where the figure's joints are: pixels that are clearly teal."""
    red, _, blue = np.moveaxis(np.asarray(picture.convert("RGB")).astype(int), -1, 0)
    return blue - red > 45


def test_skin_follows_the_bones():
    person = walker(5)
    body = make_mannequin(person.skeleton)
    rest = person.skeleton.rest_joints()
    vertices, normals = body.pose(person)
    near = np.linalg.norm(body.vertices[:, None] - rest, axis=-1) < 0.12
    for joint in range(len(rest)):
        moved = np.linalg.norm(
            vertices[:, near[:, joint]] - person.joints()[:, joint, None], axis=-1
        )
        assert moved.max() < 0.2
    assert normals.shape == vertices.shape


def test_the_camera_sees_its_target_in_the_middle_and_the_far_smaller():
    camera = camera_around(np.array([1.0, 1.0, 0.0]), 0.5, 0.2, 4.0, (200, 100), 2.0)
    pixels, depth = camera.project(np.array([[1.0, 1, 0], [1.0, 1.5, 0]]))
    np.testing.assert_allclose(pixels[0], (100, 50), atol=1e-9)
    assert depth[0] == pytest.approx(4)
    assert pixels[1, 1] == pytest.approx(50 - 25 * np.cos(0.2) * 4 / depth[1])


def test_a_strip_has_a_row_for_each_motion_and_figures_along_it(motion: Motion, tmp_path: Path):
    strip.write(tmp_path / "a.png", [motion, motion], figures=4)
    with Image.open(tmp_path / "a.png") as picture:
        seen = painted(picture)
    half = len(seen) // 2
    np.testing.assert_array_equal(seen[:half], seen[half:])
    quarters = np.array_split(seen[:half], 4, axis=1)
    assert all(quarter.mean() > 0.005 for quarter in quarters)
    assert not seen[:20].any()


def test_arms_at_the_ends_of_a_strip_are_in_it(tmp_path: Path):
    figure = Motion(np.repeat(walker(1).skeleton.rest_joints()[None], 9, axis=0).astype("f4"))
    strip.write(tmp_path / "a.png", [figure])
    with Image.open(tmp_path / "a.png") as picture:
        seen = (np.asarray(picture.convert("L"))[60:150] < 190).any(axis=0)
    assert seen[:200].any() and not seen[:4].any() and not seen[-4:].any()


def test_a_font_that_has_the_letters_is_taken():
    assert font_for("a person walks", 18).getname() == font_for("", 18).getname()
    cyrillic = font_for("человек идёт", 18)
    for name in ("DejaVuSans.ttf", "NotoSans-Regular.ttf"):
        try:
            ImageFont.truetype(name, 18)
        except OSError:
            continue
        assert bytes(cyrillic.getmask("ч")) != bytes(cyrillic.getmask("\U0010ffff"))


def test_a_strip_along_the_path(motion: Motion, tmp_path: Path):
    strip.write(tmp_path / "a.png", [motion], style="path", figures=3)
    with Image.open(tmp_path / "a.png") as picture:
        seen = painted(picture)
    assert seen.mean() > 0.004


def test_bad_strips_are_refused(motion: Motion, tmp_path: Path):
    with pytest.raises(InputError, match="at least 1"):
        strip.write(tmp_path / "a.png", [motion], figures=0)
    assert not list(tmp_path.iterdir())


def test_mp4(motion: Motion, tmp_path: Path):
    motion.save(tmp_path / "a.mp4")
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.streams.video[0].average_rate == 20
        frames = [painted(frame.to_image()) for frame in container.decode(video=0)]
    assert len(frames) == len(motion)
    assert all(frame.mean() > 0.005 for frame in frames)
    assert (frames[0] != frames[6]).mean() > 0.003


def test_the_camera_follows(motion: Motion):
    way = np.arange(12, dtype="f4")[:, None, None] * np.array((0.3, 0, 0), "f4")
    for picture in video.frames([Motion(motion.joints + way)], 200):
        across = painted(picture).any(0)
        assert 40 < np.flatnonzero(across).mean() < 160


def test_gif_with_two_takes(motion: Motion, tmp_path: Path):
    video.write(tmp_path / "a.gif", [motion, Motion(motion.joints[:5])], size=160)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == len(motion)
        assert picture.info["duration"] == 50


def test_bad_videos_are_refused(motion: Motion, tmp_path: Path):
    with pytest.raises(InputError, match="at most"):
        video.write(tmp_path / "a.gif", [motion] * 9)
    with pytest.raises(InputError, match="frame rate"):
        video.write(tmp_path / "a.gif", [motion, Motion(motion.joints, fps=30.0)])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("package", "ending"), [("PIL", ".gif"), ("PIL", ".png"), ("av", ".mp4")])
def test_missing_packages_are_named(package: str, ending: str, tmp_path: Path):
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "import numpy as np\n"
        "from latentmotion.errors import MissingExtraError\n"
        "from latentmotion.motion import Motion\n"
        "from latentmotion.kinematics.skeleton import HUMANML3D\n"
        "joints = np.tile(HUMANML3D.rest_joints(), (2, 1, 1))\n"
        "try:\n"
        f"    Motion(joints).save({str(tmp_path / ('a' + ending))!r})\n"
        "except MissingExtraError as error:\n"
        "    print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "latentmotion[video]" in run.stdout, run.stderr
    assert not list(tmp_path.iterdir())
