"""Raters' answers → votes → preference by question, with interval, exact tests and agreement.

Wilson's interval (1927) of a proportion p = k/n at z = 1.96:

    (p + z²/2n ± z √(p(1 − p)/n + z²/4n²)) / (1 + z²/n)

The exact sign test: under "no preference" wins are binomial(n, 1/2), so both tails have
min(1, 2 Σ_{i ≥ max(k, n−k)} C(n, i) / 2ⁿ).

Krippendorff's α = 1 − D_observed / D_expected, for labels: 1 is full agreement, 0 that of chance.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Hashable, Iterable, Sequence
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

    pair: str  # The pair's opaque name.
    question: str  # The question's name.
    choice: Literal["left", "right"]  # The side that was chosen.
    seconds: float  # Time from first sight of the pair to the answer.


@dataclass(frozen=True)
class Answers:
    """One rater's answers."""

    format: str  # Version of the format.
    study: str  # Name of the study.
    rater: str  # Random name of the rater's browser.
    name: str  # Name of the rater, if given.
    saved: str  # When they were downloaded.
    answers: tuple[Answer, ...]  # All answers.


@dataclass(frozen=True)
class Vote:
    """An answer, once the key has been applied."""

    rater: str  # Random name of the rater's browser.
    pair: str  # The pair's opaque name.
    question: str  # The question's name.
    model: Model  # The model that was chosen.
    side: Literal["left", "right"]  # The side that it stood on.


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
        answered = set()
        for answer in answers.answers:
            both = (answer.pair, answer.question)
            if answer.pair not in pairs or answer.question not in key.questions or both in answered:
                raise DataError(
                    f"{path}: pair {answer.pair!r}, question {answer.question!r} is unknown or "
                    "answered twice; the file was changed by hand, download it again"
                )
            answered.add(both)
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


Z = 1.959963984540054  # Normal quantile of a 95 % interval.


