"""Words of captions as the evaluators of papers see them: tokens, classes, base forms."""

from __future__ import annotations

import pytest

from latentmotion.data.clip import Caption
from latentmotion.evaluation.evaluators.words import (
    END,
    KEYWORDS,
    MAX_WORDS,
    OTHER,
    PARTS_OF_SPEECH,
    START,
    TaggedWord,
    base_forms,
    class_of,
    tokens_of,
)


@pytest.mark.parametrize(
    ("caption", "expected"),
    [
        (
            Caption("x", 0, 8, "man/NOUN go/VERB"),
            [TaggedWord("man", "NOUN"), TaggedWord("go", "VERB")],
        ),
        (Caption("x", 0, 8, "and/or/CCONJ /X"), [TaggedWord("and/or", "CCONJ")]),
        (
            Caption("He's 2 steps LEFT!", 0, 8),
            [TaggedWord(word, OTHER, tagged=False) for word in ("he", "s", "2", "steps", "left")],
        ),
        (Caption("…", 0, 8), []),
    ],
)
def test_tokens_lie_between_start_and_end(caption: Caption, expected: list[TaggedWord]) -> None:
    assert tokens_of(caption) == [START, *expected, END]


@pytest.mark.parametrize("count", [MAX_WORDS - 1, MAX_WORDS, MAX_WORDS + 9])
def test_no_sentence_has_more_words_than_the_most(count: int) -> None:
    for caption in (Caption("go " * count, 0, 8), Caption("", 0, 8, "go/VERB " * count)):
        assert len(tokens_of(caption)) == 2 + min(count, MAX_WORDS)


@pytest.mark.parametrize(
    ("word", "part", "expected"),
    [
        ("walk", "NOUN", "Act_VIP"),
        ("left", "ADJ", "Loc_VIP"),
        ("knee", "NOUN", "Body_VIP"),
        ("slowly", "ADV", "Desc_VIP"),
        ("man", "NOUN", "NOUN"),
        ("of", "ADP", "ADP"),
        ("!", "PUNCT", OTHER),
        ("sos", OTHER, OTHER),
    ],
)
def test_keywords_have_classes_of_their_own(word: str, part: str, expected: str) -> None:
    assert PARTS_OF_SPEECH[class_of(TaggedWord(word, part))] == expected


def test_no_keyword_is_in_two_lists() -> None:
    words = [word for listed in KEYWORDS.values() for word in listed.split()]
    assert len(words) == len(set(words)) > 80


@pytest.mark.parametrize(
    ("word", "forms"),
    [
        ("walk", {"walk"}),
        ("walks", {"walks", "walk"}),
        ("carries", {"carries", "carri", "carry", "carrie"}),
        ("jogging", {"jogging", "jogg", "jog", "jogge"}),
        ("raising", {"raising", "rais", "raise"}),
        ("stopped", {"stopped", "stopp", "stop", "stoppe"}),
        ("reaches", {"reaches", "reache", "reach"}),
    ],
)
def test_base_forms_begin_with_the_word_itself(word: str, forms: set[str]) -> None:
    found = base_forms(word)
    assert found[0] == word and set(found) == forms
