"""English verbs of movement: base forms, inflection, and phrases that mean the same."""

from __future__ import annotations

import re
from dataclasses import dataclass

from latentmotion.language.inflection import present_participle, third_person

_VERB_WORDS = """
    act adjust advance answer applaud approach attempt balance bat begin bend block bounce bow box
    brace break bring brush bump carry cartwheel cast catch celebrate chop circle clap clean climb
    clutch collapse come conduct continue cook cough cower crawl creep crouch cry curl cut dance
    dash descend dig dip direct do dodge drag draw dribble drift drink drive drop drum duck eat
    elevate emulate end enter examine exercise extend fake fall fight finish fix flail flap flex
    flip fling fold follow gallop gather gesture get give glance go golf grab grasp greet grip
    hang hesitate hit hold hop hug hunch hurry imitate indicate inspect jab jerk jog jump juggle
    kick kneel knock land laugh lay lead lean leap let lie lift limp look loosen lower lunge make
    march meander mime mimic mix motion move nod open paddle paint pace pass pat pause peck pedal
    perform pet pick pirouette pitch pivot place plant play point pose pour practice pray prepare
    press pretend proceed prowl pull pump punch push put raise reach read recover regain relax
    release remain remove repeat rest resume return ride rise roam roll rotate row rub run salute
    saunter scoop scratch scrub search shadowbox shake shift shimmy shiver shoot shout shove show
    shrug shuffle shush sidestep signal sing sip sit skate ski skip slam slap slide slouch slow
    slump smack smoke sneak speed spin spread sprint sprinkle squat stagger stand start stay step
    stir stomp stoop stop straighten strafe stretch stride strike stroke stroll strum strut
    stumble swat sway sweep swerve swim swing swipe switch swivel take talk tap taunt teeter throw
    thrust tie tilt tiptoe toss touch transition travel tread trip trot trudge try tuck turn twirl
    twist twitch type uncross unscrew use veer waddle wait wake walk waltz wander warm wash wave
    weave whistle wiggle wind wipe wobble work wrap write yawn zigzag alternate appear arch assume
    change check clasp clench close complete cover cross demonstrate flick form grow keep kiss
    leave lose maintain mop mount poke position rearrange reverse rock seem slip smash sprawl
    squeeze stack steady stare stick swoop teach tense tumble undo unfold watch wring
"""

VERBS = tuple(_VERB_WORDS.split())
"""Base forms. Words that are parts of the body as well (hand, knee, elbow, face) are left out."""

BASE_OF_THIRD = {third_person(verb): verb for verb in VERBS}
"""Base form by third person."""

BASE_OF_PARTICIPLE = {present_participle(verb): verb for verb in VERBS}
"""Base form by participle."""

_BODY = r"(?:(?:his|her|their|your|the|both|a|one|of|left|right) )+"
_LIMB = r"(?:arms?|hands?|legs?|knees?|foot|feet|elbows?)\b"
_END = (
    r"(?:$|and\b|then\b|,|\.|while\b|again\b|with\b|as\b|before\b|after\b|on\b|in\b|for\b|over\b)"
)
_OBJECT = r"(?:an?|the|something|some|two|it)\b"
_WAY = r"(?:in|forwards?|backwards?|ahead|to|around|across|slowly|quickly|with|over|up|down)\b"


@dataclass(frozen=True)
class VerbGroup:
    """Beginnings of clauses, verb first in its base form, that mean the same."""

    phrases: tuple[str, ...]
    """The beginnings; the first found that fits is replaced by another."""
    following: str = ""
    """Pattern of what must follow."""
    unless: str = ""
    """Pattern that must not be anywhere in the clause."""


