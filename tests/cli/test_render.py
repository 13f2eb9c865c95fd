"""`latentmotion render`: motion files in, pictures and videos out, or one clear line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.formats import load, save
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from tests.support.pages import Elements
from tests.support.walker import walker

Image = pytest.importorskip("PIL.Image")
av = pytest.importorskip("av")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """walk.npz: 12 frames on a circle at 20 fps; ahead.npz: 8 frames at 10 fps, 6 m ahead."""
    folder = tmp_path_factory.mktemp("motions")
    joints = walker(12).joints().astype("f4")
    save(folder / "walk.npz", [Motion(joints, caption="a person walks in a circle")])
    ahead = joints[:8] - joints[:8, :1] * (1, 0, 1) + np.linspace((0, 0, 0), (0, 0, 6), 8)[:, None]
    save(folder / "ahead.npz", [Motion(ahead, fps=10.0, caption="ahead")])
    return folder


def seen(picture) -> np.ndarray:
    """Where the first take's color is."""
    red, _, blue = np.moveaxis(np.asarray(picture.convert("RGB")).astype(int), -1, 0)
    return blue - red > 25


def gif_frames(path: Path) -> tuple[list[np.ndarray], list[int]]:
    with Image.open(path) as picture:
        masks, milliseconds = [], []
        for frame in range(picture.n_frames):
            picture.seek(frame)
            masks.append(seen(picture))
            milliseconds.append(picture.info["duration"])
    return masks, milliseconds


def draw(*words: object) -> None:
    main(["render", *map(str, words)])


def test_all_three_at_once(files: Path, tmp_path: Path, capsys):
    outputs = [tmp_path / name for name in ("a.mp4", "a.gif", "a.png")]
    draw(files / "walk.npz", "-o", *outputs, "--size", 240)
    assert capsys.readouterr().out == "".join(f"wrote {path}\n" for path in outputs)
    with av.open(str(outputs[0])) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate) == (240, 240, 20)
        assert sum(1 for _ in container.decode(video=0)) == 12
    assert len(gif_frames(outputs[1])[0]) == 9  # 15 frames per second
    with Image.open(outputs[2]) as picture:
        assert picture.width == 240


def test_every_figure_is_drawn_in_pictures_and_on_pages(files: Path, tmp_path: Path):
    (motion,) = load(files / "walk.npz")
    motion.save(tmp_path / "hero.glb")
    masks, pages = {}, {}
    for figure in ("mannequin", "stick", tmp_path / "hero.glb"):
        outputs = [tmp_path / "a.png", tmp_path / "a.html"]
        draw(
            *(files / "walk.npz", "-o", *outputs, "--size", 400, "--figures", 3, "--figure", figure)
        )
        with Image.open(outputs[0]) as picture:
            masks[Path(figure).stem] = seen(picture)
        content = json.loads(Elements(outputs[1].read_text()).text["script"][0])
        pages[Path(figure).stem] = content.get("figure")
    assert masks["stick"].any() and (masks["stick"] != masks["mannequin"]).any()
    assert masks["hero"].sum() > 2 * masks["mannequin"].sum()  # all of it in the take's color
    assert pages["stick"] == "stick" and pages["mannequin"] is None
    assert pages["hero"]["skin"]["bones"] == 22


def test_several_files_are_takes_of_the_first_ones_rate(files: Path, tmp_path: Path):
    draw(files / "ahead.npz", files / "walk.npz", "-o", tmp_path / "a.gif", "--size", 128)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.size == (2 * 96, 128)
        assert picture.info["duration"] == 100
        assert picture.n_frames == 8


@pytest.mark.parametrize(("fps", "frames"), [(30, 17), (60, 28)])
def test_a_gif_is_as_long_as_the_motion_at_any_rate(files, tmp_path, fps: int, frames: int):
    draw(files / "walk.npz", "-o", tmp_path / "a.gif", "--size", 96, "--output-fps", fps)
    masks, milliseconds = gif_frames(tmp_path / "a.gif")
    assert len(masks) == frames
    assert min(milliseconds) >= 20
    assert sum(milliseconds) == pytest.approx(1000 * frames / min(fps, 50), abs=10)


