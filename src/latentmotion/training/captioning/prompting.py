"""One measured action, or two → prompts as users type them: short, varied, in every form.

Patterns of `prompts.toml` become third person ("a man turns left"), imperatives ("turn left"),
progressive forms ("someone is turning left"), bare participles, or noun phrases ("a left turn"). In
a pattern `[a|b|]` is one of the alternatives, `~turn` is a verb in the form of the sentence,
`<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or "his". The plainest
patterns come first and are drawn most often.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np

from latentmotion.language.words import inflect, plain
from latentmotion.measure.facts import LEFT, RIGHT, SingleAction
from latentmotion.storage.reading import packaged_toml

# Kinds of actions that go in a direction.
_DIRECTED = ("walk", "jog", "run", "jump", "steps")


@dataclass(frozen=True)
class Subject:
    """The subject of a sentence, and the words that agree with it."""

    name: str  # As the sentence begins; empty in orders and bare participles.
    his: str  # The possessive.
    him: str  # The object.
    he: str  # The pronoun.

    @property
    def plural(self) -> bool:
        """Whether its verb is the plural one, as that of "they"."""
        return self.name == "they"


# Subjects of sentences and forms of prompts.
SUBJECTS = packaged_toml(__file__, "subjects.toml")

_HE, _SHE, _THEY = ("his", "him", "he"), ("her", "her", "she"), ("their", "them", "they")
_PEOPLE = {
    name: {"they": _THEY, "he": _HE, "she": _SHE}[pronoun]
    for pronoun, *names in SUBJECTS["people"]
    for name in names
}
_MASCULINE = frozenset({"man", "businessman", "grandpa", "knight", "butler", "monk"})
_FEMININE = frozenset({"woman", "grandma", "girl"})

_CLOSED = re.compile(r"\[([^\[\]]*)\]")
# Phrases that the grammar allows but nobody types, such as "keeping hopping".
_CLUMSY = re.compile(
    r"\b(?:keep|start|beginn|stopp|finish)ing \w+ing\b|\bbeing\b|then .*then .*then"
    r"|(?:spot|place) while|\b(\w+) \1\b"
)

# Words of a pattern that describes a sequence by itself.
_SEQUENCE = re.compile(r"\b(?:then|before|after|first|from|followed)\b|,")

_VOWEL = re.compile(r"\b([Aa]) (?=[aeio](?!ne\b|ne-))")


def prompts(
    action: SingleAction,
    generator: np.random.Generator,
    count: int,
    refused: frozenset[str] = frozenset(),
) -> list[str]:
    """Writes different prompts that ask for one action.

    Args:
        action: The action.
        generator: Draws wording and style.
        count: How many; fewer where there are fewer ways to say it.
        refused: Prompts that are never returned, as `plain` writes them.
    """
    words = wording(action)
    return _different(lambda: _styled(_single(words, generator), generator), count, refused)


def prompts_in_order(
    first: SingleAction,
    second: SingleAction,
    generator: np.random.Generator,
    count: int,
    refused: frozenset[str] = frozenset(),
) -> list[str]:
    """Writes different prompts that ask for one action and then another.

    Args:
        first: The first action.
        second: The action that follows it.
        generator: Draws wording and style.
        count: How many; fewer where there are fewer ways to say it.
        refused: Prompts that are never returned, as `plain` writes them.
    """
    begin, end = _plainer(wording(first)), _plainer(wording(second))
    contrasts = contrasted(first, second)

    def draw() -> str:
        if contrasts and generator.random() < 0.35:
            return _styled(_single(Wording(contrasts), generator), generator)
        return _styled(_ordered(begin, end, generator), generator)

    return _different(draw, count, refused)


def contrasted(first: SingleAction, second: SingleAction) -> Sequence[str]:
    """Returns patterns that name the act once: "kick with the left leg, then with the right"."""
    if first.kind != second.kind or max(first.count, second.count) > 1:
        return ()
    if first.kind in SUBJECTS["limbs"] and {first.side, second.side} == {LEFT, RIGHT}:
        limb, *texts = SUBJECTS["limbs"][first.kind]
        named = [text.replace("LIMB", limb) for text in texts]
        named += [f"{text.replace('LIMB', limb)} {limb}" for text in texts if "LIMB" in text]
        return [
            text.replace("A", first.side).replace("B", second.side).replace(", then", join)
            for text in named
            for join in (", then", " and then", " then")
        ]
    ways = first.direction, second.direction
    same_pace = first.kind in _DIRECTED and first.pace == second.pace
    if same_pace and "" not in ways and ways[0] != ways[1]:
        verb = "step" if first.kind == "steps" else first.kind
        way, other_way = (
            f"[{w}|to the {w}]" if w in (LEFT, RIGHT) else f"[{w}|{w}s]" for w in ways
        )
        return [f"~{verb} {way}, then {other_way}", f"~{verb} {way} and then {other_way}"]
    return ()


def _plainer(words: Wording) -> Wording:
    """Prefers patterns that do not describe a sequence by themselves, and uses "once" less."""
    clauses = [text for text in words.clauses if not _SEQUENCE.search(text)]
    nouns = [text for text in words.nouns if not _SEQUENCE.search(text)]
    return replace(
        words,
        clauses=[_uncounted(text) for text in clauses or words.clauses],
        nouns=[_uncounted(text) for text in nouns],
    )


def _uncounted(pattern: str) -> str:
    """Makes "once" and "one" rarer, and drops "in a row"."""
    return pattern.replace(ONCE, "[|||||once]").replace(ONE, "[a|a|a|a|one]").replace(IN_A_ROW, "")


def _different(draw: Callable[[], str], count: int, refused: frozenset[str]) -> list[str]:
    """Draws sentences until there are as many different ones, or no more seem to come."""
    drawn: dict[str, str] = {}
    for _ in range(30 * count + 100):
        if len(drawn) >= count:
            break
        sentence = draw()
        if plain(sentence) not in refused and not _CLUMSY.search(sentence):
            drawn.setdefault(plain(sentence), sentence)
    return list(drawn.values())


def _single(words: Wording, generator: np.random.Generator) -> str:
    """One action in a form drawn at random."""
    form = _draw_share(generator, SUBJECTS["forms"])
    if words.orders and generator.random() < 0.06:
        return _pick(words.orders, generator)
    if form == "noun" and words.nouns:
        return _noun(words, generator)
    pattern = _front(words.clauses, generator)
    text = _clause(pattern, form, _subject(words, form, generator), generator)
    if form == "doing" and generator.random() < 0.15:
        return f"{_pick(SUBJECTS['shown'], generator)} {text}"
    if words.places and generator.random() < 0.06:
        text = f"{text} {_pick(words.places, generator)}"
    return text


def _ordered(one: Wording, two: Wording, generator: np.random.Generator) -> str:
    """Two actions, in an order of words drawn at random."""
    style = _draw_share(generator, {"plain": 55, "before": 12, "after": 14, "noun": 12, "dot": 7})
    if style == "noun" and one.nouns and two.nouns:
        begin, end = _noun(one, generator), _noun(two, generator)
        if generator.random() < 0.12:
            return f"first {begin}, then {end}"
        joins = (", then ", ", followed by ", " followed by ", " and then ", " before ")
        return f"{begin}{_pick(joins, generator)}{end}"
    form = _draw_share(generator, {"order": 42, "third": 40, "is": 7, "participle": 9, "past": 2})
    who = _subject(one if generator.random() < 0.5 else two, form, generator)
    follow = two.after if two.after and generator.random() < 0.4 else two.clauses
    first, second = _front(one.clauses, generator), _front(follow, generator)
    unnamed = replace(who, name="")
    if style in ("before", "after"):
        minor, major = (second, first) if style == "before" else (first, second)
        doing = _clause(minor, "participle", unnamed, generator)
        main = _clause(major, form, who, generator)
        leads = generator.random() < (0.4 if style == "before" else 0.6)
        return f"{style} {doing}, {main}" if leads else f"{main} {style} {doing}"
    then = {"is": "participle", "third": "plural" if who.plural else "third"}.get(form, form)
    begin, end = _clause(first, form, who, generator), _clause(second, then, unnamed, generator)
    if style == "dot":
        if form in ("third", "past") and who.name:
            end = _clause(second, form, replace(who, name=who.he), generator)
        return f"{begin}. then {end}"
    if generator.random() < 0.12:
        return f"first {begin}, then {end}"
    joins = (", then ", ", then ", " and then ", " and then ", " and ", " then ", ", and then ")
    return f"{begin}{_pick(joins, generator)}{end}"


def _clause(pattern: str, form: str, who: Subject, generator: np.random.Generator) -> str:
    """Fills a pattern of a verb phrase in a form, with its subject where it has one."""
    verb_form = "participle" if form in ("is", "doing") else form
    if form == "third" and who.plural:
        verb_form = "plural"
    text = _agreed(_expanded(pattern, generator), who, generator)
    text = inflected(text, verb_form)
    lead = who.name
    if form == "is" and who.name:
        lead = f"{who.name} {'are' if who.plural else 'is'}"
    return _tidy(f"{lead} {text}")


def inflected(text: str, form: str) -> str:
    """Returns a text with its verbs, which follow `~` in their base form, in another form."""
    return re.sub(r"~([\w-]+)", lambda match: inflect(match[1], form), text)


def _noun(words: Wording, generator: np.random.Generator) -> str:
    who = Subject("", "the", "them", "they")
    return _tidy(_agreed(_expanded(_front(words.nouns, generator), generator), who, generator))


def _subject(words: Wording, form: str, generator: np.random.Generator) -> Subject:
    """Draws who acts; orders and bare participles have no subject."""
    if form == "order" or (form == "participle" and generator.random() < 0.4):
        return Subject("", "your", "you", "you")
    if form == "participle":
        return Subject("", *_THEY)
    people = _PEOPLE if generator.random() < 0.45 else SUBJECTS["common"]
    if words.people and generator.random() < 0.2:
        people = words.people
    name = _pick(tuple(people), generator)
    while form == "doing" and name in ("he", "she", "they"):
        name = _pick(SUBJECTS["common"], generator)
    terse = generator.random() < 0.08
    if not _MASCULINE.isdisjoint(name.split()):
        pronouns = _HE
    elif not _FEMININE.isdisjoint(name.split()):
        pronouns = _SHE
    else:
        pronouns = _PEOPLE.get(name, _THEY)
        may_be_he = pronouns is _THEY and name not in ("they", "someone", "somebody")
        if may_be_he and generator.random() < 0.3:
            pronouns = _HE
    return Subject(re.sub(r"^(?:a|an|the) ", "", name) if terse else name, *pronouns)


def _agreed(text: str, who: Subject, generator: np.random.Generator) -> str:
    """Fills the words that agree with the subject."""
    themselves = {"his": "himself", "her": "herself", "your": "yourself", "the": "yourself"}
    is_one = "is" if who.he in ("he", "she") else "are"
    text = text.replace("<himself>", themselves.get(who.his, "themselves"))
    text = text.replace("<is>", is_one).replace("<he>", who.he)
    text = text.replace("<him>", who.him).replace("<his>", who.his)
    return text.replace("<the>", who.his if generator.random() < 0.6 else "the")


def _expanded(pattern: str, generator: np.random.Generator) -> str:
    """Draws one of every alternative, the innermost first."""
    while match := _CLOSED.search(pattern):
        chosen = _pick(tuple(match[1].split("|")), generator)
        pattern = pattern[: match.start()] + chosen + pattern[match.end() :]
    return pattern


def _tidy(text: str) -> str:
    text = re.sub(r"\s+([,.])", r"\1", " ".join(text.split()))
    return _VOWEL.sub(r"\1n ", text).strip(" ,")


def _styled(sentence: str, generator: np.random.Generator) -> str:
    """Adds what people do when they type: a capital, a period, no comma."""
    kind = generator.random()
    if kind < 0.16:
        return f"{sentence}."
    if kind < 0.24:
        return f"{sentence[0].upper()}{sentence[1:]}."
    if kind < 0.28:
        return f"{sentence[0].upper()}{sentence[1:]}"
    return sentence.replace(",", "") if kind < 0.33 else sentence


def _front(patterns: Sequence[str], generator: np.random.Generator) -> str:
    """Draws a pattern; the first are drawn about twice as often as the last."""
    return patterns[int(len(patterns) * generator.random() ** 1.5)]


def _pick(choices: Sequence[str], generator: np.random.Generator) -> str:
    return choices[int(generator.integers(len(choices)))]


def _draw_share(generator: np.random.Generator, shares: dict[str, int]) -> str:
    weights = np.array(list(shares.values()), float)
    return list(shares)[int(generator.choice(len(weights), p=weights / weights.sum()))]


_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

GOING = {"walk": "walking", "jog": "jogging", "run": "running"}  # Participles of gaits.

ONCE = "[|||once|once|once|one time|just once]"  # A single repetition, left out half of the time.

ONE = "[a|a|a|one|a single|just one]"  # The article or number of a single thing.

IN_A_ROW = "[|||| in a row]"  # Words that may follow a counted noun.

# Tables of kinds of actions that are named otherwise.
_TABLES = {
    **dict.fromkeys(GOING, "gait"),
    **dict.fromkeys(("start_walking", "start_running"), "start"),
    **dict.fromkeys(("stop_walking", "stop_running"), "stop"),
    **dict.fromkeys(("turn", "walk_then_turn", "turn_then_walk"), "turned"),
}

_COMPARED = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "is": lambda value, names: value in names, "not": lambda value, names: value not in names,
}  # fmt: skip


@dataclass(frozen=True)
class Wording:
    """Patterns for one action."""

    clauses: Sequence[str]  # Verb phrases without a subject.
    nouns: Sequence[str] = ()  # Noun phrases.
    # Verb phrases that fit only after another action, such as "walk away".
    after: Sequence[str] = ()
    people: Sequence[str] = ()  # Subjects that fit this action best.
    places: Sequence[str] = ()  # Harmless contexts to put at the end.
    orders: Sequence[str] = ()  # Whole prompts without a verb to inflect.


_LISTS = tuple(field.name for field in fields(Wording))


def number(count: int) -> str:
    """Returns a number in letters or digits."""
    return f"[{_NUMBERS[count]}|{_NUMBERS[count]}|{count}]" if count < len(_NUMBERS) else str(count)


def times(count: int) -> str:
    """Returns how often: "twice", "three times"; "once" is left out half of the time."""
    if count == 1:
        return ONCE
    if count == 2:
        return "[twice|twice|twice|two times|2 times|twice in a row|a couple of times]"
    vague = "|several times" if count >= 4 else "|a few times"
    vague += "|again and again|repeatedly|over and over" if count >= 5 else ""
    return f"[{number(count)} times|{number(count)} times|{number(count)} times in a row{vague}]"


def some(count: int, one: str, many: str) -> str:
    """Returns a counted noun: "a kick", "one kick", "two kicks", "several kicks"."""
    if count == 1:
        return f"{ONE} {one}"
    vague = "|a couple of" if count == 2 else "|several" if count >= 4 else "|a few"
    return f"[{number(count)}|{number(count)}|{number(count)}{vague}] {many}{IN_A_ROW}"


def clockwise(side: str) -> str:
    """Returns the sense of rotation, seen from above, of a turn to a side."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"


