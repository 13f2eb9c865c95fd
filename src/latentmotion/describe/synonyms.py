"""Words and phrases of movement that may stand for each other without changing what happens."""

from __future__ import annotations

import re
from dataclasses import dataclass

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
    VerbGroup(("kneel", "kneel down"), r"(?:$|and\b|then\b|,|\.|on one|on both|on their|on his)"),
    VerbGroup(("sit down", "take a seat"), r"(?:$|and\b|then\b|,|\.|on an?\b|in an?\b)"),
    VerbGroup(("stand up", "get up"), r"(?:$|and\b|then\b|,|\.|again\b|from\b)"),
    VerbGroup(("stand back up", "get back up"), r"(?:$|and\b|then\b|,|\.|again\b|from\b)"),
    VerbGroup(("bend down", "bend over"), _END, r"\bover\b|\bdown\b.*\bdown\b"),
    VerbGroup(("raise", "lift"), _BODY + _LIMB, r"\bweight|\bdumbbell"),
    VerbGroup(("throw", "toss"), _OBJECT, r"punch|kick|throw|fit|jab|hook|arms?\b"),
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
)

_GOES = (
    r"(?<=^)(?P<verb>walk|run|jog|step|move|march|crawl|hop|jump|sneak|stroll|shuffle|skip|limp) "
)

PHRASES: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"\bforwards?\b(?<!a forward)(?<!the forward)"
     r"(?! (?:direction|motion|and backward|facing|pace|lean|momentum|roll))",
     ("forward", "forwards")),
    (_GOES + r"forwards?(?=$| at| with| for| in a straight| slowly| quickly)",
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
    (r"\bas if (?:he is|she is|they are|they were|he was|he were)\b", ("as if",)),
    (r"\b(?:simply|just|seemingly|basically) ", ("",)),
)  # fmt: skip
"""Patterns inside a clause, verb first in its base form, and what each may become."""

NUMBERS = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

_COUNTED = re.compile(
    rf"\b({'|'.join(NUMBERS)}|[2-9]|10) (?=(?:small |big |large |slow |quick )?"
    r"(?:steps|times|jumps|hops|kicks|punches|squats|paces|laps|circles)\b)"
)


def other_number(text: str) -> str:
    """Writes counts of steps and repetitions in digits where they were words, and back."""

    def swap(match: re.Match[str]) -> str:
        word = match.group(1)
        number = str(NUMBERS.index(word) + 2) if word in NUMBERS else NUMBERS[int(word) - 2]
        return f"{number} "

    return _COUNTED.sub(swap, text)
