"""Motions over HTTP: what the library makes, in each format; wrong input gets our own texts."""

from __future__ import annotations

import io
import zipfile
from typing import Any, get_args

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp
from latentmotion.control.timeline import generate_timeline
from latentmotion.language.claims import Corrections
from latentmotion.service.schemas import Format
from tests.service.conftest import Called

WALK = {"prompt": "a person walks", "seconds": 1.0, "seed": 3}
ARM = {"part": "right_arm", "prompt": "a person waves", "start": 0.2, "end": 0.8}


@pytest.fixture(scope="module")
def walk() -> Motion:
    return MotionPipeline.from_pretrained(threads=1).batch(["a person walks"], 1.0, [3])[0]


def test_raw_joints_are_the_librarys(called: Called, walk: Motion) -> None:
    answer = called.post("/v1/motions", WALK | {"format": "raw", "clean": False})
    joints = np.frombuffer(answer.content, "<f4").reshape(-1, 22, 3)
    np.testing.assert_allclose(joints, walk.joints, atol=1e-5)
    assert answer.headers["latentmotion-model"] == "fast"
    assert answer.headers["latentmotion-frames"] == "20"
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_motion_is_cleaned_unless_told_otherwise(called: Called, walk: Motion) -> None:
    found = called.post("/v1/motions", WALK).json()
    settled = walk.cleaned(CleanUp(), Corrections(sharpens=True, settles=True))
    np.testing.assert_allclose(found["positions"], settled.joints, atol=1e-4)
    assert found["joints"][0] == "pelvis"
    assert found["metadata"]["seed"] == 3
    at_30 = called.post("/v1/motions", WALK | {"fps": 30}).json()
    assert at_30["fps"] == 30
    assert len(at_30["positions"]) in (29, 30)


@pytest.mark.parametrize(
    ("kind", "prompt"), [("turn", "turn left by 90 degrees"), ("count", "a person bows twice")]
)
def test_turns_and_counts_are_exact_unless_told_otherwise(
    called: Called, kind: str, prompt: str
) -> None:
    (raw,) = MotionPipeline.from_pretrained(threads=1).raw_motions([prompt], seeds=[1])
    for exact in (True, False):
        expected = raw.motion.cleaned(CleanUp(**{f"exact_{kind}": exact}), raw.corrections)
        body = {"prompt": prompt, "seed": 1, f"exact_{kind}": exact}
        found = called.post("/v1/motions", body).json()
        np.testing.assert_allclose(found["positions"], expected.joints, atol=1e-4)
    assert "made" in raw.motion.cleaned(None, raw.corrections).metadata[kind]
    if kind == "count":  # nor where somebody gave the length
        body = {"prompt": prompt, "seed": 1, "seconds": raw.motion.seconds}
        timed = called.post("/v1/motions", body).json()
        assert len(timed["positions"]) == len(raw.motion) and "count" not in timed["metadata"]


@pytest.mark.parametrize(
    ("form", "begins"),
    [
        ("bvh", b"HIERARCHY"),
        ("glb", b"glTF"),
        ("npz", b"PK"),
        ("html", b"<!doctype html>"),
        ("png", b"\x89PNG"),
        ("vrma", b"glTF"),
    ],
)
def test_files_begin_as_their_format_does(called: Called, form: str, begins: bytes) -> None:
    answer = called.post("/v1/motions", WALK | {"format": form})
    assert answer.status_code == 200
    assert answer.content.startswith(begins)
    assert answer.headers["content-disposition"] == f'attachment; filename="motion.{form}"'


def test_goals_are_met(called: Called) -> None:
    goal = {"joint": "right_wrist", "at": 0.8, "to": [None, 1.4, None]}
    found = called.post("/v1/motions", WALK | {"goals": [goal]}).json()
    wrist = found["joints"].index("right_wrist")
    assert found["positions"][16][wrist][1] == pytest.approx(1.4, abs=1e-3)


def test_a_timeline_has_its_prompts(called: Called) -> None:
    spans = [{"prompt": "a person walks", "seconds": 1}, {"prompt": "a person sits down"}]
    found = called.post("/v1/motions", {"timeline": spans, "clean": False}).json()
    assert [span["prompt"] for span in found["metadata"]["spans"]] == [s["prompt"] for s in spans]


def test_a_part_of_the_body_follows_the_second_track(called: Called) -> None:
    body = {"timeline": [{"prompt": "a person walks", "seconds": 2}], "seed": 3, "clean": False}
    wave = {"part": "right_arm", "prompt": "a person waves", "start": 0.5, "end": 1.5}
    plain, found = (
        called.post("/v1/motions", body | {"timeline_parts": parts}).json()
        for parts in ([], [wave])
    )
    library = generate_timeline(
        MotionPipeline.from_pretrained(threads=1),
        [("a person walks", 2.0)],
        3,
        parts=[("right_arm", "a person waves", 0.5, 1.5)],
    )
    np.testing.assert_allclose(found["positions"], library.joints, atol=1e-4)
    arm = [found["joints"].index(f"right_{joint}") for joint in ("elbow", "wrist")]
    moved = np.abs(np.subtract(found["positions"], plain["positions"])).max(axis=(0, 2))
    assert np.flatnonzero(moved > 1e-6).tolist() == arm and moved[arm].min() > 0.05
    assert found["metadata"]["spans"][1] == wave


