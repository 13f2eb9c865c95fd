"""Claims of a prompt: what its words ask for, with usual degrees and the order of acts.

Users write "do a one-eighty" and "kick left, then right". The words are made plainer until they
read as a caption's (`claims.py`); what captions claim stays as it is.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from latentmotion.corrections import Corrections, Count, Turn
from latentmotion.describe.claims import SLIGHT, Claim, claims_of, verb_before

MORE_VERBS = (
    ("jack", (r"(?:jumping|star)[- ]?(?:jacks?|jumps?)",)),
    ("weave", (r"zig-?zag\w*|slalom\w*|weav(?:es?|ing)|serpentine|wavy line|snaking|swerv\w+",)),
    ("speed_up", (r"(?:speed(?:s|ing)? up|accelerat\w+|faster and faster|gets? faster)",)),
    ("slow_down", (r"(?:slow(?:s|ing)? (?:down|to)|slower and slower|gets? slower)",)),
    ("crawl", (r"crawl(?:s|ed|ing)?|on all fours|on hands and knees",)),
    ("stooped", (r"sneak\w*|creep\w*|prowl\w*|hunched(?: over)?|stooped|in a (?:low )?crouch",)),
    (
        "arms_out",
        (r"scarecrow|t[- ]pose|arms out(?:stretched)?|outstretched arms|spread\w* .*arms",),
    ),
    ("hands_on_hips", (r"hands? (?:on|at) (?:the |his |her |their )?hips|akimbo",)),
    (
        "touch_head",
        (
            r"(?:touch|scratch|hold)\w*(?= \w+ (?:head|hair)\b)",
            r"(?:put|plac|rais|bring|reach)\w*(?= .*\b(?:on|to|for) \w+ (?:head|hair)\b)",
            r"(?:left |right )?hand (?:on|to) \w+ head",
        ),
    ),
    (
        "kneel_down",
        (r"(?:get|go|drop|sink|fall|come)\w* (?:down )?(?:on|to|onto) (?:one|both|\w+) knees?",),
    ),
    ("lie_down", (r"sleep(?:s|ing)?|asleep|nap(?:s|ping)?",)),
    (
        "punch",
        (
            # A box after an article or an adjective is a thing.
            r"hooks?|^box|boxing|boxer fights|shadow-?box\w*|spar(?:s|ring)|fight(?:s|ing)?",
            r"(?:person|someone|woman|man|guy|he|she) boxes",
            r"(?:hits?|hitting|strikes?|striking)(?= .*(?:fist|hand|arm|left|right))",
        ),
    ),
    ("wave", (r"greet(?:s|ing)?|say\w* (?:hello|goodbye|hi|bye)",)),
    ("squat", (r"knee[- ]bends?",)),
    ("bow", (r"bend(?:s|ing)? at the (?:waist|hips)",)),
)
"""Kinds of acts that prompts ask for and captions' claims leave out, and words for them."""

_LIMBS = r"((?:(?:the|his|her|their) )?(?:left|right|both) (?:arm|hand|knee)s?)"
_TIMES = r"once|twice|thrice|(?:two|three|four|five|six|\d) times"
_WORDS = (
    (r"[.!]+$", ""),
    (r"\b(?:your|its|my)\b", "their"),
    (r"\bon one (leg|foot)\b", r"on a \1"),
    (r"\ba couple of\b", "two"),
    (r"\b(?:several|a few) (?!step|pace)", "three "),
    (r"\bone time\b", "once"),
    (r"\b(?:just |only |exactly )?(?:one|a single)(?: single)? (?=(?:\w+ ){0,3}(?:kick|punch|jab"
     r"|hook|hit|strike|clap|jump|hop|leap|squat|step|bow|rais|lift|knee|star|wave)\w*)", "1 "),
    (r"\bjump(\w*)(?= (?:\w+ ){0,3}on (?:a|\w+ left|\w+ right) (?:foot|leg)\b)", "hop"),
    (r"\bkick(s|ing|ed)? (left|right)\b(?! \w*(?:leg|foot))", r"kick\1 with the \2 foot"),
    (r"\b(punch|jab|hook|hit|strike)(.*) with the (left|right)(?= |$)(?! \w*(?:hand|arm|fist))",
     r"\1\2 with the \3 hand"),
    (r"\b(left|right) knee (?:raise|lift)s?\b", r"raise the \1 knee"),
    (rf"\b(?:put|bring|throw|pull|stretch|mov)\w* (?:up )?{_LIMBS}", r"raise \1"),
    (rf"(^|then |by |after |and |first ){_LIMBS} (?:up|go(?:es|ing)? up|in the air)",
     r"\1raise \2"),
    (r"^(?:both )?(hands|arms) up", r"raise both \1 up"),
    (rf"\b((?:kick|punch|hit|strik|jab|jump|hop|rais|lift|clap|wav|bow|bend|squat|throw|turn|spin)\w*)"
     rf" ([^,.]*?) ?\b({_TIMES})", r"\1 \3 \2"),
    (r"\b(?:waits?|waiting|without moving(?: forward)?|stands? upright|stands?$)", "stands still"),
    (r"\b(?:has|have|having) a seat\b|\bfrom standing to sitting\b", "sits down"),
    (r"\bfrom sitting to standing\b|\bleaves? the (?:chair|seat)", "stands up"),
    (r"\btouch\w* \w+ toes\b", "touches the floor"),
    (r"\bstraf(?:e|es|ed|ing)\b", "sidestep"),
    (r"\b(?:go|going|went|goes)(?= (?:for|back|ahead|left|right|sideways|straight|to the))",
     "moves"),
    (r"\b(step|mov|jump|leap|hop)(\w*) back\b", r"\1\2 backward"),
    (r"\bspring(?:s|ing)?(?= (?:up|into|forward|back|ahead|to))", "jumps"),
    (r"\bsprint(s|ing|ed)?\b", r"run\1 fast"),
    (r"\b(?:hurr(?:y|ies|ying)|rush(?:es|ing)?|strid\w+ .*quickly)\b", "walks quickly"),
    (r"\b(?:ambl|saunter|plod|stroll)\w*", "walks slowly"),
    (r"\bwithout turning(?: around)?\b", "straight"),
    # What is not to happen is claimed by nothing, and corrected towards nothing.
    (r"\b(?:(?:do|does|is|will|can)(?: not|n't)|never|not|without|no|isn't|won't|can't)\b"
     r"(?:(?! (?:but|just) )[^,.;])*", ""),
)  # fmt: skip
"""Words of users and plainer ones."""

