"""Acts → verb phrases, several for each."""

from __future__ import annotations

from latentmotion.describe.acts import Act
from latentmotion.describe.facts import BOTH, LEFT, Event
from latentmotion.describe.travel import FAST, SLOW
from latentmotion.describe.verbs import present_participle

Phrase = tuple[str, str]
"""Verb in base form and the rest; `{his}` stands for a possessive."""

_TIMES = (
    "",
    "once",
    "twice",
    "three times",
    "four times",
    "five times",
    "six times",
    "seven times",
    "eight times",
    "nine times",
    "ten times",
)
_WORDS = ("", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def phrases(act: Act) -> list[Phrase]:
    """Returns ways to tell an act, the plainest first."""
    event = act.event
    if event.kind == "turn":
        return _turn(event, act.gait)
    if act.on:
        return _onward(event)
    if event.kind in ("walk", "jog", "run"):
        return _gait(event, act.posture)
    if event.kind in ("kick", "punch", "knee"):
        return _limb(event)
    if event.kind in ("jump", "hop"):
        return _jump(event)
    if event.kind in ("raise", "wave", "arm_circle", "clap"):
        return _arms(event)
    if event.kind == "climb":
        return [
            ("climb", event.direction),
            ("go", event.direction),
            ("climb", f"{event.direction} something"),
        ]
    return _counted(_PLAIN[event.kind], event) if event.kind in _PLAIN else _sided(event)


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


def _pace(event: Event) -> list[str]:
    if event.kind == "walk" and event.amount < SLOW:
        return ["slowly", "slowly", "at a slow pace"]
    if event.kind == "walk" and event.amount > FAST:
        return ["quickly", "briskly", "fast", "at a fast pace"]
    if event.kind == "run" and event.amount > 3.6:
        return ["", "fast", "quickly"]
    return ["", "", "", "", "at a normal pace" if event.kind == "walk" else ""]


def _onward(event: Event) -> list[Phrase]:
    way = "" if event.direction in ("forward", "place") else f" {event.direction}"
    return [
        ("keep", f"{present_participle(event.kind)}{way}"),
        (event.kind, f"on{way}"),
        ("continue", f"{present_participle(event.kind)}{way}"),
        (event.kind, way.strip() or "forward"),
    ]


def meanwhile(act: Act) -> list[Phrase]:
    """Returns ways to tell an act that happens during another, after "while"."""
    event = act.event
    if event.kind != "turn":
        return phrases(act)
    if event.amount < 45:
        return [("turn", f"slightly to the {event.side}"), ("veer", f"to the {event.side}")]
    around = "around to the" if event.amount >= 150 else "to the"
    return [("turn", f"{around} {event.side}")]


_WAYS = {
    "forward": ("forward", "forward", "straight ahead", "forwards"),
    "backward": ("backward", "backwards", "backwards"),
    "left": ("sideways to the left", "to the left sideways", "left sideways"),
    "right": ("sideways to the right", "to the right sideways", "right sideways"),
    "place": ("in place", "on the spot"),
}
_LOW = {"crouch": ("crouched", "in a crouch"), "bend": ("bent forward", "bent over"), "": ("",)}


def _gait(event: Event, posture: str) -> list[Phrase]:
    verbs = [event.kind]
    if event.direction in ("left", "right") and event.kind == "walk":
        verbs = ["step", "walk", "move"]
    found = [
        (verb, _words(way, pace, low))
        for verb in verbs
        for way in _WAYS[event.direction]
        for pace in _pace(event)
        for low in _LOW[posture]
    ]
    if event.kind == "walk" and event.direction == "forward" and not posture:
        found += [(event.kind, _words(pace)) for pace in _pace(event)]
        found += [(event.kind, _words("in a straight line", pace)) for pace in _pace(event)]
    if event.direction == "left" or event.direction == "right":
        found += [("sidestep", f"to the {event.direction}")] if event.kind == "walk" else []
    return found


def _turn(event: Event, gait: Event | None) -> list[Phrase]:
    side, degrees = event.side, event.amount
    clock = "counterclockwise" if side == LEFT else "clockwise"
    verb, pace = (gait.kind, _pace(gait)[0]) if gait else ("turn", "")
    onward = gait if gait and gait.direction == "forward" else None
    far = gait is not None and gait.amount * gait.seconds / max(degrees / 57.3, 0.3) > 0.4
    if degrees >= 290:
        return _circles(event, onward if far else None, clock, verb, pace)
    if degrees >= 150:
        out = _turn_around(side, degrees)
        if onward and far:
            out += _half_circle(side, degrees, clock, verb, pace)
    else:
        out = _turn_aside(side, degrees)
    if onward and degrees < 150:
        out += [
            (verb, _words(f"in a curve to the {side}", pace)),
            (verb, _words(f"forward and {{turn}} {_slightly(degrees)}{side}", "")),
        ]
        out += [("curve", f"to the {side}")]
    return out


def _turn_around(side: str, degrees: float) -> list[Phrase]:
    """Turns of 150 to 290 degrees."""
    if degrees > 220:
        return [("turn", f"around to the {side}"), ("turn", f"far to the {side}")]
    return [
        ("turn", "around"),
        ("turn", f"around to the {side}"),
        ("turn", "around"),
        ("make", f"a half turn to the {side}"),
        ("turn", f"{side} by 180 degrees"),
        ("turn", f"{side} and {{face}} the other way"),
    ]


def _half_circle(side: str, degrees: float, clock: str, verb: str, pace: str) -> list[Phrase]:
    """The same while walking or running on."""
    if degrees >= 220:
        return [(verb, f"in a wide curve to the {side}")]
    return [
        (verb, _words(f"in a half circle to the {side}", pace)),
        (verb, f"around to the {side} in a half circle"),
        ("make", f"a u-turn to the {side}"),
        (verb, f"in a {clock} half circle"),
    ]


def _turn_aside(side: str, degrees: float) -> list[Phrase]:
    """Turns of less than 150 degrees."""
    if degrees < 45:
        return [
            ("turn", f"slightly to the {side}"),
            ("veer", f"slightly to the {side}"),
            ("turn", f"slightly {side}"),
        ]
    out = [("turn", side), ("turn", f"to the {side}")]
    if degrees < 65:
        return [*out, ("turn", f"a bit to the {side}")]
    out += [("make", f"a {side} turn")]
    if 78 <= degrees <= 104:
        out += [
            ("turn", f"{side} by 90 degrees"),
            ("make", f"a quarter turn to the {side}"),
            ("turn", f"90 degrees to the {side}"),
        ]
    return out


def _slightly(degrees: float) -> str:
    return "slightly " if degrees < 45 else ""


def _circles(event: Event, gait: Event | None, clock: str, verb: str, pace: str) -> list[Phrase]:
    side, rounds = event.side, event.amount / 360
    if gait is None:
        out = [
            ("spin", f"around to the {side}"),
            ("turn", f"all the way around to the {side}"),
            ("make", f"a full turn to the {side}"),
            ("spin", f"around {clock}"),
        ]
        if 1.75 < rounds < 2.25:
            out = [
                ("spin", f"around twice to the {side}"),
                ("make", f"two full turns to the {side}"),
            ]
        elif rounds >= 1.75:
            out = [("spin", f"around several times to the {side}"), ("spin", f"around {clock}")]
        return out
    out = [
        (verb, _words(f"in a circle to the {side}", pace)),
        (verb, f"in a {clock} circle"),
        (verb, _words("in a circle", pace)),
        (verb, f"around in a circle to the {side}"),
    ]
    if rounds >= 1.75:
        out += [(verb, f"in circles to the {side}"), (verb, f"around in circles {clock}")]
    return out


def _limbs_in_turn(event: Event) -> list[Phrase]:
    if event.kind == "knee":
        return [
            ("raise", "{his} knees one after the other"),
            ("lift", "{his} knees in turn"),
            ("bring", "{his} left and right knee up in turn"),
        ]
    limbs = "legs" if event.kind == "kick" else "hands"
    one = "leg" if event.kind == "kick" else "hand"
    out = [
        (event.kind, f"with both {limbs} in turn"),
        (event.kind, f"with {{his}} left and right {one} in turn"),
        (event.kind, f"several times with both {limbs}"),
    ]
    if event.count < len(_TIMES):
        out.append((event.kind, f"{_TIMES[event.count]} with both {limbs} in turn"))
    return out


def _limb(event: Event) -> list[Phrase]:
    if event.side == BOTH:
        return _limbs_in_turn(event)
    side, many = event.side, event.count
    where = f" {event.direction}" if event.direction == "forward" else ""
    out: list[Phrase]
    if event.kind == "knee":
        out = [
            ("raise", f"{{his}} {side} knee"),
            ("lift", f"{{his}} {side} knee"),
            ("bring", f"{{his}} {side} knee up"),
        ]
        return _counted(out, event)
    limbs = ("leg", "foot") if event.kind == "kick" else ("hand", "fist", "arm")
    out = [(event.kind, f"{where.strip()} with {{his}} {side} {limb}".strip()) for limb in limbs]
    if event.kind == "kick" and event.direction == "side":
        out += [("kick", f"to the side with {{his}} {side} leg")]
    out = _counted(out, event)
    if many == 1:
        out += [("throw", f"a {side} {event.kind}")]
    elif many < len(_WORDS):
        out += [
            (
                "do",
                f"{_WORDS[many]} {event.kind}{'es' if event.kind == 'punch' else 's'} "
                f"with {{his}} {side} {limbs[0]}",
            )
        ]
    return out


def _jump(event: Event) -> list[Phrase]:
    on = ""
    if event.kind == "hop":
        on = f"on {{his}} {event.side} foot"
    way = {
        "forward": "forward",
        "backward": "backward",
        "place": "",
        "left": "to the left",
        "right": "to the right",
    }.get(event.direction, "")
    ups = ["up", "up and down", "in place"] if event.direction == "place" and not on else [way]
    if event.count == 1:
        ups = [word.replace("up and down", "up into the air") for word in ups]
    out = _counted([(event.kind, _words(up, on)) for up in ups], event)
    if on:
        out += _counted(
            [
                ("hop", _words(way, f"on {{his}} {event.side} leg")),
                ("hop", _words(way, "on one leg")),
            ],
            event,
        )
    elif event.side == BOTH and event.direction == "forward":
        out += _counted([("jump", "forward with both feet"), ("hop", "forward")], event)
    return out


def _arms(event: Event) -> list[Phrase]:
    both = event.side == BOTH
    hand = "both hands" if both else f"{{his}} {event.side} hand"
    arm = "both arms" if both else f"{{his}} {event.side} arm"
    if event.kind == "raise":
        above = ["above {his} head", "up high", "up"] if event.amount > 0.25 else ["", "up", ""]
        if event.direction == "side" and event.amount < 0.2:
            above = ["to the side" if not both else "to the sides", ""]
        if event.direction == "forward" and event.amount < 0.2:
            above = ["in front of {him}", ""]
        out = [("raise", _words(limb, where)) for limb in (hand, arm) for where in above]
        return _counted([*out, ("lift", _words(arm, above[-1]))], event)
    if event.kind == "wave":
        return [
            ("wave", hand),
            ("wave", f"with {hand}"),
            ("wave", f"{hand} from side to side"),
            ("wave", arm),
        ]
    if event.kind == "clap":
        return [("clap", "{his} hands"), ("clap", ""), *_counted([("clap", "{his} hands")], event)]
    way = f" {event.direction}" if event.direction else ""
    out = [
        ("circle", f"{arm}{way}"),
        ("rotate", f"{arm}{way} in a circle"),
        ("swing", f"{arm}{way} in a big circle"),
    ]
    return _counted(out, event) if event.count > 1 else out


def _sided(event: Event) -> list[Phrase]:
    if event.kind == "pick_up":
        hand = "both hands" if event.side == BOTH else f"{{his}} {event.side} hand"
        out = [
            ("bend", f"down and {{reach}} to the floor with {hand}"),
            ("reach", f"down to the floor with {hand}"),
            ("bend", f"down and {{touch}} the floor with {hand}"),
        ]
        return _counted(out, event)
    if event.kind == "balance":
        return [
            ("stand", f"on {{his}} {event.side} leg"),
            ("balance", f"on {{his}} {event.side} foot"),
            ("balance", "on one leg"),
        ]
    return [("do", event.kind.replace("_", " "))]


def _counted(found: list[Phrase], event: Event) -> list[Phrase]:
    """Tells how often, once it is more than one time."""
    if event.count == 1:
        return found
    often = _TIMES[event.count] if event.count < len(_TIMES) else "several times"
    vague = ["repeatedly", "several times"] if event.count > 3 else []
    return [(verb, _words(rest, word)) for verb, rest in found for word in (often, often, *vague)]


def _words(*parts: str) -> str:
    return " ".join(part for part in parts if part)
