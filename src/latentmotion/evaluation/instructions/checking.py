"""Whether a motion fulfills a check, and whether a check is well formed."""

from __future__ import annotations

from latentmotion.describe.scene import Scene
from latentmotion.errors import InputError, hint
from latentmotion.evaluation.instructions.acts import ACTS, happens, in_order
from latentmotion.evaluation.instructions.conditions import CONDITIONS
from latentmotion.evaluation.instructions.expressions import Check, Term


def fulfills(scene: Scene, check: Check) -> bool:
    """Returns whether a motion does all that is demanded, in order where there is one."""
    if check.ordered:
        return in_order(scene, check)
    return all(_holds(scene, term) for term in check.terms)


def validate(check: Check) -> None:
    """Checks names, words and numbers.

    Raises:
        InputError: One is unknown or missing.
    """
    for term in check.terms:
        _validate(term, check.ordered)


def _holds(scene: Scene, term: Term) -> bool:
    if term.name in CONDITIONS:
        return CONDITIONS[term.name].holds(scene, term)
    return happens(scene, term)


def _validate(term: Term, ordered: bool) -> None:
    known = ACTS if ordered else ACTS | CONDITIONS
    if term.name not in known:
        raise InputError(f"check {term}: unknown {term.name!r}, {hint(term.name, known)}")
    counts = ordered or term.name not in CONDITIONS
    words = ACTS[term.name].words if counts else CONDITIONS[term.name].words
    if not counts and len(term.numbers) != CONDITIONS[term.name].numbers:
        raise InputError(f"check {term}: expected {CONDITIONS[term.name].numbers} numbers")
    if counts and (len(term.numbers) > 2 or (ordered and term.numbers and term.name != "turn")):
        raise InputError(f"check {term}: expected fewer numbers")
    if list(term.numbers) != sorted(term.numbers):
        raise InputError(f"check {term}: expected the smaller number first")
    if len(term.words) > len(words) or (not counts and len(term.words) < len(words)):
        raise InputError(f"check {term}: expected {len(words)} words")
    for word, choices in zip(term.words, words, strict=False):
        if word not in choices:
            raise InputError(f"check {term}: unknown word {word!r}, {hint(word, choices)}")
