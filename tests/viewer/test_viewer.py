from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from latentmotion.arrays import unit
from latentmotion.errors import InputError
from latentmotion.formats.notebook import bundle
from latentmotion.kinematics.rotations import matrix_from_quaternion
from latentmotion.kinematics.skeleton import HUMANML3D, KIT
from latentmotion.motion import Motion
from latentmotion.render.mannequin import mannequin_of
from latentmotion.viewer.page import Skinned, marks_of, page_html, write_page
from tests.support.pages import (
    CHROMIUM,
    FLAGS,
    HOSTILE,
    Elements,
    chromium,
    pictured,
    walking,
)


def standing_kit(caption: str = "") -> Motion:
    joints = np.tile(KIT.rest_joints().astype(np.float32), (5, 1, 1))
    return Motion(joints, 12.5, KIT, caption)


def payload(page: str) -> dict:
    return json.loads(Elements(page).text["script"][0])


def carried_joints(entry: dict) -> np.ndarray:
    root = np.frombuffer(base64.b64decode(entry["root"]), "<f4").reshape(-1, 1, 3)
    relative = np.frombuffer(base64.b64decode(entry["relative"]), "<i2").reshape(len(root), -1, 3)
    return root + relative * entry["step"]


def test_page_asks_for_nothing_outside_itself():
    page = page_html([walking()])
    elements = Elements(page)
    links = [
        value
        for _, attrs in elements.tags
        for key, value in attrs.items()
        if key in ("src", "href", "action", "data", "srcset")
    ]
    assert links == ["data:,"]
    policy = [attrs["content"] for _, attrs in elements.tags if "http-equiv" in attrs]
    assert policy[0].startswith("default-src 'none'")
    style = "".join(elements.text["style"])
    assert "url(" not in style and "@import" not in style


def test_page_is_small_and_carries_the_notice_of_three_js():
    page = page_html([walking(10.0) for _ in range(4)])
    assert len(page.encode()) < 500_000
    assert "three.js authors" in page and "THE SOFTWARE IS PROVIDED" in page


def test_bundle_is_of_the_pinned_three_js():
    source = resources.files("latentmotion.viewer") / "source"
    pinned = json.loads((source / "package.json").read_text())["devDependencies"]["three"]
    bundle = (source.parent / "viewer.js").read_text(encoding="utf-8")
    assert f'"{pinned.split(".")[1]}"' in bundle


def test_a_hostile_caption_stays_text():
    page = page_html([walking(caption=HOSTILE)])
    elements = Elements(page)
    assert [tag for tag, _ in elements.tags].count("script") == 2
    assert "b" not in [tag for tag, _ in elements.tags]
    assert elements.text["title"] == [HOSTILE]
    assert payload(page)["motions"][0]["caption"] == HOSTILE


def test_what_was_not_known_is_said_below_the_caption():
    doubt = 'not sure about "golf" (far from all captions)'
    motions = [
        replace(walking(), metadata={"notes": notes}) for notes in ([doubt, 3, HOSTILE], [doubt], 7)
    ]
    elements = Elements(page_html(motions))
    assert "".join(elements.text["p"]) == f"{doubt}\n{HOSTILE}"
    assert not Elements(page_html([walking()])).text.get("p", [""])[0]


@pytest.mark.parametrize("size", [1.0, 30.0])
def test_positions_survive_within_half_a_millimeter(size):
    motion = walking(4.0, speed=9.0)
    scaled = Motion(motion.joints * np.float32(size))
    carried = carried_joints(payload(page_html([scaled]))["motions"][0])
    assert np.abs(carried - scaled.joints).max() < 5e-4 * max(1.0, size / 3)


def test_takes_share_a_skeleton_and_may_differ_in_it():
    data = payload(page_html([walking(), walking(3.0), standing_kit()]))
    assert [entry["skeleton"] for entry in data["motions"]] == ["humanml3d", "humanml3d", KIT.name]
    assert set(data["skeletons"]) == {"humanml3d", KIT.name}
    lengths = np.linalg.norm(HUMANML3D.offsets, axis=-1)
    assert np.allclose(data["skeletons"]["humanml3d"]["lengths"], lengths, atol=0.02)


def test_a_notebook_shows_the_viewer_that_its_first_output_brought(tmp_path, monkeypatch):
    monkeypatch.setattr("latentmotion.formats.notebook._is_shown", False)
    motions = [walking(caption=HOSTILE), walking(3.0)]
    outputs = "".join(bundle(motion)["text/html"] for motion in motions)
    (tmp_path / "notebook.html").write_text(f"<!doctype html><meta charset=utf-8>{outputs}")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as driver:
        page = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS)).new_page()
        page.goto((tmp_path / "notebook.html").as_uri())
        for number, motion in enumerate(motions):
            frame = page.frame_locator("iframe").nth(number)
            frame.locator("body[data-stage]").wait_for(state="attached", timeout=120_000)
            assert frame.locator("#caption").inner_text().strip() == motion.caption
    outputs = "".join(bundle(motion)["text/html"] for motion in motions)  # without the viewer
    assert outputs.count("<img") == 2 and "globalThis.latentmotionViewer =" not in outputs


