"""Claims of a sentence about a motion: actions with side, direction, count, degrees and pace.

Only what the describer can measure is read. "A man slowly walks backwards, then kicks twice with
his left leg." claims `walk` backward, slow, then `kick` left, two. Words about the viewer's view
("walks to the right of the screen") are read as the body's own side and checked leniently.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache

from latentmotion.describe.facts import BOTH, LEFT, RIGHT


@dataclass(frozen=True)
class Claim:
    """One action that a sentence mentions."""

    kind: str
    """As `Event.kind`, or `move` (any gait), `circle`, `stop`, `place` (on the spot)."""
    side: str = ""
    """Side of a hand, foot or knee, or of a turn."""
    direction: str = ""
    """`forward`, `backward`, `left`, `right`, `side` (either), `up`, `place`."""
    count: int = 0
    """Number of repetitions; zero where the sentence has none."""
    degrees: float = 0.0
    """Degrees of a turn; zero where the sentence has none."""
    pace: str = ""
    """`slow` or `fast`; empty where the sentence has none."""
    then: bool = False
    """Whether it comes after the claim before it."""


_NOT_MEANT = (
    r"jumping[- ]jacks?|jump ?(?:shot|rop)\w*|sit[- ]?ups?|push[- ]?ups?|run ?ways?|foot ?step\w*",
    r"run\w* (?:his|her|their|its|both|one|the|a|them|it)\b ?(?:\w+ )?(?:hands?|fingers?|arms?)?",
    r"(?:left|right|upper) (?:hand )?side(?= of)|walkman|stand ?point|in ?position",
)
"""Words with a verb in them that mean something else."""

Verbs = tuple[tuple[str, tuple[str, ...]], ...]
"""Kinds of claims and the words for them; the first wins where two begin at the same word."""

_VERBS: Verbs = (
    ("", _NOT_MEANT),
    ("place", (r"(?:in|on) (?:place|the spot|one place|one spot|the same (?:place|spot))",)),
    (
        "circle",
        (
            r"(?:(?:half|semi|full|quarter)[- ]?|half (?:of )?a )?(?:semi-?)?circles?"
            r"(?! (?:his|her|their|the|both|its)\b)",
            r"circular (?:path|pattern|route|direction|motion)|u[- ]shape\w*",
        ),
    ),
    ("jog", (r"jog(?:s|ged|ging)?|trot(?:s|ting)?",)),
    ("run", (r"run(?:s|ning)?|ran|sprint(?:s|ed|ing)?|dash(?:es|ing)?",)),
    (
        "walk",
        (
            r"walk(?:s|ed|ing|es)?|stroll(?:s|ed|ing)?|saunter\w*|march(?:es|ed|ing)?|strid(?:es?|ing)",
            r"strut\w*|tip-?toe(?:s|ing)?|sneak(?:s|ing)?|creep(?:s|ing)?|wander(?:s|ed|ing)?|trudg\w+",
            r"limp(?:s|ing)?",
        ),
    ),
    (
        "stand_up",
        (
            r"(?:stand|stood|stands|standing|get|gets|getting|got|rise|rises|rising)(?: back)? up"
            r"(?: again)?(?! ?(?:right|straight))|rises? to (?:his|her|their) feet",
        ),
    ),
    ("lie_down", (r"lie|lies|lying|lays?|laying",)),
    ("sit", (r"sit|sits|sat|sitting|takes? a seat|seated|seating",)),
    ("kneel_down", (r"kneel(?:s|ed|ing)?|knelt",)),
    ("squat", (r"squat(?:s|ted|ting)?|bend(?:s|ing)? (?:(?:his|her|their|both|the) )?knees",)),
    ("crouch", (r"crouch(?:es|ed|ing)?|duck(?:s|ing)?(?= down)",)),
    (
        "pick_up",
        (
            r"pick(?:s|ed|ing)?(?: \w+){0,4}? up",
            r"(?:from|off|on|onto|to|touch\w*) (?:of )?the (?:floor|ground)",
        ),
    ),
    ("bow", (r"bow(?:s|ed|ing)?|(?:bend|lean)(?:s|ing)? (?:over|down|forwards?)|bent over",)),
    ("hop", (r"hop(?:s|ped|ping)?",)),
    ("jump", (r"jump(?:s|ed|ing)?|leap(?:s|ed|ing|t)?",)),
    ("kick", (r"kick(?:s|ed|ing)?",)),
    ("punch", (r"punch(?:es|ed|ing)?|jab(?:s|bed|bing)?|uppercuts?",)),
    ("clap", (r"clap(?:s|ped|ping)?|applau\w+",)),
    ("wave", (r"wav(?:e|es|ed|ing)",)),
    (
        "arm_circle",
        (
            r"(?:rotat|circl|swing|windmill|spin)\w* (?:both |(?:his|her|their|the) )?(?:\w+ )?"
            r"(?:straight )?arms?(?= .{0,25}circ)|arm circles?",
            r"(?:circl|rotat)\w+ (?:both |(?:his|her|their|the) )?(?:\w+ )?arms?",
        ),
    ),
    (
        "balance",
        (
            r"balanc(?:e|es|ing)(?= on)",
            r"stand(?:s|ing)? on (?:one|(?:his|her|their|the) (?:left|right)) (?:leg|foot)",
        ),
    ),
    (
        "turn",
        (
            r"turn(?:s|ed|ing)?|rotat(?:e|es|ed|ing)|pivot(?:s|ed|ing)?|spin(?:s|ning)?|spun",
            r"twirl(?:s|ed|ing)?|swivel(?:s|ed|ing)|about[- ]face|u[- ]?turns?|veer(?:s|ed|ing)?",
            r"curv(?:e|es|ed|ing)",
        ),
    ),
    (
        "raise",
        (
            r"rais(?:e|es|ed|ing)|lift(?:s|ed|ing)?|reach(?:es|ed|ing)?(?= (?:up|high|above|over))",
            r"(?:put(?:s|ting)?|hold(?:s|ing)?)"
            r"(?= (?:\w+ ){0,3}(?:hands?|arms?) (?:up|high|above|over))",
        ),
    ),
    ("stop", (r"stop(?:s|ped|ping)?|halt(?:s|ed|ing)?|comes? to a (?:stop|halt|standstill)",)),
    (
        "stand",
        (
            r"(?:stand|stands|standing|stay|stays|remain|remains)(?: \w+ly)?"
            r" (?:still|motionless|in place)",
            r"(?:does|do)(?: not|n't) move|motionless|hardly moves?|stands? there|idle\w*|idling",
        ),
    ),
    (
        "move",
        (
            r"step(?:s|ped|ping)?|mov(?:e|es|ed|ing)|side-?steps?|shuffl\w+|advanc\w+|retreat\w*",
            r"back(?:s|ed|ing)(?= (?:up|away))|goes|paces|pacing|stagger(?:s|ing)?|stumbl\w+",
        ),
    ),
)
"""The verbs of captions."""

_NUMBERS = {
    **{"once": 1, "one": 1, "single": 1, "twice": 2, "two": 2, "three": 3, "thrice": 3},
    **{"four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9, "ten": 10},
}
_COUNT = re.compile(
    rf"\b(?P<word>{'|'.join(_NUMBERS)}|\d{{1,2}})\b"
    r"(?P<times> times| (?:\w+ ){0,2}(?:kick|punch|jab"
    r"|jump|hop|leap|step|squat|clap|circle|wave|swing|turn|spin|rep|wide|pace|stride)\w*)?"
)
_LIMB = re.compile(
    r"\b(left|right|both|two)(?:[- ](?:of )?(?:(?:his|her|their|the) )?)"
    r"(hand|arm|fist|elbow|wrist|leg|foot|feet|knee|side kick|hook|jab|heel|toe)s?\b"
)
_BOTH_LIMBS = re.compile(
    r"\b(?:both|his|her|their|the|two)? ?(?:hands|arms|fists|legs|feet|knees)\b"
)
SLIGHT = 25.0
"""Degrees of a turn that a sentence calls slight."""

_GAITS = ("walk", "jog", "run", "move", "turn", "circle", "stop", "stand")
_HANDS = re.compile(r"\b(?:hand|arm|fist|elbow|wrist)s?\b")
_LEGS = re.compile(r"\b(?:legs?|knees?|foot|feet)\b")
_TWISTED = re.compile(
    r"\b(?:head|torso|trunk|waist|hips?|upper body|wrists?|hands?|arms?|cap|bottle|wheel|knobs?"
    r"|dial|key|page|valve|handle|lid|foot|them|it|leg|shoulders?|neck)\b"
)
_LEFT_AND_RIGHT = re.compile(
    r"\bleft (?:and|to|or) (?:the )?right\b|\bright (?:and|to|or) (?:the )?left\b"
)
_VIEWER = re.compile(r"\b(?:top|bottom|screen|camera|viewer|upper|lower)\b")
_FORWARD = re.compile(r"\b(?:for?wards?|ahead|straight|front)\b")
_BACKWARD = re.compile(r"\bback ?wards?\b|\bin reverse\b|\bbacks? (?:up|away)\b|\bretreat")
_SIDEWAYS = re.compile(r"\bsideways?\b|\blaterally\b|\bside-?steps?\b")
_SIDE = re.compile(r"\b(left|right|(?:counter|anti)[- ]?clock-?wise|clock-?wise)(?:wards?)?\b")
_TO_SIDE = re.compile(
    r"\b(?:to|towards?|in)(?: \w+){0,2} (left|right)\b|\b(left|right)(?:wards?)?$"
)
_BOUNDARY = re.compile(r",|\band\b|\bthen\b|\bwhile\b|\bbefore\b|\bperson\b|\bman\b|;|\. ")
_SLOW = re.compile(r"\bslow(?:ly)?\b|\bgingerly\b|\bleisurely\b|\bcautiously\b|\bcarefully\b")
_FAST = re.compile(r"\b(?:quick|brisk|rapid|hurried)(?:ly)?\b|\bfast(?:er)?\b|\bat speed\b")
_DEGREES = re.compile(r"(\d{2,3})(?: ?°| ?-?deg)")
_THEN = re.compile(
    r"\b(?:then|before|after(?:wards| that| which)|next|finally|followed by)\b|;|\. "
)
_DEGREE_WORDS = (
    (
        re.compile(
            r"\bhalf[- ](?:turn|circle)|\bsemi-?circ|\bu[- ]?turn|\babout[- ]face|\b180"
            r"|half (?:of )?a circle"
        ),
        180.0,
    ),
    (re.compile(r"\bquarter[- ](?:turn|circle)"), 90.0),
    (re.compile(r"\bfull[- ](?:turn|circle|rotation)|\bcomplete (?:turn|circle)|\b360"), 360.0),
)
_CLOCK = {"clock": RIGHT, "count": LEFT, "anti-": LEFT, "anti ": LEFT, "antic": LEFT}


def claims_of(sentence: str, more: Verbs = ()) -> tuple[Claim, ...]:
    """Reads the claims of a sentence, in the order of its words.

    A circle or `in place` that follows a gait belongs to the gait, which keeps its own claim.

    Args:
        sentence: A caption.
        more: Further verbs to read; they win over those of captions.
    """
    text = " ".join(sentence.lower().split())
    verbs = _verbs_in(text, more)
    claims: list[Claim] = []
    for index, (match, kind) in enumerate(verbs):
        begin = verbs[index - 1][0].end() if index else 0
        end = verbs[index + 1][0].start() if index + 1 < len(verbs) else len(text)
        gap = text[begin : match.start()]
        last = claims[-1] if claims else None
        if kind == "place":
            if last and last.kind in ("walk", "jog", "run", "jump", "hop", "move"):
                claims[-1] = replace(last, direction="place")
            continue
        # Words right before a verb belong to it, not to the verb before, e.g. "slowly" or "two".
        before = _BOUNDARY.split(gap)[-1].strip()
        after = text[match.end() : end]
        parts = list(_BOUNDARY.finditer(after)) if end < len(text) else []
        after = after[: parts[-1].start()] if parts else after
        claim = _claim(kind, before, match.group(), after.strip())
        if claim.kind == "circle" and last and last.kind == "arm_circle":
            continue
        claims.append(replace(claim, then=index > 0 and bool(_THEN.search(gap))))
    return tuple(claims)


def verb_before(text: str, more: Verbs = ()) -> str:
    """Returns the last verb of a text as it is written, or nothing."""
    verbs = _verbs_in(text, more)
    return verbs[-1][0].group() if verbs else ""


def _verbs_in(text: str, more: Verbs) -> list[tuple[re.Match[str], str]]:
    """Returns the verbs of a text and the kinds of their claims."""
    known = (*more, *_VERBS)
    found = [
        (match, known[int(str(match.lastgroup)[1:])][0]) for match in _pattern(known).finditer(text)
    ]
    return [(match, kind) for match, kind in found if kind]


@cache
def _pattern(verbs: Verbs) -> re.Pattern[str]:
    return re.compile(
        "|".join(rf"(?P<v{n}>\b(?:{'|'.join(words)})\b)" for n, (_, words) in enumerate(verbs))
    )


def _claim(kind: str, before: str, verb: str, after: str) -> Claim:
    """Reads the claim of a verb from the words before and after it."""
    near = re.split(r",|;|\. |\bwhile\b|\bas (?:he|she|they)\b", after)[0]
    whole = f"{before} {verb} {near}"
    degrees = 0.0
    if kind in ("turn", "circle"):
        if match := _DEGREES.search(whole):
            degrees = float(match[1])
        elif re.search(r"\bslight(?:ly)?\b|\ba (?:little|bit)\b", whole):
            degrees = SLIGHT
        else:
            named = (amount for pattern, amount in _DEGREE_WORDS if pattern.search(whole))
            degrees = next(named, 0.0)
    side, direction = _side_and_direction(kind, before, verb, after)
    if kind == "kick" and re.search(r"\bback\b(?! leg| foot)", near):
        direction = "backward"
    return Claim(
        _kind_by_object(kind, before, verb, near, after),
        side=side,
        direction=direction,
        count=_count(before, after),
        degrees=degrees,
        pace="slow" if _SLOW.search(whole) else "fast" if _FAST.search(whole) else "",
    )


def _kind_by_object(kind: str, before: str, verb: str, near: str, after: str) -> str:
    """Returns the kind of a claim according to the object of the verb.

    A raised leg is a `knee`, a lifted thing a `lift`, a turned wheel or waist a `twist`.
    """
    if kind == "raise":
        leg, hand = _LEGS.search(near), _HANDS.search(near)
        if leg and (hand is None or leg.start() < hand.start()):
            return "knee"
        return kind if re.search(rf"{_HANDS.pattern}|\bup\b|\babove\b", after) else "lift"
    if kind in ("turn", "circle"):
        whole = f"{before} {verb} {near}"
        both = _LEFT_AND_RIGHT.search(near)
        held = _HANDS.search(before) or (kind == "turn" and _TWISTED.search(near))
        moved = kind == "circle" and (
            re.search(r"\b(?:leg|foot|body|head|hips?|waist|it|them)\b", before)
            or ("motion" in verb and not re.search(r"\b(?:walk|run|jog|step|turn|spin)", before))
        )
        drawn = kind == "circle" and re.search(r"\bwith (?:\w+ ){0,2}hands?\b|\bopposite", whole)
        return "twist" if both or held or moved or drawn else kind
    return kind


def _side_and_direction(kind: str, before: str, verb: str, after: str) -> tuple[str, str]:
    """Returns side and direction of the action of a verb."""
    limb = None if kind in _GAITS else _LIMB.search(f"{verb} {after}") or _LIMB.search(before)
    rest = after if limb is None else after.replace(limb.group(), " ")
    if kind in ("turn", "circle") and (side := _SIDE.search(f"{before} {rest}")):
        return _CLOCK.get(side[1][:5], side[1]), ""
    direction = ""
    if kind in ("walk", "jog", "run", "move", "jump", "hop", "kick", "arm_circle"):
        text = f"{before if kind == 'move' else ''} {verb} {rest}"
        if _BACKWARD.search(text):
            direction = "backward"
        elif _SIDEWAYS.search(text):
            side = re.search(r"\b(left|right)\b", text)
            direction = side[1] if side else "side"
        elif _FORWARD.search(text):
            direction = "forward"
        elif not _VIEWER.search(text) and (side := _TO_SIDE.search(text.strip(" .,"))):
            direction = side[1] or side[2]
    if limb and limb[1] in (LEFT, RIGHT):
        return limb[1], direction
    if limb or (kind in ("raise", "wave") and _BOTH_LIMBS.search(after)):
        return BOTH, direction
    if kind in ("kick", "punch") and (side := re.search(r"\b(left|right)\b", before)):
        return side[1], direction
    return "", direction


def _count(before: str, after: str) -> int:
    """Returns the number of repetitions that the words around a verb tell, else zero."""
    for text in (after, before):
        match = _COUNT.search(text)
        if match is None or re.match(
            r"\s*(?:leg|foot|hand|arm|knee|side|end|person|second|feet|place|spot|direction)",
            text[match.end() :],
        ):
            continue
        word = match["word"]
        number = _NUMBERS.get(word) or (int(word) if word.isdigit() else 0)
        near = match.start() < 25 if text is after else True
        plain = word in ("once", "twice", "thrice") or match["times"] or text is before
        if number <= 20 and near and plain and word != "one":
            return number
    return 0
