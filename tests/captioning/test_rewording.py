"""Captions in other words: what may change, what must stay, and what is left alone."""

from __future__ import annotations

import lzma
import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.clip import Caption
from latentmotion.data.instructions import instructions
from latentmotion.language.words import inflect
from latentmotion.training.captioning import rewording
from latentmotion.training.captioning.clauses import read_clauses
from latentmotion.training.captioning.described import reworded_captions
from latentmotion.training.captioning.rewording import rewordings

QUALITY = Path(__file__).parents[2] / "benchmarks" / "quality"

SENTENCE = "the person walks forward slowly, then turns to the left."


def reworded(sentence: str, count: int = 40, seed: int = 0) -> list[str]:
    return rewordings(sentence, np.random.default_rng(seed), count)


@pytest.fixture
def rules_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No written wordings of clauses."""
    monkeypatch.setattr(rewording, "_WRITTEN_CLAUSE", 0.0)


@pytest.mark.parametrize(
    ("verb", "goes", "going"),
    [
        ("walk", "walks", "walking"),
        ("run", "runs", "running"),
        ("dance", "dances", "dancing"),
        ("punch", "punches", "punching"),
        ("carry", "carries", "carrying"),
        ("lie", "lies", "lying"),
        ("squat", "squats", "squatting"),
        ("tiptoe", "tiptoes", "tiptoeing"),
        ("sidestep", "sidesteps", "sidestepping"),
        ("do", "does", "doing"),
        ("bow", "bows", "bowing"),
    ],
)
def test_verbs_are_inflected(verb: str, goes: str, going: str) -> None:
    assert (inflect(verb, "third"), inflect(verb, "participle")) == (goes, going)


def test_sentence_is_read_in_clauses() -> None:
    read = read_clauses("A man slowly walks in a circle and then is waving his hand twice.")
    assert read is not None
    assert (read.subject, read.gender) == ("a man", "male")
    assert [(c.link, c.verb) for c in read.clauses] == [("", "walk"), ("then", "wave")]
    assert read.clauses[0].before == ("slowly",)


@pytest.mark.parametrize(
    "sentence",
    [
        "a person who is tired walks",
        "the person pick something up and poured it",
        "a man crouching down reaches up",
        "a person walks forward and faces left",
        "a person frobs the widget",
        "a person walks then turns around runs back",
        "from a standing position, someone sits",
        "",
    ],
)
def test_doubtful_sentences_are_not_read(sentence: str) -> None:
    assert read_clauses(sentence) is None


@pytest.mark.usefixtures("rules_alone")
def test_wordings_keep_actions_their_order_and_side() -> None:
    found = reworded(SENTENCE)
    assert len(set(found)) == 40
    for text in found:
        assert re.search(r"walk.*(slow).*turn.*left", text), text
        assert "right" not in text


@pytest.mark.usefixtures("rules_alone")
def test_wordings_are_of_many_kinds() -> None:
    found = reworded(SENTENCE, 60)
    assert any(text.startswith("walk ") for text in found)
    assert any(text.startswith("walking ") for text in found)
    assert any(" is walking " in text and " turning " in text for text in found)
    assert any(text.startswith(("a woman walks", "the woman walks", "she walks")) for text in found)
    assert any("then" not in text for text in found)


def test_owners_follow_the_subject() -> None:
    for text in reworded("a man raises his left hand above his head"):
        owners = set(re.findall(r"\b(his|her|their|your)\b", text))
        assert len(owners) <= 1, text
        if re.match(r"(the|a) man|he\b", text):
            assert owners <= {"his"}
        if text.startswith(("raise ", "lift ")):
            assert owners <= {"your"}
        assert "left hand" in text


def test_pronouns_inside_keep_subject_and_person() -> None:
    for text in reworded("a man waves as he walks"):
        assert re.match(r"(the man|a man|he) ", text), text


@pytest.mark.usefixtures("rules_alone")
def test_counts_stay() -> None:
    for text in reworded("a person takes three steps and jumps twice"):
        assert re.search(r"\b(three|3) steps", text)
        assert re.search(r"twice|two times|2 times", text)


def test_wordings_repeat_with_their_seed_and_never_hold_the_sentence() -> None:
    assert reworded(SENTENCE, 10, 3) == reworded(SENTENCE, 10, 3)
    assert reworded(SENTENCE, 10, 3) != reworded(SENTENCE, 10, 4)
    assert all(text.rstrip(".") != SENTENCE.rstrip(".") for text in reworded(SENTENCE, 60))


def test_unread_sentences_get_another_subject_at_most() -> None:
    found = reworded("a person has their arms out and frobs")
    assert 0 < len(found) < 10
    assert all(text.endswith("has their arms out and frobs") for text in found)


def test_captions_get_wordings_of_the_same_span() -> None:
    captions = (Caption("a person walks forward.", 0, 40), Caption("he stops", 40, 60, "he/PRON"))
    found = reworded_captions(captions, np.random.default_rng(0), 3)
    assert {(c.start_frame, c.end_frame) for c in found} == {(0, 40), (40, 60)}
    assert len({c.text for c in found}) == len(found) <= 6
    assert not {c.text for c in captions} & {c.text for c in found}


def sides(text: str) -> set[str]:
    return set(re.findall(r"\b(left|right)(?!over)", text))


def test_written_wordings_keep_sides_and_are_of_no_benchmark() -> None:
    packed = files("latentmotion.training.captioning").joinpath("wordings.tsv.xz").read_bytes()
    table = lzma.decompress(packed).decode()
    rows = [line.split("\t") for line in table.splitlines()[1:]]
    assert len(rows) > 500
    asked = {one.prompt for one in instructions()}
    for name in ("sheet_60.txt", "wordings.tsv"):
        lines = (QUALITY / name).read_text("utf-8").splitlines()
        asked |= {line.split("\t")[-1].lower() for line in lines}
    for caption, texts in rows:
        for text in texts.split("|"):
            assert sides(text) == sides(caption), (caption, text)
            assert text == text.lower().strip() and text not in asked


def test_a_clause_among_others_takes_written_wordings() -> None:
    found = reworded(SENTENCE, 60)
    plain = re.compile(r"(walk|go|move|step|stroll)\w* .*turn.*left")
    assert sum(not plain.search(text) for text in found) > 5
    for text in found:
        assert sides(text) == {"left"}, text
        assert "then" in text or "," in text, text


def test_captions_are_found_whatever_their_subject_and_form() -> None:
    one, other = (reworded(text, 60) for text in ("a man kneels down.", "she is kneeling down"))
    assert len(set(one) & set(other)) >= 5


@pytest.mark.parametrize(
    ("sentence", "other"),
    [
        ("a person kneels down", r"knee\b"),
        ("a person throws something with the right hand", "stone|ball"),
        ("a person bends down and puts something on the floor", "^(?!.*bend).*(box|object)"),
        ("a person raises their right hand in front of them", "point"),
        ("someone plays tennis and swings the racket", r"hits? the ball|hitting a tennis ball"),
    ],
)
def test_users_words_for_an_act_are_among_its_wordings(sentence: str, other: str) -> None:
    assert any(re.search(other, text) for text in reworded(sentence, 60))


def test_your_becomes_the_subjects_own() -> None:
    for text in reworded("kick with your left leg"):
        assert text.startswith("kick") or "your" not in text, text
