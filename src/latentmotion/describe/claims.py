"""What a sentence claims about a motion: actions with side, direction, count, degrees and pace.

Only what the describer can measure is read. "A man slowly walks backwards, then kicks twice with
his left leg." claims `walk` backward, slow, then `kick` left, two. Words about the viewer's view
("walks to the right of the screen") are read as the body's own side and judged leniently.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from latentmotion.describe.facts import BOTH, LEFT, RIGHT


@dataclass(frozen=True)
class Claim:
    """One action that a sentence tells of."""

    kind: str
    """As `Event.kind`, or `move` (any gait), `circle`, `stop`, `place` (on the spot)."""
    side: str = ""
    """Hand, foot or knee, or way of a turn."""
    direction: str = ""
    """Where to: `forward`, `backward`, `left`, `right`, `side` (either), `up`, `place`."""
    count: int = 0
    """How often; zero where it is not told."""
    degrees: float = 0.0
    """How far a turn goes; zero where it is not told."""
    pace: str = ""
    """`slow` or `fast`; empty where it is not told."""
    then: bool = False
    """Whether it comes after the claim before it."""


_VERBS: tuple[tuple[str, str], ...] = (
    (
        "",
        r"jumping[- ]jacks?|jump ?(?:shot|rop)\w*|sit[- ]?ups?|push[- ]?ups?|run\w* (?:his|her|their|its|both|one|the) (?:\w+ )?(?:hand|finger|arm)s?|short|walkman|foot ?step\w*",
    ),
    ("place", r"(?:in|on) (?:place|the spot|one place|the same (?:place|spot))"),
    (
        "circle",
        r"(?:half|semi|full|quarter|three[- ]quarter)?[- ]?(?:of a |an? )?(?<!arm )(?<!hand )(?:semi-?)?circ(?:les?\b(?! (?:his|her|their|the|both|its))|ular (?:path|pattern|motion|route))|circling|u[- ]shape\w*",
    ),
    ("jog", r"jog(?:s|ged|ging)?|trot(?:s|ting)?"),
    ("run", r"run(?:s|ning)?|ran|sprint(?:s|ed|ing)?|dash(?:es|ing)?"),
    (
        "walk",
        r"walk(?:s|ed|ing|es)?|stroll(?:s|ed|ing)?|saunter\w*|march(?:es|ed|ing)?|strid(?:es?|ing)|strut\w*|(?:tip)?toes? (?=forward)|tip-?toe(?:s|ing)?|sneak(?:s|ing)?|creep(?:s|ing)?|wander(?:s|ed|ing)?|trudg\w+|limp(?:s|ing)?|stagger(?:s|ing)?|stumbl\w+",
    ),
    (
        "stand_up",
        r"(?:stand|stood|stands|standing|get|gets|getting|got|rise|rises|rising)(?: back)? up(?: again)?(?! ?right)|rises? to (?:his|her|their) feet",
    ),
    ("lie_down", r"lie|lies|lying|lays?|laying"),
    ("sit", r"sit|sits|sat|sitting|takes? a seat|seated|seating"),
    ("kneel_down", r"kneel(?:s|ed|ing)?|knelt"),
    (
        "squat",
        r"squat(?:s|ted|ting)?|bends? (?:(?:his|her|their|both|the) )?knees|bend(?:s|ing) (?:his|her|their|both|the)? ?knees",
    ),
    ("crouch", r"crouch(?:es|ed|ing)?|duck(?:s|ing)?(?= down)"),
    (
        "pick_up",
        r"pick(?:s|ed|ing)?(?: \w+){0,4}? up|picks? up|(?:from|off|on|onto|to|touch\w*) (?:of )?the (?:floor|ground)",
    ),
    ("bow", r"bow(?:s|ed|ing)?|(?:bend|lean)(?:s|ing)? (?:over|down|forwards?)|bent over"),
    ("hop", r"hop(?:s|ped|ping)?"),
    ("jump", r"jump(?:s|ed|ing)?|leap(?:s|ed|ing|t)?"),
    ("kick", r"kick(?:s|ed|ing)?"),
    ("punch", r"punch(?:es|ed|ing)?|jab(?:s|bed|bing)?|uppercuts?"),
    ("clap", r"clap(?:s|ped|ping)?|applau\w+"),
    ("wave", r"wav(?:e|es|ed|ing)"),
    (
        "arm_circle",
        r"(?:rotat|circl|swing|windmill|spin)\w* (?:both |(?:his|her|their|the) )?(?:\w+ )?(?:straight )?arms?(?= .{0,25}circ)|arm circles?|circles? (?:both |his |her |their |the )?(?:\w+ )?arms?|rotat\w+ (?:both |(?:his|her|their|the) )?(?:\w+ )?arms?",
    ),
    (
        "balance",
        r"balanc(?:e|es|ing)(?= on)|stand(?:s|ing)? on (?:one|(?:his|her|their|the) (?:left|right)) (?:leg|foot)",
    ),
    (
        "turn",
        r"turn(?:s|ed|ing)?|rotat(?:e|es|ed|ing)|pivot(?:s|ed|ing)?|spin(?:s|ning)?|spun|twirl(?:s|ed|ing)?|swivel\w*|about[- ]face|u[- ]?turns?|veer(?:s|ed|ing)?|curv(?:e|es|ed|ing)",
    ),
    (
        "raise",
        r"rais(?:e|es|ed|ing)|lift(?:s|ed|ing)?|put(?:s|ting)?(?= (?:\w+ ){0,3}(?:hands?|arms?) up)|reach(?:es|ed|ing)?(?= (?:up|high|above|over))|hold(?:s|ing)?(?= (?:\w+ ){0,3}(?:hands?|arms?) (?:up|high|above|over))",
    ),
    ("stop", r"stop(?:s|ped|ping)?|halt(?:s|ed|ing)?|comes? to a (?:stop|halt|standstill)|pauses?"),
    (
        "stand",
        r"(?:stand|stands|standing|stay|stays|remain|remains)(?: \w+ly)? (?:still|motionless|in place)|(?:does|do)(?: not|n't) move|motionless|hardly moves?|stands? there|idle\w*|idling",
    ),
    (
        "move",
        r"step(?:s|ped|ping)?|mov(?:e|es|ed|ing)|side-?steps?|shuffl\w+|advanc\w+|retreat\w*|back(?:s|ed|ing)(?= (?:up|away))|goes|paces|pacing",
    ),
)

_PATTERN = re.compile(
    "|".join(rf"(?P<v{n}>\b(?:{pattern})\b)" for n, (_, pattern) in enumerate(_VERBS))
)
_NUMBERS = {
    **{"once": 1, "one": 1, "single": 1, "twice": 2, "two": 2, "three": 3, "thrice": 3},
    **{"four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9, "ten": 10},
}
_COUNT = re.compile(
    rf"\b(?P<word>{'|'.join(_NUMBERS)}|\d{{1,2}})\b(?P<times> times| (?:\w+ ){{0,2}}(?:kick|punch|jab"
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
"""Degrees of a turn that is called slight."""

_GAITS = ("walk", "jog", "run", "move", "turn", "circle", "stop", "stand")
_LEG = ("leg", "foot", "feet", "knee")
_FORWARD = re.compile(r"\b(?:for?wards?|ahead|straight|front)\b")
_BACKWARD = re.compile(r"\bback ?wards?\b|\bin reverse\b|\bbacks? (?:up|away)\b|\bretreat")
_SIDEWAYS = re.compile(r"\bsideways?\b|\blaterally\b|\bside-?steps?\b")
_SIDE = re.compile(r"\b(left|right|(?:counter|anti)[- ]?clock-?wise|clock-?wise)(?:wards?)?\b")
_SLOW = re.compile(r"\bslow(?:ly)?\b|\bgingerly\b|\bleisurely\b|\bcautiously\b|\bcarefully\b")
_FAST = re.compile(r"\b(?:quick|brisk|rapid|hurried)(?:ly)?\b|\bfast(?:er)?\b|\bat speed\b")
_DEGREES = re.compile(r"(\d{2,3})(?: ?°| ?-?deg)")
_THEN = re.compile(
    r"\b(?:then|before|after(?:wards| that| which)|next|finally|followed by)\b|;|\. "
)
_DEGREE_WORDS = (
    (
        re.compile(
            r"\bhalf[- ](?:turn|circle)|\bsemi-?circ|\bu[- ]?turn|\babout[- ]face|\b180|half of a circle|half a circle"
        ),
        180.0,
    ),
    (re.compile(r"\bquarter[- ](?:turn|circle)"), 90.0),
    (re.compile(r"\bfull[- ](?:turn|circle|rotation)|\bcomplete (?:turn|circle)|\b360"), 360.0),
)
_CLOCK = {"clock": RIGHT, "count": LEFT, "anti-": LEFT, "anti ": LEFT, "antic": LEFT}


def claims_of(sentence: str) -> tuple[Claim, ...]:
    """Reads the claims of a sentence, in the order told."""
    text = " ".join(sentence.lower().split())
    found = [m for m in _PATTERN.finditer(text) if _kind(m)]
    claims: list[Claim] = []
    for number, match in enumerate(found):
        begin = found[number - 1].end() if number else 0
        until = found[number + 1].start() if number + 1 < len(found) else len(text)
        gap = text[begin : match.start()]
        claim = _claim(_kind(match), _own_start(gap), match.group(), text[match.end() : until])
        then = bool(claims) and bool(_THEN.search(gap))
        claims.append(replace(claim, then=then))
    return tuple(_joined(claims))


def _kind(match: re.Match[str]) -> str:
    name = match.lastgroup or "v0"
    return _VERBS[int(name[1:])][0]


def _own_start(gap: str) -> str:
    """Returns what stands right before a verb and belongs to it, e.g. "slowly" or "two"."""
    return re.split(r",|\band\b|\bthen\b|\bwhile\b|\bbefore\b|\bperson\b|\bman\b|;|\. ", gap)[-1]


def _claim(kind: str, before: str, verb: str, after: str) -> Claim:
    near = re.split(r",|;|\. |\bwhile\b|\bas (?:he|she|they)\b", after)[0]
    whole = f"{before} {verb} {near}"
    limb = None if kind in _GAITS else _LIMB.search(after) or _LIMB.search(before)
    side, direction = _sides(kind, before, verb, after, limb)
    if kind == "raise" and (
        limb and limb[2] in _LEG or not limb and re.search(r"\b(?:legs?|knees?|foot|feet)\b", after)
    ):
        kind = "knee"
    if kind == "raise" and not re.search(
        r"\b(?:hand|arm|fist|elbow|wrist)s?\b|\bup\b|\babove\b", after
    ):
        kind = "lift"
    if kind in ("turn", "circle") and re.search(r"\barms?\b|\bhands?\b", before):
        kind = "twist"
    if kind == "turn" and re.search(
        r"\b(?:head|torso|waist|hips?|upper body|wrist|hands?|arms?|cap|bottle|wheel)\b", after
    ):
        kind = "twist"
    return Claim(
        kind,
        side=side,
        direction=direction,
        count=_count(kind, before, verb, after),
        degrees=_degrees(whole) if kind in ("turn", "circle") else 0.0,
        pace="slow" if _SLOW.search(whole) else "fast" if _FAST.search(whole) else "",
    )


def _sides(
    kind: str, before: str, verb: str, after: str, limb: re.Match[str] | None
) -> tuple[str, str]:
    """Returns side and direction."""
    rest = after if limb is None else after.replace(limb.group(), " ")
    direction = ""
    if kind in ("turn", "circle", "arm_circle") and (way := _SIDE.search(f"{before} {rest}")):
        if kind != "arm_circle":
            return _CLOCK.get(way[1][:5], way[1]), ""
    if kind in ("walk", "jog", "run", "move", "jump", "hop", "kick", "arm_circle"):
        whole = f"{before if kind == 'move' else ''} {verb} {rest}"
        direction = _direction(whole)
    if limb and limb[1] in (LEFT, RIGHT):
        return limb[1], direction
    if limb or (kind in ("raise", "wave") and _BOTH_LIMBS.search(after)):
        return BOTH, direction
    if kind in ("kick", "punch") and (way := re.search(r"\b(left|right)\b", before)):
        return way[1], direction
    return "", direction


def _direction(text: str) -> str:
    if _BACKWARD.search(text):
        return "backward"
    if _SIDEWAYS.search(text):
        way = re.search(r"\b(left|right)\b", text)
        return way[1] if way else "side"
    if _FORWARD.search(text):
        return "forward"
    way = re.search(
        r"\b(?:to|towards?|in)(?: \w+){0,2} (left|right)\b|\b(left|right)(?:wards?)?$",
        text.strip(" .,"),
    )
    return (way[1] or way[2]) if way else ""


def _count(kind: str, before: str, verb: str, after: str) -> int:
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


def _degrees(text: str) -> float:
    if match := _DEGREES.search(text):
        return float(match[1])
    if re.search(r"\bslight(?:ly)?\b|\ba (?:little|bit)\b", text):
        return SLIGHT
    return next((amount for pattern, amount in _DEGREE_WORDS if pattern.search(text)), 0.0)


def _joined(claims: list[Claim]) -> Iterator[Claim]:
    """A circle or `in place` that follows a gait is the gait's; the gait keeps its own claim."""
    last: Claim | None = None
    for claim in claims:
        if claim.kind == "place":
            if last is not None and last.kind in ("walk", "jog", "run", "jump", "hop", "move"):
                last = replace(last, direction="place")
            continue
        if last is not None:
            yield last
        last = claim
    if last is not None:
        yield last
