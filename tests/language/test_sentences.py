"""Reading of sentences that were written before the rules: coverage, and claims that are none.

`with.tsv` holds sentences that ask for something, with the reading that a person gives them;
`without.tsv` sentences with words that only look like an act, a turn or a count.
"""

from __future__ import annotations

from pathlib import Path

from latentmotion.language.claims import Claim
from latentmotion.language.reading import request_of

UNMEASURED = {"twist", "lift"}  # Kinds of claims that name nothing to be done by the whole body.

# Kinds of claims by the names of the lists, where they differ.
KINDS = {
    "walk_backward": {"walk", "move"}, "sidestep": {"walk", "move"}, "step": {"walk", "move"},
    "march": {"walk"}, "tiptoe": {"walk"}, "turn": {"turn", "circle"}, "run": {"run", "jog"},
    "hop": {"hop", "jump"}, "lie": {"lie_down"}, "kneel": {"kneel_down"}, "stand": {"stand"},
    "crouch": {"crouch", "squat"}, "bend": {"bow", "pick_up"}, "raise_arm": {"raise"},
    "stand_still": {"stand"}, "one_leg": {"balance"}, "jumping_jack": {"jack"}, "reach": {"raise"},
    "walk": {"walk", "move"},
}  # fmt: skip


def rows(name: str) -> list[list[str]]:
    text = (Path(__file__).parent / name).read_text(encoding="utf-8")
    lines = (line.split("\t") for line in text.splitlines() if not line.startswith("#"))
    return [(line + [""] * 3)[:4] for line in lines]


def kinds(acts: str) -> list[set[str]]:
    return [KINDS.get(act, {act}) for act in acts.split()]


def is_false(claim: Claim, allowed: str) -> bool:
    known = set[str]().union(*kinds(allowed)) | UNMEASURED
    return claim.kind not in known or claim.count > 0 or claim.degrees > 0


def is_as_expected(claims: tuple[Claim, ...], acts: str, degrees: str, times: str) -> bool:
    fits = all(any(claim.kind in kind for claim in claims) for kind in kinds(acts))
    turns = [claim for claim in claims if claim.kind in ("turn", "circle")]
    if number := degrees.rstrip("?"):
        fits &= abs(float(number)) in [turn.degrees * max(turn.count, 1) for turn in turns]
    if number and not degrees.endswith("?"):
        fits &= turns[0].side == ("left" if float(number) > 0 else "right") if turns else False
    if "walk_backward" in acts:
        fits &= any(claim.direction == "backward" for claim in claims)
    if "sidestep" in acts:
        fits &= any(claim.direction in ("left", "right", "side") for claim in claims)
    return fits and (not times or int(times) in [claim.count for claim in claims])


def test_what_is_no_act_is_not_claimed() -> None:
    false = [
        sentence
        for sentence, allowed, *_ in rows("without.tsv")
        if any(is_false(claim, allowed) for claim in request_of(sentence).claims)
    ]
    assert len(rows("without.tsv")) == 100 and len(false) <= 2, false


def test_what_is_asked_is_read() -> None:
    table = rows("with.tsv")
    read = [row[0] for row in table if request_of(row[0]).claims]
    right = [row[0] for row in table if is_as_expected(request_of(row[0]).claims, *row[1:])]
    assert len(table) == 96 and len(read) >= 0.92 * 96 and len(right) >= 0.9 * 96
