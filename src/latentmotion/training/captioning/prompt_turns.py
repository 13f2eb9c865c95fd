"""Prompts that ask for turns on the spot and on the way, curves and circles."""

from __future__ import annotations

from latentmotion.measure.facts import SingleAction
from latentmotion.training.captioning.prompt_patterns import (
    GOING,
    RUNNERS,
    Wording,
    clockwise,
    patterns,
    people_on_foot,
    times,
    towards,
)


def turn(action: SingleAction) -> Wording:
    """Patterns for a turn on the spot, or on the way while walking or running."""
    gait, degrees = action.gait, action.degrees
    if gait and degrees > 270:
        return circle(action)
    clauses, nouns = turned(action.side, degrees)
    if gait:
        going = GOING[gait]
        clauses = [
            *(f"~{gait} and {text}" for text in clauses),
            *(f"{text} while {going}" for text in clauses[:5]),
            *_curved(action),
        ]
        nouns = [f"{text} while {going}" for text in nouns]
        return Wording(clauses, nouns, people=people_on_foot(gait))
    if degrees < 290:
        clauses = [f"{text}[||||| on the spot| in place]" for text in clauses]
        clauses += [f"~stand on the spot and {text}" for text in clauses[:1]]
    return Wording(clauses, nouns, people=("a dancer",) if degrees >= 290 else ())


