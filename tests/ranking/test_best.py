from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp
from latentmotion.cli.main import main
from latentmotion.errors import InputError, ModelError
from latentmotion.kinematics.skeleton import KIT
from latentmotion.language.claims import Corrections, Count
from latentmotion.ranking.best import best_of, ranked, usual_takes
from latentmotion.ranking.scorer import Scorer, shipped_scorer
from tests.support import acted
from tests.support.walker import walker

NO_COUNT = CleanUp(exact_count=False)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return Motion(walker(50).joints())


@pytest.fixture(scope="module")
def fast() -> MotionPipeline:
    return MotionPipeline.from_pretrained("fast", threads=1)


def test_vectors_have_unit_length_and_no_company(walk: Motion) -> None:
    scorer = shipped_scorer()
    other = replace(walk, joints=walk.joints[:23])
    together, alone = scorer.motions([walk, other]), scorer.motions([other])
    assert np.allclose(np.linalg.norm(together, axis=1), 1, atol=1e-5)
    assert np.abs(together[1] - alone[0]).max() < 1e-5
    sentences = scorer.texts(["a person walks", "jump twice on the left foot"])
    assert np.array_equal(sentences[:1], scorer.texts(["a person walks"]))


def test_place_heading_and_frame_rate_do_not_matter(walk: Motion) -> None:
    scorer = shipped_scorer()
    moved = replace(walk, joints=walk.joints * [-1, 1, -1] + [3, 0, 5])
    dense = Motion(np.repeat(walk.joints, 2, axis=0)[:-1], fps=40)
    vectors = scorer.motions([walk, moved, dense])
    assert (vectors @ vectors[0]).min() > 0.99


def test_the_score_is_the_match_less_feet_and_floor(walk: Motion) -> None:
    below = replace(walk, joints=walk.joints - [0, 0.3, 0])
    good, bad = ranked([below, walk], "a person walks", shipped_scorer())
    assert good.motion is walk and bad.motion is below
    assert good.text == pytest.approx(bad.text, abs=1e-4)
    assert bad.penetration > good.penetration and bad.score < good.score


@pytest.mark.parametrize(
    ("prompt", "claims"),
    [
        ("turn a full circle to the left", 1),
        ("turn left by 180 degrees", 0.1),
        ("turn right", 0),
        ("a person juggles", 0),
    ],
)
def test_claims_are_graded(walk: Motion, prompt: str, claims: float) -> None:
    (take,) = ranked([walk], prompt, shipped_scorer())
    assert take.claims == pytest.approx(claims, abs=0.11)
    off_floor = take.penetration + take.floating + take.unfinished
    costs = take.sliding + 2 * off_floor + max(0, take.jerk - 150) / 1000
    assert take.score == pytest.approx(2 * take.claims + take.text - costs)


def test_the_take_with_the_degrees_asked_is_preferred() -> None:
    turns = [Motion(acted.turn_in_place(n).astype(np.float32)) for n in (130.0, 60.0, 92.0)]
    best = ranked(turns, "turn left by ninety degrees", shipped_scorer())[0]
    assert best.motion is turns[2]


def test_a_count_that_the_clean_up_mends_is_no_reason_against_a_take() -> None:
    """Two jumps for three: clean-up adds one."""
    prompt, corrections = "a person jumps three times", [Corrections(count=Count("jump", "", 3))]
    twice = Motion(acted.jump(2).astype(np.float32))
    (mended,) = ranked([twice], prompt, shipped_scorer(), CleanUp(), corrections)
    (left,) = ranked([twice], prompt, shipped_scorer(), NO_COUNT, corrections)
    assert mended.claims > left.claims
    assert mended.motion is twice


def test_the_best_tells_of_all_takes(fast: MotionPipeline) -> None:
    takes = fast.ranked("a person kicks", 3, seconds=1.6, seed=5)
    assert [take.score for take in takes] == sorted((t.score for t in takes), reverse=True)
    assert {take.motion.metadata["seed"] for take in takes} == {5, 6, 7}
    best = fast("a person kicks", takes=3, seconds=1.6, seed=5)
    assert takes[0].cleaned is not None and np.array_equal(best.joints, takes[0].cleaned.joints)
    raw = fast("a person kicks", takes=3, seconds=1.6, seed=5, clean_up=None)
    assert np.array_equal(raw.joints, takes[0].motion.joints)
    assert json.loads(json.dumps(best.metadata["best_of"])) == [take.about() for take in takes]


def test_takes_have_several_lengths_where_nobody_gave_one(fast: MotionPipeline) -> None:
    takes = fast.ranked("a person walks", 4, clean_up=None)
    lengths = {take.motion.metadata["seed"]: take.motion.seconds for take in takes}
    usual = fast.usual_seconds(["a person walks"] * 4, [0.5, 0.25, 0.5, 0.75])
    assert [lengths[seed] for seed in range(4)] == pytest.approx(usual, abs=0.025)
    assert len(set(lengths.values())) == 3


