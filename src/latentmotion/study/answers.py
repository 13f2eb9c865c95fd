"""Raters' answers, as their browsers download them, read strictly and checked against the key."""

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
    """Version of the format."""
    study: str
    """Name of the study."""
    rater: str
    """Random name of the rater's browser."""
    name: str
    """Name of the rater, if given."""
    saved: str
    """When they were downloaded."""
    answers: tuple[Answer, ...]
    """All answers."""


@dataclass(frozen=True)
class Vote:
    """An answer, once the key has been applied."""

    rater: str
    """Random name of the rater's browser."""
    pair: str
    """The pair's opaque name."""
    question: str
    """The question's name."""
    model: Model
    """The model that was chosen."""
    side: Literal["left", "right"]
    """The side that it stood on."""


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
    pairs = {pair.id for pair in key.pairs}
    for path in paths:
        answers = read_json(Answers, path)
        if answers.format != ANSWERS_FORMAT:
            raise InputError(
                f"{path}: expected format {ANSWERS_FORMAT!r}, found {answers.format!r}"
            )
        if answers.study != key.study:
            raise DataError(
                f"{path} holds answers to study {answers.study}, the key is of {key.study}; pass "
                "the key that was written with the page these were given on"
            )
        given = set()
        for answer in answers.answers:
            both = (answer.pair, answer.question)
            if answer.pair not in pairs or answer.question not in key.questions or both in given:
                raise DataError(
                    f"{path}: pair {answer.pair!r}, question {answer.question!r} is unknown or "
                    "answered twice; the file was changed by hand, download it again"
                )
            given.add(both)
        before = latest.get(answers.rater)
        if before is None or before.saved < answers.saved:
            latest[answers.rater] = answers
    return list(latest.values())


def votes_of(answers: Sequence[Answers], key: StudyKey) -> list[Vote]:
    """Returns all answers with the model that each chose."""
    left: dict[str, Model] = {pair.id: pair.left for pair in key.pairs}
    other: dict[Model, Model] = {"A": "B", "B": "A"}
    return [
        Vote(
            rater=rater.rater,
            pair=answer.pair,
            question=answer.question,
            model=left[answer.pair] if answer.choice == "left" else other[left[answer.pair]],
            side=answer.choice,
        )
        for rater in answers
        for answer in rater.answers
    ]
