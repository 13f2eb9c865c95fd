"""How an act is done, from the words around it: side, direction, count, degrees."""

from __future__ import annotations

from collections.abc import Sequence

from latentmotion.language.acts import Mention
from latentmotion.language.claims import BOTH, LEFT, RIGHT, SLIGHT, data, kinds
from latentmotion.language.words import ANGLES, STOPS, Token, is_plural, listed, match

_WITHOUT_LIMB = (*kinds("lasting"), "turn", "circle")
# Largest count that is read.
_MOST = 20

# Characters after a verb in which "two kicks" is its count.
_HEAD = 25

Tokens = Sequence[Token]


def has(tokens: Tokens, pattern: str) -> bool:
    """Whether a pattern matches anywhere."""
    return any(match(pattern, tokens, at) is not None for at in range(len(tokens)))


def near(after: Tokens) -> Tokens:
    """Returns the words up to the end of the clause."""
    for at, token in enumerate(after):
        following = after[at + 1].text if at + 1 < len(after) else ""
        as_they = token.text == "as" and following in ("he", "she", "they")
        if token.text in ",;." or token.text == "while" or as_they:
            return after[:at]
    return after


def kind_by_object(mention: Mention, before: Tokens, verb: Tokens, after: Tokens) -> str:
    """Returns the kind of a claim according to the object of the verb.

    A raised leg is a `knee`, a lifted thing a `lift`, a turned wheel or waist a `twist`.
    """
    kind, words = mention.act.kind, [token.text for token in near(after)]
    if kind == "raise":
        leg = next((at for at, word in enumerate(words) if word in listed("leg")), None)
        hand = next((at for at, word in enumerate(words) if word in listed("hand")), None)
        if leg is not None and (hand is None or leg < hand):
            return "knee"
        up = {token.text for token in (*verb, *after)} & (listed("hand") | {"up", "above"})
        return kind if up or "reach" in verb[0].text else "lift"
    if kind not in ("turn", "circle"):
        return kind
    ahead = {token.text for token in before}
    to_and_fro = has(near(after), "left|right and|to|or the? left|right")
    if to_and_fro or ahead & listed("hand"):
        return "twist"
    if kind == "turn":
        # Whether it has an object that is not the body: "spins a basketball".
        article, beside = words[:1] and words[0] in listed("articles"), set(words[1:4])
        counted = any(token.number for token in near(after)[:3])
        thing = article and beside and not counted and not beside & listed("not_things")
        return "twist" if set(words) & listed("twisted") or thing else kind
    motion = verb[-1].text == "motion" and not ahead & listed("gait_forms")
    by_hand = "opposite" in words or has(near(after), "with * hand|hands")
    return "twist" if ahead & listed("swung") or motion or by_hand else kind


def side_and_direction(kind: str, before: Tokens, verb: Tokens, after: Tokens) -> tuple[str, str]:
    """Returns side and direction of an act."""
    limb = None if kind in _WITHOUT_LIMB else _limb([*verb, *after]) or _limb(before)
    rest = [token for token in after if limb is None or not limb[1] <= token.start < limb[2]]
    if kind in ("turn", "circle") and (turned := _turned_side([*before, *verb, *rest])):
        return turned, ""
    direction = ""
    if kind in (*kinds("way"), "kick", "arm_circle"):
        direction = _direction([*(before if kind == "move" else ()), *verb, *rest])
    words = [token.text for token in after if token.text not in STOPS]
    if kind == "kick" and has(near(after), "back") and not has(near(after), "back leg|foot"):
        direction = "backward"
    if limb and limb[0] in (LEFT, RIGHT):
        return limb[0], direction
    pair = kind in ("raise", "wave") and any(t.text in listed("pair") for t in (*verb, *after))
    if limb or pair:
        return BOTH, direction
    named: list[str] = []
    if kind in ("kick", "punch", "knee"):
        named = [token.text for token in (*before, *verb) if token.text in (LEFT, RIGHT)]
    if kind in ("kick", "punch") and words[:1] in ([LEFT], [RIGHT]):  # "kick left"
        return (named or words)[0], ""
    if kind == "punch" and words[-2:-1] in (["the"], ["with"]) and words[-1] in (LEFT, RIGHT):
        named = named or words[-1:]
    return (named[0] if named else ""), direction


def _limb(tokens: Tokens) -> tuple[str, int, int] | None:
    """Returns the side of the first hand, foot or knee, and its characters in the sentence."""
    for at, token in enumerate(tokens):
        if token.text not in (LEFT, RIGHT, BOTH, "two"):
            continue
        end = at + 1
        while end < len(tokens) and tokens[end].text in ("of", "his", "her", "their", "the"):
            end += 1
        side_kick = has(tokens[end : end + 2], "side kick|kicks")
        if side_kick or (end < len(tokens) and tokens[end].text in listed("limb")):
            return (BOTH if token.text == "two" else token.text), token.start, tokens[end].end
    return None