def test_a_take_that_ends_in_the_air_is_not_preferred() -> None:
    jumps = acted.jump(2).astype(np.float32)
    highest = int(jumps[..., 0, 1].argmax())
    cut, whole = Motion(jumps[: highest + 1]), Motion(jumps)
    takes = ranked([cut, whole], "a person juggles", shipped_scorer())
    assert {take.motion is cut: take.unfinished > 0.03 for take in takes} == {
        True: True,
        False: False,
    }


def test_a_clip_of_somebody_off_the_floor_is_no_worse(walk: Motion) -> None:
    """As on a ladder: 0.8 m above the floor, on what no motion shows."""
    above = replace(walk, joints=walk.joints + np.array([0, 0.8, 0], np.float32))
    takes = [walk, above]
    best = ranked(takes, "a person climbs", shipped_scorer(), None, advantages=[0.0, 0.9])[0]
    assert best.motion is above and best.floating > 0.1
    assert ranked(takes, "a person climbs", shipped_scorer(), None)[0].motion is walk


def test_one_bow_is_preferred_to_three() -> None:
    bows = [Motion(acted.bow(n).astype(np.float32)) for n in (3, 1)]
    takes = ranked(bows, "a person bows", shipped_scorer())
    assert {take.motion is bows[1]: take.claims > 0.7 for take in takes} == {
        True: True,
        False: False,
    }


def test_one_take_is_the_motion_itself(fast: MotionPipeline) -> None:
    alone = fast("a person kicks", seconds=1.6, seed=2, takes=1)
    assert np.array_equal(best_of(fast.ranked("a person kicks", 1, 1.6, 2)).joints, alone.joints)


@pytest.mark.parametrize(
    ("prompt", "of"), [("a person kicks", 0), ("a person kicks", 999), ("", 4)]
)
def test_what_cannot_be_scored_is_refused(fast: MotionPipeline, prompt: str, of: int) -> None:
    with pytest.raises(InputError, match=f"best of {of}"):
        fast(prompt, takes=of)


def test_other_skeletons_and_too_short_motions_are_refused(walk: Motion) -> None:
    with pytest.raises(InputError, match="'kit'"):
        shipped_scorer().motions([Motion(KIT.rest_joints()[None].repeat(9, 0), skeleton=KIT)])
    with pytest.raises(InputError, match=r"0\.3 s or more"):
        shipped_scorer().motions([replace(walk, joints=walk.joints[:4])])


def test_a_folder_that_is_no_scorer_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"no scorer\.json"):
        Scorer.load(tmp_path)
    (tmp_path / "scorer.json").write_text("{}")
    with pytest.raises(ModelError, match="missing key"):
        Scorer.load(tmp_path)


def test_the_command_line_tells_scores(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = f"-o {tmp_path}/kick.npz --seconds 1.6 --no-cache --threads 1"
    main(["generate", "a person kicks", *f"--best-of 2 --json {out}".split()])
    captured = capsys.readouterr()
    (motion,) = json.loads(captured.out)["motions"]
    assert set(motion["best_of"][0]) == {
        *("seed", "score", "claims", "text", "sliding", "penetration", "floating"),
        *("unfinished", "jerk", "advantage"),
    }
    assert "best of 2: seed" in captured.err


def test_the_command_keeps_the_best_of_four_takes_of_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = f"-o {tmp_path}/kick.npz --seconds 1.6 --seed 3 --no-cache --threads 1"
    main(["generate", "a person kicks", *f"--count 2 --json {out}".split()])
    motions = json.loads(capsys.readouterr().out)["motions"]
    seeds = [{take["seed"] for take in motion["best_of"]} for motion in motions]
    assert seeds == [{3, 4, 5, 6}, {7, 8, 9, 10}]


def test_one_take_is_usual_where_takes_are_slow_or_cannot_be_scored(fast: MotionPipeline) -> None:
    card = fast.card
    slow = replace(card, sampling=replace(card.sampling, steps=50))
    assert usual_takes(card, "a person kicks") == 4
    assert [usual_takes(slow, "a person kicks"), usual_takes(card, " ")] == [1, 1]
    assert usual_takes(replace(card, representation="kit"), "a person kicks") == 1


@pytest.mark.parametrize(
    "words", [["--timeline", "a person walks", "--best-of", "2"], ["walk", "--best-of", "0"]]
)
def test_mistakes_are_named(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["generate", *words, "-o", str(tmp_path / "out.npz")])
    assert stop.value.code == 2 and "best" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
