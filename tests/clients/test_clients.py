"""Every format in the programs that its users work in: joints, scale, axes and speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline, formats
from latentmotion.control.states import generate_states, parse_state
from latentmotion.formats.engines import for_engine
from latentmotion.motion import Motion
from tests.clients.clients import Seen, in_blender, in_browser, in_usd, measure, takes, validate
from tests.clients.conftest import Row, Table

CLOSE = 0.01  # Meters.

# Which take is looked at, and when, as a share of its length; none is where a foot is highest.
MOMENTS = ((0, 0.4), (0, None), (1, 0.8), (2, 0.97))


def record(
    table: Table,
    what: tuple[str, str, str],
    seen: list[Seen],
    motions: list[Motion],
    up: str,
    frames: list[int] | None = None,
) -> None:
    """Measures all takes, adds their worst to the table, and says whether they are right."""
    assert len(seen) == len(motions)
    found = [measure(s, m, up, frames) for s, m in zip(seen, motions, strict=True)]
    worst = max(found, key=lambda one: one.error)
    off = max(found, key=lambda one: abs(one.speed - 1))
    counted = sum(len(s.positions) for s in seen)
    table.rows.append(
        Row(*what, counted, worst.error, worst.scale, found[0].up, off.speed, found[0].sole)
    )
    assert worst.error < CLOSE
    assert worst.scale == pytest.approx(1, abs=1e-3)
    assert {one.up for one in found} == {f"+{up}"}
    assert off.speed == pytest.approx(1, abs=1e-3)


def pictures(folder: Path, name: str, motions: list[Motion]) -> list[tuple[int, int, str]]:
    wanted = []
    for number, (take, share) in enumerate(MOMENTS):
        feet = motions[take].joints[:, motions[take].skeleton.right_foot, 1].max(-1)
        frame = int(feet.argmax()) if share is None else round(share * (len(feet) - 1))
        wanted.append((take, frame, str(folder / f"{name}_{number}.png")))
    return wanted


def job(path: Path, motions: list[Motion], wanted: list, **more: object) -> dict:
    frames = [len(motion) for motion in motions]
    about = {"path": str(path), "frames": frames, "fps": motions[0].fps, "pictures": wanted}
    return about | more


def check_bones(rest: dict, motion: Motion) -> None:
    """Bones have the joints' names and parents, and point to the next joint."""
    names, parents = motion.skeleton.names, motion.skeleton.parents
    assert set(names) <= set(rest)
    for name, parent in zip(names, parents, strict=True):
        if parent >= 0:
            assert rest[name]["parent"] == names[parent]
        children = motion.skeleton.children(names.index(name))
        if len(children) == 1:
            head, tail = (np.array(rest[name][end]) for end in ("head", "tail"))
            toward = np.array(rest[names[children[0]]]["head"]) - head
            cosine = (tail - head) @ toward
            cosine /= np.linalg.norm(tail - head) * np.linalg.norm(toward)
            assert cosine > 0.99, name


def test_glb_has_no_faults_for_khronos(node_modules, motions, table, tmp_path):
    issues = []
    for ending in (".glb", ".gltf"):
        formats.save(tmp_path / f"a{ending}", motions)
        issues.append(validate(node_modules, tmp_path / f"a{ending}"))
        kinds = ("Errors", "Warnings", "Infos", "Hints")
        counts = ", ".join(f"{issues[-1][f'num{kind}']} {kind.lower()}" for kind in kinds)
        table.notes.append(f"gltf-validator, {ending} of {len(motions)} takes: {counts}")
    assert all(found["numErrors"] == found["numWarnings"] == 0 for found in issues)


@pytest.mark.parametrize("ending", [".glb", ".gltf", ".fbx"])
def test_takes_in_one_file_in_blender(ending, blender, motions, table, results, tmp_path):
    path = tmp_path / f"a{ending}"
    write(path, motions)
    wanted = [] if ending == ".gltf" else pictures(results, ending[1:], motions)
    (report,) = in_blender(blender, [job(path, motions, wanted)], tmp_path)
    record(table, (ending[1:], "Blender", f"{len(motions)} of 3"), takes(report), motions, "z")
    check_bones(report["rest"], motions[0])


def test_fbx_by_the_importer_before_blender_5(blender, motions, table, tmp_path):
    write(tmp_path / "a.fbx", motions)
    (report,) = in_blender(blender, [job(tmp_path / "a.fbx", motions, [], old=True)], tmp_path)
    what = ("fbx", "Blender, importer before 5", f"{len(report['takes'])} of 3")
    record(table, what, takes(report), motions, "z")
    check_bones(report["rest"], motions[0])


def test_glb_in_a_scene_of_24_frames_per_second(blender, motions, table, tmp_path):
    """What a user gets who sets nothing: keys fall between frames, but the speed is right."""
    formats.save(tmp_path / "a.glb", motions)
    about = job(tmp_path / "a.glb", motions, [], set_fps=False)
    (report,) = in_blender(blender, [about], tmp_path)
    assert report["scene_fps"] == 24
    record(table, ("glb", "Blender, scene left at 24 fps", "3 of 3"), takes(report), motions, "z")


@pytest.mark.parametrize("ending", [".glb", ".bvh", ".usdc", ".fbx"])
def test_resampled_to_30_frames_per_second(ending, blender, motions, table, tmp_path):
    resampled = [motion.resampled(30) for motion in motions[:1]]
    write(tmp_path / f"a{ending}", motions[:1], 30)
    (report,) = in_blender(blender, [job(tmp_path / f"a{ending}", resampled, [])], tmp_path)
    assert report["scene_fps"] == pytest.approx(30)
    record(table, (ending[1:], "Blender, --fps 30", "1 of 1"), takes(report), resampled, "z")