def wilson(wins: int, n: int, z: float = Z) -> tuple[float, float]:
    """Returns the 95 % confidence interval of a proportion; (0, 1) where nothing is known."""
    if n == 0:
        return 0.0, 1.0
    p, scale = wins / n, 1 + z * z / n
    middle = p + z * z / (2 * n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def sign_test(wins: int, n: int) -> float:
    """Returns the two-sided exact p-value of "no preference"."""
    tail = sum(math.comb(n, i) for i in range(max(wins, n - wins), n + 1))
    return min(1.0, 2 * tail / 2**n)


def observed_agreement(ratings: Iterable[Sequence[Hashable]]) -> float | None:
    """Returns the share of pairs of ratings of one item that agree; None if there is no pair.

    Args:
        ratings: For each item the ratings of its raters.
    """
    agreeing = possible = 0
    for item in ratings:
        agreeing += sum(math.comb(count, 2) for count in Counter(item).values())
        possible += math.comb(len(item), 2)
    return agreeing / possible if possible else None


def krippendorff(ratings: Iterable[Sequence[Hashable]]) -> float | None:
    """Returns α for labels, without items that have a single rating; None if undefined."""
    items = [Counter(item) for item in ratings if len(item) > 1]
    total = sum(sum(item.values()) for item in items)
    disagreeing = sum(_unlike(item) / (sum(item.values()) - 1) for item in items)
    expected = _unlike(sum(items, Counter())) / (total - 1) if total > 1 else 0.0
    return 1 - disagreeing / expected if expected else None


def _unlike(counts: Counter[Hashable]) -> int:
    """Counts ordered pairs of unlike labels."""
    total = sum(counts.values())
    return total * total - sum(count * count for count in counts.values())


@dataclass(frozen=True)
class Preference:
    """Answers of all raters to one question."""

    question: str  # Text of the question.
    answers: int  # Number of answers.
    for_a: int  # Number of answers for A.
    share_of_a: float | None  # Share of the answers for A.
    interval: tuple[float, float]  # Its 95 % confidence interval (Wilson).
    p_answers: float  # Exact two-sided p of "no preference", every answer counted as independent.
    # Pairs of motions that A won, that B won, and ties, by the majority of their raters.
    pairs: tuple[int, int, int]
    p_pairs: float  # Exact sign test over pairs, ties left out.
    # Share of two raters' answers to one pair that agree; None if no two raters share a pair.
    agreement: float | None
    alpha: float | None  # Krippendorff's alpha of these answers.
    left: float | None  # Share of the answers for the left side; far from 0.5, raters do not look.


@dataclass(frozen=True)
class RaterPreference:
    """Answers of one rater."""

    rater: str  # Random name of the rater's browser.
    answers: int  # Number of answers.
    for_a: int  # Number of answers for A.


@dataclass(frozen=True)
class StudyReport:
    """Results of a study."""

    study: str  # Name of the study.
    a: str  # Description of A.
    b: str  # Description of B.
    pairs: int  # Pairs of motions on the page.
    preferences: tuple[Preference, ...]  # By question.
    raters: tuple[RaterPreference, ...]  # By rater.

    def markdown(self) -> str:
        """Returns the report as text."""
        head = [f"A is {self.a}", f"B is {self.b}", ""]
        counts = f"{len(self.raters)} raters, {self.pairs} pairs of motions, study {self.study}"
        tables: list[str] = []
        for preference in self.preferences:
            (low, high), (a, b, ties) = preference.interval, preference.pairs
            alpha = "unknown" if preference.alpha is None else f"{preference.alpha:.2f}"
            tables += [
                f"{preference.question}",
                f"- A preferred in {_percent(preference.share_of_a)} of {preference.answers} "
                f"answers, 95 % interval {_percent(low)} to {_percent(high)} (Wilson), exact p "
                f"{preference.p_answers:.3g}",
                f"- pairs: A won {a}, B won {b}, {ties} tied; sign test over pairs p "
                f"{preference.p_pairs:.3g}",
                f"- agreement of raters {_percent(preference.agreement)} (Krippendorff's alpha "
                f"{alpha}); left side chosen in {_percent(preference.left)}",
                "",
            ]
        raters = [f"- {r.rater}: A in {r.for_a} of {r.answers} answers" for r in self.raters]
        return "\n".join([*head, counts, "", *tables, "By rater:", *raters])


def report(votes: Sequence[Vote], key: StudyKey) -> StudyReport:
    """Counts votes."""
    by_rater: dict[str, list[Vote]] = defaultdict(list)
    for vote in votes:
        by_rater[vote.rater].append(vote)
    preferences = []
    for name, text in key.questions.items():
        answers = [vote for vote in votes if vote.question == name]
        n, for_a = len(answers), sum(vote.model == "A" for vote in answers)
        by_pair: dict[str, list[Model]] = defaultdict(list)
        for vote in answers:
            by_pair[vote.pair].append(vote.model)
        # By how many of its raters' answers A is ahead in each pair.
        ahead = [2 * models.count("A") - len(models) for models in by_pair.values()]
        a_won, b_won = sum(lead > 0 for lead in ahead), sum(lead < 0 for lead in ahead)
        preferences.append(
            Preference(
                question=text,
                answers=n,
                for_a=for_a,
                share_of_a=for_a / n if n else None,
                interval=wilson(for_a, n),
                p_answers=sign_test(for_a, n),
                pairs=(a_won, b_won, ahead.count(0)),
                p_pairs=sign_test(a_won, a_won + b_won),
                agreement=observed_agreement(by_pair.values()),
                alpha=krippendorff(by_pair.values()),
                left=sum(vote.side == "left" for vote in answers) / n if n else None,
            )
        )
    return StudyReport(
        study=key.study,
        a=key.a,
        b=key.b,
        pairs=len(key.pairs),
        preferences=tuple(preferences),
        raters=tuple(
            RaterPreference(rater, len(rater_votes), sum(v.model == "A" for v in rater_votes))
            for rater, rater_votes in sorted(by_rater.items())
        ),
    )


def _percent(share: float | None) -> str:
    return "unknown" if share is None else f"{100 * share:.1f} %"