VERB_GROUPS = (
    VerbGroup(("jog", "run slowly"), _END, r"slow|fast|quick|pace|speed|brisk|light|jog|steady"),
    VerbGroup(("sprint", "run fast"), _END, r"slow|fast|quick|pace|speed|sprint"),
    VerbGroup(("crouch down", "squat down"), _END, r"squats?\b|crouch\b"),
    VerbGroup(("crouch", "crouch down"), r"(?:$|and\b|then\b|,|\.|while\b)"),
    VerbGroup(
        ("kneel", "kneel down", "get down on one knee", "go down on a knee", "drop to one knee"),
        r"(?:$|and\b|then\b|,|\.)",
    ),
    VerbGroup(("kneel", "kneel down"), r"on (?:one|both|their|his|the floor|the ground)"),
    VerbGroup(
        ("sit down", "take a seat", "have a seat"), r"(?:$|and\b|then\b|,|\.|on an?\b|in an?\b)"
    ),
    VerbGroup(("stand up", "get up"), r"(?:$|and\b|then\b|,|\.|again\b|from\b)"),
    VerbGroup(("stand back up", "get back up"), r"(?:$|and\b|then\b|,|\.|again\b|from\b)"),
    VerbGroup(("bend down", "bend over"), _END, r"\bover\b|\bdown\b.*\bdown\b"),
    VerbGroup(("raise", "lift"), _BODY + _LIMB, r"\bweight|\bdumbbell"),
    VerbGroup(
        ("throw", "toss", "hurl", "fling"), _OBJECT, r"punch|kick|throw|fit|jab|hook|arms?\b"
    ),
    VerbGroup(("hit", "strike"), _OBJECT, r"pose|hit"),
    VerbGroup(("punch", "throw punches"), r"(?:$|with both)", r"once|twice|times|punch"),
    VerbGroup(("spin around", "twirl around"), _END, r"arm|hand|leg|them|it\b"),
    VerbGroup(("jump up", "leap up"), _END, r"and down|\bjumps?\b|\bleaps?\b"),
    VerbGroup(("jump over", "leap over")),
    VerbGroup(("stumble", "stagger"), _WAY, r"stumbl|stagger|stead|trip"),
    VerbGroup(("place", "put"), _BODY, r"\b(?:air|out|up|down|back|forwards?|together)\b"),
    VerbGroup(("grab", "take hold of", "grasp"), _OBJECT),
    VerbGroup(("stop", "come to a stop", "halt"), r"(?:$|\.)"),
    VerbGroup(("sneak", "creep"), _WAY, r"sneak|creep"),
    VerbGroup(("tiptoe", "walk on tiptoe"), _WAY, r"tiptoe|walk"),
    VerbGroup(("clap", "clap the hands"), r"(?:$|once|twice|\w+ times)"),
    VerbGroup(
        ("do", "perform"),
        r"(?:an? |the |some |\w+ )?[a-z-]*(?: kick| jack| squat| lunge|flip|wheel)",
    ),
    VerbGroup(("start", "begin"), r"(?:to|[a-z]+ing)\b"),
    VerbGroup(("fall down", "fall over"), _END, r"\bover\b"),
    VerbGroup(("look around", "look about"), r"(?:$|\.)"),
    VerbGroup(("walk in a circle", "walk around in a circle"), "", r"around"),
    VerbGroup(("pace back and forth", "walk back and forth")),
    VerbGroup(("return to", "go back to")),
    VerbGroup(("shuffle", "shuffle along"), r"(?:$|forwards?\b|slowly\b)"),
    VerbGroup(("lie down", "lay down", "get down and lie"), r"(?:$|on the)", r"\bback\b"),
    VerbGroup(
        ("climb up", "climb", "walk up", "go up"), r"(?:the |some |a few )?(?:stairs|steps)\b"
    ),
    VerbGroup(("walk upstairs", "climb the stairs", "go up some stairs"), "$"),
    VerbGroup(("wave hello", "wave", "wave at someone", "greet someone with a wave"), "$"),
    VerbGroup(("give a high five", "raise a hand for a high five"), "$"),
    VerbGroup(("shake hands", "shake hands with someone", "greet someone with a handshake"), "$"),
    VerbGroup(("serve at table tennis", "make a table tennis serve", "serve in ping pong"), "$"),
    VerbGroup(("play table tennis", "play ping pong"), "$"),
    VerbGroup(("dribble a basketball", "dribble a ball", "bounce a basketball")),
    VerbGroup(
        (
            "shoot a basketball up at the hoop",
            "take a shot at the hoop",
            "throw a basketball",
            "make a basketball shot",
            "throw a ball at the basket",
        ),
        "$",
    ),
    VerbGroup(("pass a basketball", "pass the ball"), "$"),
    VerbGroup(("fight", "fight with someone", "fight against somebody"), "$"),
    VerbGroup(("hand something over", "give something to someone", "give someone something"), "$"),
    VerbGroup(("push someone with the hands", "shove another person", "push somebody away"), "$"),
    VerbGroup(("bow deeply", "bow", "take a deep bow"), "$"),
    VerbGroup(("bob under punches", "duck punches", "duck and weave"), "$"),
    VerbGroup(("limp", "hobble"), _WAY),
    VerbGroup(("get down low", "crouch down", "duck down"), "$"),
    VerbGroup(("walk around", "wander around", "roam around"), "$"),
    VerbGroup(("circle", "rotate"), r"both arms|the (?:left|right) arm"),
    VerbGroup(("stretch", "spread", "hold out"), rf"{_BODY}arms?\b"),
)

_GAIT_VERB = (
    r"(?<=^)(?P<verb>walk|run|jog|step|move|march|crawl|hop|jump|sneak|stroll|shuffle|skip|limp) "
)

