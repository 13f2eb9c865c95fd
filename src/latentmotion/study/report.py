"""Votes → preference by question, with interval, exact tests and agreement."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from latentmotion.study.answers import Vote
from latentmotion.study.design import StudyKey
from latentmotion.study.statistics import krippendorff, observed_agreement, sign_test, wilson


@dataclass(frozen=True)
class Preference:
    """What raters say to one question."""

    question: str
    """As it was asked."""
    answers: int
    """How many answers there are."""
    for_a: int
    """How many of them are for A."""
    share_of_a: float | None
    """Part of the answers for A."""
    interval: tuple[float, float]
    """Its 95 % confidence interval (Wilson)."""
    p_answers: float
    """Exact two-sided p of "no preference", every answer counted as independent."""
    pairs: tuple[int, int, int]
    """Pairs of motions that A won, that B won, and ties, by the majority of their raters."""
    p_pairs: float
    """Exact sign test over pairs, ties left out."""
    agreement: float | None
    """Part of two raters' answers to one pair that agree; none where nobody shares a pair."""
    alpha: float | None
    """Krippendorff's alpha of the same."""
    left: float | None
    """Part of the answers for the left side; far from 0.5, raters do not look."""


@dataclass(frozen=True)
class RaterPreference:
    """What one rater says."""

    rater: str
    """Random name of the rater's browser."""
    answers: int
    """How many answers there are."""
    for_a: int
    """How many of them are for A."""


@dataclass(frozen=True)
class StudyReport:
    """All that is known of a study."""

    study: str
    """Name of the study."""
    a: str
    """What A is."""
    b: str
    """What B is."""
    pairs: int
    """Pairs of motions on the page."""
    preferences: tuple[Preference, ...]
    """By question."""
    raters: tuple[RaterPreference, ...]
    """By rater."""

    def markdown(self) -> str:
        """Returns the report as text."""
        head = [f"A is {self.a}", f"B is {self.b}", ""]
        counts = f"{len(self.raters)} raters, {self.pairs} pairs of motions, study {self.study}"
        tables = [line for one in self.preferences for line in _lines(one)]
        raters = [f"- {r.rater}: A in {r.for_a} of {r.answers} answers" for r in self.raters]
        return "\n".join([*head, counts, "", *tables, "By rater:", *raters])


def report(votes: Sequence[Vote], key: StudyKey) -> StudyReport:
    """Counts votes."""
    by_rater: dict[str, list[Vote]] = defaultdict(list)
    for vote in votes:
        by_rater[vote.rater].append(vote)
    return StudyReport(
        study=key.study,
        a=key.a,
        b=key.b,
        pairs=len(key.pairs),
        preferences=tuple(
            _preference(text, [v for v in votes if v.question == name])
            for name, text in key.questions.items()
        ),
        raters=tuple(
            RaterPreference(rater, len(own), sum(v.model == "A" for v in own))
            for rater, own in sorted(by_rater.items())
        ),
    )


def _preference(question: str, votes: Sequence[Vote]) -> Preference:
    n, for_a = len(votes), sum(vote.model == "A" for vote in votes)
    by_pair: dict[str, list[str]] = defaultdict(list)
    for vote in votes:
        by_pair[vote.pair].append(vote.model)
    won = Counter(_majority(models) for models in by_pair.values())
    return Preference(
        question=question,
        answers=n,
        for_a=for_a,
        share_of_a=for_a / n if n else None,
        interval=wilson(for_a, n),
        p_answers=sign_test(for_a, n),
        pairs=(won["A"], won["B"], won["tie"]),
        p_pairs=sign_test(won["A"], won["A"] + won["B"]),
        agreement=observed_agreement(by_pair.values()),
        alpha=krippendorff(by_pair.values()),
        left=sum(vote.side == "left" for vote in votes) / n if n else None,
    )


def _majority(models: Sequence[str]) -> str:
    ahead = 2 * sum(model == "A" for model in models) - len(models)
    return "A" if ahead > 0 else "B" if ahead < 0 else "tie"


def _lines(one: Preference) -> list[str]:
    low, high = one.interval
    a, b, ties = one.pairs
    return [
        f"{one.question}",
        f"- A preferred in {_percent(one.share_of_a)} of {one.answers} answers, "
        f"95 % interval {_percent(low)} to {_percent(high)} (Wilson), exact p {one.p_answers:.3g}",
        f"- pairs: A won {a}, B won {b}, {ties} tied; sign test over pairs p {one.p_pairs:.3g}",
        f"- agreement of raters {_percent(one.agreement)} (Krippendorff's alpha "
        f"{'unknown' if one.alpha is None else f'{one.alpha:.2f}'}); left side chosen in "
        f"{_percent(one.left)}",
        "",
    ]


def _percent(share: float | None) -> str:
    return "unknown" if share is None else f"{100 * share:.1f} %"
