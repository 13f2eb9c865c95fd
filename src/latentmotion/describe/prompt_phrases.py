"""How people type gaits and turns: patterns of verb phrases and noun phrases for each kind.

A pattern is read by `prompting`: `[a|b|]` is one of them, `~turn` a verb in the form of the
sentence, `<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or "his".
The plainest patterns come first; they are drawn most.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from latentmotion.describe.facts import LEFT
from latentmotion.describe.single import SingleAction

NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

PEOPLE_ON_FOOT = ("a pedestrian", "a passerby", "our hero")
RUNNERS = ("a runner", "the runner", "an athlete", "a jogger")


@dataclass(frozen=True)
class Wording:
    """Patterns for one action."""

    clauses: tuple[str, ...]
    """Verb phrases without a subject."""
    nouns: tuple[str, ...] = ()
    """Noun phrases."""
    after: tuple[str, ...] = ()
    """Verb phrases that fit only after another action, such as "walk away"."""
    people: tuple[str, ...] = ()
    """Subjects that fit this action best."""
    places: tuple[str, ...] = ()
    """Harmless contexts to put at the end."""
    orders: tuple[str, ...] = ()
    """Whole prompts without a verb to inflect."""


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


def number(count: int) -> str:
    """Returns a number in letters or digits."""
    return f"[{NUMBERS[count]}|{NUMBERS[count]}|{count}]" if count < len(NUMBERS) else str(count)


def times(count: int) -> str:
    """Returns how often, nothing half of the time for once."""
    if count == 1:
        return "[|||once|once|once|one time|just once]"
    if count == 2:
        return "[twice|twice|twice|two times|2 times|twice in a row|a couple of times]"
    vague = "|several times" if count >= 4 else "|a few times"
    vague += "|again and again|repeatedly|over and over" if count >= 5 else ""
    return f"[{number(count)} times|{number(count)} times|{number(count)} times in a row{vague}]"


def some(count: int, one: str, many: str) -> str:
    """Returns a counted noun: "a kick", "one kick", "two kicks", "several kicks"."""
    if count == 1:
        return f"[a|a|a|one|a single|just one] {one}"
    vague = "|a couple of" if count == 2 else "|several" if count >= 4 else "|a few"
    return f"[{number(count)}|{number(count)}|{number(count)}{vague}] {many}[|||| in a row]"


def towards(side: str) -> str:
    """Returns the way of a turn or a step to a side."""
    return f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]"


def clockwise(side: str) -> str:
    """Returns the sense of rotation seen from above."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"


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
            "~walk [at a normal pace|at a normal speed|normally|casually] WAY",
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
    kind, pace = action.kind, action.pace or "normal"
    if kind == "jog":
        return _GAITS["jog", "normal"] if pace != "fast" else _GAITS["run", "normal"]
    return _GAITS.get((kind, pace)) or _GAITS["run", "normal"]


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
    several = some(count, f"{slow}step", f"{slow}steps")
    clauses = [f"~take {several} {where}", f"~walk {several} {where}", f"~go {several} {where}"]
    clauses += [f"~make {several} {where}", f"~move {several} {where}", f"~do {several} {where}"]
    clauses += [f"~take exactly {number(count)} step{'s' * (count > 1)} {where}"]
    clauses += [f"~take {several} {where} and ~stop"]
    nouns = [f"{several} {where}", f"{number(count)} step{'s' * (count > 1)} {where}"]
    if count == 1 and where:
        clauses += [f"~step {where}", f"~step {where} once"]
    if way in ("left", "right"):
        side = some(count, "[side step|sidestep]", "[side steps|sidesteps]")
        clauses += [f"~take {side} {where}", f"~make {side} {where}"]
        clauses += [f"~sidestep {where} {times(count)}", f"~step {way} {times(count)}"]
        nouns += [f"{side} {where}"]
    return Wording(tuple(clauses), tuple(nouns))


def turn(action: SingleAction) -> Wording:
    """A turn on the spot, or on the way while walking or running."""
    if action.gait:
        return _turn_on_the_way(action)
    clauses, nouns = turned(action.side, action.degrees)
    spot = "[||||| on the spot| in place]"
    people = ("a dancer",) if action.degrees >= 290 else ()
    if action.degrees < 290:
        clauses = [f"{text}{spot}" for text in clauses]
        clauses += [f"~stand on the spot and {text}" for text in clauses[:1]]
    return Wording(tuple(clauses), tuple(nouns), people=people)


