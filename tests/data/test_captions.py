from __future__ import annotations

import json
import lzma
from pathlib import Path

import pytest

from latentmotion.data.clip import (
    Caption,
    TaggedSentence,
    fit_sentences,
    mirror_words,
    parse_sentences,
)


def test_lines_with_and_without_tags() -> None:
    text = "a man walks.#a/DET man/NOUN walk/VERB#0.0#0.0\n\nplain words\nhe is #1\n"
    assert parse_sentences(text) == (
        TaggedSentence("a man walks.", "a/DET man/NOUN walk/VERB"),
        TaggedSentence("plain words"),
        TaggedSentence("he is #1"),
    )


def test_nan_counts_as_zero() -> None:
    (sentence,) = parse_sentences("he sits.#he/PRON#nan#nan")
    assert (sentence.start, sentence.end) == (0, 0)
    captions, dropped = fit_sentences([sentence], 77)
    assert captions == (Caption("he sits.", 0, 77, "he/PRON"),)
    assert not dropped


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        (1.0, 2.55, (20, 51)),
        (0.0, 2.0, (0, 40)),
        (2.0, 9.0, (40, 60)),  # past the end
        (3.0, 4.0, "starts past the end"),
        (2.0, 2.0, "tagged from 2 s to 2 s"),
        (10.0, 4.5, "tagged from 10 s to 4.5 s"),
        (-1.0, 2.0, "tagged from -1 s"),
    ],
)
def test_parts_of_a_motion_of_60_frames(
    start: float, end: float, expected: tuple[int, int] | str
) -> None:
    captions, dropped = fit_sentences([TaggedSentence("he turns", "", start, end)], 60)
    if isinstance(expected, str):
        assert not captions
        assert expected in dropped[0]
    else:
        assert [(c.start_frame, c.end_frame) for c in captions] == [expected]


@pytest.mark.parametrize(
    ("text", "mirrored"),
    [
        ("Left foot, then right.", "Right foot, then left."),
        ("runs clockwise", "runs counterclockwise"),
        ("runs counter-clockwise", "runs clockwise"),
        ("anti clockwise turns", "clockwise turns"),
        ("Clock-wise turns", "Counterclockwise turns"),
        ("leftward, right-handed, two lefts", "rightward, left-handed, two rights"),
        ("stands upright, frightened and bright", "stands upright, frightened and bright"),
        ("right/ADJ leg/NOUN", "left/ADJ leg/NOUN"),
    ],
)
def test_mirrored_words(text: str, mirrored: str) -> None:
    assert mirror_words(text) == mirrored


@pytest.fixture(scope="module")
def texts(shared: Path) -> dict[str, str]:
    with lzma.open(shared / "data/humanml3d/texts.json.xz", "rt", encoding="utf-8") as file:
        return json.load(file)


def test_mirrored_words_agree_with_humanml3d(texts: dict[str, str]) -> None:
    names = [name for name in texts if not name.startswith("M")][:1500]
    pairs = [
        (mirror_words(ours.text), theirs.text)
        for name in names
        for ours, theirs in zip(
            parse_sentences(texts[name]), parse_sentences(texts[f"M{name}"]), strict=True
        )
    ]
    # The rest are HumanML3D's slips, such as "upleft" and "counter counterclockwise".
    assert sum(ours == theirs for ours, theirs in pairs) > 0.985 * len(pairs)


def test_humanml3d_has_as_many_odd_tags_as_known(texts: dict[str, str]) -> None:
    whole = [text for name, text in texts.items() if not name.startswith("M")]
    sentences = [sentence for text in whole for sentence in parse_sentences(text)]
    assert len(sentences) == 43_692
    assert sum(s.start != 0 or s.end != 0 for s in sentences) == 1_522
    assert all(sentence.tokens for sentence in sentences)