@cache
def _tables() -> Mapping[str, Any]:
    return packaged_toml(__file__, "prompts.toml")


def kinds() -> tuple[str, ...]:
    """Returns all kinds of actions that have words."""
    composed = {"words", "turned_off", "curved", *_TABLES.values()}
    return (*_TABLES, "turn_and_return", *(kind for kind in _tables() if kind not in composed))


def wording(action: SingleAction) -> Wording:
    """Returns the patterns for an action.

    Raises:
        KeyError: Its kind is none of `kinds`.
    """
    if action.kind in ("walk_then_turn", "turn_then_walk"):
        return _walk_and_turn(action)
    if action.kind != "turn":
        return _patterns(_TABLES.get(action.kind, action.kind), action)
    # A turn on the spot, or on the way while walking or running.
    gait, turned = action.gait, _patterns("turned", action)
    if gait and action.degrees > 270:
        return wording(replace(action, kind="circle"))
    if gait:
        on_the_way, going = _patterns("curved", action), GOING[gait]
        clauses = [f"~{gait} and {text}" for text in turned.clauses]
        clauses += [f"{text} while {going}" for text in turned.clauses[:5]]
        nouns = [f"{text} while {going}" for text in turned.nouns]
        return Wording([*clauses, *on_the_way.clauses], nouns, people=on_the_way.people)
    if action.degrees >= 290:  # a spin, in whose words there is no going elsewhere
        return turned
    clauses = [f"{text}[||||| on the spot| in place]" for text in turned.clauses]
    clauses += [f"~stand on the spot and {text}" for text in clauses[:1]]
    return replace(turned, clauses=clauses)


