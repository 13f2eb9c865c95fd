"""How people type starts, stops and changes of gait or speed.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from collections.abc import Callable

from latentmotion.describe.prompt_phrases import (
    GOING,
    PEOPLE_ON_FOOT,
    RUNNERS,
    Wording,
)
from latentmotion.describe.single import SingleAction


def _on_foot(gait: str) -> tuple[str, ...]:
    return RUNNERS if gait in ("jog", "run") else PEOPLE_ON_FOOT


def _faster(action: SingleAction) -> Wording:
    gait = action.gait
    clauses = ["~speed up", "~get faster [|and faster]", "~accelerate", "~pick up [speed|the pace]"]
    clauses += ["~start [slow|slowly|out slow] and ~speed up", "~start slowly, then ~get faster"]
    if gait:
        clauses += [
            f"~{gait} faster and faster",
            f"~{gait} and ~speed up",
            f"~{gait} and ~get faster",
        ]
        clauses += [f"~{gait} and ~accelerate", f"~{gait} slowly at first, then faster"]
        clauses += [f"~{gait}, then ~{gait} faster", f"~{gait}, getting faster [|and faster]"]
        clauses += [f"~{gait}, then ~speed up", f"~start to {gait} faster"]
    nouns = [f"a {gait or 'walk'} that gets faster [|and faster]", "an acceleration"]
    nouns += [f"a {gait or 'walk'} with increasing speed", f"a faster and faster {gait or 'walk'}"]
    return Wording(tuple(clauses), tuple(nouns), people=_on_foot(gait))


def _slower(action: SingleAction) -> Wording:
    gait = action.gait
    clauses = ["~slow down", "~get slower [|and slower]", "~decelerate", "~lose speed"]
    clauses += ["~start fast and ~slow down", "~reduce the pace", "~start fast, then ~get slower"]
    if gait:
        clauses += [
            f"~{gait} slower and slower",
            f"~{gait} and ~slow down",
            f"~{gait} and ~get slower",
        ]
        clauses += [f"~{gait}, then ~slow down", f"~{gait}, getting slower [|and slower]"]
        clauses += [f"~{gait} fast at first, then slower", f"~{gait}, then ~{gait} slower"]
    nouns = [f"a {gait or 'walk'} that gets slower [|and slower]", "a slowdown"]
    nouns += [f"a {gait or 'walk'} with decreasing speed", f"a slower and slower {gait or 'walk'}"]
    return Wording(tuple(clauses), tuple(nouns), people=_on_foot(gait))


_AHEAD = {
    "": ("[||off|forward|away|ahead]", ""),
    "forward": ("[||off|forward|away|ahead]", "[||forward|ahead|a bit|a little]"),
    "backward": ("[backward|backwards]", "[backward|backwards]"),
    "left": ("[sideways |]to the left", "[sideways |]to the left"),
    "right": ("[sideways |]to the right", "[sideways |]to the right"),
}
"""How a start and a gait before a stop go on, by direction."""


def _started(action: SingleAction) -> Wording:
    gait = "walk" if action.kind == "start_walking" else "run"
    going, away = GOING[gait], _AHEAD[action.direction][0]
    still = "[~stand|~stand still|~wait|~stand for a moment|~stand there|~stay still for a moment]"
    clauses = [
        f"~start {going} {away}",
        f"~start to {gait} {away}",
        f"{still}, then ~{gait} {away}",
    ]
    clauses += [f"~begin to {gait} {away}", f"{still} and then ~{gait} {away}"]
    clauses += [f"~begin {going} {away}", f"{still}, then ~start {going} {away}"]
    clauses += [f"~go from standing to {going} {away}", f"{still} before {going} {away}"]
    clauses += [f"~stand at first, then ~{gait} {away}"]
    nouns = [f"first standing, then {going} {away}", f"from standing to {going}"]
    nouns += [f"a {gait} from a standstill", f"standing and then {going} {away}"]
    nouns += [f"the start of a {gait}"]
    if action.direction in ("", "forward"):
        clauses += [f"~{gait} off", f"~set off [{going}|at a {gait}]", f"~take off at a {gait}"]
    return Wording(tuple(clauses), tuple(nouns), people=_on_foot(gait))


def _stopped(action: SingleAction) -> Wording:
    gait = "walk" if action.kind == "stop_walking" else "run"
    going, way = GOING[gait], _AHEAD[action.direction][1]
    halt = "[~stop|~stop|~come to a stop|~halt|~come to a halt|~stand still|~come to a standstill]"
    clauses = [f"~stop {going} {way}", f"~{gait} {way}, then {halt}", f"~{gait} {way} and {halt}"]
    clauses += [f"~{gait} {way} and then {halt}", f"~come to a [stop|halt] after {going} {way}"]
    clauses += [f"~{gait} {way} before stopping", f"~finish {going} and ~stand still"]
    clauses += [f"~go from {going} {way} to standing", f"~stop after {going} {way}"]
    nouns = [f"{going} {way}, then standing still", f"a {gait} {way}, then a stop"]
    nouns += [f"a {gait} {way} followed by a stop", f"from {going} to standing"]
    nouns += [f"{going} and stopping", f"a {gait} {way} that comes to a stop"]
    if action.direction in ("", "forward"):
        clauses += [f"~{gait} up and ~stop", f"~{gait} forward and ~stop there"]
    after = ("~stop", "~come to a stop", "~stand still", "~halt")
    return Wording(tuple(clauses), tuple(nouns), after, _on_foot(gait))


_CHANGES: dict[str, Wording] = {
    "walk_to_run": Wording(
        (
            "~walk, then ~run",
            "~walk and then ~run",
            "~walk [|forward|a bit], then ~start [running|to run]",
            "~go from walking to running",
            "~walk, then ~break into a [run|run|jog]",
            "~break into a run",
            "~start walking and ~end up running",
            "~walk first, then ~run",
            "~walk and ~start [running|to run]",
            "~speed up from a walk to a run",
            "~walk before running",
            "~run after walking [a bit|a little|]",
            "~switch from walking to running",
        ),
        (
            "a walk that turns into a run",
            "from a walk to a run",
            "first walking, then running",
            "a walk, then a run",
            "a walk followed by a run",
            "from walking to running",
        ),
        people=RUNNERS,
    ),
    "run_to_walk": Wording(
        (
            "~run, then ~walk",
            "~run and then ~walk",
            "~run [|forward|a bit], then ~slow down to [a walk|walking]",
            "~go from running to walking",
            "~run, then ~start walking",
            "~slow down from a run to a walk",
            "~run first, then ~walk",
            "~stop running and ~walk",
            "~run and ~slow [down |]to a walk",
            "~run before walking",
            "~walk after running [a bit|a little|]",
            "~switch from running to walking",
            "~drop from a run to a walk",
        ),
        (
            "a run that turns into a walk",
            "from a run to a walk",
            "first running, then walking",
            "a run, then a walk",
            "a run followed by a walk",
            "from running to walking",
        ),
        people=RUNNERS,
    ),
}

_SPEEDS: dict[str, Callable[[SingleAction], Wording]] = {
    "speed_up": _faster,
    "slow_down": _slower,
    **dict.fromkeys(("start_walking", "start_running"), _started),
    **dict.fromkeys(("stop_walking", "stop_running"), _stopped),
}


def changed(action: SingleAction) -> Wording:
    """Starting, stopping, and changing from one gait or speed to another."""
    return _SPEEDS[action.kind](action) if action.kind in _SPEEDS else _CHANGES[action.kind]


CHANGES = (*_SPEEDS, *_CHANGES)
"""Kinds of actions whose gait or pace changes."""
