"""Captions as clauses: who, does what, and then does what; only where there is no doubt.

"the man walks forward slowly, then turns left." has the subject "the man" and two clauses, `walk`
with "forward slowly" and `turn` with "left". Anything that does not fit this scheme word by word
(other verbs, two persons, a relative clause) is no `Sentence`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

from latentmotion.describe.verbs import BASE_OF_PARTICIPLE, BASE_OF_THIRD, VERBS

_WORDS = re.compile(r"[a-z0-9]+(?:['-][a-z0-9]+)*|[,.;]")

SUBJECT = re.compile(
    r"(?:(?:a|an|the|this|one)? ?(?:stick |standing )?"
    r"(?P<noun>person|man|woman|figure|human|guy|boy|girl|character|individual|someone|somebody"
    r"|subject|toon|sim|lady|dude)"
    r"|(?P<pronoun>he|she|they))\b(?!'s)"
)
"""Who acts, at the start of a sentence."""

_GENDER: dict[str, str] = dict.fromkeys(("man", "guy", "boy", "he", "dude"), "male")
_GENDER |= dict.fromkeys(("woman", "girl", "she", "lady"), "female")

_LINKS = {",", ".", ";", "and", "then", "but"}
_BEFORE_VERB = re.compile(r"(?:then|also|[a-z]+ly|once again|again)")
_PRONOUNS = {"he", "she", "they"}

_REFUSED_WORDS = """
    who which that whose people two's is are was were am be been being has had have does if
    because can could would will should may might must its both's another person man woman someone
    someone's figure they're he's she's it's there not doesn't isn't until or i you we us my our
    others other's
"""

_REFUSED = set(_REFUSED_WORDS.split())
"""Words that make the meaning depend on more than clauses in a row."""

_PLURAL_WORDS = """
    his hers this its always arms hands legs feet knees elbows shoulders hips fingers wrists palms
    thumbs toes heels ankles thighs eyes ears glasses forwards backwards sideways upwards
    downwards inwards outwards towards afterwards leftwards rightwards steps paces times circles
    sides jacks squats lunges pushups situps ups crunches objects things items boxes stairs across
    us is movements motions gestures poses moves weights dumbbells drums arms' vocals lips bongos
    cymbals
