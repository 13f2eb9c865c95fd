"""Directing through the pipeline, with a small untrained student that was exported."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import Heading, Motion, MotionPipeline, Pose, Reach, RootPath
from latentmotion.cleanup import CleanUpWarning
from latentmotion.cli.main import main
from latentmotion.control.direct import goal_report
from latentmotion.control.edit import generate_between, generate_edited, generate_joined
from latentmotion.errors import InputError, ModelError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.canonical import heading, turn
from tests.support.walker import walker


@pytest.fixture(scope="module")
def generate(student: Path) -> MotionPipeline:
    return MotionPipeline.from_pretrained(student, "onnxruntime", 1)


def test_goals_are_met_exactly_in_the_cleaned_motion(generate: MotionPipeline) -> None:
    free = generate("1", 2.0, 3, clean_up=None).joints
    near = [Reach("right_wrist", 1.0, tuple((free[20, 21] + 0.02).tolist()))]
    near += [Reach("pelvis", 1.6, (float(free[32, 0, 0]), None, float(free[32, 0, 2]) + 0.05))]
    (raw,) = generate.raw_motions(["1"], 2.0, [3], goals=[*near, Heading(1.6, 5)])
    assert raw.goals == (*near, Heading(1.6, 5))
    # The decoder is untrained, so that a few updates leave more than those of real ones.
    assert max(goal["before"] for goal in raw.motion.metadata["goals"][:2]) < 0.1
    cleaned = generate("1", 2.0, 3, goals=[*near, Heading(1.6, 5)])
    assert max(goal["after"] for goal in cleaned.metadata["goals"]) < 1e-3
    assert goal_report(near, raw.motion, cleaned)["goals"][0]["after"] < 1e-3
    assert (generate("1", 2.0, 3, clean_up=None).joints == free).all()


def test_what_nobody_could_do_is_refused_and_the_goal_named() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    goals = [Reach("pelvis", 0.5, (0, None, 0.1)), Reach("right_wrist", 1.5, (-0.2, 1.0, -3.5))]
    with pytest.raises(InputError, match=r"of 12 takes .*right_wrist at 1.5 s was \d+ cm away"):
        pipeline("a person walks forward", 2.0, 0, goals=goals)
    with pytest.warns(CleanUpWarning, match="none of 12 takes"):
        forced = pipeline("a person walks forward", 2.0, 0, goals=goals, force=True)
    assert "right_wrist at 1.5 s was" in forced.metadata["violation"]
    assert forced.metadata["seed"] < 4 and forced.metadata["goals"][1]["after"] < 1e-3


def test_a_pose_at_the_start_says_where_the_motion_starts() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    free = pipeline("a person walks forward", 2.0, 3, takes=1).joints[:1]
    there = turn(free.astype(float), np.array(0.7)) + np.array([3, 0, -2])
    made = pipeline("a person walks", 2.0, 3, goals=[Pose(0, Motion(there))], takes=1)
    (goal,) = made.metadata["goals"]
    assert goal["pose"] == 0 and goal["before"] < 0.15 and goal["after"] < 1e-4
    assert np.abs(made.joints[0] - there[0]).max() < 1e-4


def test_a_path_is_taken(generate: MotionPipeline) -> None:
    path = RootPath([(1, 0), (1, 0.2), (1.1, 0.4)], [0, 1, 1.9])
    motion = generate("1", 2.0, 3, goals=[path])
    assert np.abs(motion.joints[20, 0, ::2] - (1, 0.2)).max() < 1e-3
    assert np.abs(motion.joints[38, 0, ::2] - (1.1, 0.4)).max() < 1e-3


def test_other_frames_of_an_edit_are_the_same_numbers(generate: MotionPipeline) -> None:
    motion = Motion(walker(60).joints())
    edited = generate_edited(generate, motion, "1", (1.0, 1.85), seed=4)
    assert (edited.joints[:20] == motion.joints[:20]).all()
    assert (edited.joints[37:] == motion.joints[37:]).all()
    assert (edited.joints[20:37] != motion.joints[20:37]).any()
    assert (
        generate_edited(generate, motion, "1", (1.0, 1.85), seed=4).joints == edited.joints
    ).all()
    with pytest.raises(InputError, match="nothing of the motion"):
        generate_edited(generate, motion, "1", (0, 3))
    with pytest.raises(InputError, match="resampled"):
        generate_edited(generate, motion.resampled(30), "1", (1, 2))


def test_seams_of_an_edit_stand_on_the_floor() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    walk = pipeline("a person walks forward", 4.0, 1, takes=1)
    for prompt, between in (("a person waves", (1, 2)), ("a person sits down", (2, 4))):
        edited = generate_edited(pipeline, walk, prompt, between, 1)
        heights = edited.joints[..., 1].min(axis=1)
        assert heights.min() > -0.03  # it was -0.12 and -0.13
        assert heights.max() < 0.1
        assert np.abs(np.diff(edited.joints, n=2, axis=0)).max() < 0.2  # nothing jumps


def test_a_goal_does_not_raise_the_body_off_the_floor() -> None:
    pipeline = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    path = RootPath([(0, 0), (0, 2), (1, 3)], [0, 2, 3.9])
    goals = [path, Reach("left_hand", 2.4, (0.5, 1.3, 2.3), 2.8), Heading(3.9, 45)]
    motion = pipeline("a person walks forward", 4.0, 8, goals=goals, takes=1)
    assert max(goal["after"] for goal in motion.metadata["goals"]) < 1e-3
    assert motion.joints[..., 1].min(axis=1).max() < 0.075  # it was 12.6 cm


def test_between_poses_and_motions(generate: MotionPipeline) -> None:
    motion = Motion(walker(60).joints())
    start, end = motion.joints[:1], motion.joints[30:31]
    joined = generate_between(generate, Motion(start), Motion(end), 1.0, "1")
    assert len(joined) == 22
    assert (joined.joints[[0, -1]] == np.concatenate([start, end])).all()
    longer = generate_between(
        generate, Motion(motion.joints[:20]), Motion(motion.joints[40:]), 1.0, "1"
    )
    assert len(longer) == 60
    assert (longer.joints[:20] == motion.joints[:20]).all()
    assert (longer.joints[40:] == motion.joints[40:]).all()
    away = Motion(end + np.float32([0, 0, 30]))
    with pytest.warns(CleanUpWarning, match=r"begins \d+\.\d m from where .* it was put there"):
        moved = generate_between(generate, Motion(start), away, 1.0, "1")
    aligned = generate_between(generate, Motion(start), away, 1.0, "1", align=True)
    assert (moved.joints == aligned.joints).all()
    assert np.linalg.norm(moved.joints[-1, 0] - start[0, 0]) < 2


def test_motions_are_joined_where_each_leads(generate: MotionPipeline) -> None:
    motion = Motion(walker(60).joints(), caption="one")
    turned = turn(motion.joints, np.asarray(2.0)) + np.array([4.0, 0, 1])
    other = Motion(turned.astype("f4"), caption="two")
    whole = generate_joined(generate, [motion, other, other], 0.5, "1")
    assert len(whole) == 3 * 60 + 2 * 10 and whole.caption == "one, then two, then two"
    assert (whole.joints[:60] == motion.joints).all()
    for start in (70, 140):
        part, before = whole.joints[start : start + 60], whole.joints[start - 11]
        shape = part - part[:1, :1]
        angle = heading(part[0], HUMANML3D) - heading(motion.joints[0], HUMANML3D)
        same = turn(motion.joints - motion.joints[0, 0], np.asarray(angle))
        np.testing.assert_allclose(shape, same, atol=1e-4)
        assert abs(heading(part[0], HUMANML3D) - heading(before, HUMANML3D)) < 1e-4
        pace = np.linalg.norm(motion.joints[5, 0] - motion.joints[0, 0]) / 0.25
        assert np.linalg.norm(part[0, 0] - before[0]) == pytest.approx(0.5 * pace, abs=0.1)
    assert len(generate_joined(generate, [motion, other], 0)) == 120
    assert (generate_joined(generate, [motion], 0.5).joints == motion.joints).all()
    with pytest.raises(InputError, match="no motion to join"):
        generate_joined(generate, [], 0.5)


def test_a_pose_is_a_goal(generate: MotionPipeline) -> None:
    pose = Motion(generate("1", 2.0, 3, clean_up=None).joints[20:21])
    cleaned = generate("1", 2.0, 3, goals=[Pose(1.0, pose)])
    assert np.abs(cleaned.joints[20] - pose.joints[0]).max() < 1e-5


def test_a_model_without_a_pullback_says_so(generate: MotionPipeline) -> None:
    older = replace(generate, backend=replace(generate.backend, pullback=None))
    with pytest.raises(ModelError, match=r"no pullback\.onnx.*export it again"):
        older("1", 2.0, goals=[Heading(1.0, 0)])
    assert len(older("1", 2.0)) == 40


def test_the_command_line(
    student: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    common = ["--model", str(student), "--runtime", "onnxruntime"]
    goals = ["--path", "0,0@0 0,.2@1", "--heading", "0@1", "--reach", "head@1=0,1.5,.2"]
    main(["generate", "1", "--seconds", "2", *goals, *common, "-o", "one.npz"])
    printed = capsys.readouterr()
    assert "pelvis at 1 s: 0.0 mm from its goal" in printed.err
    main(["edit", "one.npz", "1", "--between", "0.5", "1.2", *common, "-o", "two.npz"])
    edited, motion = (Motion.load(name) for name in ("two.npz", "one.npz"))
    assert (edited.joints[:10] == motion.joints[:10]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a student: motions are anywhere
        main(["between", "one.npz", "two.npz", "--prompt", "1", *common, "-o", "three.npz"])
    assert len(Motion.load("three.npz")) == 100
    main(["between", "one.npz", "two.npz", "--align", "--prompt", "1", *common, "-o", "five.npz"])
    later = Motion.load("five.npz").joints[60:]
    assert np.linalg.norm(later[0, 0] - edited.joints[0, 0]) > 0.1
    join = ["join", "one.npz", "two.npz", "--trim", "0.5", "1.5", "--prompt", "1", *common]
    main([*join, "--seconds", "0.5", "-o", "six.npz", "six.contacts.csv"])
    assert len(Motion.load("six.npz")) == 50
    assert Path("six.contacts.csv").read_text().startswith("time,event")
    with pytest.raises(SystemExit):
        main(["join", *common])
    assert "no motion file given" in capsys.readouterr().err
    scene = {"format": 1, "prompt": "1", "seconds": 2, "headings": [{"at": 1, "degrees": 3}]}
    Path("scene.json").write_text(json.dumps(scene), encoding="utf-8")
    main(["generate", "--scene", "scene.json", *common, "-o", "four.npz"])
    assert len(Motion.load("four.npz")) == 40
