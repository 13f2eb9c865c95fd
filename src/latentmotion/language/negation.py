"""Negated clauses: "does not sit down" asks for no sitting, so it is left out.

A clause is negated from its negation (`not`, `never`, `without`, …) to a comma, a "but", or to
an act in another form after "and". That nothing moves is an act of its own: standing still.
"""

from __future__ import annotations

from collections.abc import Sequence

from latentmotion.language.acts import verb_forms
from latentmotion.language.words import STOPS, Token, listed, tokens_of

# Words that join a clause to one that is left out.
_LEFT_OVER = ("but", "just", "and", "instead", "then", "or")


def affirmed(sentence: str) -> str:
    """Returns a sentence without its negated clauses; as it is if it has none.

    Text encoders read "does not sit down" as nearly "sits down" (cosine 0.84), so a model is not
    given such a clause. Where nothing is left to do, the person stands.
    """
    tokens = tokens_of(sentence)
    remaining = without_negated(tokens)
    if len(remaining) == len(tokens):
        return sentence
    said: list[Token] = []
    for token in remaining:
        idle = is_idle(said) or (said[-1].text in STOPS and token.text in STOPS)
        if not (idle and _joins(token)):  # "a man who does not kneel and bows" → "a man who bows"
            said.append(token)
    while said:  # a clause without a verb at the end, such as "then he", was of a negation
        cut = max((at for at, token in enumerate(said) if _joins(token)), default=-1)
        if not is_idle(said[cut + 1 :]):
            break
        said = said[: max(cut, 0)]
    text, end = "", None
    for token in said:
        between = "" if token.text in STOPS or not text else " "
        if end is not None and not any(end <= other.start < token.start for other in tokens):
            between = sentence[end : token.start]
        text, end = text + between + sentence[token.start : token.end], token.end
    return text or "a person stands"


def _joins(token: Token) -> bool:
    """Whether a word or mark joins clauses."""
    return token.text in _LEFT_OVER or token.text in STOPS


def is_idle(clause: Sequence[Token]) -> bool:
    """Whether a clause has a subject at most."""
    subject = listed("person") | listed("determiner") | listed("their") | listed("boundary")
    return all(token.text in subject | {"or", *STOPS} for token in clause)


def without_negated(tokens: Sequence[Token]) -> list[Token]:
    """Leaves out the negated clauses of a sentence."""
    remaining: list[Token] = []
    at = 0
    while at < len(tokens):
        if not _negates(tokens, at):
            remaining.append(tokens[at])
            at += 1
            continue
        while remaining and remaining[-1].text in listed("modal") | {"or", "to"}:
            remaining.pop()
        at = _end(tokens, at)
    return remaining


def _negates(tokens: Sequence[Token], at: int) -> bool:
    """Whether a token begins a negation."""
    text, following, after = ([token.text for token in tokens[at : at + 3]] + [""] * 2)[:3]
    if text not in listed("negation"):
        refuses = text in listed("refusal")
        return refuses or (text in ("instead", "rather") and following in ("of", "than"))
    if text == "no" and following in ("", *_LEFT_OVER, *STOPS):
        return False  # an answer: "shakes the head no and crosses the arms"
    still = following in ("moving", "move", "movement")
    still &= after in ("", "forward", "at", "anymore") or after in STOPS
    return not still and following not in ("only", "longer")


def _end(tokens: Sequence[Token], start: int) -> int:
    """Returns where the clause of a negation ends."""
    first = ""
    for at in range(start + 1, len(tokens)):
        text = tokens[at].text
        if text in STOPS or text in listed("affirmed"):
            return at
        first = first or verb_forms().get(text, "")
        following = verb_forms().get(tokens[at + 1].text) if at + 1 < len(tokens) else ""
        if text == "and" and first != "third" and following == "third":
            return at  # "does not sit and waves"
    return len(tokens)