def turned(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Returns verb phrases and noun phrases of a turn by degrees."""
    if degrees >= 290:
        return _spun(side, degrees)
    if 130 <= degrees <= 230:
        return _turned_around(side, degrees)
    to, to_the = towards(side), f"to [the|the|<his>] {side}"
    clauses: list[str] = []
    nouns: list[str] = []
    if degrees < 50:
        clauses += [f"~turn slightly {to}", f"~turn a [bit|little] {to}", f"slightly ~turn {to}"]
        clauses += [f"~turn {to} [a bit|a little|slightly]", f"~turn just a [bit|little] {to}"]
        clauses += [f"~make a [slight|small] turn {to_the}", f"~rotate [slightly|a little] {to}"]
        clauses += [f"~make a [slight|small] {side} turn"]
        nouns += [f"a [slight|small|little] turn {to_the}", f"a [slight|small] {side} turn"]
    if 33 <= degrees < 60:
        half = "[45|45|forty-five]"
        clauses += [f"~turn {half} degrees {to}", f"~turn {to} by {half} degrees"]
        clauses += [f"~rotate {half} degrees {to}", f"~make a 45 degree turn {to_the}"]
        nouns += [f"a [45 degree|45-degree] turn {to_the}", f"a 45 degree {side} turn"]
    if 68 <= degrees < 113:
        right = "[90|90|ninety]"
        clauses += [f"~turn {right} degrees {to}", f"~make a quarter turn {to_the}"]
        clauses += [f"~turn {to} by {right} degrees", f"~turn {to} {right} degrees"]
        clauses += [f"~do a [quarter|90 degree] turn {to_the}", f"~turn a quarter {to_the}"]
        clauses += [f"~rotate {right} degrees {to}"]
        nouns += [f"a quarter turn {to_the}", f"a quarter turn {side}"]
        nouns += [f"a [90 degree|90-degree|ninety degree] turn {to_the}"]
        nouns += [f"a [90 degree|90-degree] {side} turn"]
    if degrees >= 113:
        clauses += [f"~turn [far|around] to the {side}", f"~turn a long way to the {side}"]
        clauses += [f"~make a big {side} turn", f"~turn {clockwise(side)}"]
        nouns += [f"a [big|wide|large] turn to the {side}"]
    if degrees >= 30:
        plain = [f"~turn {to}", f"~turn {to}", f"~make a {side} turn", f"~rotate {to}"]
        plain += [f"~pivot {to}", f"~do a turn to the {side}", f"~swivel to the {side}"]
        plain += [f"~take a turn to the {side}", f"~turn to the {side} side"]
        if 60 <= degrees <= 120:
            plain += [f"~turn to face [{side}|the {side}]", f"~face {side}"]
        clauses = [*plain[:2], *clauses, *plain[2:]]
        nouns = [f"a {side} turn", f"a turn {to_the}", f"{side} turn", *nouns]
    return clauses, nouns


def _turned_around(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Returns verb phrases and noun phrases of turns of 130 to 230 degrees."""
    to, to_the = towards(side), f"to [the|the|<his>] {side}"
    clauses = ["~turn around", f"~turn around [to the {side}|to <his> {side}|{side}]"]
    clauses += [f"~turn around [{clockwise(side)}|over <his> {side} shoulder]", "~turn back"]
    clauses += ["~turn to face the other way", "~turn to the opposite direction"]
    clauses += ["~turn and ~face the [opposite direction|other direction|other way]"]
    nouns = [f"a turn around {to_the}", f"turning around {to_the}"]
    if 150 <= degrees <= 210:
        half = ["~turn [180|180|a hundred and eighty] degrees", f"~turn [180|180] degrees {to}"]
        half += [f"~make a half turn {to_the}", f"~turn {side} by 180 degrees"]
        half += ["~do [an about-face|a 180|a one-eighty|an about face]", "~make a half turn"]
        half += [f"~turn halfway around {to_the}", f"~do a [half|180 degree] turn {to_the}"]
        clauses = [*clauses[:2], *half, *clauses[2:]]
        nouns += [f"a half turn {to_the}", "a half turn", "an about-face"]
        nouns += [f"a [180|180 degree] turn {to_the}", "a [180|180 degree] turn"]
    return clauses, nouns


def _spun(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Returns verb phrases and noun phrases of turns of 290 degrees and more."""
    rounds, to, clock = round(degrees / 360), towards(side), clockwise(side)
    spot = "[|||on the spot|in place]"
    if degrees <= 430:
        clauses = patterns(f"""
            ~spin around [||once]; ~spin around {to}; ~spin {clock} {spot};
            ~turn all the way around {to}; ~turn in a full circle [||to the {side}|{clock}];
            ~do a [360|360|full spin|full turn] [||to the {side}|{clock}];
            ~make a full turn to [the|<his>] {side};
            ~rotate [once|all the way around|360 degrees] {clock};
            ~turn [360 degrees|a full 360] [||{to}]; ~turn around once {to};
            ~twirl around [||to the {side}|once]
        """)
        nouns = [f"a [full|complete|360 degree] turn to the {side}", f"a spin to the {side}"]
        return clauses, [*nouns, f"a {clock} spin", "a full spin", "a 360", f"a full {side} turn"]
    vague = "several times" if rounds > 2 else "more than once"
    often = times(rounds) if abs(degrees / 360 - rounds) < 0.2 and rounds > 1 else vague
    clauses = patterns(f"""
        ~spin around {often}; ~spin around and around {to}; ~spin {clock} {spot};
        ~spin around {to} {often}; ~keep [spinning|turning] [to the {side}|{clock}];
        ~turn around and around {to}; ~turn in circles {spot} [|to the {side}|{clock}];
        ~rotate {clock} {often}; ~twirl around {often}
    """)
    return clauses, [f"spins to the {side}", f"spinning {clock}", "spinning around and around"]


def _curved(action: SingleAction) -> list[str]:
    """Returns verb phrases of a turn on the way: curves, bends and corners."""
    gait, side, degrees = action.gait, action.side, action.degrees
    going = GOING[gait]
    to = f"to [the|the|<his>] {side}"
    if degrees > 230:
        return [f"~{gait} in a [wide|long] curve {to}", f"~{gait} far around {to}"]
    if degrees >= 130:
        out = [f"~{gait} and ~make a u-turn [|{to}]", f"~{gait} around in a half circle {to}"]
        out += [f"~make a u-turn [|{to}] while {going}", f"~do a u-turn, {going}"]
        return [*out, f"~turn back while {going}", f"~{gait}, ~turn and ~{gait} the other way"]
    out = [f"~{gait} in a [curve|bend|curve|arc] {to}", f"~{gait} along a curve {to}"]
    out += [f"~curve {to} while {going}", f"~{gait} a curve {to}"]
    if degrees <= 75:
        veer = f"[bearing|veering|drifting] {towards(side)}"
        out += [f"~{gait} and ~veer {to}", f"~veer {to} while {going}", f"~{gait}, {veer}"]
        out += [f"~{gait} and ~bear {side}", f"~bear {side} while {going}"]
        out += [f"~{gait} and ~drift {to}"]
    if degrees >= 45:
        out += [f"~take a {side} while {going}", f"~{gait} and ~take a {side} [|turn]"]
        out += [f"~{gait} around a [corner|bend] {to}", f"~{gait} and ~round a corner {to}"]
        out += [f"~{gait}, turning {side}"]
    return out


def walk_and_turn(action: SingleAction) -> Wording:
    """Patterns for a straight way and then a turn, or the other way around."""
    gait = action.gait or "walk"
    turns, nouns = turned(action.side, action.degrees)
    if 130 <= action.degrees <= 230:
        turns += ["~make a u-turn", f"~do a u-turn to the {action.side}"]
        nouns += ["a u-turn", f"a u-turn to the {action.side}"]
    elif action.degrees >= 45:
        turns += [f"~take a {action.side} [|turn]", f"~turn off to the {action.side}"]
    ahead = "[||forward|ahead|straight ahead|a bit|a little]"
    if action.kind == "walk_then_turn":
        join = "[, then|, then| and then| and|, and then]"
        clauses = [f"~{gait} {ahead}{join} {text}" for text in turns]
        named = [f"a {gait} [forward|], then {text}" for text in nouns]
        named += [f"a {gait} followed by {text}" for text in nouns]
        return Wording(clauses, named)
    on = f"~{gait} [||forward|off|away|on|straight on|ahead|straight ahead]"
    clauses = [f"{text}[, then| and then| and| and|, and then] {on}" for text in turns]
    named = [f"{text}, then a {gait} [forward|straight ahead|]" for text in nouns]
    return Wording(clauses, (*named, *(f"{text} followed by a {gait}" for text in nouns)))


def turn_and_return(action: SingleAction) -> Wording:
    """Patterns for a way there, a turn around and the way back."""
    gait = action.gait or "walk"
    going = GOING[gait]
    side = f"[|||to the {action.side}|to <his> {action.side}]" if action.side else ""
    around = f"[~turn around {side}|~make a u-turn {side}|~turn back|~do a 180]"
    clauses = patterns(f"""
        ~{gait} [forward|ahead|away|], {around} and [~come back|~{gait} back|~return|~go back];
        ~{gait} [|forward|ahead] and {around} and ~{gait} back; ~{gait} there and back;
        ~{gait} away, [~turn|~turn around] and [~come back|~return|~{gait} back];
        ~turn [around|back] {side} and ~{gait} [back|the other way];
        ~{gait} [forward|ahead], then {around}, then ~{gait} back;
        ~{gait}, {around} and ~{gait} [in the opposite direction|the other way];
        ~make a u-turn {side} and ~come back;
        ~{gait} one way, ~turn around and ~{gait} the other way;
        ~{gait} [up|off], ~turn [around|back] {side} and ~return
    """)
    nouns = patterns(f"""
        a {gait} [there and back|with a u-turn|forward and back]; {going} there and back;
        a u-turn while {going}; a {gait}, a u-turn and a {gait} back
    """)
    return Wording(clauses, nouns, people=people_on_foot(gait))


def circle(action: SingleAction) -> Wording:
    """Patterns for a whole circle, walked or run."""
    gait, side, clock = action.gait or "walk", action.side, clockwise(action.side)
    going = GOING[gait]
    way = f"[||to the {side}|{clock}|{clock}|to <his> {side}]"
    clauses = patterns(f"""
        ~{gait} in a circle {way}; ~{gait} in a circle {way}; ~{gait} around in a circle {way};
        ~{gait} {clock} in a circle; ~{gait} in a {clock} circle; ~go around in a circle {way};
        ~{gait} a [full|whole|complete] circle {way};
        ~circle around [to the {side}|{clock}] while {going}
    """)
    nouns = patterns(f"""
        a {clock} circle, {going}; a {gait} in a circle {way};
        a circle [to the {side}|{clock}] while {going}; {going} in a circle {way}
    """)
    if action.degrees >= 400:
        clauses += [f"~{gait} in circles {way}", f"~go around in circles {way}"]
        clauses += [f"~{gait} around and around {way}", f"~{gait} round and round"]
    elif action.degrees >= 290:
        clauses += [f"~{gait} [one lap|a lap|one round] {way}", f"~{gait} around once {way}"]
        clauses += [f"~{gait} in a circle {way} and ~end up where <he> started"]
        nouns += [f"[a|one] lap {way}[|, {going}]"]
    return Wording(clauses, nouns, people=people_on_foot(gait))


def half_circle(action: SingleAction) -> Wording:
    """Patterns for half a circle, walked or run."""
    gait, side, clock = action.gait or "walk", action.side, clockwise(action.side)
    going = GOING[gait]
    way = f"[|to the {side}|to the {side}|{clock}|to <his> {side}]"
    half = "[half circle|semicircle|half-circle|half circle]"
    clauses = patterns(f"""
        ~{gait} in a {half} {way}; ~{gait} a {half} {way}; ~make a {half} {way} while {going};
        ~{gait} around in a {half} {way}; ~{gait} half a circle {way};
        ~follow a {half} {way}, {going}; ~{gait} along a {half} {way};
        ~{gait} in a [wide|long] curve to the {side}; ~{gait} a wide u-turn {way};
        ~{gait} in a {clock} {half}
    """)
    nouns = [f"a {half} {way}, {going}", f"a {gait} in a {half} {way}", f"half a circle {way}"]
    return Wording(clauses, nouns, people=RUNNERS if gait != "walk" else ())


def weave(action: SingleAction) -> Wording:
    """Patterns for a way that bends to the left and the right in turn."""
    gait = action.gait or "walk"
    going = GOING[gait]
    clauses = patterns(f"""
        ~{gait} in a zigzag [|line|pattern|path]; ~zigzag [|forward|ahead|along];
        ~{gait} in [a wavy line|an s-curve|s-curves|a serpentine|a snaking line|curves];
        ~weave [left and right|from side to side|along|through obstacles|in and out];
        ~{gait} a slalom; ~slalom [|forward|while {going}]; ~{gait} and ~zigzag;
        ~{gait} in curves [left and right|to both sides];
        ~{gait}, weaving [left and right|from side to side|around obstacles];
        ~{gait} [zigzag|in a slalom]; ~{gait} forward, swerving left and right;
        ~{gait} around [cones|obstacles] in a slalom; ~swerve left and right while {going}
    """)
    nouns = (f"a [zigzag|slalom|wavy|winding] {gait}", f"a slalom, {going}", "a zigzag path")
    return Wording(clauses, nouns)
