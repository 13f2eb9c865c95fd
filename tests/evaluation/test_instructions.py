"""The instruction benchmark: motions of known truth, folders of joints, figures, the command."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.clip import Caption
from latentmotion.data.instructions import GROUPS, instructions, parse, refused_captions
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.evaluation.instructions import benchmark as asked
from latentmotion.evaluation.instructions import detectors
from latentmotion.evaluation.instructions.benchmark import Share, judge, markdown, patterns, wilson
from latentmotion.evaluation.instructions.motions import read_joints_folder
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.language.words import plain
from latentmotion.measure.scene import describe
from latentmotion.model.card import CARD_FILE, find_model, read_card
from latentmotion.training.checking import ACTS, CONDITIONS, fulfills, validate
from latentmotion.training.drawn_instructions import drawn_instructions

FRAMES = 80
JOINT = {name: index for index, name in enumerate(HUMANML3D.names)}


def figure(
    ahead: np.ndarray | float = 0.0,
    left: np.ndarray | float = 0.0,
    turned: np.ndarray | float = 0.0,
    **moved: np.ndarray,
) -> np.ndarray:
    """A standing body that glides at speeds (m/s) as it sees them, and turns (degrees so far).

    `moved` adds offsets (frames, 3) in the body's own axes to joints.
    """
    rest = HUMANML3D.rest_joints()
    rest[:, 1] -= rest[:, 1].min()
    body = np.repeat(rest[None], FRAMES, axis=0)
    for name, offset in moved.items():
        body[:, JOINT[name]] += offset
    angle = np.radians(np.broadcast_to(turned, FRAMES).astype(float))
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    speed = np.stack([np.broadcast_to(left, FRAMES), np.broadcast_to(ahead, FRAMES)], axis=1)
    step = np.concatenate(
        [c * speed[:, :1] + s * speed[:, 1:], c * speed[:, 1:] - s * speed[:, :1]], 1
    )
    x, z = body[..., 0], body[..., 2]
    world = np.stack([c * x + s * z, body[..., 1], c * z - s * x], axis=-1)
    return world + np.insert(np.cumsum(step / 20, axis=0), 1, 0.0, axis=1)[:, None]


def between(start: int, end: int, value: float = 1.0) -> np.ndarray:
    """Rises from 0 to a value from one frame to another, smoothly."""
    part = np.clip((np.arange(FRAMES) - start) / (end - start), 0, 1)
    return value * (3 * part**2 - 2 * part**3)


def bump(start: int, end: int, value: float = 1.0) -> np.ndarray:
    """Rises and falls again."""
    middle = (start + end) // 2
    return between(start, middle, value) - between(middle, end, value)


def upward(height: np.ndarray) -> np.ndarray:
    return np.stack([0 * height, height, 0 * height], axis=1)


def done(joints: np.ndarray, check: str) -> bool:
    return fulfills(describe(joints), parse(check))


LEFT_TURN = figure(ahead=1.2, turned=between(20, 60, 90))
RIGHT_TURN = figure(ahead=1.2, turned=between(20, 60, -90))
CIRCLE = figure(ahead=1.5, turned=np.linspace(0, 360, FRAMES))
HAND = figure(left_wrist=upward(bump(10, 60, 0.9)), left_elbow=upward(bump(10, 60, 0.45)))
GONE_AND_STOPPED = figure(ahead=1.2 - between(35, 45, 1.2))
JUMP = figure() + upward(bump(30, 42, 0.35))[:, None]
TWO_JUMPS = figure() + upward(bump(15, 27, 0.35) + bump(50, 62, 0.35))[:, None]


@pytest.mark.parametrize(
    ("joints", "does", "does_not"),
    [
        (LEFT_TURN, "turn(left, 60, 120) & travel(2)", "turn(right, 60, 120)"),
        (RIGHT_TURN, "turn(right, 60, 120)", "turn(left, 60, 120)"),
        (LEFT_TURN, "walk > turn(left, 60, 120)", "walk > turn(right, 60, 120)"),
        (CIRCLE, "turn(left, 270, 4000) & travel(2)", "turn(right, 270, 4000)"),
        (HAND, "raise(left)", "raise(right)"),
        (HAND, "raise(any)", "raise(both)"),
        (figure(ahead=-0.8), "move(backward, 0.8)", "move(forward, 0.8)"),
        (figure(left=0.7), "move(left, 0.4) & facing(45)", "move(right, 0.4)"),
        (figure(left=-0.7), "move(sideways, 0.4)", "move(left, 0.1)"),
        (figure(ahead=1.2), "move(forward, 1) & straight(20)", "in_place(0.8)"),
        (figure(ahead=0.5), "speed(0.1, 0.9)", "speed(1.35, 2.6)"),
        (figure(ahead=2.9), "travel(2) & speed(2, 9)", "travel(2) & speed(0.5, 1.8)"),
        (figure(ahead=0.4 + between(20, 60, 1.0)), "faster(1.3)", "slower(1.3)"),
        (GONE_AND_STOPPED, "walk > halt", "halt > walk"),
        (GONE_AND_STOPPED, "slower(1.3)", "faster(1.3)"),
        (figure(), "still(0.7)", "travel(0.3)"),
        (figure(), "upright & in_place(0.4)", "crouch"),
        (JUMP, "jump(1) & height(0.25)", "jump(2)"),
        (TWO_JUMPS, "jump(2)", "jump(1)"),
        (
            figure(turned=40 * np.sin(np.arange(FRAMES) / 6), ahead=1.0),
            "weave(20)",
            "turn(either, 90, 400)",
        ),
    ],
)
def test_motions_of_known_truth(joints: np.ndarray, does: str, does_not: str) -> None:
    validate(parse(does))
    validate(parse(does_not))
    assert done(joints, does)
    assert not done(joints, does_not)


def test_the_list_is_well_formed() -> None:
    listed = instructions()
    assert len({one.id for one in listed}) == len(listed) == 252
    assert len({one.prompt.lower() for one in listed}) == len(listed)
    assert tuple(dict.fromkeys(one.group for one in listed)) == GROUPS
    for one in listed:
        validate(one.check)
        assert re.fullmatch(r"[a-z]+-\d\d", one.id) and one.prompt.strip() == one.prompt
        assert one.group.startswith(one.id[:-3])
        assert one.seconds is None or 2 <= one.seconds <= 9.8
        assert parse(str(one.check)) == one.check
    seeds = [seed for one in listed for seed in one.seeds(5)]
    assert len(set(seeds)) == len(seeds) and listed[0].seeds(5)[:2] == listed[0].seeds(2)


def test_left_and_right_are_asked_alike() -> None:
    said = " ".join(str(one.check) for one in instructions() if one.group in ("side", "turns"))
    assert abs(said.count("left") - said.count("right")) <= 3


def test_drawn_prompts_are_other_ones_whose_checks_demand_what_they_say() -> None:
    drawn = drawn_instructions(400, seed=1)
    assert {one.group for one in drawn} == set(GROUPS)
    assert not {plain(one.prompt) for one in drawn} & refused_captions()
    for one in drawn:
        validate(one.check)
        demanded = re.search(r"\b(left|right)\b(?!,? head)", str(one.check))
        says = re.search(r"left|right|clockwise", one.prompt, re.IGNORECASE)
        assert bool(demanded) <= bool(says), one
        if one.group == "counts" and re.search(r"\b(?:twice|two times)\b", one.prompt):
            assert re.search(r"\b2\b", str(one.check)), one
    assert drawn == drawn_instructions(400, seed=1)


def test_every_act_and_condition_is_used() -> None:
    terms = {term.name for one in instructions() for term in one.check.terms}
    assert terms == set(ACTS) | set(CONDITIONS)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("fly", "unknown 'fly'"),
        ("kick(top)", "unknown word 'top'"),
        ("turn(left)", "expected 2 numbers"),
        ("turn(left, 90, 60)", "smaller number first"),
        ("travel(1) > walk", "unknown 'travel'"),
        ("kick(2, left)", "words before numbers"),
        ("walk > sit & jump", "not both"),
        ("kick(right", "expected a term"),
        ("__import__('os')", "unknown '__import__'"),
    ],
)
def test_wrong_checks_are_refused(text: str, told: str) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        validate(parse(text))


def test_captions_of_real_motions_are_read() -> None:
    def claims(caption: str) -> set[str]:
        text = Caption(caption, 0, 80).text
        return {
            f"{one.group}: {one.check}" for one in patterns("captions") if one.words.search(text)
        }

    assert "side: net(left, 15, 400)" in claims("a man turns to his left and stops.")
    assert "side: kick(right)" in claims("someone kicks with their right leg")
    assert claims("a person waves") == set()
    assert any(one.startswith("order: walk > sit") for one in claims("he walks over and sits down"))
    known = {*detectors.ACTS, *detectors.CONDITIONS}
    for pattern in (*patterns("captions"), *patterns("labels")):
        assert {term.name for term in pattern.check.terms} <= known
        assert pattern.group in GROUPS


def test_intervals() -> None:
    assert wilson(0.5, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0, 0.2775), abs=1e-4)
    assert wilson(1, 10) == pytest.approx((0.7225, 1), abs=1e-4)
    alike, mixed = Share.of([[True] * 5, [False] * 5] * 10), Share.of([[True, False]] * 50)
    assert alike.share == mixed.share == 0.5 and alike.motions == mixed.motions == 100
    # Takes that are all alike are worth one each: 20 motions in all.
    assert (alike.low, alike.high) == pytest.approx(wilson(0.5, 20), abs=1e-6)
    assert (mixed.low, mixed.high) == pytest.approx(wilson(0.5, 100), abs=1e-6)
    assert alike.ever == 0.5 and mixed.ever == 1
    assert Share.of([[True] * 5]).low == pytest.approx(wilson(1, 1)[0])
    assert str(wilson(0, 3)) and str(Share.of([[False], [True]])).startswith("50 %")


def test_figures_by_group() -> None:
    listed = [one for one in asked.instructions() if one.id in ("side-05", "turn-02", "action-26")]
    found = judge("someone", {}, listed, [[LEFT_TURN, RIGHT_TURN], [LEFT_TURN] * 2, [figure()] * 2])
    assert [one.fulfilled for one in found.outcomes] == [(True, False), (True,) * 2, (True,) * 2]
    assert found.model["side"].share == 0.5 and found.model["overall"].share == pytest.approx(5 / 6)
    assert found.model["side"].motions == 2 and not found.real
    assert "| side | 1 | 50 %" in markdown(found)


def write_folder(folder: Path, joints: np.ndarray) -> Path:
    folder.mkdir()
    for one in instructions():
        np.save(folder / f"{one.id}_0.npy", joints.astype(np.float32))
    return folder


def test_a_folder_of_joints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "theirs", LEFT_TURN + np.array([0, 0.3, 0]))
    faster = np.repeat(LEFT_TURN, 3, axis=0)
    (folder / "side-01_0.npy").unlink()
    np.savez(folder / "side-01_0.npz", joints=faster, fps=60.0)
    given = ["evaluate", "--instructions", "--takes", "1", "--joints", str(folder)]
    main([*given, "-o", str(tmp_path / "report")])
    printed = capsys.readouterr().out
    assert "| group | prompts | theirs |" in printed and "| side | 40 |" in printed
    report = json.loads((tmp_path / "report" / "instructions.json").read_text())
    done = {one["id"]: one["fulfilled"] for one in report["outcomes"]}
    assert done["side-01"] == done["turn-02"] == [True] and done["side-02"] == [False]
    assert report["version"] == 2 and len(report["outcomes"]) == 252
    assert (tmp_path / "report" / "instructions.md").is_file()


def test_a_folder_says_what_is_wrong(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "theirs", LEFT_TURN)
    wrong = folder / "side-03_0.npy"

    def refused(error: type[Exception], told: str, takes: int = 1, fps: float = 20.0) -> None:
        with pytest.raises(error, match=told) as caught:
            read_joints_folder(folder, instructions(), takes, fps)
        assert "\n" not in str(caught.value)

    refused(DataError, "lacks 252 of 504 files, the first side-01_1.npy", takes=2)
    refused(InputError, "expected 1 to 1000", fps=0)
    refused(FileFormatError, "lasts 0.32 s", fps=250)
    for array, told in (
        (LEFT_TURN[:, :21], r"found float64 of shape \(80, 21, 3\)"),
        (LEFT_TURN[:3], "found 3 frames"),
        (LEFT_TURN.astype(int), "found int64"),
        (np.where(np.arange(80)[:, None, None] > 70, np.nan, LEFT_TURN), "NaN"),
        (np.array(["a", None], dtype=object), "shape"),
    ):
        np.save(wrong, array, allow_pickle=True)
        refused(FileFormatError, told)
    wrong.write_bytes(b"\x93NUMPY broken")
    refused(FileFormatError, "expected an array")
    wrong.unlink()
    np.savez(wrong.with_suffix(".npz"), positions=LEFT_TURN)
    refused(FileFormatError, "joints")
    for name, joints in (("lying", LEFT_TURN[..., [0, 2, 1]]), ("millimeters", LEFT_TURN * 1000)):
        folder = write_folder(tmp_path / name, joints)
        refused(DataError, "expected y up" if name == "lying" else "expected positions in meters")


def test_the_command_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, told in (
        (["--instructions"], "MODEL is missing"),
        (["fast", "--instructions", "--takes", "0"], "--takes 0: expected 1 or more"),
        (["fast", "--joints", str(tmp_path)], "not both"),
        (["--joints", str(tmp_path / "none")], "is no folder"),
        (["fast"], "--data is missing"),
    ):
        with pytest.raises(SystemExit):
            main(["evaluate", *words])
        error = capsys.readouterr().err
        assert told in error and error.count("\n") == 1


def test_prompts_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["evaluate", "--instructions", "--prompts", str(tmp_path / "prompts.csv")])
    lines = (tmp_path / "prompts.csv").read_text().splitlines()
    assert lines[0] == "id,group,prompt,check,seconds,seeds" and len(lines) == 253
    assert "252 prompts" in capsys.readouterr().out


def test_a_model_is_asked_without_pytorch_and_its_card_tells(tmp_path: Path) -> None:
    model, shipped = tmp_path / "m", find_model("fast")
    model.mkdir()
    for path in shipped.iterdir():
        (model / path.name).symlink_to(path)
    (model / CARD_FILE).unlink()
    replace(read_card(shipped), figures={"fid": 0.5}).write(model)
    code = (
        "import sys; from latentmotion.cli.main import main;"
        "from latentmotion.evaluation.instructions import benchmark as p;"
        "few = tuple(o for o in p.instructions() if o.id in ('side-01', 'pace-18', 'pace-19'));"
        "import latentmotion.cli.evaluate as c; c.instructions = lambda: few;"
        f"main(['evaluate', {str(model)!r}, '--takes', '2', '--instructions', '--card',"
        f" '-o', {str(tmp_path / 'r')!r}]);"
        "print('torch' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.endswith("False\n")
    report = json.loads((tmp_path / "r" / "instructions.json").read_text())
    lengths = {one["id"]: one["seconds"] for one in report["outcomes"]}
    assert lengths["pace-18"] == [2.0, 2.0] and lengths["pace-19"] == [8.0, 8.0]
    assert report["about"]["motions"] == "cleaned"
    shares = {group: one["share"] for group, one in report["model"].items()}
    assert {"side", "pace"} <= set(shares)
    assert read_card(model).figures == {"fid": 0.5, "instructions": pytest.approx(shares, abs=1e-4)}
    assert "instructions" not in read_card(shipped).figures