def _walk_and_turn(action: SingleAction) -> Wording:
    """Patterns for a straight way and then a turn, or the other way around."""
    gait = action.gait or "walk"
    turned, turned_off = _patterns("turned", action), _patterns("turned_off", action)
    turns, nouns = [*turned.clauses, *turned_off.clauses], [*turned.nouns, *turned_off.nouns]
    if action.kind == "walk_then_turn":
        way = f"~{gait} [||forward|ahead|straight ahead|a bit|a little]"
        clauses = [f"{way}[, then|, then| and then| and|, and then] {text}" for text in turns]
        named = [f"a {gait} [forward|], then {text}" for text in nouns]
        return Wording(clauses, [*named, *(f"a {gait} followed by {text}" for text in nouns)])
    on = f"~{gait} [||forward|off|away|on|straight on|ahead|straight ahead]"
    clauses = [f"{text}[, then| and then| and| and|, and then] {on}" for text in turns]
    named = [f"{text}, then a {gait} [forward|straight ahead|]" for text in nouns]
    return Wording(clauses, [*named, *(f"{text} followed by a {gait}" for text in nouns)])


def _patterns(table: str, action: SingleAction) -> Wording:
    """Returns the lists of those parts of a table that hold for an action."""
    kind, pace, side, degrees = action.kind, action.pace or "normal", action.side, action.degrees
    go = action.gait or (kind if kind in GOING else "run" if kind.endswith("running") else "walk")
    if kind == "jog" and pace != "normal":  # a fast jog is a run, and a slow one a slow run
        tempo = "run-slow" if pace == "slow" else "run-normal"
    else:
        tempo = f"{go}-{pace}"
    rounds = round(degrees / 360)
    spins = "several times" if rounds > 2 else "more than once"
    if rounds > 1 and abs(degrees / 360 - rounds) < 0.2:
        spins = times(rounds)
    words = {  # what patterns and conditions may name
        "kind": kind, "side": side, "direction": action.direction, "count": action.count,
        "degrees": degrees, "gait": action.gait, "pace": action.pace, "frames": action.frames,
        "act": action.act[1] - action.act[0], "go": go, "going": GOING[go], "tempo": tempo,
        "often": times(action.count), "number": number(action.count), "spins": spins,
        "to": f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]",
        "clock": clockwise(side), **_tables()["words"],
    }  # fmt: skip
    parts = list(filled(_tables()[table], words, _LISTS))
    return Wording(**{name: [text for part in parts for text in part[name]] for name in _LISTS})