def test_no_motion_is_an_error():
    with pytest.raises(InputError, match="no motion"):
        page_html([])


def test_a_missing_folder_is_an_error_and_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        write_page(tmp_path / "none" / "page.html", [walking()])
    assert list(tmp_path.iterdir()) == []


def skinned_page(motion: Motion) -> tuple[str, np.ndarray]:
    """A page of the mannequin, and where its vertices are in all frames."""
    skin, animation = mannequin_of(motion)
    rotations, shifts = skin.moves(animation)
    parts = skin.vertices, skin.normals, skin.triangles, skin.joints, skin.weights
    return page_html([motion], figure=Skinned(*parts, [rotations], [shifts])), skin.pose(animation)[
        0
    ]


def test_a_page_carries_the_mannequin_of_files_within_a_millimeter():
    motion = walking(caption=HOSTILE)
    page, vertices = skinned_page(motion)
    figure = payload(page)["figure"]

    def array(part: dict, name: str, kind: str, width: int) -> np.ndarray:
        return np.frombuffer(base64.b64decode(part[name]), kind).reshape(-1, width).astype(float)

    skin, (move,) = figure["skin"], figure["moves"]
    rest = array(skin, "positions", "<i2", 3) * skin["step"]
    joints, weights = (
        array(skin, "joints", "u1", 4).astype(int),
        array(skin, "weights", "u1", 4) / 255,
    )
    turns = matrix_from_quaternion(unit(array(move, "rotations", "<i2", 4))[:, [3, 0, 1, 2]])
    turns = turns.reshape(len(motion), 22, 3, 3)
    shifts = array(move, "shifts", "<f4", 3).reshape(len(motion), 22, 3)
    carried = np.einsum("tvkab,vb->tvka", turns[:, joints], rest) + shifts[:, joints]
    shown = np.einsum("vk,tvka->tva", weights / weights.sum(-1, keepdims=True), carried)
    assert np.abs(shown - vertices).max() < 4e-3
    assert np.abs(shown - vertices).mean() < 1e-3
    corners = array(skin, "triangles", "<u2", 3)
    assert corners.max() == len(rest) - 1


def test_a_stick_figure_costs_a_page_nothing():
    plain, stick = (page_html([walking()], figure=figure) for figure in ("mannequin", "stick"))
    assert 0 < len(stick) - len(plain) < 30


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("page") / "page.html"
    takes = [walking(caption=HOSTILE), walking(3.0, HOSTILE, speed=0.5), standing_kit(HOSTILE)]
    write_page(path, takes)
    return path


def shown(page: Path, time: float, folder: Path, *flags: str) -> tuple[str, list[np.ndarray]]:
    """The DOM after the page's script has run, and the joints it says it shows."""
    dom = chromium(f"{page.as_uri()}#t={time}", folder, "--dump-dom", *flags)
    body = next(attrs for tag, attrs in Elements(dom).tags if tag == "body")
    assert body["data-joints"], "the page's script did not run to its end"
    return dom, [np.array(take) for take in json.loads(body["data-joints"])]


def test_browser_shows_the_caption_and_moves_the_figure_with_time(page, tmp_path):
    motions = [walking(), walking(3.0, speed=0.5)]  # the third take, KIT's, stands still
    dom, early = shown(page, 0.25, tmp_path / "a")
    assert 'data-stage="webgl"' in dom
    heading = re.search(r'<h1 id="caption">(.*?)</h1>', dom, re.DOTALL)
    assert heading is not None and html.unescape(heading[1]) == HOSTILE
    _, late = shown(page, 1.5, tmp_path / "b")
    for motion, then, now in zip(motions, early, late, strict=False):
        assert np.abs(then - motion.joints[5]).max() < 5e-4
        assert np.abs(now - motion.joints[30]).max() < 5e-4


def test_browser_without_webgl_still_shows_the_motion(page, tmp_path):
    dom, (take, *_) = shown(page, 0.525, tmp_path / "a", "--disable-3d-apis")
    assert 'data-stage="canvas"' in dom
    between = walking().joints[10:12].mean(axis=0)
    assert np.abs(take - between).max() < 0.02