def test_fast_mocap_becomes_a_video_of_at_most_30_frames_per_second(files: Path, tmp_path: Path):
    motion = Motion(walker(48, 120.0).joints().astype("f4"), fps=120.0)
    save(tmp_path / "fast.bvh", [motion])
    draw(tmp_path / "fast.bvh", "-o", tmp_path / "a.mp4", "--size", 96)
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.streams.video[0].average_rate == 30
        assert sum(1 for _ in container.decode(video=0)) == 12


def test_a_still_camera_sees_the_whole_path_and_one_that_follows_the_middle(files, tmp_path):
    for camera in ("still", "follow"):
        draw(
            *(files / "ahead.npz", "-o", tmp_path / f"{camera}.gif"),
            *("--size", 160, "--camera", camera),
        )
    across = {}
    for camera in ("still", "follow"):
        masks = [mask[:110] for mask in gif_frames(tmp_path / f"{camera}.gif")[0]]  # no caption
        assert all(mask.any() for mask in masks)
        across[camera] = [np.flatnonzero(mask.any(0)).mean() for mask in masks]
        assert not any(mask[:, [0, -1]].any() for mask in masks)
    assert np.ptp(across["still"]) > 60
    assert np.ptp(across["follow"]) < 50


def test_a_path_has_figures_that_fade(files: Path, tmp_path: Path):
    draw(
        *(files / "ahead.npz", "-o", tmp_path / "a.png", "--style", "path"),
        *("--figures", 4, "--size", 500),
    )
    with Image.open(tmp_path / "a.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    strong = (pixels[..., 2] - pixels[..., 0]) * (pixels[..., 2] - pixels[..., 0] > 25)
    columns = np.flatnonzero(strong.any(0))
    quarters = np.array_split(strong[:, columns[0] : columns[-1] + 1], 4, axis=1)
    most = [np.percentile(quarter[quarter > 0], 90) for quarter in quarters]
    assert abs(most[0] - most[-1]) > 30
    assert columns[0] > 5 and columns[-1] < 494


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["walk.npz", "-o", "a.bvh"], "its ending is none of .mp4 .gif .png .html"),
        (["walk.npz", "-o", "nowhere/a.gif"], "does not exist"),
        (["walk.npz", "-o", "a.gif", "--figure", "stik"], "expected mannequin, stick or"),
        (["walk.npz", "-o", "a.gif", "--figure", "person"], "there is no such file"),
        (["walk.npz", "-o", "a.gif", "--figure", "walk.npz"], "is no rig that can be read"),
        (["nothing.npz", "-o", "a.gif"], "there is no file"),
        (["-o", "a.gif"], "no motion file given"),
        (["broken.npz", "-o", "a.gif"], "not a motion file"),
        (["walk.txt", "-o", "a.gif"], "cannot be read"),
        (["walk.npz", "-o", "a.gif", "--size", "99"], "an even number"),
        (["walk.npz", "-o", "a.mp4", "--size", "90000"], "an even number"),
        (["walk.npz", "-o", "a.png", "--size", "3"], "pixels wide"),
        (["walk.npz", "-o", "a.png", "--figures", "0"], "at least 1"),
        (["walk.npz", "-o", "a.gif", "--output-fps", "0"], "fps is 0"),
        (["blob.npz", "-o", "a.gif"], "a body with left_hip"),
        (["blob.npz", "-o", "a.png"], "a body with left_hip"),
    ],
)
def test_bad_input_is_told_in_a_line(files, tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.npz").write_bytes((files / "walk.npz").read_bytes())
    (tmp_path / "broken.npz").write_bytes((files / "walk.npz").read_bytes()[:300])
    (tmp_path / "walk.txt").write_text("hello")
    worm = Skeleton("worm", ("head", "tail"), (-1, 0), np.array([[0, 0, 0], [0, 0, -1.0]]))
    save(tmp_path / "blob.npz", [Motion(np.zeros((2, 2, 3)), skeleton=worm)])
    before = sorted(tmp_path.iterdir())
    with pytest.raises(SystemExit, match="2"):
        draw(*words)
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
