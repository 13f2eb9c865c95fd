"""Prompts that ask for gaits, steps, starts, stops and changes of gait or pace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from latentmotion.measure.facts import SingleAction
from latentmotion.training.captioning.prompt_patterns import (
    GOING,
    IN_A_ROW,
    PEOPLE_ON_FOOT,
    RUNNERS,
    Wording,
    number,
    patterns,
    people_on_foot,
    some,
    times,
)


@dataclass(frozen=True)
class _Pace:
    """Words of a gait at one pace."""

    clauses: Sequence[str]
    """Patterns with `WAY` for the direction."""
    nouns: Sequence[str]
    """Patterns with `WAY`."""
    back: Sequence[str] = ("",)
    """Adverbs of the pace for a gait backward or sideways."""
    people: Sequence[str] = ()
    """Subjects that fit the pace."""


_STREET = (
    "on the street",
    "down the street",
    "through the room",
    "across the room",
    "in the park",
    "down the hallway",
    "along the road",
)

_AHEAD = "[|||forward|forward|ahead|straight ahead|straight on|forwards|in a straight line|along]"

_GAITS: dict[tuple[str, str], _Pace] = {
    ("walk", "normal"): _Pace(
        patterns("""
            ~walk WAY; ~walk WAY; ~walk [forward|ahead|straight ahead|straight|in a straight line];
            ~walk along a straight line;
            ~walk WAY [at a normal pace|at a normal speed|normally|casually];
            ~go [forward|straight ahead|straight|ahead|on foot]; ~move [forward|ahead];
            ~take [a walk|a few steps forward|some steps forward|some steps]; ~go for a walk;
            ~keep walking [|forward|straight ahead]; ~pace [forward|ahead]; ~step forward
        """),
        patterns("""
            a walk WAY; a [normal|regular|plain|simple|ordinary|casual] walk;
            a [few|couple of] steps forward; normal walking; a [straight|forward] walk;
            a walk [at a normal pace|at an ordinary pace]
        """),
        people=PEOPLE_ON_FOOT,
    ),
    ("walk", "slow"): _Pace(
        patterns("""
            ~walk slowly WAY; ~walk WAY [slowly|very slowly|at a slow pace|really slow];
            slowly ~walk WAY;
            ~walk [slow|very slowly|at a slow pace|at a leisurely pace|without hurry];
            ~stroll [||along|forward|ahead|slowly];
            ~take [slow|slow|slow, careful] steps [forward|ahead|]; ~amble [along|forward];
            ~saunter [||along|forward]; ~move forward slowly; ~go forward [slowly|at a slow pace];
            ~plod along
        """),
        patterns("""
            a slow walk WAY; slow walking; [slow|slow and careful] steps [forward|ahead|];
            a [leisurely|slow|lazy] stroll; a walk at a slow pace
        """),
        ("slowly", "at a slow pace", "very slowly"),
        ("an old man", "an old woman", "a tired man", "grandma", "an elderly person"),
    ),
    ("walk", "fast"): _Pace(
        patterns("""
            ~walk fast WAY; ~walk WAY [fast|quickly|briskly|at a fast pace|at a brisk pace];
            ~walk [quickly|briskly|very fast|at high speed|with quick steps] WAY; quickly ~walk WAY;
            ~hurry [along|ahead|forward|somewhere|to work]; ~rush [along|ahead|forward];
            ~power-walk WAY; ~take quick steps [forward|ahead|]; ~stride along quickly;
            ~be in a hurry
        """),
        patterns("""
            a [fast|fast|brisk|quick|hurried] walk WAY; [fast|brisk] walking;
            a walk at a [fast|brisk] pace; quick steps [forward|ahead]
        """),
        ("quickly", "fast", "at a fast pace"),
        ("a busy man", "a businessman", "a commuter"),
    ),
    ("jog", "normal"): _Pace(
        patterns("""
            ~jog WAY; ~jog WAY; ~jog [at an easy pace|at a steady pace|lightly] WAY;
            ~run [slowly|at an easy pace] WAY; ~trot [||along|forward]; ~go for a jog; ~go jogging;
            ~jog [along|ahead|straight ahead|forward]
        """),
        ("a jog WAY", "a [light|easy|steady|gentle] jog", "a slow run WAY", "[some|light] jogging"),
        people=RUNNERS,
    ),
    ("run", "normal"): _Pace(
        patterns("""
            ~run WAY; ~run WAY; ~run [ahead|forward|straight ahead|straight|in a straight line];
            ~go for a run; ~go running; ~keep running [|forward|straight ahead];
            ~run [at a steady pace|at a normal pace] WAY
        """),
        ("a run WAY", "a [steady|normal|straight] run", "some running", "a forward run"),
        people=RUNNERS,
    ),
    ("run", "slow"): _Pace(
        patterns("""
            ~run slowly WAY; ~run WAY [slowly|at a slow pace|at an easy pace|very slowly]; ~jog WAY;
            ~run [at a slow pace|without hurry]; slowly ~run WAY;
            ~jog [slowly|at an easy pace|lightly]; ~trot [|along|forward]
        """),
        ("a slow run WAY", "a slow jog", "slow running", "an easy run WAY", "a light jog"),
        ("slowly", "at a slow pace"),
        RUNNERS,
    ),
    ("run", "fast"): _Pace(
        patterns("""
            ~run fast WAY; ~sprint [||forward|ahead|straight ahead|away];
            ~run WAY [fast|quickly|very fast|at full speed|as fast as possible];
            ~run as fast as <he> can; ~dash [ahead|forward|off];
            ~run [quickly|at top speed|really fast|at high speed]; ~race ahead; ~rush forward
        """),
        ("a sprint WAY", "a fast run WAY", "a full speed run", "fast running", "a dash WAY"),
        ("fast", "quickly", "at full speed"),
        people=(*RUNNERS, "a sprinter"),
    ),
}
"""Words by gait and pace."""


def gait(action: SingleAction) -> Wording:
    """Patterns for walking, jogging and running in a direction at a pace."""
    kind, pace = action.kind, action.pace or "normal"
    if kind == "jog" and pace != "normal":  # a fast jog is a run, and a slow one a slow run
        kind, pace = "run", "slow" if pace == "slow" else "normal"
    words = _GAITS[kind, pace]
    if action.direction in ("backward", "left", "right"):
        return _gait_back_or_aside(action, words)
    clauses = [text.replace("WAY", _AHEAD) for text in words.clauses]
    nouns = [text.replace("WAY", "[|forward|straight ahead|]") for text in words.nouns]
    after = {
        "walk": ("~walk [away|off|on|straight on]", "~walk"),
        "jog": ("~jog [away|off|on]", "~jog"),
        "run": ("~run [away|off|on]", "~run"),
    }[action.kind]
    plain = after if action.pace != "slow" else ()
    if action.end - action.start > 100:
        clauses += [f"~{action.kind} [for a while|on and on]"]
    return Wording(clauses, nouns, plain, words.people, _STREET)


def _gait_back_or_aside(action: SingleAction, words: _Pace) -> Wording:
    kind, way = action.kind, action.direction
    pace = "[||" + "|".join(words.back) + "]"
    if words.back[0] == "slowly":
        pace = "[slowly|slowly|at a slow pace|]"
    if way == "backward":
        back = "[backward|backwards|backward|backwards|in reverse]"
        clauses = [f"~{kind} {back} {pace}", f"~{kind} {back}", f"~{kind} {pace} backward[|s]"]
        clauses += [f"~{kind} back {pace}", f"~{kind} backward[|s] without turning around"]
        nouns = [f"a {kind} [backward|backwards|in reverse]", f"a backward[|s] {kind}"]
        if kind == "walk":
            clauses += ["~back up {pace}", "~go [backward|backwards|back]", "~step back[|wards]"]
            clauses += ["~move back[|ward|wards] {pace}", "~retreat {pace}", "~back [away|off|up]"]
            clauses += ["~take steps back[|ward|wards]", "~go in reverse", "~pace backward[|s]"]
            nouns += ["[some|a few] steps back[|ward|wards]", "a retreat", "steps backward[|s]"]
    else:
        to = f"[to the {way}|{way}|to the {way}|to <his> {way}]"
        clauses = [f"~{kind} sideways {to} {pace}", f"~{kind} {to} sideways", f"~{kind} sideways"]
        nouns = [f"a sideways {kind} to the {way}", f"a {kind} sideways to the {way}"]
        if kind == "walk":
            clauses += [f"~sidestep {to} {pace}", f"~step sideways {to} {pace}", f"~strafe {to}"]
            clauses += [f"~shuffle sideways {to} {pace}", f"~side-step {to}", f"~step {to}"]
            clauses += [f"~move sideways {to} [||like a crab] {pace}", f"~shuffle {to}"]
            clauses += [f"~go sideways {to}", f"~move {to} with side steps", f"~crab-walk {to}"]
            nouns += [f"[side steps|sidesteps] to the {way}", f"a crab walk to the {way}"]
            nouns += [f"a sideways shuffle to the {way}"]
            nouns += [f"steps to the {way}", f"a few side steps to the {way}"]
    clauses = [text.replace("{pace}", pace) for text in clauses]
    return Wording(clauses, nouns, people=words.people)


def steps(action: SingleAction) -> Wording:
    """Patterns for a number of steps in a direction."""
    count, way = action.count, action.direction
    where = {
        "": "",
        "forward": "[forward|forward|ahead|forwards|to the front]",
        "backward": "[back|backward|backwards|back]",
    }.get(way, f"[to the {way}|to the {way}|{way}|to <his> {way}]")
    slow = {"slow": "[|slow] ", "fast": "[|quick] "}.get(action.pace, "")
    several = some(count, f"{slow}step", f"{slow}steps").removesuffix(IN_A_ROW)
    clauses = [f"~take {several} {where}", f"~walk {several} {where}", f"~go {several} {where}"]
    clauses += [f"~make {several} {where}", f"~move {several} {where}", f"~do {several} {where}"]
    clauses += [f"~take exactly {number(count)} step{'s' * (count > 1)} {where}"]
    nouns = [f"{several} {where}", f"{number(count)} step{'s' * (count > 1)} {where}"]
    if count == 1 and where:
        clauses += [f"~step {where}", f"~step {where} once"]
    if way in ("left", "right"):
        side = some(count, "[side step|sidestep]", "[side steps|sidesteps]").removesuffix(IN_A_ROW)
        clauses += [f"~take {side} {where}", f"~make {side} {where}"]
        clauses += [f"~sidestep {where} {times(count)}", f"~step {way} {times(count)}"]
        nouns += [f"{side} {where}"]
    return Wording(clauses, nouns)


def sped_up(action: SingleAction) -> Wording:
    """Patterns for a gait that gets faster."""
    gait = action.gait
    clauses = ["~speed up", "~get faster [|and faster]", "~accelerate", "~pick up [speed|the pace]"]
    clauses += ["~start [slow|slowly|out slow] and ~speed up", "~start slowly, then ~get faster"]
    if gait:
        clauses += patterns(f"""
            ~{gait} faster and faster; ~{gait} and ~speed up; ~{gait} and ~get faster;
            ~{gait} and ~accelerate; ~{gait} slowly at first, then faster;
            ~{gait}, then ~{gait} faster; ~{gait}, getting faster [|and faster];
            ~{gait}, then ~speed up; ~start to {gait} faster
        """)
    nouns = [f"a {gait or 'walk'} that gets faster [|and faster]", "an acceleration"]
    nouns += [f"a {gait or 'walk'} with increasing speed", f"a faster and faster {gait or 'walk'}"]
    return Wording(clauses, nouns, people=people_on_foot(gait))


def slowed_down(action: SingleAction) -> Wording:
    """Patterns for a gait that gets slower."""
    gait = action.gait
    clauses = ["~slow down", "~get slower [|and slower]", "~decelerate", "~lose speed"]
    clauses += ["~start fast and ~slow down", "~reduce the pace", "~start fast, then ~get slower"]
    if gait:
        clauses += patterns(f"""
            ~{gait} slower and slower; ~{gait} and ~slow down; ~{gait} and ~get slower;
            ~{gait}, then ~slow down; ~{gait}, getting slower [|and slower];
            ~{gait} fast at first, then slower; ~{gait}, then ~{gait} slower
        """)
    nouns = [f"a {gait or 'walk'} that gets slower [|and slower]", "a slowdown"]
    nouns += [f"a {gait or 'walk'} with decreasing speed", f"a slower and slower {gait or 'walk'}"]
    return Wording(clauses, nouns, people=people_on_foot(gait))


_DIRECTIONS = {
    "": ("[||off|forward|away|ahead]", ""),
    "forward": ("[||off|forward|away|ahead]", "[||forward|ahead|a bit|a little]"),
    "backward": ("[backward|backwards]", "[backward|backwards]"),
    "left": ("[sideways |]to the left", "[sideways |]to the left"),
    "right": ("[sideways |]to the right", "[sideways |]to the right"),
}
"""By direction: where a start leads to, and where a gait before a stop leads to."""


def started(action: SingleAction) -> Wording:
    """Patterns for a start from standing."""
    gait = "walk" if action.kind == "start_walking" else "run"
    going, away = GOING[gait], _DIRECTIONS[action.direction][0]
    still = "[~stand|~stand still|~wait|~stand for a moment|~stand there|~stay still for a moment]"
    clauses = patterns(f"""
        ~start {going} {away}; ~start to {gait} {away}; {still}, then ~{gait} {away};
        ~begin to {gait} {away}; {still} and then ~{gait} {away}; ~begin {going} {away};
        {still}, then ~start {going} {away}; ~go from standing to {going} {away};
        {still} before {going} {away}; ~stand at first, then ~{gait} {away}
    """)
    nouns = [f"first standing, then {going} {away}", f"from standing to {going}"]
    nouns += [f"a {gait} from a standstill", f"standing and then {going} {away}"]
    nouns += [f"the start of a {gait}"]
    if action.direction in ("", "forward"):
        clauses += [f"~{gait} off", f"~set off [{going}|at a {gait}]", f"~take off at a {gait}"]
    return Wording(clauses, nouns, people=people_on_foot(gait))


def stopped(action: SingleAction) -> Wording:
    """Patterns for a gait that ends in standing."""
    gait = "walk" if action.kind == "stop_walking" else "run"
    going, way = GOING[gait], _DIRECTIONS[action.direction][1]
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
    return Wording(clauses, nouns, after, people_on_foot(gait))
