"""What clean-up must make exact: the degrees of one turn, the count of one act."""

from __future__ import annotations

from itertools import pairwise, product

from latentmotion.corrections import Corrections, Count, Turn
from latentmotion.language.claims import SLIGHT, Claim
from latentmotion.language.kinds import kinds, related
from latentmotion.language.reading import request_of
from latentmotion.language.tables import data
from latentmotion.language.words import listed, match, tokens_of


def asked_exactly(prompt: str, any_length: bool) -> Corrections:
    """Returns the numbers that clean-up makes exact in a motion of a prompt.

    They have a turn where the prompt names the degrees of exactly one, and a count where it says
    how often exactly one act is done.

    Args:
        prompt: A sentence as users write it.
        any_length: Whether the motion may become shorter or longer; else there is no count.
    """
    claims = request_of(prompt).claims
    turns = [claim for claim in claims if claim.kind in ("turn", "circle")]
    turn = None
    if len(turns) == 1 and turns[0].degrees not in (0, SLIGHT):
        turn = Turn(turns[0].degrees * max(turns[0].count, 1), turns[0].side)
    counts = [claim for claim in claims if claim.count and claim not in turns]
    if not any_length or len(counts) != 1 or _is_vague(prompt):
        return Corrections(turn)
    return Corrections(turn, _count(counts[0], claims, prompt))


def usual_range(prompt: str) -> tuple[float, float] | None:
    """Returns how many seconds a motion of a prompt lasts at least and at most.

    None where it names several acts, a count, or nothing of the table.
    """
    claims, tokens = request_of(prompt).claims, tokens_of(prompt)
    if len(claims) > 1 or any(claim.count or claim.degrees for claim in claims):
        return None
    for row in data("acts.toml")["seconds"]:
        named = any(claim.kind in row.get("kinds", ()) for claim in claims)
        places = product(row.get("phrases", ()), range(len(tokens))) if not claims else ()
        if named or any(match(phrase, tokens, at) for phrase, at in places):
            least, most = row["range"]
            return least, most
    return None


def _is_vague(prompt: str) -> bool:
    """Whether a count is not exact, or not of repetitions: "about three", "2-3", "two people"."""
    words = [token.text for token in tokens_of(prompt)]
    pairs = set(pairwise(words))
    bounds = {tuple(bound.split()) for bound in listed("bounds")}
    return bool(set(words) & listed("vague") or pairs & bounds or "-" in words)


def _count(counted: Claim, claims: tuple[Claim, ...], prompt: str) -> Count | None:
    """Returns the count of the one act that is counted; none if others look like it."""
    kind = counted.kind
    alike = related("looks_like").get(kind, (kind,))
    others = [claim for claim in claims if claim is not counted and claim.kind in alike]
    if kind == "move":  # "walks four steps" claims both
        directions = ("", counted.direction)
        others = [one for one in others if one.kind != "walk" or one.direction not in directions]
        others += [claim for claim in claims if claim.then]
    if kind not in kinds("exact") or others:
        return None
    act = "step" if kind in ("move", "walk") else kind
    on_one_leg = {token.text for token in tokens_of(prompt)} & {"leg", "foot"}
    if kind == "hop" and not counted.side and not on_one_leg:
        act = "jump"
    side = counted.side if act in ("hop", "kick", "knee", "punch", "raise") else ""
    return Count(act, side, counted.count)