def picture(page: Path, time: float, folder: Path, *flags: str) -> np.ndarray:
    image = pytest.importorskip("PIL.Image")
    path = folder / f"{time}.png"
    address = f"{page.as_uri()}#t={time}"
    pictured(address, path, *flags)
    # Caption and controls lie above and below these rows.
    return np.asarray(image.open(path).convert("RGB"), dtype=np.int16)[60:480]


@pytest.mark.parametrize(
    ("figure", "flags"),
    [("mannequin", ()), ("mannequin", ("--disable-3d-apis",)), ("skin", ()), ("stick", ())],
)
def test_pixels_of_the_figure_move(page, tmp_path, figure, flags):
    standing, still = tmp_path / "page.html", walking(speed=0.0)
    if figure == "skin":
        standing.write_text(skinned_page(still)[0], encoding="utf-8")
    else:
        write_page(standing, [still], figure=figure)
    before, after = (picture(standing, time, tmp_path, *flags) for time in (0.25, 0.75))
    background = np.median(before, axis=(0, 1))
    figure = np.abs(before - background).max(axis=-1) > 40
    moved = np.abs(before - after).max(axis=-1) > 40
    assert figure.sum() > 1_000, "no figure in the picture"
    assert moved.sum() > 500, "the figure stands still"
    assert moved.mean() < 0.3, "everything changed, not only the figure"


def test_every_take_of_many_stands_in_the_picture(tmp_path):
    write_page(tmp_path / "page.html", [walking(speed=0.0)] * 24, figure="stick")
    rows = picture(tmp_path / "page.html", 0.25, tmp_path)[100:]  # below the takes' buttons
    colored = (rows.max(axis=-1) - rows.min(axis=-1) > 40).any(axis=0)
    starts = np.flatnonzero(colored[1:] & ~colored[:-1])
    assert len(starts) == 24 and not colored[:5].any() and not colored[-5:].any()


def asked() -> Motion:
    wrist = {"joint": "right_wrist", "at": 1.0, "to": [-0.3, None, 1.2]}
    path = [{"joint": "pelvis", "at": at, "to": [0.0, None, at]} for at in (0.5, 1.5)]
    pose = [{"pose": 0, "at": 0.75, "before": 0.1, "after": 0.0}]
    spans = [{"prompt": HOSTILE, "start": 0, "end": 1}, {"prompt": "turns", "start": 1, "end": 2}]
    spans.append({"prompt": "waves", "part": "arms", "start": 0.5, "end": 2})
    return replace(walking(), metadata={"goals": [wrist, *path, *pose], "spans": spans})


def test_page_has_what_was_asked_of_the_motion():
    motion = asked()
    marks = payload(page_html([motion]))["motions"][0]["marks"]
    wrist = HUMANML3D.names.index("right_wrist")
    (goal,) = marks["goals"]
    assert goal["joint"] == "right_wrist"
    assert goal["to"] == pytest.approx([-0.3, motion.joints[20, wrist, 1], 1.2], abs=1e-4)
    start = motion.joints[0, 0, ::2]
    assert marks["path"][0] == {"at": 0, "to": pytest.approx(start.tolist(), abs=1e-4)}
    assert [stop["at"] for stop in marks["path"][1:]] == [0.5, 1.5]
    assert marks["poses"] == [0.75]
    assert [span["prompt"] for span in marks["spans"]] == [HOSTILE, "turns", "waves"]
    assert marks_of(walking()) == {}


@pytest.mark.parametrize(
    "metadata",
    [
        {"goals": "pelvis", "spans": 3},
        {"goals": [1, {"joint": "tail", "at": 0, "to": [0, 0, 0]}]},
        {"goals": [{"joint": "head", "at": "0", "to": [0, 0, 0]}]},
        {"goals": [{"joint": "head", "at": 0, "to": [0, float("nan"), 0]}]},
        {"goals": [{"joint": "head", "at": 99, "to": [0, 0, 0]}]},
        {"goals": [{"joint": ["head"], "at": 0, "to": [0, 0]}]},
        {"spans": [{"prompt": 1, "start": 0, "end": 1}, {"prompt": "a", "start": 1, "end": 0}]},
    ],
)
def test_marks_of_foreign_files_are_left_out(metadata):
    assert marks_of(replace(walking(), metadata=metadata)) == {}


def test_browser_draws_what_was_asked(tmp_path):
    path = tmp_path / "page.html"
    write_page(path, [asked()])
    dom, _ = shown(path, 0.5, tmp_path / "a")
    elements = Elements(dom)
    spans = [attrs.get("title") for tag, attrs in elements.tags if tag == "span"]
    assert [title for title in spans if title] == [HOSTILE, "turns", "arms: waves"]
    assert [tag for tag, _ in elements.tags].count("i") == 5
    assert [tag for tag, _ in elements.tags].count("b") == 0