def _turned_side(tokens: Tokens) -> str:
    """Returns the side of a turn; clockwise, seen from above, is to the right."""
    for at, token in enumerate(tokens):
        text = token.text.removesuffix("wards").removesuffix("ward")
        following = tokens[at + 1].text if at + 1 < len(tokens) else ""
        if text in (LEFT, RIGHT) and following not in ("angle", "angles", "away", "now", "there"):
            return text
        if text in ("counterclockwise", "anticlockwise"):
            return LEFT
        if text == "clockwise" or (text == "clock" and following == "wise"):
            counter = at > 0 and tokens[at - 1].text in ("counter", "anti")
            return LEFT if counter else RIGHT
    return ""


def _direction(tokens: Tokens) -> str:
    """Returns the direction of a movement over the floor, in the body's own frame."""
    words = [token.text for token in tokens]
    back = has(tokens, "~step|~move|~jump|~leap|~hop|~go back") and not has(tokens, "back and")
    away = has(tokens, "back|backs|backing up|away") or any(w.startswith("retreat") for w in words)
    if back or away or set(words) & listed("backward"):
        return "backward"
    if set(words) & listed("sideways") or has(tokens, "side step|steps"):
        return next((word for word in words if word in (LEFT, RIGHT)), "side")
    if set(words) & listed("forward"):
        return "forward"
    if set(words) & listed("viewer"):
        return ""
    for at, word in enumerate(words):
        if word in (LEFT, RIGHT) and set(words[max(at - 3, 0) : at]) & listed("towards"):
            return word
    last = next((word for word in reversed(words) if word not in STOPS), "")
    last = last.removesuffix("wards").removesuffix("ward")
    return last if last in (LEFT, RIGHT) else ""


def degrees_and_side(mention: Mention, tokens: Tokens, implied: bool) -> tuple[float, str]:
    """Returns the degrees of a turn, and its side where a direction by the clock tells it."""
    words = [token.text for token in tokens]
    for at, token in enumerate(tokens):
        following = words[at + 1 : at + 3]
        if following[:1] in (["°"], ["degrees"], ["degree"], ["deg"]) and token.number >= 5:
            return token.number, ""
        if following == ["o", "clock"] and 1 <= token.number <= 12:
            hours = token.number % 12
            side = LEFT if hours > 6 else RIGHT if 0 < hours < 6 else ""
            return 30 * min(hours, 12 - hours), side
    if {"slight", "slightly"} & set(words) or has(tokens, "a little|bit"):
        return SLIGHT, ""
    if implied and mention.act.slight:
        return SLIGHT, ""
    tables = data("acts.toml")
    if has(tokens, "{angle} {stop}"):  # "a 180", "turns 90", not "turns 90 centimeters"
        return next(token.number for token in tokens if token.number in ANGLES), ""
    angles = tables["angles"]
    if implied and mention.act.kind == "turn":
        full = mention.base in tables["full_turns"] or any(
            word.startswith(("revolution", "rotation")) for word in words
        )
        angles = angles | ({"{any}": 360} if full else tables["implied_angles"])
    return next((float(angle) for words, angle in angles.items() if has(tokens, words)), 0.0), ""


def count_of(mention: Mention, before: Tokens, after: Tokens, implied: bool) -> float:
    """Returns the number of repetitions that the words around a verb tell, else zero."""
    for tokens in (near(after), before):
        for at, token in enumerate(tokens):
            rest = [other.text for other in tokens[at + 1 :]]
            if token.number and _counts(mention, token, rest, implied):
                ahead = tokens is before
                times = {token.text, *rest[:1]} & listed("repetition")
                single = token.text in ("one", "single") and not times
                named = any(word.startswith(tuple(listed("counted"))) for word in rest[:3])
                close = token.start - tokens[0].start < _HEAD
                belongs = not any(map(is_plural, rest)) and (implied or not single)
                if times or (belongs if ahead else named and close and not single):
                    return token.number
    doubles = data("words.toml")["adjectives"]
    return next((doubles[token.text] for token in reversed(before) if token.text in doubles), 0.0)


def _counts(mention: Mention, token: Token, rest: list[str], implied: bool) -> bool:
    """Whether a number beside an act may be its count, and not that of something else."""
    vague = token.text in data("words.toml")["vague"]
    steps = mention.act.kind == "move" or (bool(rest) and rest[0].startswith(("step", "pace")))
    other = bool(rest) and rest[0] in listed("not_counted") | listed("units")
    again = token.text == "once" and rest[:1] in (["more"], ["again"])
    before_place = bool(rest) and rest[-1] in listed("preposition") - {"over"}
    angle = token.number in ANGLES and mention.act.kind in ("turn", "circle")
    gait = token.text == "one" and mention.act.kind in ("walk", "run", "jog")
    excluded = other or again or angle or gait or (before_place and rest[:1] != ["times"])
    return not excluded and token.number <= _MOST and not (vague and (steps or not implied))
