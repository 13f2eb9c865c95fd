"""A study by its definitions: closed forms of its numbers, its design, answers read strictly."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import DataError, InputError
from latentmotion.motion import Motion
from latentmotion.storage.configuration import write_json
from latentmotion.study.design import KEY_FORMAT, KeyPair, Pair, StudyKey, asked, design
from latentmotion.study.report import (
    ANSWERS_FORMAT,
    Answer,
    Answers,
    Vote,
    Z,
    krippendorff,
    observed_agreement,
    read_answers,
    read_key,
    report,
    sign_test,
    votes_of,
    wilson,
)

QUESTIONS = {"realism": "Which is more realistic?", "text": "Which fits the text?"}
KEY = StudyKey(
    KEY_FORMAT,
    "abc",
    "one",
    "two",
    0,
    QUESTIONS,
    (KeyPair("p", "a person walks", 0, "A"), KeyPair("q", "a person sits", 1, "B")),
)


def answers(*given: tuple[str, str, str], rater: str = "x", **changes: str) -> Answers:
    rows = tuple(Answer(pair, question, side, 1.0) for pair, question, side in given)  # type: ignore[arg-type]
    return replace(Answers(ANSWERS_FORMAT, "abc", rater, "", "2026-01", rows), **changes)


# Statistics


@pytest.mark.parametrize("n", [1, 7, 50])
def test_an_interval_of_the_losses_is_that_of_the_wins_turned_over(n: int) -> None:
    for wins in range(n + 1):
        low, high = wilson(wins, n)
        assert 0 <= low <= wins / n + 1e-12 and wins / n - 1e-12 <= high <= 1
        assert wilson(n - wins, n) == pytest.approx((1 - high, 1 - low))
    none = Z * Z / (n + Z * Z)  # of k = 0: both terms are z²/2n
    assert wilson(0, n) == pytest.approx((0, none))
    assert wilson(n, n) == pytest.approx((1 - none, 1))


def test_four_times_the_answers_are_known_some_twice_as_well() -> None:
    widths = [np.ptp(wilson(n // 2, n)) for n in (100, 400, 1600)]
    assert widths[0] / widths[1] == pytest.approx(2, rel=0.02)
    assert widths[1] / widths[2] == pytest.approx(2, rel=0.005)
    assert wilson(3, 7, 0.0) == pytest.approx((3 / 7, 3 / 7)) and wilson(0, 0) == (0, 1)


@pytest.mark.parametrize("n", [1, 2, 9, 24])
def test_p_is_the_share_of_outcomes_that_are_as_uneven(n: int) -> None:
    outcomes = Counter(bin(number).count("1") for number in range(2 ** min(n, 12)))
    for wins in range(n + 1):
        assert sign_test(wins, n) == sign_test(n - wins, n)
        if n <= 12:
            uneven = abs(2 * wins - n)
            extreme = sum(c for k, c in outcomes.items() if abs(2 * k - n) >= uneven)
            assert sign_test(wins, n) == pytest.approx(extreme / 2**n)
    assert sign_test(n, n) == 2 / 2**n and sign_test(0, 0) == 1


def test_raters_who_always_agree_and_who_never_do() -> None:
    assert observed_agreement(["aaa", "bb"]) == 1 and krippendorff(["aaa", "bb"]) == 1
    assert observed_agreement(["ab", "ba"]) == 0
    # Two raters, n items, always apart: D_o = 1, D_e = n / (2n - 1).
    for n in (1, 2, 10):
        assert krippendorff(["ab"] * n) == pytest.approx(1 - (2 * n - 1) / n)
    assert observed_agreement(["a", ""]) is None and krippendorff(["a", "b"]) is None
    assert krippendorff(["aa", "aa"]) is None  # nothing to expect where all say one thing


def test_names_of_labels_and_items_of_one_rater_do_not_matter() -> None:
    ratings = ["aab", "ab", "bbb", "aaab"]
    swapped = [item.translate(str.maketrans("ab", "ba"))[::-1] for item in reversed(ratings)]
    assert krippendorff(swapped) == pytest.approx(krippendorff(ratings))
    assert krippendorff([*ratings, "a"]) == pytest.approx(krippendorff(ratings))
    assert observed_agreement([*ratings, "a"]) == observed_agreement(ratings)


# Design


def pairs(count: int, prompt: str = "walk") -> list[Pair]:
    def motion(value: float) -> Motion:
        return Motion(np.full((2, 22, 3), value, np.float32))

    return [
        Pair(f"{prompt} {n}" if prompt else "", n, motion(n), motion(-n - 1)) for n in range(count)
    ]


@pytest.mark.parametrize("count", [1, 2, 7, 20])
def test_all_pairs_are_shown_once_half_of_them_with_a_on_the_left(count: int) -> None:
    study = design(pairs(count), "one", "two", 3)
    assert sorted(row.seed for row in study.key.pairs) == list(range(count))
    assert sum(row.left == "A" for row in study.key.pairs) == (count + 1) // 2
    assert len({row.id for row in study.key.pairs}) == count
    for row, (left, right) in zip(study.key.pairs, study.motions, strict=True):
        a, b = (left, right) if row.left == "A" else (right, left)
        assert (a.joints[0, 0, 0], b.joints[0, 0, 0]) == (row.seed, -row.seed - 1)


def test_the_name_of_a_study_is_that_of_what_it_shows() -> None:
    name = design(pairs(5), "one", "two", 3).key.study
    assert design(pairs(5), "other", "words", 3).key.study == name
    assert design(pairs(5), "one", "two", 4).key.study != name
    assert design(pairs(5, "run"), "one", "two", 3).key.study != name
    assert design([*pairs(4), pairs(6)[5]], "one", "two", 3).key.study != name
    with pytest.raises(InputError, match="no pair to show"):
        design([], "one", "two", 0)


def test_who_has_no_words_is_not_asked_for_them() -> None:
    assert list(design(pairs(2, ""), "one", "two", 0).key.questions) == ["realism"]
    assert asked("", ["realism", "text"]) == ["realism"]
    assert asked("walk", ["realism", "text"]) == ["realism", "text"]


# Answers


def test_a_choice_of_a_side_is_one_of_the_model_there() -> None:
    given = answers(("p", "realism", "left"), ("q", "realism", "left"), ("q", "text", "right"))
    assert votes_of([given], KEY) == [
        Vote("x", "p", "realism", "A", "left"),
        Vote("x", "q", "realism", "B", "left"),
        Vote("x", "q", "text", "A", "right"),
    ]


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (answers(format="other 1"), InputError, f"expected format '{ANSWERS_FORMAT}', found"),
        (answers(study="def"), DataError, "answers to study def, the key is of abc"),
        (answers(("r", "realism", "left")), DataError, "pair 'r', question 'realism' is unknown"),
        (answers(("p", "beauty", "left")), DataError, "question 'beauty' is unknown"),
        (answers(*[("p", "text", "left")] * 2), DataError, "or answered twice"),
    ],
)
def test_answers_that_do_not_fit_the_key_are_named(
    given: Answers, error: type[Exception], message: str, tmp_path: Path
) -> None:
    write_json(tmp_path / "x.json", given)
    with pytest.raises(error, match=message):
        read_answers([tmp_path / "x.json"], KEY)


def test_a_key_comes_back_and_another_format_is_refused(tmp_path: Path) -> None:
    write_json(tmp_path / "key.json", KEY)
    assert read_key(tmp_path / "key.json") == KEY
    write_json(tmp_path / "key.json", replace(KEY, format="study 9"))
    with pytest.raises(InputError, match=f"expected format '{KEY_FORMAT}', found 'study 9'"):
        read_key(tmp_path / "key.json")


def test_a_report_of_the_models_exchanged_is_the_report_turned_over() -> None:
    generator = np.random.default_rng(0)
    votes = [
        Vote(rater, pair, question, generator.choice(["A", "B"], p=[0.8, 0.2]), "left")
        for rater in "xyz"
        for pair in "pq"
        for question in QUESTIONS
    ]
    other = {"A": "B", "B": "A"}
    swapped = [replace(vote, model=other[vote.model]) for vote in votes]
    for one, two in zip(report(votes, KEY).preferences, report(swapped, KEY).preferences,
                        strict=True):  # fmt: skip
        assert one.for_a + two.for_a == one.answers == two.answers == 6
        assert one.interval == pytest.approx((1 - two.interval[1], 1 - two.interval[0]))
        assert (one.p_answers, one.p_pairs) == (two.p_answers, two.p_pairs)
        assert one.pairs == (two.pairs[1], two.pairs[0], two.pairs[2]) and sum(one.pairs) == 2
        assert (one.agreement, one.left) == (two.agreement, 1.0)