PHRASES: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"\bforwards?\b(?<!a forward)(?<!the forward)"
     r"(?! (?:direction|motion|and backward|facing|pace|lean|momentum|roll))",
     ("forward", "forwards")),
    (_GAIT_VERB + r"forwards?(?=$| at| with| for| in a straight| slowly| quickly)",
     (r"\g<verb> forward", r"\g<verb> ahead")),
    (r"(?<!a )(?<!the )\bbackwards?\b(?! (?:direction|motion|facing|flip|roll|pace|and forward))",
     ("backward", "backwards")),
    (r"\bon the spot\b|\bin place\b(?! of)", ("in place", "on the spot")),
    (r"(?P<a>walk|run|jog|move|step|dance|spin|march|turn around|jump|forwards?|backwards?) "
     r"(?:quickly|rapidly)(?=$| and| then| to| in)",
     (r"\g<a> quickly", r"\g<a> fast", r"\g<a> rapidly", r"\g<a> at a fast pace")),
    (r"(?P<a>walk|jog|move|march|forwards?|backwards?) slowly(?=$| and| then| to| in)",
     (r"\g<a> slowly", r"\g<a> at a slow pace", r"\g<a> in slow steps")),
    (r"\b(?:at|in) a slow (?:pace|speed)\b", ("slowly", "at a slow pace", "at slow speed")),
    (r"\b(?:at|in) a (?:fast|quick) (?:pace|speed)\b", ("quickly", "at a fast pace", "fast")),
    (r"(?<=^turn )(?:to (?:the|his|her|their|your) )?left(?=$| and| then| again)",
     ("left", "to the left", "leftwards", "to the left side")),
    (r"(?<=^turn )(?:to (?:the|his|her|their|your) )?right(?=$| and| then| again)",
     ("right", "to the right", "rightwards", "to the right side")),
    (r"^(?P<a>step|walk|jump|hop|move|sidestep|shuffle) (?:to (?:the|his|her|their|your) )?"
     r"(?P<s>left|right)(?=$| and| then| again| twice| once)",
     (r"\g<a> to the \g<s>", r"\g<a> \g<s>", r"\g<a> \g<s>ward", r"\g<a> towards the \g<s>")),
    (r"\b(?:counter[- ]?clock-?wise|anti-?clockwise)\b",
     ("counterclockwise", "counter-clockwise", "anticlockwise", "counter clockwise")),
    (r"\btwice\b|\b(?:two|2) times\b", ("twice", "two times", "2 times")),
    (r"(?<!at )(?<!all )(?<!more than )\bonce\b(?! again| more|,| the)(?=$| with| on| in)",
     ("once", "one time")),
    (r"\b(?P<a>on|to|off|from|towards?) the (?:floor|ground)\b",
     (r"\g<a> the floor", r"\g<a> the ground")),
    (r"\b(?:above|over) (?P<a>his|her|their|your|the) head\b",
     (r"above \g<a> head", r"over \g<a> head")),
    (r"\b(?:with|using) (?P<a>his|her|their|your|the) (?P<s>left|right) "
     r"(?P<b>hand|foot|leg|arm)\b",
     (r"with \g<a> \g<s> \g<b>", r"using \g<a> \g<s> \g<b>", r"with the \g<s> \g<b>")),
    (r"^(?P<v>pick up|lift|carry|move|drop|take|grab|put|place|set down|put down) something\b"
     r"(?! (?:up )?high)",
     (r"\g<v> something", r"\g<v> an object", r"\g<v> a box", r"\g<v> a thing",
      r"\g<v> a bag")),
    (r"^(?P<v>pick|lift|put|set) something (?P<w>up|down)\b",
     (r"\g<v> something \g<w>", r"\g<v> an object \g<w>", r"\g<v> \g<w> a box",
      r"\g<v> \g<w> an object", r"\g<v> \g<w> a ball", r"\g<v> \g<w> something")),
    (r"^(?P<v>put|place|set|lay) (?P<o>something|an? [a-z]+) on the (?P<f>floor|ground)\b",
     (r"\g<v> \g<o> on the \g<f>", r"put \g<o> down on the \g<f>",
      r"set \g<o> down on the \g<f>", r"put down \g<o>", r"place \g<o> on the \g<f>")),
    (r"^(?P<v>throw|toss|hurl|fling) (?:something|a ball)\b(?! at| away)",
     (r"\g<v> something", r"\g<v> a ball", r"\g<v> a stone", r"\g<v> an object")),
    (r"^(?:raise|lift) (?P<a>his|her|their|your|the) (?P<s>left|right) hand in front"
     r"(?: of (?:him|her|them|you|themselves|himself|herself))?$",
     (r"raise \g<a> \g<s> hand in front", r"point forward with \g<a> \g<s> hand",
      r"point ahead with \g<a> \g<s> arm", r"point straight ahead",
      r"stretch \g<a> \g<s> arm out in front", r"point at something in front")),
    (r"\bas if (?:he is|she is|they are|they were|he was|he were)\b", ("as if",)),
    (r"\b(?:simply|just|seemingly|basically) ", ("",)),
)  # fmt: skip
"""Patterns inside a clause, verb first in its base form, and what each may become."""

_NUMBERS = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

_COUNTED = re.compile(
    rf"\b({'|'.join(_NUMBERS)}|[2-9]|10) (?=(?:small |big |large |slow |quick )?"
    r"(?:steps|times|jumps|hops|kicks|punches|squats|paces|laps|circles)\b)"
)


def other_number(text: str) -> str:
    """Writes counts of steps and repetitions in digits where they were words, and back."""

    def swap(match: re.Match[str]) -> str:
        word = match.group(1)
        number = str(_NUMBERS.index(word) + 2) if word in _NUMBERS else _NUMBERS[int(word) - 2]
        return f"{number} "

    return _COUNTED.sub(swap, text)
