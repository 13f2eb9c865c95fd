"""The user study: what the statistics say, and a page that a browser clicks through."""

from __future__ import annotations

import html
import itertools
import json
import re
from math import comb
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.motion import Motion
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.study.design import (
    Pair,
    StudyKey,
    check_lengths,
    design,
    study_html,
)
from latentmotion.study.report import (
    Answer,
    Answers,
    krippendorff,
    observed_agreement,
    read_answers,
    read_key,
    report,
    sign_test,
    votes_of,
    wilson,
)
from tests.support.pages import HOSTILE, Elements, chromium, walking

PROMPTS = ("a person walks", HOSTILE, "someone strolls")


def pairs() -> list[Pair]:
    speeds = ((1.2, 0.4), (0.9, 0.3), (1.5, 0.2))
    return [
        Pair(prompt, 0, *(walking(1.0, f"model {speed}", speed) for speed in both))
        for prompt, both in zip(PROMPTS, speeds, strict=True)
    ]


# Statistics


def test_wilson_is_the_published_interval() -> None:
    # Newcombe, "Two-sided confidence intervals for the single proportion", 1998, table I.
    for wins, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605)):
        assert wilson(wins, n) == pytest.approx((low, high), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_wilson_solves_its_equation() -> None:
    for bound in wilson(13, 17):
        assert (13 / 17 - bound) ** 2 == pytest.approx(1.96**2 * bound * (1 - bound) / 17, rel=1e-4)


def test_sign_test_sums_the_binomial() -> None:
    assert sign_test(5, 5) == 2 / 32
    assert sign_test(5, 10) == 1.0 and sign_test(0, 0) == 1.0
    for wins in range(13):
        every = [comb(12, i) / 2**12 for i in range(13)]
        exact = sum(p for p in every if p <= every[wins])
        assert sign_test(wins, 12) == pytest.approx(exact) == sign_test(12 - wins, 12)


def test_agreement_counts_pairs_of_raters() -> None:
    ratings = ["AAB", "BB", "A"]
    assert observed_agreement(ratings) == (1 + 1) / (3 + 1)
    assert observed_agreement(["A", "B"]) is None
    assert krippendorff(["AA", "BB"]) == 1.0
    assert krippendorff(["AA", "AA"]) is None
    # By the definition: every ordered pair of values of the pairable items.
    values = "AABBB"
    apart = [a != b for a, b in itertools.permutations(values, 2)]
    observed = ((4 / 2) + 0) / 5
    assert krippendorff(ratings) == pytest.approx(1 - observed / (sum(apart) / len(apart)))


def test_raters_who_toss_coins_have_no_alpha() -> None:
    tosses = np.random.default_rng(0).integers(2, size=(2000, 3))
    assert abs(krippendorff([tuple(row) for row in tosses]) or 1) < 0.05


# Design


def test_sides_are_balanced_and_follow_the_seed() -> None:
    many = [Pair(f"sentence {n}", 0, walking(0.2), walking(0.2, speed=0)) for n in range(21)]
    keys = [design(many, "a", "b", seed).key for seed in (1, 1, 2)]
    assert keys[0] == keys[1] and keys[0].study != keys[2].study
    assert sum(pair.left == "A" for pair in keys[0].pairs) in (10, 11)
    assert {pair.prompt for pair in keys[0].pairs} == {pair.prompt for pair in many}
    assert [p.prompt for p in keys[0].pairs] != [p.prompt for p in keys[2].pairs]


def test_motions_stand_where_the_key_says() -> None:
    study = design(pairs(), "a", "b", 5)
    by_prompt = {pair.prompt: pair for pair in pairs()}
    for row, (left, right) in zip(study.key.pairs, study.motions, strict=True):
        pair = by_prompt[row.prompt]
        expected = (pair.a, pair.b) if row.left == "A" else (pair.b, pair.a)
        assert np.array_equal(left.joints, expected[0].joints)
        assert np.array_equal(right.joints, expected[1].joints)


def test_motion_without_words_gets_one_question() -> None:
    study = design([Pair("", 0, walking(0.2), walking(0.2, speed=0))], "a", "b", 0)
    assert list(study.key.questions) == ["realism"]


def test_different_lengths_are_told() -> None:
    assert check_lengths([(walking(1.0), walking(1.0))]) == []
    assert "1.0 s" in check_lengths([(walking(1.0), walking(2.0))])[0]


# The page


def test_page_names_no_model_and_asks_for_nothing() -> None:
    page = study_html(design(pairs(), "secret-one", "secret-two", 0))
    assert "secret" not in page and "model 1.2" not in page
    elements = Elements(page)
    links = [v for _, attrs in elements.tags for k, v in attrs.items() if k in ("src", "href")]
    assert links == ["data:,"]
    assert [tag for tag, _ in elements.tags].count("script") == 2
    assert page.count("default-src 'none'") == 1 and len(page.encode()) < 800_000
    carried = json.loads(elements.text["script"][0])
    assert set(carried["pairs"][0]) == {"id", "prompt", "questions"}


CLICKS = """
const find = (id) => document.getElementById(id);
const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true}));
// The DOM is dumped at once, so what is saved may not be read from a blob, which takes time.
window.Blob = class { constructor(parts) { this.text = parts.join(""); } };
URL.createObjectURL = (blob) => {
  document.body.dataset.saved = blob.text;
  return "#";
};
"""

RATING = (
    CLICKS
    + """
find("name").value = "Ada";
find("start").click();
const shown = () => find("prompt").textContent;
document.body.dataset.first = shown();
document.querySelector("#questions > :nth-child(1) .left").click();
find("next").click();  // refused: one question is open
document.body.dataset.still = shown();
document.querySelector("#questions > :nth-child(2) .right").click();
find("next").click();
press("ArrowRight"); press("ArrowRight"); press("ArrowUp"); press("ArrowLeft"); press("Enter");
"""
)

GOING_ON = (
    CLICKS
    + """
document.body.dataset.label = find("start").textContent;
find("start").click();
document.body.dataset.resumed = find("count").textContent;
press("ArrowLeft"); press("ArrowLeft"); press("Enter");
find("download").click();
"""
)


# The page's script shows the first view once it is unpacked; the test's follows.
ONCE_SHOWN = """new MutationObserver((_, observer) => {
  observer.disconnect();
  %s
}).observe(document.body, {attributeFilter: ["data-view"]});"""


def run_script(page: Path, script: str, profile: Path, *flags: str) -> dict[str, str]:
    """What the page wrote into its body's data after `script` ran on it, in the same place."""
    original = page.read_text()
    try:
        added = f"<script>{ONCE_SHOWN % script}</script></body>"
        page.write_text(original.replace("</body>", added))
        dom = chromium(page.as_uri(), profile, "--dump-dom", *flags)
    finally:
        page.write_text(original)
    body = re.search(r"<body([^>]*)>", dom)
    assert body is not None
    return {k: html.unescape(v) for k, v in re.findall(r'data-(\w+)="([^"]*)"', body[1])}


def test_a_browser_rates_goes_on_later_and_saves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = design(pairs(), "one", "two", 5)
    page, key, saved = (tmp_path / name for name in ("s.html", "s.key.json", "ada.json"))
    page.write_text(study_html(study), "utf-8")
    write_json(key, study.key)
    first = run_script(page, RATING, tmp_path / "profile", "--disable-3d-apis")
    assert first["first"] == first["still"] == study.key.pairs[0].prompt
    assert first["done"] == "2"
    second = run_script(page, GOING_ON, tmp_path / "profile")
    assert second["resumed"] == "3 of 3" and second["label"] == "Go on (2 of 3 done)"
    assert second["view"] == "end"
    saved.write_text(second["saved"])
    answers = read_json(Answers, saved)
    assert answers.name == "Ada" and answers.study == study.key.study
    chosen = {(a.pair, a.question): a.choice for a in answers.answers}
    ids = [pair.id for pair in study.key.pairs]
    sides = (("left", "right"), ("left", "right"), ("left", "left"))
    expected = {
        (pair, question): side
        for pair, both in zip(ids, sides, strict=True)
        for question, side in zip(("realism", "text"), both, strict=True)
    }
    assert chosen == expected
    main(["study", "report", str(saved), "--key", str(key), "--json"])
    found = json.loads(capsys.readouterr().out)
    left_a = [pair.left == "A" for pair in study.key.pairs]
    assert found["preferences"][0]["for_a"] == sum(left_a)
    assert found["preferences"][1]["for_a"] == (not left_a[0]) + (not left_a[1]) + left_a[2]


# The report


def answers_of(key: StudyKey, rater: str, models: str, saved: str = "2026") -> Answers:
    """A rater who prefers these models, pair by pair, in both questions."""
    sides = [
        "left" if pair.left == model else "right"
        for pair, model in zip(key.pairs, models, strict=False)
    ]
    answers = tuple(
        Answer(pair.id, question, side, 1.0)  # type: ignore[arg-type]
        for pair, side in zip(key.pairs, sides, strict=False)
        for question in key.questions
    )
    return Answers("latentmotion study answers 1", key.study, rater, "", saved, answers)


def test_report_counts_for_whom_not_where() -> None:
    key = design(pairs(), "one", "two", 5).key
    raters = [answers_of(key, "x", "AAB"), answers_of(key, "y", "AAA"), answers_of(key, "z", "AB")]
    found = report(votes_of(raters, key), key)
    realism = found.preferences[0]
    assert (realism.for_a, realism.answers) == (6, 8)
    assert realism.interval == wilson(6, 8) and realism.p_answers == sign_test(6, 8)
    assert realism.pairs == (2, 0, 1) and realism.p_pairs == sign_test(2, 2)
    assert realism.agreement == pytest.approx((3 + 1 + 0) / (3 + 3 + 1))
    assert [rater.for_a for rater in found.raters] == [4, 6, 2]
    text = found.markdown()
    assert "A is one" in text and "75.0 % of 8 answers" in text


def test_report_without_answers_says_so() -> None:
    key = design(pairs(), "one", "two", 5).key
    assert "unknown of 0 answers" in report([], key).markdown()


def test_the_later_file_of_a_rater_counts(tmp_path: Path) -> None:
    key = design(pairs(), "one", "two", 5).key
    for name, models, saved in (("new", "AAA", "2026-02"), ("old", "BB", "2026-01")):
        write_json(tmp_path / f"{name}.json", answers_of(key, "x", models, saved))
    for order in (("new", "old"), ("old", "new")):
        (kept,) = read_answers([tmp_path / f"{name}.json" for name in order], key)
        assert kept.saved == "2026-02"


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    """Motions of two models, saved by prompt, with the prompts."""
    for name, speed in (("slow", 0.2), ("fast", 1.4)):
        (tmp_path / name).mkdir()
        for number, prompt in enumerate(PROMPTS):
            motion = walking(1.0, prompt.upper() + ".", speed)
            formats.save(tmp_path / name / f"{number}.npz", [motion])
    (tmp_path / "prompts.txt").write_text("\n".join(PROMPTS) + "\n\n")
    return tmp_path


def make(folders: Path, *words: str) -> list[str]:
    sources = [str(folders / "slow"), str(folders / "fast")]
    output = str(folders / "study.html")
    return [
        "study",
        "make",
        *sources,
        "--prompts",
        str(folders / "prompts.txt"),
        "-o",
        output,
        *words,
    ]


def test_saved_motions_become_a_study(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(make(folders, "--order-seed", "7"))
    assert "3 pairs" in capsys.readouterr().out
    key = read_key(folders / "study.key.json")
    assert key.a.endswith("slow") and key.seed == 7 and len(key.pairs) == 3
    page = (folders / "study.html").read_text()
    assert "slow" not in Elements(page).text["script"][0] and str(folders) not in page
    for rater in ("x", "y"):
        write_json(folders / f"{rater}.json", answers_of(key, rater, "BBB"))
    files = [str(path) for path in sorted(folders.glob("*.json"))]
    main(["study", "report", *files, "--key", str(folders / "study.key.json")])
    assert "A preferred in 0.0 % of 6 answers" in capsys.readouterr().out


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    return capsys.readouterr().err


def test_mistakes_in_making_are_named(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "has 1 motions for" in refused(make(folders, "--seeds", "0", "1"), capsys)
    assert "ends with .html" in refused(make(folders, "-o", str(folders / "study.txt")), capsys)
    (folders / "prompts.txt").write_text("a person swims\n")
    assert "0 motions for 'a person swims'" in refused(make(folders), capsys)
    (folders / "prompts.txt").write_text("\n")
    assert "holds no sentence" in refused(make(folders), capsys)
    for path in (folders / "slow").iterdir():
        path.unlink()
    (folders / "prompts.txt").write_text("a person walks\n")
    assert "neither a model folder nor one of motions" in refused(make(folders), capsys)
    assert not (folders / "study.html").exists()


def test_answers_of_another_study_are_refused(
    folders: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(make(folders, "--order-seed", "7"))
    key = read_key(folders / "study.key.json")
    words = ["study", "report", str(folders / "x.json"), "--key", str(folders / "study.key.json")]
    other = design(pairs(), "one", "two", 5).key
    write_json(folders / "x.json", answers_of(other, "x", "AAA"))
    assert "holds answers to study" in refused(words, capsys)
    good = answers_of(key, "x", "AAA")
    twice = Answers(
        *(getattr(good, f) for f in ("format", "study", "rater", "name", "saved")),
        (good.answers[0],) * 2,
    )
    write_json(folders / "x.json", twice)
    assert "answered twice" in refused(words, capsys)
    (folders / "x.json").write_text("{}")
    assert "missing key" in refused(words, capsys)


def test_a_motion_is_what_the_page_shows() -> None:
    study = design(pairs(), "one", "two", 5)
    carried = json.loads(Elements(study_html(study)).text["script"][0])
    assert len(carried["motions"]) == 2 * len(carried["pairs"])
    assert isinstance(study.motions[0][0], Motion)
    assert carried["motions"][1]["caption"] == study.key.pairs[0].prompt
