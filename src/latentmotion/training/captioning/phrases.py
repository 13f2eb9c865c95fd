"""Acts → verb phrases, several for each."""

from __future__ import annotations

from collections.abc import Callable

from latentmotion.language.inflection import present_participle
from latentmotion.measure.facts import BOTH, LEFT, RIGHT, Event
from latentmotion.measure.reported_acts import ReportedAct
from latentmotion.measure.whole_body import FAST, SLOW

Phrase = tuple[str, str]
"""Verb in base form and the rest; `{his}` stands for a possessive, `{turn}` for another verb."""

_TIMES = ("", "once", "twice", "three times", "four times", "five times", "six times",
          "seven times", "eight times", "nine times", "ten times")  # fmt: skip
_NUMBERS = ("", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

_PLAIN: dict[str, list[Phrase]] = {
    "squat": [("squat", ""), ("squat", "down"), ("bend", "{his} knees deeply")],
    "bow": [("bend", "forward"), ("bow", ""), ("lean", "forward"), ("bend", "over")],
    "sit_down": [("sit", "down"), ("take", "a seat")],
    "stand_up": [("stand", "up"), ("get", "up")],
    "get_up": [("get", "up from the floor"), ("stand", "up from the ground"), ("get", "up")],
    "sit_up": [("sit", "up")],
    "lie_down": [("lie", "down"), ("lie", "down on the floor"), ("get", "down on the floor")],
    "kneel_down": [("kneel", "down"), ("kneel", ""), ("get", "down on {his} knees")],
    "stay_crouch": [("crouch", ""), ("stay", "crouched"), ("crouch", "low")],
    "stay_bend": [("bend", "forward"), ("stay", "bent over"), ("lean", "forward")],
    "stay_kneel": [("kneel", ""), ("kneel", "on the floor")],
    "stay_sit": [("sit", ""), ("sit", "on a seat"), ("remain", "seated")],
    "stay_floor": [("sit", "on the floor"), ("sit", "on the ground")],
    "stay_lie": [("lie", "on the floor"), ("lie", "on the ground"), ("lie", "down")],
    "still": [("stand", "still"), ("stand", "in place without moving"), ("stay", "still")],
    "stand": [("stand", "in place"), ("stand", "on the spot"), ("stand", "")],
    "gesture": [
        ("move", "{his} arms"),
        ("stand", "in place and {move} {his} arms"),
        ("move", "{his} arms around"),
    ],
    "stop": [("stop", ""), ("come", "to a stop"), ("stand", "still")],
}

_DIRECTIONS = {
    "forward": ("forward", "forward", "straight ahead", "forwards"),
    "backward": ("backward", "backwards", "backwards"),
    "left": ("sideways to the left", "to the left sideways", "left sideways"),
    "right": ("sideways to the right", "to the right sideways", "right sideways"),
    "place": ("in place", "on the spot"),
}
_LOW = {"crouch": ("crouched", "in a crouch"), "bend": ("bent forward", "bent over"), "": ("",)}

_PHRASES: dict[str, Callable[[ReportedAct], list[Phrase]]] = {}
"""Phrases of the kinds of acts that depend on side, direction, amount or count."""


def phrases(act: ReportedAct) -> list[Phrase]:
    """Returns verb phrases for an act, the plainest first."""
    if act.kind in _PHRASES:
        return _PHRASES[act.kind](act)
    if act.kind in _PLAIN:
        return _counted(_PLAIN[act.kind], act.event)
    return [("do", act.kind.replace("_", " "))]


def meanwhile(act: ReportedAct) -> list[Phrase]:
    """Returns verb phrases for an act that happens during another, after "while"."""
    event = act.event
    if event.kind != "turn":
        return phrases(act)
    if event.amount < 45:
        return [("turn", f"slightly to the {event.side}"), ("veer", f"to the {event.side}")]
    around = "around to the" if event.amount >= 150 else "to the"
    return [("turn", f"{around} {event.side}")]


def _phrases_of(*kinds: str) -> Callable[..., Callable[[ReportedAct], list[Phrase]]]:
    """Registers the phrases of some kinds of acts."""

    def register(
        function: Callable[[ReportedAct], list[Phrase]],
    ) -> Callable[[ReportedAct], list[Phrase]]:
        _PHRASES.update(dict.fromkeys(kinds, function))
        return function

    return register


def _counted(wordings: list[Phrase], event: Event) -> list[Phrase]:
    """Adds the number of repetitions where it is more than one."""
    if event.count == 1:
        return wordings
    often = _TIMES[event.count] if event.count < len(_TIMES) else "several times"
    vague = ["repeatedly", "several times"] if event.count > 3 else []
    return [
        (verb, _words(rest, word)) for verb, rest in wordings for word in (often, often, *vague)
    ]


def _words(*words: str) -> str:
    """Joins the words that are not empty."""
    return " ".join(word for word in words if word)


def _paces(gait: Event) -> list[str]:
    """Returns adverbs of the pace of a gait."""
    if gait.kind == "walk" and gait.amount < SLOW:
        return ["slowly", "slowly", "at a slow pace"]
    if gait.kind == "walk" and gait.amount > FAST:
        return ["quickly", "briskly", "fast", "at a fast pace"]
    if gait.kind == "run" and gait.amount > 3.6:
        return ["", "fast", "quickly"]
    return ["", "", "", "", "at a normal pace" if gait.kind == "walk" else ""]


@_phrases_of("walk", "jog", "run")
def _gait(act: ReportedAct) -> list[Phrase]:
    event = act.event
    if act.on:
        to = "" if event.direction in ("forward", "place") else f" {event.direction}"
        return [
            ("keep", f"{present_participle(event.kind)}{to}"),
            (event.kind, f"on{to}"),
            ("continue", f"{present_participle(event.kind)}{to}"),
            (event.kind, to.strip() or "forward"),
        ]
    sideways = event.direction in (LEFT, RIGHT) and event.kind == "walk"
    paces = _paces(event)
    wordings = [
        (verb, _words(direction, pace, low))
        for verb in (["step", "walk", "move"] if sideways else [event.kind])
        for direction in _DIRECTIONS[event.direction]
        for pace in paces
        for low in _LOW[act.posture]
    ]
    if event.kind == "walk" and event.direction == "forward" and not act.posture:
        wordings += [(event.kind, pace) for pace in paces]
        wordings += [(event.kind, _words("in a straight line", pace)) for pace in paces]
    return [*wordings, ("sidestep", f"to the {event.direction}")] if sideways else wordings


@_phrases_of("turn")
def _turn(act: ReportedAct) -> list[Phrase]:
    side, degrees, gait = act.event.side, act.event.amount, act.gait
    verb, pace = (gait.kind, _paces(gait)[0]) if gait else ("turn", "")
    onward = gait is not None and gait.direction == "forward"
    far = gait is not None and gait.amount * gait.seconds / max(degrees / 57.3, 0.3) > 0.4
    if degrees >= 290:
        return _full_turns(side, degrees, verb if onward and far else "", pace)
    if degrees < 150:
        wordings = _turns_aside(side, degrees)
        if onward:
            slightly = "slightly " if degrees < 45 else ""
            wordings += [
                (verb, _words(f"in a curve to the {side}", pace)),
                (verb, f"forward and {{turn}} {slightly}{side}"),
                ("curve", f"to the {side}"),
            ]
        return wordings
    if degrees > 220:
        wordings = [("turn", f"around to the {side}"), ("turn", f"far to the {side}")]
    else:
        wordings = [
            ("turn", "around"),
            ("turn", f"around to the {side}"),
            ("turn", "around"),
            ("make", f"a half turn to the {side}"),
            ("turn", f"{side} by 180 degrees"),
            ("turn", f"{side} and {{face}} the other way"),
        ]
    if onward and far and degrees >= 220:
        wordings += [(verb, f"in a wide curve to the {side}")]
    elif onward and far:
        wordings += [
            (verb, _words(f"in a half circle to the {side}", pace)),
            (verb, f"around to the {side} in a half circle"),
            ("make", f"a u-turn to the {side}"),
            (verb, f"in a {_clock(side)} half circle"),
        ]
    return wordings


def _turns_aside(side: str, degrees: float) -> list[Phrase]:
    """Returns phrases for turns of less than 150 degrees."""
    if degrees < 45:
        return [
            ("turn", f"slightly to the {side}"),
            ("veer", f"slightly to the {side}"),
            ("turn", f"slightly {side}"),
        ]
    wordings = [("turn", side), ("turn", f"to the {side}")]
    if degrees < 65:
        return [*wordings, ("turn", f"a bit to the {side}")]
    wordings += [("make", f"a {side} turn")]
    if 78 <= degrees <= 104:
        wordings += [
            ("turn", f"{side} by 90 degrees"),
            ("make", f"a quarter turn to the {side}"),
            ("turn", f"90 degrees to the {side}"),
        ]
    return wordings


def _clock(side: str) -> str:
    """Returns the sense of rotation, seen from above, of a turn to a side."""
    return "counterclockwise" if side == LEFT else "clockwise"


def _full_turns(side: str, degrees: float, verb: str, pace: str) -> list[Phrase]:
    """Returns phrases for turns of 290 degrees and more: circles, or spins without a verb."""
    rounds, clock = degrees / 360, _clock(side)
    if verb:
        wordings = [
            (verb, _words(f"in a circle to the {side}", pace)),
            (verb, f"in a {clock} circle"),
            (verb, _words("in a circle", pace)),
            (verb, f"around in a circle to the {side}"),
        ]
        many = [(verb, f"in circles to the {side}"), (verb, f"around in circles {clock}")]
        return wordings + many if rounds >= 1.75 else wordings
    if 1.75 < rounds < 2.25:
        return [("spin", f"around twice to the {side}"), ("make", f"two full turns to the {side}")]
    if rounds >= 1.75:
        return [("spin", f"around several times to the {side}"), ("spin", f"around {clock}")]
    return [
        ("spin", f"around to the {side}"),
        ("turn", f"all the way around to the {side}"),
        ("make", f"a full turn to the {side}"),
        ("spin", f"around {clock}"),
    ]


@_phrases_of("knee")
def _knee(act: ReportedAct) -> list[Phrase]:
    side = act.event.side
    if side == BOTH:
        return [
            ("raise", "{his} knees one after the other"),
            ("lift", "{his} knees in turn"),
            ("bring", "{his} left and right knee up in turn"),
        ]
    wordings = [("raise", f"{{his}} {side} knee"), ("lift", f"{{his}} {side} knee")]
    return _counted([*wordings, ("bring", f"{{his}} {side} knee up")], act.event)


@_phrases_of("kick", "punch")
def _strike(act: ReportedAct) -> list[Phrase]:
    event = act.event
    kind, side, count = event.kind, event.side, event.count
    limbs = ("leg", "foot") if kind == "kick" else ("hand", "fist", "arm")
    if side == BOTH:
        wordings = [
            (kind, f"with both {limbs[0]}s in turn"),
            (kind, f"with {{his}} left and right {limbs[0]} in turn"),
            (kind, f"several times with both {limbs[0]}s"),
        ]
        if count < len(_TIMES):
            wordings.append((kind, f"{_TIMES[count]} with both {limbs[0]}s in turn"))
        return wordings
    to = "forward" if event.direction == "forward" else ""
    wordings = [(kind, _words(to, f"with {{his}} {side} {limb}")) for limb in limbs]
    if kind == "kick" and event.direction == "side":
        wordings += [("kick", f"to the side with {{his}} {side} leg")]
    wordings = _counted(wordings, event)
    if count == 1:
        wordings += [("throw", f"a {side} {kind}")]
    elif count < len(_NUMBERS):
        many = f"{_NUMBERS[count]} {kind}{'es' if kind == 'punch' else 's'}"
        wordings += [("do", f"{many} with {{his}} {side} {limbs[0]}")]
    return wordings


@_phrases_of("jump", "hop")
def _jump(act: ReportedAct) -> list[Phrase]:
    event = act.event
    on = f"on {{his}} {event.side} foot" if event.kind == "hop" else ""
    to = {
        "forward": "forward",
        "backward": "backward",
        "place": "",
        "left": "to the left",
        "right": "to the right",
    }.get(event.direction, "")
    ups = ["up", "up and down", "in place"] if event.direction == "place" and not on else [to]
    if event.count == 1:
        ups = [word.replace("up and down", "up into the air") for word in ups]
    wordings = _counted([(event.kind, _words(up, on)) for up in ups], event)
    if on:
        on_leg = _words(to, f"on {{his}} {event.side} leg")
        return wordings + _counted([("hop", on_leg), ("hop", _words(to, "on one leg"))], event)
    if event.side == BOTH and event.direction == "forward":
        wordings += _counted([("jump", "forward with both feet"), ("hop", "forward")], event)
    return wordings


@_phrases_of("raise", "wave", "clap", "arm_circle")
def _arms(act: ReportedAct) -> list[Phrase]:
    event = act.event
    both = event.side == BOTH
    hand = "both hands" if both else f"{{his}} {event.side} hand"
    arm = "both arms" if both else f"{{his}} {event.side} arm"
    if event.kind == "raise":
        above = ["above {his} head", "up high", "up"] if event.amount > 0.25 else ["", "up", ""]
        if event.direction == "side" and event.amount < 0.2:
            above = ["to the side" if not both else "to the sides", ""]
        if event.direction == "forward" and event.amount < 0.2:
            above = ["in front of {him}", ""]
        wordings = [("raise", _words(limb, where)) for limb in (hand, arm) for where in above]
        return _counted([*wordings, ("lift", _words(arm, above[-1]))], event)
    if event.kind == "wave":
        return [
            ("wave", hand),
            ("wave", f"with {hand}"),
            ("wave", f"{hand} from side to side"),
            ("wave", arm),
        ]
    if event.kind == "clap":
        return [("clap", "{his} hands"), ("clap", ""), *_counted([("clap", "{his} hands")], event)]
    to = f" {event.direction}" if event.direction else ""
    wordings = [
        ("circle", f"{arm}{to}"),
        ("rotate", f"{arm}{to} in a circle"),
        ("swing", f"{arm}{to} in a big circle"),
    ]
    return _counted(wordings, event)


@_phrases_of("climb")
def _climb(act: ReportedAct) -> list[Phrase]:
    direction = act.event.direction
    return [("climb", direction), ("go", direction), ("climb", f"{direction} something")]


@_phrases_of("pick_up")
def _pick_up(act: ReportedAct) -> list[Phrase]:
    hand = "both hands" if act.event.side == BOTH else f"{{his}} {act.event.side} hand"
    wordings = [
        ("bend", f"down and {{reach}} to the floor with {hand}"),
        ("reach", f"down to the floor with {hand}"),
        ("bend", f"down and {{touch}} the floor with {hand}"),
    ]
    return _counted(wordings, act.event)


@_phrases_of("balance")
def _balance(act: ReportedAct) -> list[Phrase]:
    return [
        ("stand", f"on {{his}} {act.event.side} leg"),
        ("balance", f"on {{his}} {act.event.side} foot"),
        ("balance", "on one leg"),
    ]
