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
    """Answers of all raters to one question."""

    question: str
    """Text of the question."""
    answers: int
    """Number of answers."""
    for_a: int
    """Number of answers for A."""
    share_of_a: float | None
    """Share of the answers for A."""
    interval: tuple[float, float]
    """Its 95 % confidence interval (Wilson)."""
    p_answers: float
    """Exact two-sided p of "no preference", every answer counted as independent."""
    pairs: tuple[int, int, int]
    """Pairs of motions that A won, that B won, and ties, by the majority of their raters."""
    p_pairs: float
    """Exact sign test over pairs, ties left out."""
    agreement: float | None
    """Share of two raters' answers to one pair that agree; None if no two raters share a pair."""
    alpha: float | None
    """Krippendorff's alpha of these answers."""
    left: float | None
    """Share of the answers for the left side; far from 0.5, raters do not look."""


@dataclass(frozen=True)
class RaterPreference:
    """Answers of one rater."""

    rater: str
    """Random name of the rater's browser."""
    answers: int
    """Number of answers."""
    for_a: int
    """Number of answers for A."""


@dataclass(frozen=True)
class StudyReport:
    """Results of a study."""

    study: str
    """Name of the study."""
    a: str
    """Description of A."""
    b: str
    """Description of B."""
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
    won = Counter()
    for models in by_pair.values():
        margin = 2 * sum(model == "A" for model in models) - len(models)
        won["A" if margin > 0 else "B" if margin < 0 else "tie"] += 1
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


def _percent(share: float | None) -> str:
    return "unknown" if share is None else f"{100 * share:.1f} %"