def filled(
    parts: Sequence[Mapping[str, Any]], properties: Mapping[str, Any], lists: Sequence[str]
) -> Iterator[dict[str, list[str]]]:
    """Yields the lists of patterns of those parts of a table that hold.

    Args:
        parts: The parts, each with a `when`, lists of patterns, and texts that all parts may name.
        properties: What conditions and patterns may name.
        lists: Names of the lists.
    """
    words = dict(properties)
    for part in parts:
        words |= {name: text for name, text in part.items() if name not in (*lists, "when")}
    for part in parts:
        if _holds(part.get("when", ""), words):
            texts = {name: _filled(" ".join(part.get(name, "").split()), words) for name in lists}
            yield {
                name: [" ".join(pattern.split()) for pattern in text.split(";") if pattern]
                for name, text in texts.items()
            }


def _holds(condition: str, words: Mapping[str, Any]) -> bool:
    """Says whether a condition holds, such as "33 <= degrees < 60 and side is left|right"."""

    def value(word: str) -> Any:
        return words[word] if word in words else float(word)

    for alternative in condition.split(" or "):
        for comparison in filter(None, alternative.split(" and ")):
            terms = comparison.split()
            if terms[1] in ("is", "not"):
                name = str(words[terms[0]] or "none")
                holds = _COMPARED[terms[1]](name, terms[2].split("|"))
            else:
                triples = zip(terms[::2], terms[1::2], terms[2::2], strict=False)
                holds = all(_COMPARED[how](value(a), value(b)) for a, how, b in triples)
            if not holds:
                break
        else:
            return True
    return False


def _filled(text: str, words: Mapping[str, Any]) -> str:
    """Fills in the names in braces, the innermost first."""

    def fill(match: re.Match[str]) -> str:
        how, _, nouns = match[1].partition(" ")
        if nouns:
            counted = some(words["count"], *nouns.split(" / "))
            return counted if how == "some" else counted.removesuffix(IN_A_ROW)
        chosen = words[how]
        if isinstance(chosen, dict):
            by = str(words[chosen["by"]] or "none")
            texts = {word: text for names, text in chosen.items() for word in names.split("|")}
            chosen = texts.get(by, chosen.get("other"))
        return str(chosen)

    while "{" in text:
        text = re.sub(r"\{([^{}]*)\}", fill, text)
    return text