@pytest.mark.parametrize("ending", [".bvh", ".usda", ".usdc", ".usdz"])
def test_one_take_a_file_in_blender(ending, blender, motions, table, results, tmp_path):
    files, seen = [], []
    for number, motion in enumerate(motions):
        path = tmp_path / f"take{number}{ending}"
        formats.save(path, [motion])
        wanted = pictures(results, ending[1:], motions) if ending in (".bvh", ".usdc") else []
        wanted = [(0, frame, picture) for take, frame, picture in wanted if take == number]
        files.append(job(path, [motion], wanted))
    reports = in_blender(blender, files, tmp_path)
    for report in reports:
        seen += takes(report)
        check_bones(report["rest"], motions[0])
    record(table, (ending[1:], "Blender", "3 files"), seen, motions, "z")


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usdz"])
def test_usd_in_its_own_library(ending, blender, motions, table, tmp_path):
    pytest.importorskip("pxr")
    formats.save(tmp_path / f"a{ending}", motions)
    report = in_usd(blender, tmp_path / f"a{ending}", tmp_path)
    assert (report["up"], report["meters"], report["played"]) == ("Y", 1.0, 0)
    assert report["names"] == list(motions[0].skeleton.names)
    what = (ending[1:], "UsdSkel of usd-core", f"{len(report['takes'])} of 3")
    record(table, what, takes(report), motions, "y")


def test_the_first_take_of_a_usd_file_in_blender(blender, motions, table, tmp_path):
    pytest.importorskip("pxr")
    formats.save(tmp_path / "a.usdc", motions)
    (report,) = in_blender(blender, [job(tmp_path / "a.usdc", motions, [])], tmp_path)
    record(table, ("usdc", "Blender", "1 of 3"), takes(report), motions[:1], "z")


@pytest.mark.parametrize("ending", [".glb", ".fbx"])
def test_three(ending, blender, node_modules, chromium, motions, table, results, tmp_path):
    write(tmp_path / f"a{ending}", motions)
    fps, frames = motions[0].fps, list(range(0, 80, 7))
    wanted = pictures(results, "three", motions) if ending == ".glb" else []
    about = {
        "path": str(tmp_path / f"a{ending}"),
        "chromium": chromium,
        "pictures": [(take, frame / fps, path) for take, frame, path in wanted],
        "times": [frame / fps for frame in frames],
    }
    report = in_browser(node_modules, about, tmp_path)
    assert report["errors"] == []
    what = (ending[1:], "three.js in Chromium", f"{len(report['takes'])} of 3")
    # FBX does not keep the order of takes; their names do.
    report["takes"].sort(key=lambda take: take["name"])
    record(table, what, takes(report), motions, "y", frames)


def write(path: Path, motions: list[Motion], fps: float | None = None) -> None:
    """Saves, or skips what this package cannot write here."""
    if path.suffix not in formats.ENDINGS:
        pytest.skip(f"{path.suffix} is not written yet")
    formats.save(path, motions, fps)


def test_pictures_side_by_side(results):
    """Puts what the clients drew on one sheet, to be looked at; runs last."""
    image = pytest.importorskip("PIL.Image")
    names = [n for n in ("glb", "three", "bvh", "usdc", "fbx") if (results / f"{n}_0.png").exists()]
    if not names:
        pytest.skip("no pictures were drawn in this run")
    from PIL import ImageDraw

    width, height = 320, 240
    sheet = image.new("RGB", (width * len(MOMENTS), height * len(names)), "white")
    for row, name in enumerate(names):
        for column in range(len(MOMENTS)):
            with image.open(results / f"{name}_{column}.png") as picture:
                small = picture.convert("RGBA").resize((width, height))
            sheet.paste(small, (column * width, row * height), small)
        label = "glb in three.js" if name == "three" else f"{name} in Blender"
        ImageDraw.Draw(sheet).text((8, row * height + 6), label, "black")
    sheet.save(results / "clients.png")


def test_clips_of_a_state_machine_fade_into_each_other(node_modules, chromium, tmp_path):
    generate = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    states = [parse_state(state) for state in ("idle", "walk", "run", "turn left 90")]
    clips = [clip.resampled(30) for clip in generate_states(generate, states, takes=2)]
    formats.save(tmp_path / "a.glb", [for_engine(clip, "unity") for clip in clips])
    names = ["idle", "walk", "run", "walk", "idle", "turn left 90"]
    shown = {n: str(tmp_path / f"fade_{n}.png") for n in (30, 96, 150, 192, 285, 380)}
    fade = {"names": names, "hold": 1.5, "blend": 0.4, "pictures": shown}
    seen = in_browser(
        node_modules,
        {"path": str(tmp_path / "a.glb"), "fade": fade, "chromium": chromium},
        tmp_path,
    )
    assert not [error for error in seen["errors"] if "GPU stall" not in error]
    frames = np.array(seen["frames"])
    steps = np.linalg.norm(np.diff(frames, axis=0), axis=-1).max(axis=-1)
    fading = np.array([(n / 60) % 1.5 < 0.4 and n >= 90 for n in range(1, len(frames))])
    # While one clip fades into another nothing moves faster than in a run.
    assert steps[fading].max() < 1.1 * steps[~fading].max()
    assert steps.max() < 0.2