_TURNS = (
    (r"\bforty[- ]five\b", "45"),
    (r"\bninety\b", "90"),
    (r"\b(?:(?:an?|one) hundred and|one)[- ]eighty\b", "180"),
    (r"\bthree[- ](?:hundred and )?sixty\b", "360"),
    (r"\b(45|90|180|270|360|540|720)\b(?! ?(?:°|-? ?deg))", r"\1 degrees"),
    (r"\b(?:do|does|doing|did|a|an|full|half) (?:an? )?(?:full )?(\d+ degrees)", r"turn \1"),
    (r"\bthere and back\b", "forward, turn 180 degrees and move"),
    (r"\b(?:walk|jog|run)(\w*) (?:one |a )(?:lap|round)\b", r"walk\1 in a circle"),
    (r"\b(?:take|takes|taking|took|along) a (?:bend |curve |corner )?(?:to \w+ )?(left|right)\b"
     r"(?! (?:step|side))", r"turn \1"),
    (r"\b(?:veer|bear|drift)(s|ing)?\b", r"turn\1 slightly"),
    (r"\bswivel(?:s|ing|ed)?\b", "turn"),
    (r"(^|then |and |someone |person )(?:face|faces|facing) (left|right)", r"\1turn \2"),
    (r"\bhalf ?way (?:a?round)\b", "180 degrees"),
    (r"\b(?:turn|spin|twirl)\w* a?round and a?round\b", "turn 720 degrees"),
    (r"\b(?:spin|spins|spinning|spun|twirl\w*|pirouett\w*|full spin)\b(?!.* \d+ degrees)",
     "turn 360 degrees"),
    (r"\bkeep(?:s|ing)? turn(?:ing)?\b", "turn 720 degrees"),
    (r"\ball the way a?round\b", "360 degrees"),
    (r"\b(?:turn\w*) a?round (?:just )?once\b", "turn 360 degrees"),
    (r"\bturn(?:s|ed|ing)? (?:and (?=walk|run|jog|com|return|mov)"
     r"|(?:and |to )?(?:fac\w+ )?(?:to |in )?the (?:opposite|other) (?:direction|way)"
     r"|back\b|a?round\b)(?! (?:a|the) corner)", "turn 180 degrees "),
)  # fmt: skip
"""Turns as users tell them, and their degrees."""

_ORDERS = (
    (r"^after (.+?), (.+)$", r"\1, then \2"),
    (r"^before (.+?), (.+)$", r"\2, then \1"),
    (r"^(.+?),? after (?!that|which)(.+)$", r"\2, then \1"),
)
"""Orders that the words tell backward."""

_PLAINER = tuple((re.compile(words), plain) for words, plain in (*_WORDS, *_TURNS, *_ORDERS))
_SAME_VERB = re.compile(
    r"(,? (?:and )?then) ((?:(?:with|on|to|using) )?(?:(?:the|his|her|their) )?"
    r"(?:left|right|forwards?|backwards?)\b[^,.]*)$"
)
"""A second act without a verb of its own: "then with the right leg"."""