def test_a_batch_has_a_take_for_each_prompt_and_seed(called: Called, walk: Motion) -> None:
    asked = {"prompts": ["a person walks", "a person jumps"], "seconds": 1.0, "seed": 3, "count": 2}
    answer = called.post("/v1/batches", asked | {"clean": False})
    with np.load(io.BytesIO(answer.content)) as found:
        assert found["caption"].tolist() == [p for p in asked["prompts"] for _ in range(2)]
        np.testing.assert_allclose(found["joints"][:20], walk.joints, atol=1e-5)
    archive = called.post("/v1/batches", asked | {"format": "bvh"})
    assert archive.headers["content-type"] == "application/zip"
    assert len(zipfile.ZipFile(io.BytesIO(archive.content)).namelist()) == 4


@pytest.mark.parametrize(
    ("change", "status", "told"),
    [
        ({"seconds": 200}, 422, "makes motions of 0.6 to 9.8 seconds"),
        ({"seconds": -1.7e308}, 422, "a number that frames can be counted in"),
        ({"prompt": ""}, 422, "the sentence is empty"),
        ({"prompt": "x" * 501}, 422, "at most 500 characters"),
        ({"steps": 3}, 422, "this distilled model takes 1, 2, 4"),
        ({"seed": -1}, 422, "body.seed"),
        ({"seed": 1.5}, 422, "body.seed"),
        ({"guidance": 1e5}, 422, "guidance"),
        ({"secs": 2}, 422, "body.secs: unknown field; did you mean 'seconds'?"),
        ({"promt": "a person sits"}, 422, "body.promt: unknown field; did you mean 'prompt'?"),
        ({"format": "exe"}, 422, "body.format"),
        ({"fps": 0}, 422, "body.fps"),
        ({"timeline": [{"prompt": "a person walks"}]}, 422, "a timeline has no prompt"),
        ({"timeline_parts": [ARM]}, 422, "timeline_parts needs a timeline"),
        ({"goals": [{"joint": "wing", "at": 0.5, "to": [0, 1, 0]}]}, 422, "unknown joint 'wing'"),
    ],
)
def test_wrong_input_is_told(called: Called, change: Any, status: int, told: str) -> None:
    answer = called.post("/v1/motions", WALK | change)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert told in answer.json()["detail"]


@pytest.mark.parametrize(
    ("part", "told"),
    [
        (ARM | {"part": "rigth_arm"}, "did you mean 'right_arm'"),
        (ARM | {"start": 0.9}, "two ascending times"),
        (ARM | {"end": 9}, "ends at 9 s, the timeline at 1 s"),
        (ARM | {"prompt": ""}, "the sentence is empty"),
        ({"part": "head"}, "body.timeline_parts.0: PartSpan: missing key 'prompt', 'start', 'end'"),
    ],
)
def test_wrong_parts_are_told(called: Called, part: Any, told: str) -> None:
    spans = [{"prompt": "a person walks", "seconds": 1}]
    answer = called.post("/v1/motions", {"timeline": spans, "timeline_parts": [part]})
    assert answer.status_code == 422
    assert told in answer.json()["detail"]


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 422),
        (b"{", 400),
        (b"[" * 60_000, 400),
        (b'{"prompt": "a \\ud800"}', 422),
        (b'{"prompt": "a person walks", "seconds": NaN}', 422),
        (b'{"prompt": "a person walks", "seconds": 1e999}', 422),
        (b"\xff\xfe", 400),
        (b'"' + b"x" * (1 << 18) + b'"', 413),
    ],
)
def test_no_body_is_the_services_fault(called: Called, body: bytes, status: int) -> None:
    headers = {"Content-Type": "application/json"}
    answer = called.wait(called.client.post("/v1/motions", content=body, headers=headers))
    assert answer.status_code == status
    assert answer.json()["status"] == status
    assert "Traceback" not in answer.text


def test_the_model_is_described(called: Called) -> None:
    (model,) = called.get("/v1/models").json()
    assert model["name"] == "fast"
    assert model["seconds"] == [0.6, 9.8]
    assert {"glb", "bvh", "json"} <= set(model["formats"])
    every = set(get_args(Format))
    assert set(model["formats"]) | set(model["lacking"]) == every
    assert not set(model["formats"]) & set(model["lacking"])


def test_openapi_has_examples_and_problems(called: Called) -> None:
    found = called.get("/openapi.json").json()
    examples = found["components"]["schemas"]["MotionRequest"]["examples"]
    assert examples[0]["seed"] == 7
    for example in examples:
        assert called.post("/v1/motions", example).status_code == 200
    assert any("timeline_parts" in example for example in examples)
    answers = found["paths"]["/v1/motions"]["post"]["responses"]
    assert {"200", "401", "413", "422", "429", "503"} <= set(answers)
