"""Acts → verb phrases, several for each, from `phrases.toml`: "~bend <his> knees" for "bends"."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from latentmotion.language.inflection import present_participle
from latentmotion.measure.facts import LEFT, RIGHT, Event
from latentmotion.measure.reported_acts import ReportedAct
from latentmotion.measure.whole_body import FAST, SLOW
from latentmotion.training.captioning.prompt_patterns import filled

_TIMES = ("", "once", "twice", "three times", "four times", "five times", "six times",
          "seven times", "eight times", "nine times", "ten times")  # fmt: skip

# Meters per second above which a run is called fast.
_FAST_RUN = 3.6

# Radius in meters from which a turn on the way is called a curve or a circle.
_WIDE = 0.4

_DIRECTIONS = {
    "forward": ("forward", "forward", "straight ahead", "forwards"),
    "backward": ("backward", "backwards", "backwards"),
    "left": ("sideways to the left", "to the left sideways", "left sideways"),
    "right": ("sideways to the right", "to the right sideways", "right sideways"),
    "place": ("in place", "on the spot"),
}
_LOW = {"crouch": ("crouched", "in a crouch"), "bend": ("bent forward", "bent over"), "": ("",)}


@cache
def _tables() -> Mapping[str, Any]:
    text = files("latentmotion.training.captioning").joinpath("phrases.toml").read_text("utf-8")
    return tomllib.loads(text)


def phrases(act: ReportedAct) -> list[str]:
    """Returns verb phrases for an act, the plainest first.

    A verb in its base form follows `~`; `<his>` and `<him>` stand for pronouns.
    """
    if act.kind in ("walk", "jog", "run"):
        return _gait(act)
    if act.kind in _tables():
        return _filled(_tables()[act.kind], act)
    return [f"~do {act.kind.replace('_', ' ')}"]


def meanwhile(act: ReportedAct) -> list[str]:
    """Returns verb phrases for an act that happens during another, after "while"."""
    return _filled(_tables()["turn_meanwhile"], act) if act.kind == "turn" else phrases(act)


def _filled(table: Sequence[Mapping[str, Any]], act: ReportedAct) -> list[str]:
    event, gait, degrees = act.event, act.gait, act.event.amount
    often = _TIMES[event.count] if event.count < len(_TIMES) else "several times"
    onward = gait is not None and gait.direction == "forward"
    # The path is as long as the gait is fast; divided by the angle it is the radius. Angles below
    # 0.3 rad would make any path a wide one.
    wide = gait is not None and gait.amount * gait.seconds / max(degrees / 57.3, 0.3) > _WIDE
    properties = {
        "side": event.side, "direction": event.direction, "count": event.count, "amount": degrees,
        "often": often, "number": often.removesuffix(" times").replace("twice", "two"),
        "gait": gait.kind if gait else "", "pace": _paces(gait)[0] if gait else "",
        "onward": "yes" if onward else "", "circling": "yes" if onward and wide else "",
        "slightly": "slightly" if degrees < 45 else "",
        "clock": "counterclockwise" if event.side == LEFT else "clockwise",
    }  # fmt: skip
    # Plain repetition counts are likelier than vague ones.
    counts = [""] if event.count == 1 else [often, often]
    counts += ["repeatedly", "several times"] if event.count > 3 else []
    texts = []
    for part in filled(table, properties, ("phrases", "counted")):
        texts += part["phrases"]
        texts += [f"{text} {count}".strip() for text in part["counted"] for count in counts]
    return texts


def _gait(act: ReportedAct) -> list[str]:
    """Returns every combination of verb, direction, pace and posture of a gait."""
    event = act.event
    if act.on:
        going = present_participle(event.kind)
        to = "" if event.direction in ("forward", "place") else event.direction
        texts = [f"keep {going} {to}", f"{event.kind} on {to}", f"continue {going} {to}"]
        return [
            f"~{' '.join(text.split())}" for text in (*texts, f"{event.kind} {to or 'forward'}")
        ]
    sideways = event.direction in (LEFT, RIGHT) and event.kind == "walk"
    paces = _paces(event)
    texts = [
        f"{verb} {direction} {pace} {low}"
        for verb in (["step", "walk", "move"] if sideways else [event.kind])
        for direction in _DIRECTIONS[event.direction]
        for pace in paces
        for low in _LOW[act.posture]
    ]
    if event.kind == "walk" and event.direction == "forward" and not act.posture:
        texts += [f"walk {pace}" for pace in paces]
        texts += [f"walk in a straight line {pace}" for pace in paces]
    texts += [f"sidestep to the {event.direction}"] if sideways else []
    return [f"~{' '.join(text.split())}" for text in texts]


def _paces(gait: Event) -> list[str]:
    """Returns adverbs of the pace of a gait."""
    if gait.kind == "walk" and gait.amount < SLOW:
        return ["slowly", "slowly", "at a slow pace"]
    if gait.kind == "walk" and gait.amount > FAST:
        return ["quickly", "briskly", "fast", "at a fast pace"]
    if gait.kind == "run" and gait.amount > _FAST_RUN:
        return ["", "fast", "quickly"]
    return ["", "", "", "", "at a normal pace" if gait.kind == "walk" else ""]
