"""Timelines: spans as users write them, tokens with a known past, one motion of several prompts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.control.scene import read_scene
from latentmotion.control.stream import KNOWN
from latentmotion.control.timeline import (
    PartSpan,
    Span,
    check_parts,
    generate_timeline,
    parse_part_span,
    parse_span,
    sampled_spans,
    spans_of,
    tokens_of,
)
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.motion import Motion

WALK, SIT = "a person walks forward", "a person sits down"
WAVE = PartSpan("right_arm", "a person waves the right hand", 1, 2.6)


@pytest.fixture(scope="module")
def generate() -> MotionPipeline:
    return MotionPipeline.from_pretrained("fast", "onnxruntime", 1)


@pytest.fixture(scope="module")
def motion(generate: MotionPipeline) -> Motion:
    return generate_timeline(generate, [(WALK, 3), ("a person jumps", 2), (SIT, 3)], seed=2)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a person walks@3", Span("a person walks", 3.0)),
        ("a person walks @ 2.5", Span("a person walks", 2.5)),
        (" a person walks ", Span("a person walks")),
        ("meet @ the door@1", Span("meet @ the door", 1.0)),
    ],
)
def test_spans_are_read_as_written(text: str, expected: Span) -> None:
    assert parse_span(text) == expected


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("walk@soon", "--timeline 'walk@soon': expected PROMPT or PROMPT@SECONDS"),
        ("walk@0", "'walk': 0 seconds; expected more than 0 s"),
        ("walk@-2", "-2 seconds"),
        ("walk@nan", "nan seconds"),
        ("walk@inf", "inf seconds"),
    ],
)
def test_wrong_spans_are_refused(text: str, error: str) -> None:
    with pytest.raises(InputError, match=error):
        parse_span(text)


def test_a_timeline_is_prompts_pairs_or_spans() -> None:
    spans = spans_of([WALK, (SIT, 2.0), Span("a person waves", 1.0)])
    assert spans == (Span(WALK), Span(SIT, 2.0), Span("a person waves", 1.0))
    with pytest.raises(InputError, match="the timeline is empty"):
        spans_of([])


def test_spans_begin_within_a_tenth_of_a_second() -> None:
    spans = [Span("a", seconds) for seconds in (1.1, 0.7, 2.33, 0.9, 1.0)] + [Span("b")]
    tokens = tokens_of(spans, [4.0] * 6, 20.0)
    starts = np.cumsum([1.1, 0.7, 2.33, 0.9, 1.0, 4.0])
    assert np.abs(np.cumsum(tokens) * 4 / 20 - starts).max() <= 0.1 + 1e-9
    assert tokens_of([Span("a", 0.01)], [4.0], 20.0) == [1]
    with pytest.raises(InputError, match=r"a timeline of 1e\+09 seconds; expected at most 600"):
        tokens_of([Span("a", 1e9)], [4.0], 20.0)


def test_each_span_knows_the_last_second_and_long_ones_are_made_in_parts() -> None:
    calls: list[tuple[int, int, int]] = []

    def sample_of(number: int):  # type: ignore[no-untyped-def]
        def sample(z: np.ndarray, known: np.ndarray, seed: int) -> np.ndarray:
            calls.append((number, int(known.sum()), len(z)))
            drawn = np.random.default_rng(seed).standard_normal(z.shape)
            return np.where(known[:, None], z, drawn)

        return sample

    z = sampled_spans([12, 30, 3], sample_of, 20, 4, 7)
    assert z.shape == (45, 4)
    assert [number for number, *_ in calls] == [0, 1, 1, 2]
    assert [known for _, known, _ in calls] == [0, KNOWN, KNOWN, KNOWN]
    assert max(length for *_, length in calls) <= 20
    assert (sampled_spans([12, 30, 3], sample_of, 20, 4, 7) == z).all()
    assert (sampled_spans([12, 30, 3], sample_of, 20, 4, 8) != z).any()
    assert (sampled_spans([12, 8], sample_of, 20, 4, 7)[:12] == z[:12]).all()


def test_a_timeline_is_one_motion_with_its_spans(generate: MotionPipeline, motion: Motion) -> None:
    assert len(motion) == 160 and motion.caption == f"{WALK}, then a person jumps, then {SIT}"
    spans = motion.metadata["spans"]
    assert [(span["start"], span["end"]) for span in spans] == [(0, 3), (3, 5), (5, 8)]
    again = generate_timeline(generate, [(WALK, 3), ("a person jumps", 2), (SIT, 3)], seed=2)
    assert (again.joints == motion.joints).all()
    assert (generate_timeline(generate, [(WALK, 3)], seed=3).joints != motion.joints[:60]).any()


def test_transitions_are_smooth(motion: Motion) -> None:
    jerk = np.linalg.norm(np.diff(motion.joints, n=3, axis=0), axis=-1).max(axis=1)
    seams = max(jerk[start - 4 : start + 4].max() for start in (60, 100))
    assert 20**3 * seams < 1000  # m/s³; a jump or a kick has as much
    step = np.linalg.norm(np.diff(motion.joints[:, 0, [0, 2]], axis=0), axis=1)
    assert step.max() < 0.15  # 3 m/s: no jump of the place


def test_each_span_does_what_its_prompt_says(motion: Motion) -> None:
    pelvis = motion.joints[:, 0]
    assert np.linalg.norm(pelvis[55, [0, 2]] - pelvis[0, [0, 2]]) > 1.5
    assert pelvis[60:105, 1].max() > pelvis[:40, 1].mean() + 0.08
    assert pelvis[150:, 1].mean() < pelvis[:40, 1].mean() - 0.2


def test_lengths_left_out_are_predicted(generate: MotionPipeline) -> None:
    usual = generate.usual_seconds([WALK, SIT])
    assert usual is not None
    ends = [span["end"] for span in generate_timeline(generate, [WALK, SIT]).metadata["spans"]]
    assert np.abs(np.array(ends) - np.cumsum(usual)).max() <= 0.1 + 1e-9


def test_the_command_writes_a_timeline(tmp_path: Path) -> None:
    order = ["--timeline", f"{WALK}@2", "--timeline", f"{SIT}@2"]
    main(["generate", *order, "-o", str(tmp_path / "both.npz")])
    motion = Motion.load(tmp_path / "both.npz")
    assert len(motion) == 80 and motion.caption == f"{WALK}, then {SIT}"


def test_a_timeline_has_the_prompts(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["generate", "--timeline", WALK, WALK])
    assert stop.value.code and "--timeline has the prompts" in capsys.readouterr().err


def test_a_scene_may_hold_a_timeline_instead_of_a_prompt(tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    spans = [{"prompt": WALK, "seconds": 2}, {"prompt": SIT}]
    scene.write_text(json.dumps({"format": 1, "timeline": spans}))
    assert read_scene(scene).timeline == (Span(WALK, 2.0), Span(SIT))
    for key, value in (("prompt", "a"), ("seconds", 3), ("headings", [{"at": 1, "degrees": 0}])):
        scene.write_text(json.dumps({"format": 1, "timeline": spans, key: value}))
        with pytest.raises(InputError, match="a timeline has no prompt, length or goals"):
            read_scene(scene)


def test_a_part_is_read_as_written() -> None:
    assert parse_part_span(" right_arm @1-2.6= a person waves the right hand") == WAVE
    assert parse_part_span("legs@0-.5=x=1@2").prompt == "x=1@2"
    for text in ("right_arm@1-3", "right_arm=waves", "right_arm@1=waves", "right_arm@a-b=waves"):
        with pytest.raises(InputError, match="expected PART@START-END=PROMPT"):
            parse_part_span(text)
    with pytest.raises(InputError, match="from 3 to 1 s; expected two ascending times"):
        parse_part_span("right_arm@3-1=a person waves")


@pytest.mark.parametrize(
    ("spans", "error"),
    [
        ([PartSpan("rigt_arm", "a", 1, 2)], "unknown part 'rigt_arm'.*right_arm"),
        ([PartSpan("arms", "a", 1, 4.3)], "ends at 4.3 s, the timeline at 4 s"),
        (
            [PartSpan("arms", "a", 0, 2), PartSpan("right_arm", "b", 1.9, 3)],
            "'a' until 2 s and 'b' from 1.9 s .* belongs to both arms and right_arm",
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused(spans: list[PartSpan], error: str) -> None:
    with pytest.raises(InputError, match=error):
        check_parts(spans, 4.0, HUMANML3D)


def test_parts_may_follow_each_other_or_move_together() -> None:
    both = [PartSpan("right_arm", "a", 0, 2), PartSpan("left_arm", "b", 1, 3)]
    check_parts([*both, PartSpan("arms", "c", 3, 4.05)], 4.0, HUMANML3D)


def test_an_arm_waves_on_a_body_that_walks(generate: MotionPipeline) -> None:
    walk, wave = (
        generate_timeline(generate, [(WALK, 4)]),
        generate_timeline(generate, [(WALK, 4)], parts=[WAVE]),
    )
    arm = [HUMANML3D.names.index(name) for name in ("right_elbow", "right_wrist")]
    others = np.delete(np.arange(22), arm)
    assert (wave.joints[:, others] == walk.joints[:, others]).all()
    assert (wave.joints[np.r_[:20, 52:80]] == walk.joints[np.r_[:20, 52:80]]).all()
    shoulder = HUMANML3D.names.index("right_shoulder")
    above = [m.joints[26:46, arm[1], 1] - m.joints[26:46, shoulder, 1] for m in (wave, walk)]
    assert above[0].mean() > above[1].mean() + 0.3
    parents = list(HUMANML3D.parents[1:])
    bones = [np.linalg.norm(m.joints[:, 1:] - m.joints[:, parents], axis=-1) for m in (wave, walk)]
    assert np.abs(bones[0] - bones[1]).max() < 1e-4
    jerk = [np.abs(np.diff(m.joints, n=3, axis=0)).sum(axis=-1).max(axis=1) for m in (wave, walk)]
    assert jerk[0].max() < 1.5 * jerk[1].max() + 0.05
    assert wave.metadata["spans"][1] == vars(WAVE)
    assert wave.caption == f"{WALK}; right_arm: {WAVE.prompt}"


def test_a_part_may_move_all_the_time(generate: MotionPipeline) -> None:
    whole = ("arms", "a person raises both arms", 0, 0.3)
    short = generate_timeline(generate, [(WALK, 0.3)], parts=[whole])
    assert len(short) == 8 and np.isfinite(short.joints).all()


def test_the_command_takes_parts_and_says_what_they_need(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = ["--timeline-part", f"right_arm@0.5-2={WAVE.prompt}"]
    main(["generate", "--timeline", f"{WALK}@2", *part, "-o", str(tmp_path / "both.npz")])
    assert Motion.load(tmp_path / "both.npz").metadata["spans"][1]["part"] == "right_arm"
    with pytest.raises(SystemExit):
        main(["generate", WALK, *part])
    assert "--timeline-part needs --timeline" in capsys.readouterr().err


def test_a_scene_may_hold_parts(tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    written = {"format": 1, "timeline": [{"prompt": WALK}], "timeline_parts": [vars(WAVE)]}
    scene.write_text(json.dumps(written))
    assert read_scene(scene).timeline_parts == (WAVE,)
    del written["timeline"]
    scene.write_text(json.dumps(written))
    with pytest.raises(InputError, match="timeline_parts needs a timeline"):
        read_scene(scene)
