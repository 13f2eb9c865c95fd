"""Two clips that touch become one, captioned "A, then B"."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.clip import TaggedSentence
from latentmotion.data.recording import Label, Recording
from latentmotion.data.segments import join_sentences, joined, touching
from latentmotion.data.sources.cmu import read_exercises
from latentmotion.errors import FileFormatError


def clip(name: str, text: str, frames: int = 60, split="train", start: float = 0.0) -> Recording:
    sentence = TaggedSentence(text, "", start, start and 2.0)
    label = Label(name, "cmu", f"05_18[{name}]", split, (sentence,), (sentence,))
    return Recording(label, np.zeros((frames, 22, 3)))


@pytest.mark.parametrize(
    ("first", "second", "both"),
    [
        ("a person waves.", "a person walks away.", "a person waves, then walks away."),
        ("a man sits", "he stands up", "a man sits, then stands up"),
        ("someone runs.", "a man is walking.", "someone runs. then the man is walking."),
        ("someone runs", "someone is falling", "someone runs. then the person is falling"),
        ("a person runs", "walking in a circle", "a person runs. then walking in a circle"),
        ("jumps up", "a person sits down", "jumps up. then the person sits down"),
    ],
)
def test_sentences_are_joined(first: str, second: str, both: str) -> None:
    assert join_sentences(first, second) == both


def test_touching_train_clips_become_one() -> None:
    clips = [(60, 120, clip("b", "a person runs.")), (0, 60, clip("a", "a person waves."))]
    (both,) = touching(clips)
    assert len(both.joints) == 120
    assert both.label.id == "a+b"
    assert [s.text for s in both.label.sentences] == ["a person waves, then runs."]
    assert [s.text for s in both.label.mirrored_sentences] == ["a person waves, then runs."]


@pytest.mark.parametrize(
    "second",
    [
        (61, 121, clip("b", "a person runs.")),
        (60, 120, clip("b", "a person runs.", split="test")),
        (60, 220, clip("b", "a person runs.", frames=160)),
        (60, 120, clip("b", "a person waves.")),
        (60, 120, clip("b", "a person runs.", start=1.0)),
    ],
    ids=["apart", "test", "too long", "the same", "about a part"],
)
def test_others_stay_apart(second: tuple[int, int, Recording]) -> None:
    assert list(touching([(0, 60, clip("a", "a person waves.")), second])) == []


def test_joining_needs_sentences() -> None:
    silent = Recording(Label("b", "cmu", "05_18", "train"), np.zeros((60, 22, 3)))
    assert joined(clip("a", "a person waves."), silent) is None


def test_labels_of_exercises(tmp_path) -> None:
    (tmp_path / "mocap6_labels").mkdir()
    path = tmp_path / "mocap6_labels" / "13_29.txt"
    path.write_text("1 1 1 2 2")
    assert read_exercises(tmp_path, 20) == {
        "13_29": [(0, 6, "does jumping jacks"), (6, 10, "jogs in place")]
    }
    path.write_text("1 13")
    with pytest.raises(FileFormatError, match="found '13', expected numbers from 1 to 12"):
        read_exercises(tmp_path, 20)
