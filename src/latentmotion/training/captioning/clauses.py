"""Captions as clauses: a subject and its actions in order; only where there is no doubt.

"the man walks forward slowly, then turns left." has the subject "the man" and two clauses, `walk`
with "forward slowly" and `turn` with "left". Anything that does not fit this scheme word by word
(other verbs, two persons, a relative clause) is no `Sentence`. Words and patterns are those of
`captions.toml`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

from latentmotion.language.words import inflect
from latentmotion.storage.reading import packaged_toml

# Lists of words by name, `patterns`, groups of verbs and phrases.
TABLE = packaged_toml(__file__, "captions.toml")

VERBS = tuple(TABLE["verbs"].split())  # Base forms.

BASE_OF_THIRD = {inflect(verb, "third"): verb for verb in VERBS}  # Base form by third person.

BASE_OF_PARTICIPLE = {
    inflect(verb, "participle"): verb for verb in VERBS
}  # Base form by participle.


@dataclass(frozen=True)
class VerbGroup:
    """Beginnings of clauses, verb first in its base form, that mean the same."""

    phrases: tuple[str, ...]  # The beginnings; the first found that fits is replaced by another.
    following: str = ""  # Pattern of what must follow.
    unless: str = ""  # Pattern that must not be anywhere in the clause.


def word_set(name: str) -> frozenset[str]:
    """Returns a list of words of the table."""
    return frozenset(TABLE[name].split())


# Beginnings of clauses that mean the same; names in braces stand for the table's patterns.
VERB_GROUPS = tuple(
    VerbGroup(
        tuple(row["phrases"]),
        re.sub(r"\{([a-z]+)\}", lambda name: TABLE["patterns"][name[1]], row.get("following", "")),
        row.get("unless", ""),
    )
    for row in TABLE["group"]
)

# Patterns inside a clause, verb first in its base form, and what each may become.
PHRASES = tuple((row["pattern"], tuple(row["choices"])) for row in TABLE["phrase"])

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


_WORDS = re.compile(r"[a-z0-9]+(?:['-][a-z0-9]+)*|[,.;]")

# The subject at the start of a sentence.
SUBJECT = re.compile(
    r"(?:(?:a|an|the|this|one)? ?(?:stick |standing )?"
    r"(?P<noun>person|man|woman|figure|human|guy|boy|girl|character|individual|someone|somebody"
    r"|subject|toon|sim|lady|dude)"
    r"|(?P<pronoun>he|she|they))\b(?!'s)"
)

_GENDER: dict[str, str] = dict.fromkeys(("man", "guy", "boy", "he", "dude"), "male")
_GENDER |= dict.fromkeys(("woman", "girl", "she", "lady"), "female")

_LINKS = {",", ".", ";", "and", "then", "but"}
_BEFORE_VERB = re.compile(r"(?:then|also|[a-z]+ly|once again|again)")
_PRONOUNS = {"he", "she", "they"}

_REFUSED, _PLURALS = word_set("refused"), word_set("plurals")
_CLAUSE_ENDS, _NOMINAL_VERBS = word_set("clause_ends"), word_set("nominal_verbs")

_FINITE = set(BASE_OF_THIRD) - _PLURALS


@dataclass(frozen=True)
class Clause:
    """One action: its link to the clause before, the verb, and the words around it."""

    link: str  # `` for the first, else `and`, `then`, `,` or `.`.
    verb: str  # Base form.
    rest: tuple[str, ...]  # Words after the verb.
    before: tuple[str, ...] = ()  # Adverbs before the verb, `then` left out.


@dataclass(frozen=True)
class Sentence:
    """A caption in clauses that share one subject."""

    subject: str  # The words of the subject; empty where there is none.
    gender: str  # `male`, `female` or `neutral`.
    clauses: tuple[Clause, ...]  # At least one.
    # Whether "he", "she" or "they" stands inside a clause, so that the subject has to stay.
    referring: bool


def words_of(text: str) -> list[str] | None:
    """Returns lower-case words, commas and periods; None where there are other characters."""
    text = text.lower().replace("\u2019", "'").strip().rstrip(". ")
    words = _WORDS.findall(text)
    return words if "".join(words) == "".join(text.split()) else None


def read_clauses(text: str) -> Sentence | None:
    """Takes a caption apart, or returns None where any word leaves doubt.

    Args:
        text: One caption, as people write them.
    """
    words = words_of(text)
    if not words:
        return None
    match = SUBJECT.match(" ".join(words))
    subject = match.group(0) if match else ""
    gender = _GENDER.get(match.group("noun") or match.group("pronoun"), "neutral") if match else ""
    words = words[len(subject.split()) :]
    if subject in ("they", "man", "woman") and words[:1] == ["and"]:
        return None
    clauses = _Reader(words, plural=subject == "they", bare=not subject).read()
    inside = {word for clause in clauses for word in clause.rest}
    adverbs = {word for clause in clauses for word in clause.before}
    if not clauses or (inside | adverbs) & {*_REFUSED, ";"}:
        return None
    if any(clause.verb in ("appear", "seem") for clause in clauses):
        return None
    if words[0] in BASE_OF_PARTICIPLE and inside & _FINITE:
        return None  # "a man crouching down reaches up"
    if any(word in _CLAUSE_ENDS and verb in _FINITE for word, verb in pairwise(words)):
        return None  # a verb follows without a comma: "turns around runs back"
    return Sentence(subject, gender or "neutral", tuple(clauses), bool(inside & _PRONOUNS))


class _Reader:
    """Finds the heads of clauses from left to right."""

    def __init__(self, words: list[str], plural: bool, bare: bool) -> None:
        self.words = words
        self.plural = plural
        self.bare = bare
        self.forms: dict[str, str] = {}

    def read(self) -> list[Clause]:
        """Returns the clauses; none where there is doubt."""
        start = self.head(0, first=True)
        if start is None:
            return []
        clauses, (before, verb, index), link = [], start, ""
        while True:
            end, following, next_link = self.next_clause(verb, index)
            if end < 0:
                return []
            clauses.append(Clause(link, verb, tuple(self.words[index:end]), before))
            if following is None:
                return clauses
            (before, verb, index), link = following, next_link

    def next_clause(
        self, verb: str, index: int
    ) -> tuple[int, tuple[tuple[str, ...], str, int] | None, str]:
        """Returns the end of a clause, and head and link of the next; -1 where there is doubt."""
        start, words = index, self.words
        while index < len(words):
            end = index
            linked = []
            while index < len(words) and words[index] in _LINKS:
                linked.append(words[index])
                index += 1
            if not linked:
                index += 1
                continue
            following = self.head(index, first=False, clause=(verb, words[start:end]))
            if following is not None:
                between = (*linked, *words[index : following[2]])
                link = next((word for word in ("then", "and", ".") if word in between), ",")
                return end, following, link
            if "then" in linked or "." in linked or "but" in linked or self.may_be_verb(index):
                return -1, None, ""
        return len(words), None, ""

    def head(
        self, index: int, first: bool, clause: tuple[str, list[str]] = ("", [])
    ) -> tuple[tuple[str, ...], str, int] | None:
        """Returns the adverbs and the verb of a clause, and the index after the verb."""
        before: list[str] = []
        words = self.words
        subject = None if first else SUBJECT.match(" ".join(words[index:]))
        index += len(subject.group(0).split()) if subject else 0
        while index < len(words) and _BEFORE_VERB.fullmatch(words[index]):
            before += [words[index]] if words[index] not in ("then", "also") else []
            index += 1
        if index < len(words) and words[index] in ("is", "are"):
            index += 1
            while index < len(words) and _BEFORE_VERB.fullmatch(words[index]):
                before += [words[index]]
                index += 1
            verb = BASE_OF_PARTICIPLE.get(words[index]) if index < len(words) else None
            self.forms.setdefault("form", "going")
        else:
            verb = self.base_form(words[index]) if index < len(words) else None
        if verb is None:
            return None
        previous, rest = clause
        if previous:  # it may be one more thing, or one more participle
            listed = bool(rest) and rest[-1] in BASE_OF_THIRD and previous in _NOMINAL_VERBS
            subordinate = {"while", "as", "by", "before", "after", "when"} & set(rest)
            participle = any(word in BASE_OF_PARTICIPLE for word in rest)
            if listed or (words[index] in BASE_OF_PARTICIPLE and (subordinate or participle)):
                return None
        return tuple(before), verb, index + 1

    def base_form(self, word: str) -> str | None:
        """Returns the base of a word in the form that the sentence's first verb has."""
        form = self.forms.get("form")
        if form in (None, "goes", "going") and word in BASE_OF_THIRD:
            self.forms.setdefault("form", "goes")
            return BASE_OF_THIRD[word]
        if form in (None, "going") and word in BASE_OF_PARTICIPLE:
            self.forms.setdefault("form", "going")
            return BASE_OF_PARTICIPLE[word]
        if form in (None, "go") and (self.plural or self.bare) and word in VERBS:
            self.forms.setdefault("form", "go")
            return word
        return None

    def may_be_verb(self, index: int) -> bool:
        """Whether the word after "and" or a comma may be an unknown verb."""
        while index < len(self.words) and _BEFORE_VERB.fullmatch(self.words[index]):
            index += 1
        if index >= len(self.words):
            return True
        word, form = self.words[index], self.forms.get("form")
        if word in _PRONOUNS or word.endswith("ed") or word in BASE_OF_THIRD:
            return True
        if form == "goes" and (word in BASE_OF_PARTICIPLE or word.endswith("ing")):
            return True
        if word in VERBS and "to" not in self.words[:index]:
            return word not in ("left", "right", "back", "forward", "hip", "cup", "step")
        return word.endswith("s") and not word.endswith("ss") and word not in _PLURALS
