"""The actions that Seoul National University's annotators named, as sentences.

What they mean was checked against the motion: `'` is done to the person (a pass received), players
feint to the side that is named, `jd` leaves the floor by a meter with the body level.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

ACTIONS: Mapping[str, str] = {
    "block": "raises the arms to block a shot",
    "bs": "spins around and kicks backward",
    "catch": "catches a ball with both hands",
    "dribble": "dribbles a basketball",
    "fake_shoot": "fakes a basketball shot",
    "fake_shot": "fakes a basketball shot",
    "feint_l": "feints to the left with a basketball",
    "feint_r": "feints to the right with a basketball",
    "hold": "holds a basketball",
    "idle": "stands still",
    "jbs": "jumps, spins around in the air and kicks backward",
    "jd": "leaps into a butterfly kick, spinning through the air with the body level",
    "jk": "jumps and kicks",
    "mark": "guards an opponent in basketball, moving with bent knees",
    "pass": "passes a basketball",
    "pass'": "catches a pass",
    "pass_long": "throws a long pass over the head",
    "pickup": "picks a basketball up from the floor",
    "pivot_l": "pivots on one foot with a basketball",
    "pivot_r": "pivots on one foot with a basketball",
    "run": "runs",
    "screen": "stands in an opponent's way to set a screen",
    "screen'": "runs into a screen",
    "shoot": "jumps and shoots a basketball at the hoop",
    "shoot_near": "runs up, jumps and shoots a basketball from close to the hoop",
    "walk": "walks",
}
"""What a person does, by the annotators' word."""

_MOST = 4


def sentences_of(actions: Sequence[str]) -> tuple[str, ...]:
    """Returns sentences for actions in this order; none for more than four, or unknown ones."""
    phrases = [phrase for phrase, _ in groupby(ACTIONS.get(action, "") for action in actions)]
    if not phrases or "" in phrases or len(phrases) > _MOST:
        return ()
    told = ", then ".join(phrases)
    return (f"a person {told}.", f"someone {told.replace(', then ', ' and then ')}.")