_TURNING = re.compile(r"\b(?:turn|rotat|pivot)")
_ON_FOOT = re.compile(r"\b(?:walk|jog|run|jump|hop|march|step|circle around)")
_SPOT = re.compile(r" ?\b(?:on the spot|in place)\b")
_ROUND = re.compile(r"\b(?:in )?(?:a )?(?:full|complete|whole) circle\b")
_TOGETHER = re.compile(r"\bwhile\b|\bas (?:he|she|they)\b")
_DOWN = ("sit", "lie_down", "stand_up", "crawl", "pick_up", "kneel_down", "crouch")
"""Kinds after which "on the floor" is a place."""


_GAITS = ("walk", "jog", "run", "move")


@dataclass(frozen=True)
class Asked:
    """What a prompt asks for."""

    claims: tuple[Claim, ...]
    """The acts, in the order of the prompt."""
    in_turn: bool
    """Whether the acts follow one another; otherwise "while" or the like joins them."""


def asked_of(prompt: str) -> Asked:
    """Reads what a prompt asks for.

    Args:
        prompt: A sentence as users write it.
    """
    text = " ".join(prompt.lower().split())
    for words, plain in _PLAINER:
        text = words.sub(plain, text)
    if not _ON_FOOT.search(text) and (_TURNING.search(text) or _ROUND.search(text)):
        verb = "" if _TURNING.search(text) else "turn "
        text = _SPOT.sub("", _ROUND.sub(f"{verb}360 degrees", text))
    text = _ROUND.sub("in a circle", text)
    if (second := _SAME_VERB.search(text)) and not claims_of(second[2], MORE_VERBS):
        verb = verb_before(text[: second.start()], MORE_VERBS)
        text = f"{text[: second.start()]}{second[1]} {verb} {second[2]}" if verb else text
    claims: list[Claim] = []
    for claim in claims_of(text, MORE_VERBS):
        last = claims[-1] if claims else Claim("")
        if claim.kind == "pick_up" and last.kind in _DOWN:
            claims[-1] = replace(last, kind="floor") if last.kind == "sit" else last
        elif claim.kind == "pick_up" and last.kind in ("bow", "lift"):
            claims[-1] = replace(claim, then=last.then)
        elif claim.kind == last.kind == "circle" or replace(claim, then=last.then) == last:
            continue
        elif last == Claim("move", then=last.then) and claim.kind in _GAITS:
            claims[-1] = replace(claim, then=last.then)
        elif claim != Claim("move", then=claim.then) or last.kind not in _GAITS:
            claims.append(claim)
    return Asked(tuple(claims), not _TOGETHER.search(text))


_COUNTED = frozenset(
    ("jump", "hop", "kick", "knee", "move", "walk", "punch", "raise", "squat", "bow", "jack")
)
"""Kinds of claims whose repetitions a motion can have more or fewer of."""

_CONFUSED = (("jump", "hop", "jack"), ("bow", "pick_up"), ("kick", "knee"), (*_GAITS, "circle"))
"""Kinds that show the same repetitions."""

_VAGUE = re.compile(
    r"\b(?:several|few|some|about|roughly|approximately|nearly|almost|at (?:least|most)|up to"
    r"|(?:more|less|fewer) than|or|people|persons|men|women|children|kids)\b|\d ?(?:-|–|to) ?\d"
)
"""Words by which a count is not exact, or not of repetitions."""


def asked_exactly(prompt: str, any_length: bool) -> Corrections:
    """Returns the numbers that clean-up makes exact in a motion of a prompt.

    They have a turn where the prompt names the degrees of exactly one, and a count where it says
    how often exactly one act is done.

    Args:
        prompt: A sentence as users write it.
        any_length: Whether the motion may become shorter or longer; else there is no count.
    """
    claims = asked_of(prompt).claims
    turns = [claim for claim in claims if claim.kind in ("turn", "circle")]
    turn = None
    if len(turns) == 1 and turns[0].degrees not in (0, SLIGHT):
        turn = Turn(turns[0].degrees * max(turns[0].count, 1), turns[0].side)
    counts = [claim for claim in claims if claim.count and claim not in turns]
    if not any_length or len(counts) != 1 or _VAGUE.search(prompt.lower()):
        return Corrections(turn)
    return Corrections(turn, _count(counts[0], claims, prompt))


def _count(counted: Claim, claims: tuple[Claim, ...], prompt: str) -> Count | None:
    """Returns the count of the one act that is counted; none if others look like it."""
    kind = counted.kind
    alike = next((kinds for kinds in _CONFUSED if kind in kinds), (kind,))
    others = [claim for claim in claims if claim is not counted and claim.kind in alike]
    if kind == "move":  # "walks four steps" claims both
        ways = ("", counted.direction)
        others = [one for one in others if one.kind != "walk" or one.direction not in ways]
        others += [claim for claim in claims if claim.then]
    if kind not in _COUNTED or others:
        return None
    act = "step" if kind in ("move", "walk") else kind
    if kind == "hop" and not counted.side and not re.search(r"\b(?:leg|foot)\b", prompt.lower()):
        act = "jump"
    side = counted.side if act in ("hop", "kick", "knee", "punch", "raise") else ""
    return Count(act, side, counted.count)
