"""Figures of the benchmark: intervals, chance, real motions, the report and its JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.instructions import GROUPS, Instruction, parse
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.benchmark import (
    OVERALL,
    PAGE_FILE,
    REPORT_FILE,
    VERSION,
    Benchmark,
    CaptionClaim,
    Outcome,
    Share,
    chance_outcomes,
    effective_size,
    judge,
    markdown,
    outcome_of,
    shares,
    table,
    wilson,
    write,
    write_prompts,
)
from latentmotion.evaluation.instructions.detectors import Body
from latentmotion.training.checking import meets
from tests.support import acted

ASKED = (
    Instruction("side-01", "side", "kick with the left leg", parse("kick(left)")),
    Instruction("side-02", "side", "kick with the right leg", parse("kick(right)")),
    Instruction("counts-01", "counts", "jump twice", parse("jump(2)"), 3.0),
    Instruction("order-01", "order", "walk, then wave", parse("walk > wave")),
)
KICK = acted.kick("left")
TAKES = ([KICK, KICK], [KICK, acted.kick("right")], [acted.jump(2)] * 2, [acted.walk()] * 2)


@pytest.fixture(scope="module")
def found() -> Benchmark:
    real = [CaptionClaim("0001", "he kicks left", "side", parse("kick(left)"), KICK)]
    trained = {one.id: partial(meets, one.check) for one in ASKED[:2]}
    return judge("mine", {"motions": "raw"}, ASKED, TAKES, real, trained)


def rows(*verdicts: str) -> list[np.ndarray]:
    return [np.array([one == "1" for one in text]) for text in verdicts]


@pytest.mark.parametrize(
    ("verdicts", "size"),
    [
        (("1", "0", "1"), 3),
        (("11", "00"), 2),
        (("11", "11"), 2),
        (("10", "01", "10"), 6),
        (("1010",), 1),
    ],
)
def test_takes_that_are_alike_count_once(verdicts: tuple[str, ...], size: float) -> None:
    assert effective_size(rows(*verdicts)) == pytest.approx(size)


def test_a_mixture_of_takes_lies_between() -> None:
    size = effective_size(rows("1110", "0001", "1101", "0000", "1111"))
    assert 5 < size < 20


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("count", [1.0, 7.5, 400.0])
def test_an_interval_holds_its_share(share: float, count: float) -> None:
    low, high = wilson(share, count)
    assert 0 <= low <= share + 1e-9 and share - 1e-9 <= high <= 1
    narrower = wilson(share, 10 * count)
    assert narrower[1] - narrower[0] < high - low
    mirrored = wilson(1 - share, count)
    assert mirrored == pytest.approx((1 - high, 1 - low))


def test_a_share_counts_motions_and_prompts() -> None:
    share = Share.of([[True, False], [False, False], [True, True], []])
    assert (share.share, share.motions, share.prompts) == (0.5, 6, 3)
    assert share.ever == pytest.approx(2 / 3)
    assert str(replace(share, low=0.21, high=0.786)) == "50 % (21–79)"


def test_verdicts_of_the_takes(found: Benchmark) -> None:
    fulfilled = [one.fulfilled for one in found.outcomes]
    assert fulfilled == [(True, True), (False, True), (True, True), (False, False)]
    assert [one.id for one in found.outcomes] == [one.id for one in ASKED]
    assert found.outcomes[2].check == "jump(2)"
    assert found.outcomes[2].seconds == (len(TAKES[2][0]) / 20,) * 2
    assert (found.subject, found.version) == ("mine", VERSION)


def test_figures_are_by_group_and_overall(found: Benchmark) -> None:
    assert list(found.model) == ["side", "counts", "order", OVERALL]
    assert [share.share for share in found.model.values()] == [0.75, 1, 0, 0.625]
    assert found.model["side"].prompts == 2 and found.model[OVERALL].prompts == 4
    assert list(found.real) == ["side", OVERALL] and found.real["side"].share == 1
    assert list(found.trained) == ["side", OVERALL] and found.trained[OVERALL].share == 0.75
    assert found.real_outcomes[0].id == "0001" and found.real_outcomes[0].prompt == "he kicks left"


def test_groups_are_in_the_order_of_reports() -> None:
    outcomes = [
        Outcome(f"{group}-01", group, "", "", (True,), (1.0,)) for group in reversed(GROUPS)
    ]
    assert list(shares(outcomes)) == [*GROUPS, OVERALL]
    assert shares([]) == {}


def test_outcomes_of_one_clip_are_dependent() -> None:
    alike = [Outcome("clip", "side", "", "", (True,), (1.0,))] * 3
    other = Outcome("other", "side", "", "", (False,), (1.0,))
    assert shares([*alike, other])["side"].prompts == 2


def test_chance_takes_motions_of_other_groups(found: Benchmark) -> None:
    bodies = [[Body(motion) for motion in takes] for takes in TAKES]
    chance = chance_outcomes(ASKED, bodies)
    assert [one.fulfilled for one in chance[:2]] == [(False, False)] * 2  # never a kick of its own
    assert chance == chance_outcomes(ASKED, bodies)
    assert all(len(one.fulfilled) == 2 for one in chance)
    assert set(found.chance) == set(found.model)


def test_an_outcome_has_the_words_of_its_instruction() -> None:
    one = outcome_of(ASKED[0], [Body(KICK)])
    assert (one.id, one.group, one.prompt) == ("side-01", "side", "kick with the left leg")
    assert (one.check, one.fulfilled) == ("kick(left)", (True,))


@pytest.mark.parametrize("frames", [0, 3])
def test_a_motion_that_is_too_short_is_refused(frames: int) -> None:
    with pytest.raises(InputError):
        judge("mine", {}, ASKED[:1], [[KICK[:frames]]])


def test_the_table_has_a_line_per_group(found: Benchmark) -> None:
    lines = table(found).splitlines()
    assert lines[0].split(" | ")[2] == "mine" and set(lines[1]) == {"|", "-"}
    assert len(lines) == 2 + 4 and len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| side | 2 | 75 %") and "100 %" in lines[2]
    assert "1 claims" in lines[2] and "| – |" in lines[3]
    assert lines[-1].startswith("| **overall** | 4 |")


def test_the_page_lists_every_prompt(found: Benchmark) -> None:
    page = markdown(found)
    assert page.startswith(f"# Instructions, version {VERSION}: mine")
    assert "* motions: raw" in page
    assert "| side-02 | kick with the right leg | `kick(right)` | 1 of 2 |" in page
    assert all(one.prompt in page for one in ASKED)


def test_the_json_holds_everything(found: Benchmark, tmp_path: Path) -> None:
    write(found, tmp_path / "report")
    report = json.loads((tmp_path / "report" / REPORT_FILE).read_text(encoding="utf-8"))
    assert report["subject"] == "mine" and report["about"] == {"motions": "raw"}
    assert report["model"]["side"]["share"] == 0.75
    assert report["outcomes"][1]["fulfilled"] == [False, True]
    assert report["real_outcomes"][0]["prompt"] == "he kicks left"
    assert report["chance"].keys() == report["model"].keys()
    assert (tmp_path / "report" / PAGE_FILE).read_text(encoding="utf-8") == markdown(found) + "\n"


def test_a_report_replaces_a_report_only(found: Benchmark, tmp_path: Path) -> None:
    write(found, tmp_path / "report")
    write(replace(found, subject="yours"), tmp_path / "report")
    assert '"yours"' in (tmp_path / "report" / REPORT_FILE).read_text()
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "dog.txt").write_text("dog")
    with pytest.raises(InputError):
        write(found, tmp_path / "photos")
    assert (tmp_path / "photos" / "dog.txt").read_text() == "dog"


def test_prompts_are_written_with_seeds(tmp_path: Path) -> None:
    write_prompts(tmp_path / "prompts.csv", 3)
    lines = (tmp_path / "prompts.csv").read_text(encoding="utf-8").splitlines()
    seeds = [line.rsplit(",", 1)[1].split() for line in lines[1:]]
    assert all(len(row) == 3 for row in seeds)
    assert len({seed for row in seeds for seed in row}) == 3 * len(seeds)
    with pytest.raises(InputError):
        write_prompts(tmp_path / "none" / "prompts.csv", 1)
