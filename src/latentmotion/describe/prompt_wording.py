"""Which patterns belong to which kind of action, and to two actions that differ only by side.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from collections.abc import Callable

from latentmotion.describe import (
    prompt_arms,
    prompt_changes,
    prompt_gaits,
    prompt_legs,
    prompt_turns,
)
from latentmotion.describe.prompt_phrases import Wording
from latentmotion.describe.prompt_postures import PLAIN, crouched
from latentmotion.describe.single import SingleAction

_WORDINGS: dict[str, Callable[[SingleAction], Wording]] = {
    **dict.fromkeys(("walk", "jog", "run"), prompt_gaits.gait),
    "steps": prompt_gaits.steps,
    "turn": prompt_turns.turn,
    **dict.fromkeys(("walk_then_turn", "turn_then_walk"), prompt_turns.walk_and_turn),
    "turn_and_return": prompt_turns.turn_and_return,
    "circle": prompt_turns.circle,
    "half_circle": prompt_turns.half_circle,
    "weave": prompt_turns.weave,
    **dict.fromkeys(prompt_changes.CHANGES, prompt_changes.changed),
    "jump": prompt_legs.jumped,
    "hop": prompt_legs.hopped,
    "kick": prompt_legs.kicked,
    "punch": prompt_arms.punched,
    "wave": prompt_arms.waved,
    "raise": prompt_arms.raised,
    "clap": prompt_arms.clapped,
    "knee": prompt_legs.kneed,
    **dict.fromkeys(("jack", "squat", "bow"), prompt_legs.counted),
    "arm_circle": prompt_arms.circled_arms,
    "pick_up": prompt_arms.picked_up,
    "balance": prompt_legs.balanced,
    "touch_head": prompt_arms.touched_head,
    "climb": prompt_legs.climbed,
    "crouch": crouched,
}

KINDS = (*_WORDINGS, *PLAIN)
"""All kinds of actions that have words."""


def wording(action: SingleAction) -> Wording:
    """Returns the patterns for an action.

    Raises:
        KeyError: Its kind is none of `KINDS`.
    """
    return PLAIN[action.kind] if action.kind in PLAIN else _WORDINGS[action.kind](action)


_LIMBS = {
    "kick": ("leg", ("~kick with <the> A LIMB, then with the B", "~kick A, then B")),
    "punch": ("hand", ("~punch with <the> A LIMB, then with the B", "~punch A, then B")),
    "wave": (
        "hand",
        ("~wave <the> A LIMB, then the B",),
    ),
    "raise": ("hand", ("~raise <the> A LIMB, then the B", "~lift <the> A LIMB, then the B")),
    "knee": ("knee", ("~raise <the> A LIMB, then the B", "~lift <the> A LIMB, then the B")),
    "hop": ("leg", ("~hop on <the> A LIMB, then on the B",)),
    "balance": (
        "leg",
        ("~stand on <the> A LIMB, then on the B",),
    ),
}
"""Limb of acts with one side, and patterns for one side A and then the other, B."""

_WAYS = ("walk", "jog", "run", "jump", "steps")


def contrasted(first: SingleAction, second: SingleAction) -> tuple[str, ...]:
    """Returns patterns that name the act once: "kick with the left leg, then with the right"."""
    if first.kind != second.kind or max(first.count, second.count) > 1:
        return ()
    if first.kind in _LIMBS and {first.side, second.side} == {"left", "right"}:
        limb, texts = _LIMBS[first.kind]
        joins = (", then", " and then", " then")
        named = [text.replace("LIMB", limb) for text in texts]
        named += [f"{text.replace('LIMB', limb)} {limb}" for text in texts if "LIMB" in text]
        return tuple(
            text.replace("A", first.side).replace("B", second.side).replace(", then", join)
            for text in named
            for join in joins
        )
    ways = first.direction, second.direction
    if first.kind in _WAYS and "" not in ways and ways[0] != ways[1] and first.pace == second.pace:
        verb = "step" if first.kind == "steps" else first.kind
        one, two = (_way(way) for way in ways)
        return (f"~{verb} {one}, then {two}", f"~{verb} {one} and then {two}")
    return ()


def _way(direction: str) -> str:
    if direction in ("left", "right"):
        return f"[{direction}|to the {direction}]"
    return f"[{direction}|{direction}s]"
