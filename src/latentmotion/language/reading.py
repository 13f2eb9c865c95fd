"""Sentence → request: its acts, in order, with side, direction, count, degrees and pace.

Users write "do a one-eighty" and "kick left, then right", captions "a man slowly walks backwards".
Words become tokens, numbers among them (`words.py`); negated clauses are left out;
acts are looked up in `acts.toml` (`acts.py`); the words around each say how it is done
(`manner.py`).

What clean-up must make exact: the degrees of one turn, the count of one act.

Negated clauses: "does not sit down" asks for no sitting, so it is left out.

A clause is negated from its negation (`not`, `never`, `without`, …) to a comma, a "but", or to
an act in another form after "and". That nothing moves is an act of its own: standing still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache
from itertools import pairwise, product

from latentmotion.language.acts import (
    GAITS,
    Mention,
    acts_in,
    clause_before,
    last_boundary,
    verb_forms,
)
from latentmotion.language.claims import (
    SLIGHT,
    Claim,
    Corrections,
    Count,
    Request,
    Turn,
    data,
    kinds,
    limits,
    related,
)
from latentmotion.language.manner import (
    count_of,
    degrees_and_side,
    has,
    kind_by_object,
    near,
    side_and_direction,
)
from latentmotion.language.words import (
    STOPS,
    THEN,
    Token,
    beginnings,
    forms,
    inflect,
    listed,
    match,
    other_forms,
    tokens_of,
    with_words,
    words_of,
)

# Seconds before and after repetitions; share by which they may be shorter or longer.
_ENDS, _SPREAD = 0.6, 0.2

# Words that join a clause to one that is left out.
_LEFT_OVER = ("but", "just", "and", "instead", "then", "or")


def affirmed(sentence: str) -> str:
    """Returns a sentence without its negated clauses; as it is if it has none.

    Text encoders read "does not sit down" as nearly "sits down" (cosine 0.84), so a model is not
    given such a clause. Where nothing is left to do, the person stands, or stays seated who does
    not get up from a chair.
    """
    tokens = tokens_of(sentence)
    remaining = without_negated(tokens)
    if len(remaining) == len(tokens):
        return sentence
    said: list[Token] = []
    for token in remaining:
        idle = is_idle(said) or (said[-1].text in STOPS and token.text in STOPS)
        if not (idle and _joins(token)):  # "a man who does not kneel and bows" → "a man who bows"
            said.append(token)
    while said:  # a clause without a verb at the end, such as "then he", was of a negation
        cut = max((at for at, token in enumerate(said) if _joins(token)), default=-1)
        if not is_idle(said[cut + 1 :]):
            break
        said = said[: max(cut, 0)]
    text, end = "", None
    for token in said:
        between = "" if token.text in STOPS or not text else " "
        if end is not None and not any(end <= other.start < token.start for other in tokens):
            between = sentence[end : token.start]
        text, end = text + between + sentence[token.start : token.end], token.end
    words = {token.text for token in tokens}
    seated = words & {*listed("leaving")} and words & {*listed("seat")}
    return text or ("a person stays seated" if seated else "a person stands")


def _joins(token: Token) -> bool:
    """Whether a word or mark joins clauses."""
    return token.text in _LEFT_OVER or token.text in STOPS


def is_idle(clause: Sequence[Token]) -> bool:
    """Whether a clause has a subject at most."""
    subject = listed("person") | listed("determiner") | listed("their") | listed("boundary")
    return all(token.text in subject | {"or", *STOPS} for token in clause)


def without_negated(tokens: Sequence[Token]) -> list[Token]:
    """Leaves out the negated clauses of a sentence."""
    remaining: list[Token] = []
    at = 0
    while at < len(tokens):
        if not _negates(tokens, at):
            remaining.append(tokens[at])
            at += 1
            continue
        while remaining and remaining[-1].text in listed("modal") | {"or", "to", "with"}:
            remaining.pop()
        at = _end(tokens, at)
    return remaining


def _negates(tokens: Sequence[Token], at: int) -> bool:
    """Whether a token begins a negation."""
    text, following, after = ([token.text for token in tokens[at : at + 3]] + [""] * 2)[:3]
    if text not in listed("negation"):
        things = listed("determiner") | {"something", "someone", "somebody", "him", "her", "it"}
        dodges = text.startswith("avoid") and following in things  # "avoids a snowball"
        refuses = text in listed("refusal") and not dodges
        return refuses or (text in ("instead", "rather") and following in ("of", "than"))
    if text == "no" and following in ("", *_LEFT_OVER, *STOPS):
        return False  # an answer: "shakes the head no and crosses the arms"
    still = following in ("moving", "move", "movement")
    still &= after in ("", "forward", "at", "anymore") or after in STOPS
    goes_on = following in ("stop", "help") and after.endswith("ing")  # "can't stop laughing"
    return not (still or goes_on) and following not in ("only", "longer")


def _end(tokens: Sequence[Token], start: int) -> int:
    """Returns where the clause of a negation ends."""
    first = ""
    for at in range(start + 1, len(tokens)):
        text = tokens[at].text
        if text in STOPS or text in listed("affirmed"):
            return at
        first = first or verb_forms().get(text, "")
        following = verb_forms().get(tokens[at + 1].text) if at + 1 < len(tokens) else ""
        if text == "and" and first != "third" and following == "third":
            return at  # "does not sit and waves"
    return len(tokens)


Tokens = Sequence[Token]
Told = tuple[Claim, Mention]  # A claim, and the words that make it.


@lru_cache(maxsize=1024)  # a prompt is read again for each of its takes
def request_of(prompt: str) -> Request:
    """Reads what a prompt asks for.

    Args:
        prompt: A sentence as users write it.
    """
    tokens = _plainer(without_negated(tokens_of(told_in_order(prompt))))
    claims: list[Claim] = []
    for claim, _ in _claims(tokens, implied=True):
        last = claims[-1] if claims else Claim("")
        if claim.kind == "pick_up" and last.kind in kinds("low"):
            claims[-1] = replace(last, kind="floor") if last.kind == "sit" else last
        elif claim.kind == "pick_up" and last.kind in ("bow", "lift"):
            claims[-1] = replace(claim, then=last.then)
        elif claim.kind == "stand_up" and claim.count and last.kind == "squat" and not last.count:
            claims[-1] = replace(last, count=claim.count)  # "squat down and stand up twice"
            claims.append(replace(claim, count=0))
        elif claim.kind == last.kind == "circle" or replace(claim, then=last.then) == last:
            continue
        elif last == Claim("move", then=last.then) and claim.kind in GAITS:
            claims[-1] = replace(claim, then=last.then)
        elif claim != Claim("move", then=claim.then) or last.kind not in GAITS:
            claims.append(claim)
    at_a_time = has(tokens, "while") or has(tokens, "as he|she|they")
    return Request(tuple(claims), not at_a_time)


def claims_of(caption: str) -> tuple[Claim, ...]:
    """Reads what a caption claims: only what is checked, nothing that its words merely imply.

    A circle or `in place` that follows a gait belongs to the gait, which keeps its own claim.

    Args:
        caption: A sentence about a motion.
    """
    pairs = _claims(without_negated(tokens_of(caption)), implied=False)
    return tuple(
        replace(claim, kind=mention.act.caption) if claim.kind == mention.act.kind else claim
        for claim, mention in pairs
        if mention.act.caption
    )


@cache
def _plain() -> dict[str, list[tuple[str, str]]]:
    """Returns phrases and plainer ones, by the words that each may begin with."""
    table: dict[str, list[tuple[str, str]]] = {}
    for pattern, plain in data("words.toml")["plain"].items():
        for word in beginnings(pattern):
            table.setdefault(word, []).append((pattern, plain))
    return table


def _plainer(tokens: list[Token]) -> list[Token]:
    """Exchanges phrases for plainer ones, in the order of the table."""
    plainer: list[Token] = []
    at = 0
    while at < len(tokens):
        rows = _plain().get(tokens[at].text, ())
        fitting = ((match(pattern, tokens, at), plain) for pattern, plain in rows)
        end, plain = next(((end, plain) for end, plain in fitting if end is not None), (at, ""))
        place = tokens[at].start
        plainer += [replace(token, start=place, end=place) for token in tokens_of(plain)]
        if end == at:
            plainer.append(tokens[at])
        at = max(end, at + 1)
    return plainer


def told_in_order(sentence: str) -> str:
    """Returns a sentence that tells its acts in the order of time, each with a verb of its own.

    "Before sitting down he waves" becomes "he waves, then sits down", and "kick with the left leg,
    then with the right" becomes "…, then kick with the right leg": captions are told so.
    """
    sentence = _in_order(sentence)
    tokens = tokens_of(sentence)
    each = next((n for n in range(len(tokens)) if match("each {limb}", tokens, n)), None)
    if each is not None and tokens[each - 1].text != "in":
        named = acts_in(tokens)
        if len(named) == 1 and named[0].start < each:  # the limb of one side after the other's
            limb = sentence[tokens[each].end :].rstrip(" .")
            sentence = f"{sentence[: tokens[each].start]}the left{limb}, then the right{limb}"
    return _completed(sentence)


def _in_order(sentence: str) -> str:
    """Brings acts that are told backward into their order."""
    tokens = tokens_of(sentence)
    words = [token.text for token in tokens]
    at = next((n for n, word in enumerate(words) if word in ("after", "before")), None)
    if at is None or words[at + 1 : at + 2] in ([], ["that"], ["which"], ["another"]):
        return sentence
    if words[at - 1 : at] == words[at + 1 : at + 2]:  # "wave after wave"
        return sentence
    ends = [n for n, word in enumerate(words) if word in STOPS or word == "then"]
    begin = max((n + 1 for n in ends if n < at), default=0)
    end = min((n for n in ends if n > at), default=len(words))
    if at > begin:
        other, last = tokens[begin:at], end
    else:  # "before sitting down, he waves", with or without a comma
        verb = next((act.end for act in acts_in(tokens) if act.start > at), at + 2)
        subject = next((n for n in range(verb, end) if words[n] in listed("person")), end)
        end = subject - (subject < end and words[subject - 1] in listed("articles"))
        start = end + (words[end : end + 1] == [","])
        last = min((n for n in ends if n > start), default=len(words))
        other = tokens[start:last]
    beside = tokens[at + 1 : end]
    acts = acts_in(beside) or (beside and beside[0].text.endswith("ing"))
    if not acts or not other or other[-1].text == "and":  # "before the king"
        return sentence
    first, second = _text(sentence, other), _text(sentence, beside)
    word, _, rest = second.partition(" ")  # "sitting down" becomes "sits down"
    bases = [base for base in sorted(other_forms(word)) if verb_forms().get(base) == "base"]
    base = next((base for base in bases if forms(base).get(word) == "participle"), None)
    second = f"{inflect(base, 'third')} {rest}".rstrip() if base else second
    if words[at] == "after":
        first, second = second, first
    return (
        f"{sentence[: tokens[begin].start]}{first}, then {second}{sentence[tokens[last - 1].end :]}"
    )


def _text(sentence: str, tokens: Sequence[Token]) -> str:
    return sentence[tokens[0].start : tokens[-1].end]


def _completed(sentence: str) -> str:
    """Says in full what leaves out what it shares with the movement before it.

    "Turns to the left, then to the right" becomes "turns to the left, then turns to the right".
    """
    parts = THEN.split(sentence)
    full = parts[:1]
    ways = listed("forward") | listed("backward") | listed("sideways")
    alike = (listed("side"), ways, listed("slow") | listed("fast"))
    for part in parts[1:]:
        words, before = {*words_of(part)}, {*words_of(full[-1])}
        shared = before | listed("preposition") | listed("towards") | listed("their") | {"one"}
        for said, other in ((words & kind, before & kind) for kind in alike):
            if len(said) == len(other) == 1 and said != other and words <= shared | said:
                others = dict(zip(other, said, strict=True))
                part = with_words(full[-1].removeprefix("first "), others)
                tokens = tokens_of(part)
                verb = next((n for n, token in enumerate(tokens) if token.text in verb_forms()), 0)
                if verb and tokens[verb - 1].text in listed("person"):
                    part = part[tokens[verb].start :]
                break
        full.append(part)
    return ", then ".join(full) if full != parts else sentence


def _claims(tokens: list[Token], implied: bool) -> list[Told]:
    """Returns the claims of a sentence with the words that make them.

    Args:
        tokens: The sentence.
        implied: Whether to read what words merely imply: that a spin is a full turn.
    """
    named, claims = acts_in(tokens), list[Told]()
    acts = [mention for mention in named if mention.act.kind != "place"]
    for index, mention in enumerate(acts):
        begin = acts[index - 1].end if index else 0
        end = acts[index + 1].start if index + 1 < len(acts) else len(tokens)
        gap, after = tokens[begin : mention.start], tokens[mention.end : end]
        # Words right before a verb belong to it, not to the verb before, e.g. "slowly" or "two".
        if end < len(tokens) and (cut := last_boundary(after)) >= 0:
            after = after[:cut]
        verb = tokens[mention.start : mention.end]
        claim = _claim(mention, clause_before(gap), verb, after, implied)
        if any(place.act.kind == "place" and mention.end <= place.start < end for place in named):
            claim = replace(claim, direction="place") if claim.kind in kinds("way") else claim
        follows = any(token.text in listed("then") or token.text in ".;" for token in gap)
        if not (claim.kind == "circle" and claims and claims[-1][0].kind == "arm_circle"):
            claims.append((replace(claim, then=index > 0 and follows), mention))
    on_the_spot = not any(claim.kind in kinds("way") for claim, _ in claims)
    full = on_the_spot and has(tokens, "full|complete|whole circle")
    return _joined_turns(claims, full) if implied else claims


def _claim(mention: Mention, before: Tokens, verb: Tokens, after: Tokens, implied: bool) -> Claim:
    """Reads the claim of an act from the words before and after it."""
    act, phrase = mention.act, [*before, *verb, *near(after)]
    kind = kind_by_object(mention, before, verb, after)
    side, direction = side_and_direction(act.kind if implied else act.caption, before, verb, after)
    degrees, clock = 0.0, ""
    if kind in ("turn", "circle"):
        degrees, clock = degrees_and_side(mention, phrase, implied)
    words = {token.text for token in phrase}
    fast = words & listed("fast") or has(phrase, "at speed")
    pace = "slow" if words & listed("slow") else "fast" if fast else act.pace
    count = 0 if kind in ("twist", "lift") else count_of(mention, before, after, implied)
    if count % 1:  # one and a half turns
        degrees, count = degrees * count, 0
    return Claim(kind, clock or side, direction, int(count), degrees, pace)


def _joined_turns(claims: list[Told], full: bool) -> list[Told]:
    """Joins "turns left" and "to face the other way", which are one turn.

    Args:
        claims: In the order of the sentence.
        full: Whether circles are full ones on the spot, and so turns; on foot they are ways to go.
    """
    joined: list[Told] = []
    for claim, mention in claims:
        last = joined[-1][0] if joined else Claim("")
        circles = full and claim.kind == "circle"
        faces = claim.kind == last.kind == "turn" and not mention.base and claim.degrees
        agrees = not claim.side or last.side in ("", claim.side)
        if circles and last.kind == "turn":
            turn = replace(last, degrees=360.0, side=last.side or claim.side)
            joined[-1] = (turn, joined[-1][1])
        elif circles:
            joined.append((replace(claim, kind="turn", degrees=360.0), mention))
        elif faces and agrees and not claim.then and not last.degrees:
            turn = replace(last, degrees=claim.degrees, side=last.side or claim.side)
            joined[-1] = (turn, joined[-1][1])
        else:
            joined.append((claim, mention))
    return joined


def asked_exactly(prompt: str, any_length: bool) -> Corrections:
    """Returns the numbers that clean-up makes exact in a motion of a prompt.

    They have a turn where the prompt names the degrees of exactly one, and a count where it says
    how often exactly one act is done.

    Args:
        prompt: A sentence as users write it.
        any_length: Whether the motion may become shorter or longer; else there is no count.
    """
    claims = request_of(prompt).claims
    turns = [claim for claim in claims if claim.kind in ("turn", "circle")]
    turn = None
    if len(turns) == 1 and turns[0].degrees not in (0, SLIGHT):
        turn = Turn(turns[0].degrees * max(turns[0].count, 1), turns[0].side)
    counts = [claim for claim in claims if claim.count and claim not in turns]
    if not any_length or len(counts) != 1:
        return Corrections(turn)
    # "About three" and "2-3" are not exact, "two people" are no repetitions.
    words = [token.text for token in tokens_of(prompt)]
    bounds = {tuple(bound.split()) for bound in listed("bounds")}
    vague = set(words) & listed("vague") or set(pairwise(words)) & bounds or "-" in words
    return Corrections(turn, None if vague else _count(counts[0], claims, prompt))


def stays_on_floor(prompt: str) -> bool:
    """Whether a prompt names acts, and nothing above the floor that one could stand on or hold."""
    claims = request_of(prompt).claims
    carried = {token.text for token in tokens_of(prompt)} & listed("carriers")
    return bool(claims) and not carried and all(claim.kind != "climb" for claim in claims)


def usual_range(prompt: str) -> tuple[float, float] | None:
    """Returns how many seconds a motion of a prompt lasts at least and at most.

    None where it names several acts, a count, or nothing of the table.
    """
    claims, tokens = request_of(prompt).claims, tokens_of(prompt)
    if len(claims) > 1 or any(claim.count or claim.degrees for claim in claims):
        return None
    for row in data("acts.toml")["seconds"]:
        named = any(claim.kind in row.get("kinds", ()) for claim in claims)
        places = product(row.get("phrases", ()), range(len(tokens))) if not claims else ()
        if named or any(match(phrase, tokens, at) for phrase, at in places):
            least, most = row["range"]
            return least, most
    return None


def counted_range(prompt: str) -> tuple[float, float] | None:
    """Returns how many seconds the repetitions last at least and at most that a prompt asks for.

    None where it names several acts, or one whose usual length is right for each count.
    """
    claims = request_of(prompt).claims
    each = limits("seconds").get(claims[0].kind, 0.0) if len(claims) == 1 else 0.0
    seconds = each * claims[0].count if each else 0.0
    return (_ENDS + (1 - _SPREAD) * seconds, _ENDS + (1 + _SPREAD) * seconds) if seconds else None


def _count(counted: Claim, claims: tuple[Claim, ...], prompt: str) -> Count | None:
    """Returns the count of the one act that is counted; none if others look like it."""
    kind = counted.kind
    alike = related("looks_like").get(kind, (kind,))
    others = [claim for claim in claims if claim is not counted and claim.kind in alike]
    if kind == "move":  # "walks four steps" claims both
        directions = ("", counted.direction)
        others = [
            other for other in others if other.kind != "walk" or other.direction not in directions
        ]
        others += [claim for claim in claims if claim.then or claim.kind in kinds("whole_body")]
    if kind not in kinds("exact") or others:
        return None
    act = "step" if kind in ("move", "walk") else kind
    on_one_leg = {token.text for token in tokens_of(prompt)} & {"leg", "foot"}
    if kind == "hop" and not counted.side and not on_one_leg:
        act = "jump"
    side = counted.side if act in ("hop", "kick", "knee", "punch", "raise") else ""
    return Count(act, side, counted.count)
