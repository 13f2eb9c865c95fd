"""The acts that sentences name, from `acts.toml`, and where a sentence names them.

Which of the words that look like acts are acts of the person.

"Box" or "turn" is an act where the sentence uses it as its verb, or as a noun that somebody does
("throws a punch", "two jumps"). It is none as a thing ("picks up a box"), as a part of a name ("a
kick drum"), done to the person ("gets punched"), or as a posture ("drinks standing up").
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from latentmotion.language.claims import data, kinds
from latentmotion.language.words import (
    STOPS,
    Token,
    beginnings,
    forms,
    inflect,
    is_plural,
    listed,
    match,
    tokens_of,
    uncounted,
)

GAITS = (*kinds("gait"), "move")  # Kinds of going on foot.


@dataclass(frozen=True)
class ActWords:
    """An entry of the table."""

    kind: str  # Kind of the claim; empty where the words ask for nothing.
    caption: str  # Kind of the claim of a caption; empty where its check measures nothing of it.
    words: tuple[str, ...] = ()  # Verbs in their base form.
    nouns: tuple[str, ...] = ()  # Base forms of those that name the act as nouns, too.
    things: tuple[str, ...] = ()  # Base forms of nouns that mostly name something else.
    phrases: tuple[str, ...] = ()  # Patterns of several words.
    unless: tuple[str, ...] = ()  # Patterns that must not follow.
    passive: bool = False  # Whether somebody else may do it to the person.
    begins: bool = False  # Whether its phrases stand at the beginning of a clause.
    slight: bool = False  # Whether the words imply a slight turn.
    pace: str = ""  # Pace that the words imply.


@dataclass(frozen=True)
class Mention:
    """A place where a sentence names an act."""

    act: ActWords  # The act.
    start: int  # First token.
    end: int  # One past the last token.
    form: str = ""  # Form of the verb, as `inflection.forms` names it; `noun`; empty for a phrase.
    base: str = ""  # Base form of the verb; empty for a phrase.


@cache
def acts() -> tuple[ActWords, ...]:
    """Returns the table."""
    rows: list[dict[str, Any]] = [{"caption": r["kind"], **r} for r in data("acts.toml")["act"]]
    for row in rows:
        row |= {name: tuple(value) for name, value in row.items() if isinstance(value, list)}
    return tuple(ActWords(**row) for row in rows)


@cache
def _beginnings() -> Mapping[str, Sequence[tuple[ActWords, str, str, str]]]:
    """Returns the acts that may begin at a word: first those with a phrase, which is second.

    Third and fourth are form and base form of a single word.
    """
    table: dict[str, list[tuple[ActWords, str, str, str]]] = defaultdict(list)
    for act in acts():
        for phrase in act.phrases:
            for word in beginnings(phrase):
                table[word].append((act, phrase, "", ""))
    single: set[str] = set()
    for act in acts():
        for base in dict.fromkeys((*act.words, *act.nouns, *act.things)):
            for form, name in forms(base).items():
                if base not in act.words:
                    name = {"base": "noun", "third": "nouns"}.get(name, "")
                if name and form not in single:
                    table[form].append((act, "", name, base))
                    single.add(form)
    return table


def mentions(tokens: Sequence[Token]) -> list[Mention]:
    """Returns where acts are named, in order; where two begin at one word the longer one."""
    mentioned: list[Mention] = []
    at = 0
    while at < len(tokens):
        here: list[Mention] = []
        for act, phrase, form, base in _beginnings().get(tokens[at].text, ()):
            end = match(phrase, tokens, at) if phrase else at + 1
            unless = (match(word, tokens, end) for word in act.unless) if end else ()
            if end is not None and end > at and all(after is None for after in unless):
                here.append(Mention(act, at, end, form, base))
        best = max(here, key=lambda one: one.end, default=None)
        if best is None:
            at += 1
            continue
        mentioned.append(best)
        at = best.end
    return [mention for mention in mentioned if mention.act.kind]


Tokens = Sequence[Token]


def acts_in(tokens: Tokens) -> list[Mention]:
    """Returns where acts are named that the person does."""
    done: list[Mention] = []
    for mention in mentions(tokens):
        # "on the spot" is said of gaits and jumps; of a turn it says nothing.
        spare = mention.act.kind == "place" and (not done or done[-1].act.kind not in kinds("way"))
        if not spare and _is_done(mention, tokens):
            done.append(mention)
    return done


def clause_before(tokens: Tokens) -> Tokens:
    """Returns the words at the end of a text that belong to the clause after it."""
    return tokens[last_boundary(tokens) + 1 :]


def last_boundary(tokens: Tokens) -> int:
    """Returns the last place where a clause ends, -1 if none does."""
    ends = (
        at
        for at in range(len(tokens) - 1, -1, -1)
        if tokens[at].text in listed("boundary") or tokens[at].text in ",;."
    )
    return next(ends, -1)


def _is_done(mention: Mention, tokens: Tokens) -> bool:
    """Whether a mention is an act of the person."""
    clause = clause_before(tokens[: mention.start])
    previous = tokens[mention.start - 1].text if mention.start else ""
    following = tokens[mention.end].text if mention.end < len(tokens) else ""
    if mention.act.kind == "stand_up" and tokens[mention.start].text.endswith("ing"):
        # "drinks a cup of coffee standing up" is a posture; "a man standing up" is an act.
        leads = listed("person") | listed("auxiliary") | listed("boundary") | listed("light")
        leads |= listed("leading") | STOPS | {""}
        return previous in leads or previous.endswith("ly")
    if mention.act.kind == "stop" and following.endswith("ing"):  # "stops clapping" does neither
        return following in gait_forms()
    if mention.form == "participle" and previous in ("stop", "stops", "stopping"):
        return False
    if not mention.base:
        return not mention.act.begins or previous in (
            "",
            "then",
            "by",
            "after",
            "and",
            "first",
            ",",
        )
    if [token.text for token in clause] == ["it"]:  # "it turns cold"
        return False
    if mention.form == "past":
        doer = [token.text for token in clause if not token.text.endswith("ly")]
        return not (mention.act.passive and doer and doer[-1] in listed("auxiliary"))
    if mention.form == "participle":
        if following in ("position", "posture", "pose") and not mention.act.passive:
            return True
        adjective = previous in listed("determiner") | listed("preposition")
        return not (adjective and _is_name(tokens, mention.end))
    return _is_verb(mention, clause, previous, following) or _is_noun_act(mention, tokens)


def _is_name(tokens: Tokens, at: int) -> bool:
    """Whether a token is a noun that the word before it belongs to: "running shoes"."""
    if at >= len(tokens):
        return False
    closed = ("after_noun", "person", "determiner", "preposition", "auxiliary", "slow", "fast")
    text = tokens[at].text
    return not (
        tokens[at].number
        or text in STOPS
        or text.endswith("ly")
        or any(text in listed(name) for name in closed)
    )


def _noun_phrase(clause: Tokens) -> int | None:
    """Returns where the noun phrase that ends a clause begins; None if it has no determiner."""
    for start in range(len(clause) - 1, max(len(clause) - 5, -1), -1):
        token = clause[start]
        if token.text in listed("person") - {"one", "another", "other", "that"}:
            return None
        counts = token.number and token.text not in listed("repetition")
        if token.number >= 2 and any(is_plural(other.text) for other in clause[start + 1 :]):
            return None  # "a man with two dogs jumps"
        if token.text in listed("determiner") or counts:
            while start and (
                clause[start - 1].text in listed("degree") or clause[start - 1].number
            ):
                start -= 1
            return start
        if token.text in listed("preposition") | listed("light") or token.text.endswith("ing"):
            return None
    return None


def _is_verb(mention: Mention, clause: Tokens, previous: str, following: str) -> bool:
    """Whether a word in its base form or third person is the verb of its clause."""
    start = _noun_phrase(clause)
    if mention.form == "base":
        return start is None and previous not in listed("preposition")
    if mention.form != "third":
        return False
    if mention.base in ("move", "step") and clause:  # mostly nouns: "karate moves"
        ways = listed("forward") | listed("backward") | listed("sideways")
        goes = following in ways | {"to", "away", "around", "left", "right"}
        person = previous in listed("person") or previous.endswith("ly")
        return person or (goes and start is None)
    if start is None:
        object_of_verb = previous.endswith("ing") and mention.act.passive  # "moving boxes"
        behind = previous in listed("preposition") - {"over", "around", "off", "in", "on"}
        return not (object_of_verb or behind)
    plural = clause[start].number >= 2 or clause[start].text in listed("plural")
    return not plural and start + 1 < len(clause)  # "the man kicks", not "the kicks"


def _is_noun_act(mention: Mention, tokens: Tokens) -> bool:
    """Whether a noun is an act that somebody does: "throws a punch", "two jumps"."""
    noun, thing = mention.base in mention.act.nouns, mention.base in mention.act.things
    of = mention.end < len(tokens) and tokens[mention.end].text == "of"
    if not (noun or thing) or of or _is_name(tokens, mention.end):
        return False
    clause = clause_before(tokens[: mention.start])
    start = _noun_phrase(clause)
    if start is None:
        words = {token.text for token in clause if not token.number}
        does = words & (listed("light") - {"with", "after", "before", "to", "into"})
        return words <= listed("modifier") or bool(does and not words & listed("preposition"))
    if start == 0:
        return True
    lead = clause[start - 1].text
    if lead == "of" and start > 1 and clause[start - 2].text in listed("collections"):
        return True
    if noun or any(token.number >= 2 for token in clause[start:]):
        return lead not in listed("preposition") - {"for", "into", "with", "over"}
    return lead in (listed("light") - {"with", "to"}) | {"walk"}


@cache
def verb_forms() -> dict[str, str]:
    """Returns the forms of verbs that acts are named by, and the name of each."""
    verbs = {verb for act in acts() for verb in act.words} | {"sit", "stand", "go", "get", "do"}
    return {form: name for verb in sorted(verbs) for form, name in forms(verb).items()}


def of_a_person(sentence: str) -> str:
    """Returns a sentence about a person: "the man waves" and "wave" become "a person waves"."""
    for number, token in enumerate(tokens_of(sentence)):
        if token.text in listed("person"):
            return f"a person{sentence[token.end :]}"
        if not number and verb_forms().get(token.text) == "base":
            return f"a person {inflect(token.text, 'third')}{sentence[token.end :]}"
        if number or token.text not in listed("determiner"):
            break
    return sentence


def lookups(sentence: str) -> list[str]:
    """Returns what a sentence is looked up by among captions: itself, without counts, of a person.

    Captions of the same count or of a woman must not be nearer than those of the act: from "a woman
    puts on a jacket" to the caption of a person the cosine is 0.58.
    """
    counts = (sentence, uncounted(sentence))
    return [*dict.fromkeys((*counts, *map(of_a_person, counts)))]


@cache
def gait_forms() -> frozenset[str]:
    """Returns the forms of verbs of going and turning."""
    verbs = {verb for act in acts() if act.kind in (*GAITS, "turn") for verb in act.words}
    return frozenset(form for verb in verbs for form in forms(verb))