def turned(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Returns verb phrases and noun phrases of a turn by degrees."""
    to = towards(side)
    if degrees >= 290:
        return _spun(side, degrees)
    if 130 <= degrees <= 230:
        return _turned_around(side)
    if degrees > 120:
        clauses = [f"~turn [far|around] to the {side}", f"~turn {to}", f"~rotate {to}"]
        clauses += [f"~make a big {side} turn", f"~turn a long way to the {side}", f"~spin {to}"]
        clauses += [f"~turn {clockwise(side)}", f"~pivot {to}", f"~swivel to the {side}"]
        return clauses, [f"a {side} turn", f"a [big|wide|large] turn to the {side}"]
    clauses, nouns = _turned_little(side, degrees)
    if degrees >= 30:
        plain = [f"~turn {to}", f"~turn {to}", f"~make a {side} turn", f"~rotate {to}"]
        plain += [f"~pivot {to}", f"~turn to face [{side}|the {side}]", f"~do a turn to the {side}"]
        plain += [f"~swivel to the {side}", f"~take a turn to the {side}"]
        clauses = [*plain[:2], *clauses, *plain[2:]]
        nouns = [f"a {side} turn", f"a turn to [the|the|<his>] {side}", f"{side} turn", *nouns]
    return clauses, nouns


def _turned_little(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Turns of up to 120 degrees, with how far."""
    to, to_the = towards(side), f"to [the|the|<his>] {side}"
    if degrees >= 60:
        right = "[90|90|ninety]"
        return [
            f"~turn {right} degrees {to}",
            f"~make a quarter turn {to_the}",
            f"~turn {to} by {right} degrees",
            f"~do a [quarter|90 degree] turn {to_the}",
            f"~rotate {right} degrees {to}",
            f"~turn {to} {right} degrees",
            f"~turn a quarter {to_the}",
        ], [
            f"a quarter turn {to_the}",
            f"a quarter turn {side}",
            f"a [90 degree|90-degree|ninety degree] turn {to_the}",
            f"a [90 degree|90-degree] {side} turn",
        ]
    clauses = [
        f"~turn slightly {to}",
        f"~turn a [bit|little] {to}",
        f"slightly ~turn {to}",
        f"~turn {to} [a bit|a little|slightly]",
        f"~make a [slight|small] turn {to_the}",
        f"~make a [slight|small] {side} turn",
        f"~rotate [slightly|a little] {to}",
        f"~turn just a [bit|little] {to}",
    ]
    nouns = [f"a [slight|small|little] turn {to_the}", f"a [slight|small] {side} turn"]
    if degrees >= 30:
        half = "[45|45|forty-five]"
        clauses += [f"~turn {half} degrees {to}", f"~turn {to} by {half} degrees"]
        clauses += [f"~rotate {half} degrees {to}", f"~make a 45 degree turn {to_the}"]
        nouns += [f"a [45 degree|45-degree] turn {to_the}", f"a 45 degree {side} turn"]
    return clauses, nouns


def _turned_around(side: str) -> tuple[list[str], list[str]]:
    """Turns of 130 to 230 degrees."""
    to, to_the = towards(side), f"to [the|the|<his>] {side}"
    clauses = [
        "~turn around",
        f"~turn around [to the {side}|to <his> {side}|{side}]",
        "~turn [180|180|a hundred and eighty] degrees",
        f"~turn [180|180] degrees {to}",
        f"~make a half turn {to_the}",
        "~do [an about-face|a 180|a one-eighty|an about face]",
        f"~turn {side} by 180 degrees",
        "~turn to face the other way",
        f"~turn halfway around {to_the}",
        f"~do a [half|180 degree] turn {to_the}",
        f"~turn around [{clockwise(side)}|over <his> {side} shoulder]",
        "~turn back",
        "~turn and ~face the [opposite direction|other direction|other way]",
        "~make a [half turn|half-turn]",
    ]
    nouns = [
        f"a half turn {to_the}",
        "a half turn",
        "an about-face",
        f"a [180|180 degree] turn {to_the}",
        "a [180|180 degree] turn",
        f"a turn around {to_the}",
    ]
    return clauses, nouns


def _spun(side: str, degrees: float) -> tuple[list[str], list[str]]:
    """Turns of 290 degrees and more."""
    rounds, to, clock = round(degrees / 360), towards(side), clockwise(side)
    spot = "[|||on the spot|in place]"
    if degrees <= 430:
        clauses = [
            "~spin around [||once]",
            f"~spin around {to}",
            f"~spin {clock} {spot}",
            f"~turn all the way around {to}",
            f"~turn in a full circle [||to the {side}|{clock}]",
            f"~do a [360|360|full spin|full turn] [||to the {side}|{clock}]",
            f"~make a full turn to [the|<his>] {side}",
            f"~rotate [once|all the way around|360 degrees] {clock}",
            f"~turn [360 degrees|a full 360] [||{to}]",
            f"~turn around once {to}",
            f"~twirl around [||to the {side}|once]",
        ]
        nouns = [f"a [full|complete|360 degree] turn to the {side}", f"a spin to the {side}"]
        return clauses, [*nouns, f"a {clock} spin", "a full spin", "a 360", f"a full {side} turn"]
    vague = "several times" if rounds > 2 else "more than once"
    often = times(rounds) if abs(degrees / 360 - rounds) < 0.2 and rounds > 1 else vague
    clauses = [
        f"~spin around {often}",
        f"~spin around and around {to}",
        f"~spin {clock} {spot}",
        f"~spin around {to} {often}",
        f"~keep [spinning|turning] [to the {side}|{clock}]",
        f"~turn around and around {to}",
        f"~turn in circles {spot} [|to the {side}|{clock}]",
        f"~rotate {clock} {often}",
        f"~twirl around {often}",
    ]
    return clauses, [f"spins to the {side}", f"spinning {clock}", "spinning around and around"]


def _turn_on_the_way(action: SingleAction) -> Wording:
    gait, side = action.gait, action.side
    if action.degrees > 270:
        return circle(action)
    verb_ing = {"walk": "walking", "jog": "jogging", "run": "running"}[gait]
    turns, nouns = turned(side, action.degrees)
    clauses = [f"~{gait} and {text}" for text in turns]
    clauses += [f"{text} while {verb_ing}" for text in turns[:5]]
    clauses += _curved(action, verb_ing)
    nouns = [f"{text} while {verb_ing}" for text in nouns]
    people = RUNNERS if gait != "walk" else PEOPLE_ON_FOOT
    return Wording(tuple(clauses), tuple(nouns), people=people)


def _curved(action: SingleAction, verb_ing: str) -> list[str]:
    """Turns on the way as users tell them: curves, bends and corners."""
    gait, side, degrees = action.gait, action.side, action.degrees
    to = f"to [the|the|<his>] {side}"
    if degrees > 230:
        return [f"~{gait} in a [wide|long] curve {to}", f"~{gait} far around {to}"]
    if degrees >= 130:
        out = [f"~{gait} and ~make a u-turn [|{to}]", f"~{gait} around in a half circle {to}"]
        out += [f"~make a u-turn [|{to}] while {verb_ing}", f"~do a u-turn, {verb_ing}"]
        return [*out, f"~turn back while {verb_ing}", f"~{gait}, ~turn and ~{gait} the other way"]
    out = [f"~{gait} in a [curve|bend|bow|arc] {to}", f"~{gait} along a curve {to}"]
    out += [f"~curve {to} while {verb_ing}", f"~{gait} a curve {to}"]
    if degrees <= 75:
        veer = f"[bearing|veering|drifting] {towards(side)}"
        out += [f"~{gait} and ~veer {to}", f"~veer {to} while {verb_ing}", f"~{gait}, {veer}"]
        out += [f"~{gait} and ~bear {side}", f"~bear {side} while {verb_ing}"]
        out += [f"~{gait} and ~drift {to}"]
    if degrees >= 45:
        out += [f"~take a {side} while {verb_ing}", f"~{gait} and ~take a {side} [|turn]"]
        out += [f"~{gait} around a [corner|bend] {to}", f"~{gait} and ~round a corner {to}"]
        out += [f"~{gait}, turning {side}"]
    return out


def walk_and_turn(action: SingleAction) -> Wording:
    """First a way, then a turn, or the other way around."""
    gait = action.gait or "walk"
    turns, nouns = turned(action.side, action.degrees)
    ahead = "[||forward|ahead|straight ahead|a bit|a little]"
    if action.kind == "walk_then_turn":
        join = "[, then|, then| and then| and|, and then]"
        clauses = [f"~{gait} {ahead}{join} {text}" for text in turns]
        clauses += [f"~{gait} {ahead}, ~stop and {text}" for text in turns[:2]]
        named = [f"a {gait} [forward|], then {text}" for text in nouns]
        named += [f"a {gait} followed by {text}" for text in nouns]
        return Wording(tuple(clauses), tuple(named))
    on = f"~{gait} [||forward|off|away|on|straight on|ahead|straight ahead]"
    clauses = [f"{text}[, then| and then| and| and|, and then] {on}" for text in turns]
    named = [f"{text}, then a {gait} [forward|straight ahead|]" for text in nouns]
    return Wording(tuple(clauses), (*named, *(f"{text} followed by a {gait}" for text in nouns)))


def turn_and_return(action: SingleAction) -> Wording:
    """There, around, and back."""
    gait = action.gait or "walk"
    going = {"walk": "walking", "jog": "jogging", "run": "running"}[gait]
    side = f"[|||to the {action.side}|to <his> {action.side}]" if action.side else ""
    around = f"[~turn around {side}|~make a u-turn {side}|~turn back|~do a 180]"
    clauses = [
        f"~{gait} [forward|ahead|away|], {around} and [~come back|~{gait} back|~return|~go back]",
        f"~{gait} [|forward|ahead] and {around} and ~{gait} back",
        f"~{gait} there and back",
        f"~{gait} away, [~turn|~turn around] and [~come back|~return|~{gait} back]",
        f"~turn [around|back] {side} and ~{gait} [back|the other way]",
        f"~{gait} [forward|ahead], then {around}, then ~{gait} back",
        f"~{gait}, {around} and ~{gait} [in the opposite direction|the other way]",
        f"~make a u-turn {side} and ~come back",
        f"~{gait} one way, ~turn around and ~{gait} the other way",
        f"~{gait} [up|off], ~turn [around|back] {side} and ~return to where <he> started",
    ]
    nouns = [
        f"a {gait} [there and back|with a u-turn|forward and back]",
        f"{going} there and back",
        f"a u-turn while {going}",
        f"a {gait}, a u-turn and a {gait} back",
    ]
    people = RUNNERS if gait != "walk" else PEOPLE_ON_FOOT
    return Wording(tuple(clauses), tuple(nouns), people=people)


def circle(action: SingleAction) -> Wording:
    """A whole circle walked or run."""
    gait, side, clock = action.gait or "walk", action.side, clockwise(action.side)
    going = {"walk": "walking", "jog": "jogging", "run": "running"}[gait]
    way = f"[||to the {side}|{clock}|{clock}|to <his> {side}]"
    clauses = [
        f"~{gait} in a circle {way}",
        f"~{gait} in a circle {way}",
        f"~{gait} around in a circle {way}",
        f"~{gait} {clock} in a circle",
        f"~{gait} in a {clock} circle",
        f"~go around in a circle {way}",
        f"~{gait} a [full|whole|complete] circle {way}",
        f"~circle around [to the {side}|{clock}] while {going}",
    ]
    nouns = [
        f"a {clock} circle, {going}",
        f"a {gait} in a circle {way}",
        f"a circle [to the {side}|{clock}] while {going}",
        f"{going} in a circle {way}",
    ]
    if action.degrees >= 400:
        clauses += [f"~{gait} in circles {way}", f"~go around in circles {way}"]
        clauses += [f"~{gait} around and around {way}", f"~{gait} round and round"]
    elif action.degrees >= 290:
        clauses += [f"~{gait} [one lap|a lap|one round] {way}", f"~{gait} around once {way}"]
        clauses += [f"~{gait} in a circle {way} and ~end up where <he> started"]
        nouns += [f"[a|one] lap {way}[|, {going}]"]
    people = RUNNERS if gait != "walk" else PEOPLE_ON_FOOT
    return Wording(tuple(clauses), tuple(nouns), people=people)


def half_circle(action: SingleAction) -> Wording:
    """Half of a circle walked or run."""
    gait, side, clock = action.gait or "walk", action.side, clockwise(action.side)
    going = {"walk": "walking", "jog": "jogging", "run": "running"}[gait]
    way = f"[|to the {side}|to the {side}|{clock}|to <his> {side}]"
    half = "[half circle|semicircle|half-circle|half circle]"
    clauses = [
        f"~{gait} in a {half} {way}",
        f"~{gait} a {half} {way}",
        f"~make a {half} {way} while {going}",
        f"~{gait} around in a {half} {way}",
        f"~{gait} half a circle {way}",
        f"~follow a {half} {way}, {going}",
        f"~{gait} along a {half} {way}",
        f"~{gait} in a [wide|long] curve to the {side}",
        f"~{gait} a wide u-turn {way}",
        f"~{gait} in a {clock} {half}",
    ]
    nouns = [f"a {half} {way}, {going}", f"a {gait} in a {half} {way}", f"half a circle {way}"]
    return Wording(tuple(clauses), tuple(nouns), people=RUNNERS if gait != "walk" else ())


def weave(action: SingleAction) -> Wording:
    """Left and right in turn on the way."""
    gait = action.gait or "walk"
    going = {"walk": "walking", "jog": "jogging", "run": "running"}[gait]
    clauses = (
        f"~{gait} in a zigzag [|line|pattern|path]",
        "~zigzag [|forward|ahead|along]",
        f"~{gait} in [a wavy line|an s-curve|s-curves|a serpentine|a snaking line|curves]",
        "~weave [left and right|from side to side|along|through obstacles|in and out]",
        f"~{gait} a slalom",
        f"~slalom [|forward|while {going}]",
        f"~{gait} and ~zigzag",
        f"~{gait} in curves [left and right|to both sides]",
        f"~{gait}, weaving [left and right|from side to side|around obstacles]",
        f"~{gait} [zigzag|in a slalom|like a snake]",
        f"~{gait} forward, swerving left and right",
        f"~{gait} around [cones|obstacles] in a slalom",
        f"~swerve left and right while {going}",
    )
    nouns = (f"a [zigzag|slalom|wavy|winding] {gait}", f"a slalom, {going}", "a zigzag path")
    return Wording(clauses, nouns)