"""

_PLURALS = set(_PLURAL_WORDS.split())
"""Words that end as a third person does and are none."""

_WAYS = {"around", "forward", "forwards", "back", "backward", "backwards", "down", "up", "still",
         "arms", "hands", "legs", "knees", "feet", "head"}  # fmt: skip
"""Words after which a third person can only be a verb."""

_FINITE = set(BASE_OF_THIRD) - _PLURALS

_NOMINAL_VERBS = {"do", "perform", "make", "practice", "throw", "mime", "imitate", "demonstrate"}
"""Verbs after which "kicks and punches" may be things."""


@dataclass(frozen=True)
class Clause:
    """One action: how it follows the one before, the verb, and the words around it."""

    link: str
    """`` for the first, else `and`, `then`, `,` or `.`."""
    verb: str
    """Base form."""
    rest: tuple[str, ...]
    """What follows the verb."""
    before: tuple[str, ...] = ()
    """Adverbs before the verb, `then` left out."""


@dataclass(frozen=True)
class Sentence:
    """A caption in clauses that share one subject."""

    subject: str
    """The words of the subject; empty where there is none."""
    gender: str
    """`male`, `female` or `neutral`."""
    clauses: tuple[Clause, ...]
    """At least one."""
    referring: bool
    """Whether "he", "she" or "they" stands inside a clause, so that the subject has to stay."""


def words_of(text: str) -> list[str] | None:
    """Returns lower-case words, commas and periods; None where there are other characters."""
    text = text.lower().replace("\u2019", "'").strip().rstrip(". ")
    words = _WORDS.findall(text)
    return words if "".join(words) == re.sub(r"\s+", "", text) else None


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
    if not clauses or any(_doubtful(clause) for clause in clauses):
        return None
    if (words[0] in BASE_OF_PARTICIPLE and _has_finite(clauses)) or _runs_on(words):
        return None
    inside = {word for clause in clauses for word in clause.rest}
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
        start = self._head(0, first=True)
        if start is None:
            return []
        clauses, (before, verb, place), link = [], start, ""
        while True:
            end, found, next_link = self._next(verb, place)
            if end < 0:
                return []
            clauses.append(Clause(link, verb, tuple(self.words[place:end]), before))
            if found is None:
                return clauses
            (before, verb, place), link = found, next_link

    def _next(
        self, verb: str, place: int
    ) -> tuple[int, tuple[tuple[str, ...], str, int] | None, str]:
        """Returns where a clause ends, the head of the next and how it is linked; -1 for doubt."""
        start, words = place, self.words
        while place < len(words):
            end = place
            linked = []
            while place < len(words) and words[place] in _LINKS:
                linked.append(words[place])
                place += 1
            if not linked:
                place += 1
                continue
            found = self._head(place, first=False, clause=(verb, words[start:end]))
            if found is not None:
                return end, found, _link(linked, self.words[place : found[2]])
            if "then" in linked or "." in linked or "but" in linked or self._suspect(place):
                return -1, None, ""
        return len(words), None, ""

    def _head(
        self, place: int, first: bool, clause: tuple[str, list[str]] = ("", [])
    ) -> tuple[tuple[str, ...], str, int] | None:
        """Returns adverbs, verb and the place after it, where a clause begins at `place`."""
        before: list[str] = []
        words = self.words
        if not first:
            place = self._skip_subject(place)
        while place < len(words) and _BEFORE_VERB.fullmatch(words[place]):
            before += [words[place]] if words[place] not in ("then", "also") else []
            place += 1
        if place < len(words) and words[place] in ("is", "are"):
            place += 1
            while place < len(words) and _BEFORE_VERB.fullmatch(words[place]):
                before += [words[place]]
                place += 1
            verb = BASE_OF_PARTICIPLE.get(words[place]) if place < len(words) else None
            self.forms.setdefault("form", "going")
        else:
            verb = self._form(words[place]) if place < len(words) else None
        if verb is None or self._nominal(verb, words[place], clause):
            return None
        return tuple(before), verb, place + 1

    def _skip_subject(self, place: int) -> int:
        rest = " ".join(self.words[place:])
        match = SUBJECT.match(rest)
        return place + len(match.group(0).split()) if match else place

    def _form(self, word: str) -> str | None:
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

    def _nominal(self, verb: str, word: str, clause: tuple[str, list[str]]) -> bool:
        """Whether what looks like a verb may be one more thing, or one more participle."""
        head, rest = clause
        if not head:
            return False
        going = word in BASE_OF_PARTICIPLE
        listed = bool(rest) and rest[-1] in BASE_OF_THIRD and head in _NOMINAL_VERBS
        subordinate = {"while", "as", "by", "before", "after", "when"} & set(rest)
        participle = any(w in BASE_OF_PARTICIPLE for w in rest)
        return listed or (going and (bool(subordinate) or participle))

    def _suspect(self, place: int) -> bool:
        """Whether the word after "and" or a comma may be a verb that we do not know."""
        while place < len(self.words) and _BEFORE_VERB.fullmatch(self.words[place]):
            place += 1
        if place >= len(self.words):
            return True
        word, form = self.words[place], self.forms.get("form")
        if word in _PRONOUNS or word.endswith("ed") or word in BASE_OF_THIRD:
            return True
        if form == "goes" and (word in BASE_OF_PARTICIPLE or word.endswith("ing")):
            return self.words[place - 1] == "and" or True
        if word in VERBS and "to" not in self.words[:place]:
            return word not in ("left", "right", "back", "forward", "hip", "cup", "step")
        return word.endswith("s") and not word.endswith("ss") and word not in _PLURALS


def _link(linked: list[str], between: list[str]) -> str:
    if "then" in linked or "then" in between:
        return "then"
    return "and" if "and" in linked else "." if "." in linked else ","


def _has_finite(clauses: list[Clause]) -> bool:
    """Whether a third person is left inside, as in "a man crouching down reaches up"."""
    words = {word for clause in clauses for word in clause.rest}
    return bool(words & _FINITE)


def _runs_on(words: list[str]) -> bool:
    """Whether a verb follows without a comma, as in "turns around runs back"."""
    return any(place in _WAYS and verb in _FINITE for place, verb in pairwise(words))


def _doubtful(clause: Clause) -> bool:
    words = {*clause.rest, *clause.before}
    return bool(words & _REFUSED) or clause.verb in ("appear", "seem") or ";" in words
