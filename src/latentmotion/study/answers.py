"""What a rater's browser downloads, read strictly and checked against the key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from latentmotion.errors import DataError, InputError
from latentmotion.storage.configuration import read_json
from latentmotion.study.design import KEY_FORMAT, Model, StudyKey

ANSWERS_FORMAT = "latentmotion study answers 1"


@dataclass(frozen=True)
class Answer:
    """One click."""

    pair: str
    """The pair's opaque name."""
    question: str
    """The question's name."""
    choice: Literal["left", "right"]
    """The side that was chosen."""
    seconds: float
    """Time from first sight of the pair to the answer."""


@dataclass(frozen=True)
class Answers:
    """One rater's answers."""

    format: str
    """Which version of the format this is."""
    study: str
    """Name of the study."""
    rater: str
    """Random name of the rater's browser."""
    name: str
    """What the rater is called, if told."""
    saved: str
    """When they were downloaded."""
    answers: tuple[Answer, ...]
    """All that were given."""


@dataclass(frozen=True)
class Vote:
    """An answer, once the key has been applied."""

    rater: str
    """Who."""
    pair: str
    """On which pair."""
    question: str
    """To which question."""
    model: Model
    """For which model."""
    side: Literal["left", "right"]
    """On which side it stood."""


def read_key(path: Path) -> StudyKey:
    """Reads study.key.json.

    Raises:
        InputError: It is missing, or not one.
    """
    key = read_json(StudyKey, path)
    if key.format != KEY_FORMAT:
        raise InputError(f"{path}: expected format {KEY_FORMAT!r}, found {key.format!r}")
    return key


def read_answers(paths: Sequence[Path], key: StudyKey) -> list[Answers]:
    """Reads the answers of several raters; of two files of one rater the later counts.

    Raises:
        InputError: A file is missing, or not one of answers.
        DataError: It holds answers to another study.
    """
    latest: dict[str, Answers] = {}
    for path in paths:
        answers = _checked(path, key)
        before = latest.get(answers.rater)
        if before is None or before.saved < answers.saved:
            latest[answers.rater] = answers
    return list(latest.values())


def votes_of(answers: Sequence[Answers], key: StudyKey) -> list[Vote]:
    """Returns all answers with the model that each was for."""
    left: dict[str, Model] = {pair.id: pair.left for pair in key.pairs}
    other: dict[Model, Model] = {"A": "B", "B": "A"}
    return [
        Vote(
            rater=one.rater,
            pair=answer.pair,
            question=answer.question,
            model=left[answer.pair] if answer.choice == "left" else other[left[answer.pair]],
            side=answer.choice,
        )
        for one in answers
        for answer in one.answers
    ]


def _checked(path: Path, key: StudyKey) -> Answers:
    answers = read_json(Answers, path)
    if answers.format != ANSWERS_FORMAT:
        raise InputError(f"{path}: expected format {ANSWERS_FORMAT!r}, found {answers.format!r}")
    if answers.study != key.study:
        raise DataError(
            f"{path} holds answers to study {answers.study}, the key is of {key.study}; pass the "
            "key that was written with the page these were given on"
        )
    known, seen = {pair.id for pair in key.pairs}, set()
    for answer in answers.answers:
        place = (answer.pair, answer.question)
        if answer.pair not in known or answer.question not in key.questions or place in seen:
            raise DataError(
                f"{path}: pair {answer.pair!r}, question {answer.question!r} is unknown or "
                "answered twice; the file was changed by hand, download it again"
            )
        seen.add(place)
    return answers
