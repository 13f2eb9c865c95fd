"""How people type gaits, steps, starts and stops, and changes of pace.

Patterns are written as in `prompt_phrases`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from latentmotion.describe.prompt_phrases import (
    IN_A_ROW,
    PEOPLE_ON_FOOT,
    RUNNERS,
    Wording,
    number,
    some,
    times,
)
from latentmotion.describe.single import SingleAction


@dataclass(frozen=True)
class _Pace:
    """Words of a gait at one pace."""

    clauses: tuple[str, ...]
    """Patterns with `WAY` for the direction."""
    nouns: tuple[str, ...]
    """Patterns with `WAY`."""
    back: tuple[str, ...] = ("",)
    """How the pace is told of another direction."""
    people: tuple[str, ...] = field(default=())
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
        (
            "~walk WAY",
            "~walk WAY",
            "~walk [forward|ahead|straight ahead|straight|in a straight line]",
            "~walk along a straight line",
            "~walk WAY [at a normal pace|at a normal speed|normally|casually]",
            "~go [forward|straight ahead|straight|ahead|on foot]",
            "~move [forward|ahead]",
            "~take [a walk|a few steps forward|some steps forward|some steps]",
            "~go for a walk",
            "~keep walking [|forward|straight ahead]",
            "~pace [forward|ahead]",
            "~step forward",
        ),
        (
            "a walk WAY",
            "a [normal|regular|plain|simple|ordinary|casual] walk",
            "a [few|couple of] steps forward",
            "normal walking",
            "a [straight|forward] walk",
            "a walk [at a normal pace|at an ordinary pace]",
        ),
        people=PEOPLE_ON_FOOT,
    ),
    ("walk", "slow"): _Pace(
        (
            "~walk slowly WAY",
            "~walk WAY [slowly|very slowly|at a slow pace|really slow]",
            "slowly ~walk WAY",
            "~walk [slow|very slowly|at a slow pace|at a leisurely pace|without hurry]",
            "~stroll [||along|forward|ahead|slowly]",
            "~take [slow|slow|slow, careful] steps [forward|ahead|]",
            "~amble [along|forward]",
            "~saunter [||along|forward]",
            "~move forward slowly",
            "~go forward [slowly|at a slow pace]",
            "~plod along",
        ),
        (
            "a slow walk WAY",
            "slow walking",
            "[slow|slow and careful] steps [forward|ahead|]",
            "a [leisurely|slow|lazy] stroll",
            "a walk at a slow pace",
        ),
        ("slowly", "at a slow pace", "very slowly"),
        ("an old man", "an old woman", "a tired man", "grandma", "an elderly person"),
    ),
    ("walk", "fast"): _Pace(
        (
            "~walk fast WAY",
            "~walk WAY [fast|quickly|briskly|at a fast pace|at a brisk pace]",
            "~walk [quickly|briskly|very fast|at high speed|with quick steps] WAY",
            "quickly ~walk WAY",
            "~hurry [along|ahead|forward|somewhere|to work]",
            "~rush [along|ahead|forward]",
            "~power-walk WAY",
            "~take quick steps [forward|ahead|]",
            "~stride along quickly",
            "~be in a hurry",
        ),
        (
            "a [fast|fast|brisk|quick|hurried] walk WAY",
            "[fast|brisk] walking",
            "a walk at a [fast|brisk] pace",
            "quick steps [forward|ahead]",
        ),
        ("quickly", "fast", "at a fast pace"),
        ("a busy man", "a businessman", "a commuter"),
    ),
    ("jog", "normal"): _Pace(
        (
            "~jog WAY",
            "~jog WAY",
            "~jog [at an easy pace|at a steady pace|lightly] WAY",
            "~run [slowly|at an easy pace] WAY",
            "~trot [||along|forward]",
            "~go for a jog",
            "~go jogging",
            "~jog [along|ahead|straight ahead|forward]",
        ),
        ("a jog WAY", "a [light|easy|steady|gentle] jog", "a slow run WAY", "[some|light] jogging"),
        people=RUNNERS,
    ),
    ("run", "normal"): _Pace(
        (
            "~run WAY",
            "~run WAY",
            "~run [ahead|forward|straight ahead|straight|in a straight line]",
            "~go for a run",
            "~go running",
            "~keep running [|forward|straight ahead]",
            "~run [at a steady pace|at a normal pace] WAY",
        ),
        ("a run WAY", "a [steady|normal|straight] run", "some running", "a forward run"),
        people=RUNNERS,
    ),
    ("run", "slow"): _Pace(
        (
            "~run slowly WAY",
            "~run WAY [slowly|at a slow pace|at an easy pace|very slowly]",
            "~jog WAY",
            "~run [at a slow pace|without hurry]",
            "slowly ~run WAY",
            "~jog [slowly|at an easy pace|lightly]",
            "~trot [|along|forward]",
        ),
        ("a slow run WAY", "a slow jog", "slow running", "an easy run WAY", "a light jog"),
        ("slowly", "at a slow pace"),
        RUNNERS,
    ),
    ("run", "fast"): _Pace(
        (
            "~run fast WAY",
            "~sprint [||forward|ahead|straight ahead|away]",
            "~run WAY [fast|quickly|very fast|at full speed|as fast as possible]",
            "~run as fast as <he> can",
            "~dash [ahead|forward|off]",
            "~run [quickly|at top speed|really fast|at high speed]",
            "~race ahead",
            "~rush forward",
        ),
        ("a sprint WAY", "a fast run WAY", "a full speed run", "fast running", "a dash WAY"),
        ("fast", "quickly", "at full speed"),
        people=(*RUNNERS, "a sprinter"),
    ),
}
"""By gait and pace."""


def gait(action: SingleAction) -> Wording:
    """Walking, jogging and running some way, at some pace."""
    words = _pace_of(action)
    if action.direction in ("backward", "left", "right"):
        return _gait_elsewhere(action, words)
    clauses = [text.replace("WAY", _AHEAD) for text in words.clauses]
    nouns = [text.replace("WAY", "[|forward|straight ahead|]") for text in words.nouns]
    after = {
        "walk": ("~walk [away|off|on|straight on]", "~walk"),
        "jog": ("~jog [away|off|on]", "~jog"),
        "run": ("~run [away|off|on]", "~run"),
    }[action.kind]
    plain = after if action.pace != "slow" else ()
    if action.end - action.start > 100:
        clauses += ["~KIND [for a while|on and on]".replace("KIND", action.kind)]
    return Wording(tuple(clauses), tuple(nouns), plain, words.people, _STREET)


def _pace_of(action: SingleAction) -> _Pace:
    """A fast jog is a run, and a slow one a slow run."""
    kind, pace = action.kind, action.pace or "normal"
    if kind == "jog" and pace != "normal":
        kind, pace = "run", "slow" if pace == "slow" else "normal"
    return _GAITS[kind, pace]


def _gait_elsewhere(action: SingleAction, words: _Pace) -> Wording:
    kind, way = action.kind, action.direction
    pace = "[||" + "|".join(words.back) + "]"
    slow = words.back[0] == "slowly"
    if slow:
        pace = "[slowly|slowly|at a slow pace|]"
    walks = kind == "walk"
    noun = {"walk": "walk", "jog": "jog", "run": "run"}[kind]
    if way == "backward":
        back = "[backward|backwards|backward|backwards|in reverse]"
        clauses = [f"~{kind} {back} {pace}", f"~{kind} {back}", f"~{kind} {pace} backward[|s]"]
        clauses += [f"~{kind} back {pace}", f"~{kind} backward[|s] without turning around"]
        nouns = [f"a {noun} [backward|backwards|in reverse]", f"a backward[|s] {noun}"]
        if walks:
            clauses += ["~back up {pace}", "~go [backward|backwards|back]", "~step back[|wards]"]
            clauses += ["~move back[|ward|wards] {pace}", "~retreat {pace}", "~back [away|off|up]"]
            clauses += ["~take steps back[|ward|wards]", "~go in reverse", "~pace backward[|s]"]
            nouns += ["[some|a few] steps back[|ward|wards]", "a retreat", "steps backward[|s]"]
    else:
        to = f"[to the {way}|{way}|to the {way}|to <his> {way}]"
        clauses = [f"~{kind} sideways {to} {pace}", f"~{kind} {to} sideways", f"~{kind} sideways"]
        nouns = [f"a sideways {noun} to the {way}", f"a {noun} sideways to the {way}"]
        if walks:
            clauses += [f"~sidestep {to} {pace}", f"~step sideways {to} {pace}", f"~strafe {to}"]
            clauses += [f"~shuffle sideways {to} {pace}", f"~side-step {to}", f"~step {to}"]
            clauses += [f"~move sideways {to} [||like a crab] {pace}", f"~shuffle {to}"]
            clauses += [f"~go sideways {to}", f"~move {to} with side steps", f"~crab-walk {to}"]
            nouns += [f"[side steps|sidesteps] to the {way}", f"a crab walk to the {way}"]
            nouns += [f"a sideways shuffle to the {way}"]
            nouns += [f"steps to the {way}", f"a few side steps to the {way}"]
    return Wording(
        tuple(text.replace("{pace}", pace) for text in clauses), tuple(nouns), people=words.people
    )


def steps(action: SingleAction) -> Wording:
    """A counted number of steps some way."""
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
    return Wording(tuple(clauses), tuple(nouns))
