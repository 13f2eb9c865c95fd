"""Words of a sentence: tokens with the numbers they say, lists of words, and patterns of them.

Lists are data (`words.toml`). A pattern is a few words that acts and phrases are recognized by, in
the notation of `acts.toml`; it is matched word by word, so that no regular expression is needed.

Inflection of English verbs: from the base form to the others, and from any form to all.

Regular endings and some forty irregular verbs are all that movements need. Libraries were tried:
lemminflect unpickles its models, simplemma takes 19 MB, and inflect knows participles only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import dropwhile

from latentmotion.language.claims import LEFT, RIGHT, data

_TOKEN = re.compile(r"\d+(?:\.\d+)?|[^\W\d_]+|[°.,;:!?]|(?<=\d)\s?[-–](?=\s?\d)")
_WORD = re.compile(r"[^\W\d_]+(?:'[^\W\d_]+)?")
# What separates movements that follow each other.
THEN = re.compile(r"\s*(?:[,;.]?\s+(?:and\s+)?then\b|;|\.\s|,\s+(?:and\s+)?finally\b)\s*", re.I)

# Endings in which two forms of a word may differ.
ENDINGS = ("s", "es", "ed", "d", "ing", "ly", "er", "ers", "e", "y", "ies")

ANGLES = (45, 90, 180, 270, 360, 540, 720)  # Numbers that are degrees without the word: "do a 180".

# Words and marks between two clauses, and the first of the second: ", and then quickly waves".
_MOST_LEADS = 7

STOPS = frozenset(".,;:!?")  # Punctuation.


@dataclass(frozen=True)
class Token:
    """A word, a number or a punctuation mark."""

    text: str  # In lower case.
    start: int  # First character in the sentence.
    end: int  # One past the last.
    number: float = 0.0  # What it says, zero where it is no number.


@cache
def listed(name: str) -> frozenset[str]:
    """Returns a list of words."""
    return frozenset(data("words.toml")["lists"][name])


@cache
def opposites() -> tuple[tuple[frozenset[str], frozenset[str]], ...]:
    """Returns pairs of words, in all their forms, of which a text says the one or the other."""
    table = data("words.toml")["opposites"]
    pairs = [[other_forms(word) | {word} for word in pair] for pair in table]
    return (*((one, other) for one, other in pairs), *((other, one) for one, other in pairs))


def is_plural(word: str) -> bool:
    """Whether a word looks like the plural of a noun: "dogs", not "sideways" or "across"."""
    ways = listed("forward") | listed("backward") | listed("sideways")
    return word.endswith("s") and not word.endswith("ss") and word not in ways


def plain(sentence: str) -> str:
    """Returns a sentence in lower case without punctuation, for comparison."""
    return " ".join(re.sub(r"[^\w\s]", " ", sentence.lower()).split())


def words_of(sentence: str) -> list[str]:
    """Returns the words of a sentence, in small letters, without numbers and marks."""
    return _WORD.findall(sentence.lower())


@lru_cache(maxsize=4096)
def content_words(sentence: str) -> frozenset[str]:
    """Returns the words of a sentence but for articles, prepositions and who moves."""
    functional = listed("determiner") | listed("preposition") | listed("auxiliary")
    functional |= other_forms("do")
    words = [word for word in words_of(sentence) if word not in functional]
    return frozenset(dropwhile(lambda word: word in listed("person"), words))


def named_sides(sentence: str) -> set[str]:
    """Returns the sides that a sentence names: left, right, both or none."""
    return {LEFT, RIGHT} & {*words_of(sentence)}


def with_words(sentence: str, others: Mapping[str, str]) -> str:
    """Returns a sentence with some words, given in small letters, replaced by others."""
    return _WORD.sub(lambda word: others.get(word[0].lower(), word[0]), sentence)


def parts_of(sentence: str) -> list[str]:
    """Returns the movements of a sentence that follow each other, in order."""
    parts = [part for part in THEN.split(sentence) if part.strip()]
    return [*parts[:1], *filter(content_words, parts[1:])] or [sentence]  # "…, then the other"


@lru_cache(maxsize=4096)  # the captions near a prompt are asked for again
def suffered(sentence: str) -> Mapping[str, str]:
    """Returns active forms of verbs that are done to somebody, and what else shows them there.

    In "gets hit", "shot in the chest" and "someone hits him", not in "kicked the ball".
    """
    words = words_of(sentence)
    active = words[1:2] and words[1] in listed("determiner") | listed("person")
    leads = zip(["" if active else "is", *words], words, strict=False)
    acted = {word for lead, word in leads if lead in listed("auxiliary")}
    verbs = data("words.toml")["done_to"]
    done = [verbs[word] for word in acted & verbs.keys()]
    who, verb, whom, after = [*words, "", "", "", ""][:4]
    ends = listed("preposition") | listed("boundary") | listed("particle") | {""}
    if who in ("someone", "somebody") and whom in ("him", "her", "them") and after in ends:
        done += [base for base in verbs.values() if verb in forms(base[0])]
    return {form: shows for base, shows in done for form in forms(base) if form != base}


def refers_back(clause: str) -> bool:
    """Whether a clause needs what is before it: "lower it", "knocks again"."""
    words = words_of(clause)
    return len(words) <= 4 and not {"it", "them", "again"}.isdisjoint(words)


def clauses_of(sentence: str, is_known: Callable[[str], bool]) -> list[str]:
    """Returns the clauses of a sentence that have a verb of their own, in order.

    They follow each other, or are joined by "and", "followed by" or a comma: "picks up a stone,
    takes two steps and throws it". A verb has the form of one before it, so that neither "raises
    the left arm and the right leg" nor "stands on one leg, waving" has two.

    Args:
        sentence: The sentence.
        is_known: Whether a word exists, so that "sheathes" is a verb and "umbrellas" is none.
    """
    clauses: list[str] = []
    for part in parts_of(sentence):
        tokens, first = tokens_of(part), 0
        joined = any(token.text in (",", "and", "followed") for token in tokens)
        before = frozenset[str]()  # forms of verbs of the clause so far
        for at, token in enumerate(tokens if joined else ()):
            followed = token.text == "followed" and at + 1 < len(tokens)
            if at > first and (followed or token.text in (",", "and")):
                ahead = range(at + 1, min(at + _MOST_LEADS, len(tokens)))
                leads = listed("leads") | set(STOPS)
                texts = ((n, tokens[n].text) for n in ahead)
                verb = next((n for n, w in texts if w not in leads and not w.endswith("ly")), at)
                after = tokens[verb + 1].text if verb + 1 < len(tokens) else "."
                more, known = after not in STOPS, is_known
                if after in listed("particle"):  # "plops down"
                    known = str.isalpha
                same = _verb_forms(tokens[verb].text, known, more) & before
                if "and" not in {other.text for other in tokens[at:verb]}:
                    same -= {"participle"}  # "stands waiting, leaning on one leg"
                if verb > at and (followed or same):
                    clauses.append(part[tokens[first].start : tokens[at - 1].end])
                    first, before = verb, frozenset()
            if at >= first:
                before |= _verb_forms(token.text, is_known)
        clauses.append(part[tokens[first].start :] if tokens else part)
    return clauses


def at_once(sentence: str) -> list[tuple[str, str]]:
    """Returns how a sentence may be two movements at once: "walks forward", "waving".

    They are joined by "while", "with" or a comma, and come in both orders, or the second is a
    participle. What follows by a "then" is not at once.
    """
    tokens, pairs = tokens_of(sentence) if len(parts_of(sentence)) == 1 else (), []
    no_verb = listed("determiner") | listed("preposition") | listed("auxiliary") | {"and", "then"}
    for at, token in enumerate(tokens):
        joins = token.text in listed("meanwhile") or match("as he|she|they", tokens, at) is not None
        waving = token.text.endswith("ing") and at > 0 and tokens[at - 1].text not in no_verb
        before, after = sentence[: token.start].strip(" ,"), sentence[token.end :].strip(" ,")
        if joins:
            pairs += [(before, after), (after, before)]
        elif waving:
            pairs.append((before, sentence[token.start :]))
    return [pair for pair in pairs if all(map(content_words, pair))]


def verb_of(clause: str, is_known: Callable[[str], bool]) -> str:
    """Returns the verb of a clause, or its first content word where there is none.

    Args:
        clause: The clause.
        is_known: Whether a word exists.
    """
    words = [word for word in words_of(clause) if word in content_words(clause)] or [clause]
    words = [word for word in words if word not in listed("light") | {*forms("have")}] or words
    return next((word for word in words if _verb_forms(word, is_known)), words[0])


def _verb_forms(word: str, is_known: Callable[[str], bool], more: bool = False) -> frozenset[str]:
    """Returns which forms of verbs a word may be, as `forms` names them.

    Args:
        word: The word.
        is_known: Whether a word exists.
        more: Whether words follow that could be its object, so that it may be a rare verb, whose
            other forms are not known.
    """
    if word in listed("no_verb") | listed("determiner") | listed("preposition"):
        return frozenset()
    bases = (base for base in other_forms(word) if word in forms(base) and is_known(base))
    return frozenset(
        forms(base)[word]
        for base in bases
        if forms(base)[word] != "past" or more  # "punched and dazed"
        if (more and forms(base)[word] == "third" and len(base) > 3)
        or any(is_known(inflect(base, form)) for form in ("participle", "past"))
    )


def uncounted(sentence: str) -> str:
    """Returns a sentence without counts: "six slow calf raises" becomes "slow calf raises"."""
    tokens = tokens_of(sentence)
    other, repetition = listed("not_counted") | listed("units"), listed("repetition")
    text, counts = "", False
    for number, token in enumerate(tokens):
        after = tokens[number + 1].text if number + 1 < len(tokens) else ""
        times = counts and token.text in repetition
        counts = token.number > 0 and token.number not in ANGLES and after not in other
        if not counts and not times:
            text += f" {sentence[token.start : token.end]}"
    return text.strip() or sentence


@lru_cache(maxsize=256)  # a prompt is read for its claims, doubts, counts, length and floor
def tokens_of(sentence: str) -> tuple[Token, ...]:
    """Returns the tokens of a sentence; words that are one number are one token."""
    tokens: list[Token] = []
    for match in _TOKEN.finditer(sentence):
        text = match[0].lower().strip().replace("–", "-")
        tight = bool(tokens) and sentence[match.start() - 1] in "'’"
        if tight and text == "t" and tokens[-1].text.endswith("n"):  # don't → do not
            before = tokens.pop()
            short = before.text if before.text == "can" else before.text[:-1]
            tokens.append(Token(short, before.start, before.end))
            text = "not"
        elif tight and text in ("s", "re", "m", "ll"):
            continue
        tokens.append(Token(text, match.start(), match.end()))
    # The words of each number become one token.
    joined: list[Token] = []
    at = 0
    while at < len(tokens):
        value, used = _number([token.text for token in tokens[at : at + 6]])
        last = tokens[at + max(used, 1) - 1]
        text = " ".join(token.text for token in tokens[at : at + max(used, 1)])
        joined.append(Token(text, tokens[at].start, last.end, value))
        at += max(used, 1)
    return tuple(joined)


def _number(words: Sequence[str]) -> tuple[float, int]:
    """Reads the number that words begin with; returns it and how many words it has."""
    tables = data("words.toml")
    cardinals, sets = tables["numbers"], tables["sets"]
    first, rest = words[0], words[1:]
    if first in tables["times"]:
        return tables["times"][first], 1
    if first in tables["vague"]:
        return tables["vague"][first], 1
    if first == "half" and rest[:1] == ["a"] and rest[1:2] and rest[1] in sets:
        return sets[rest[1]] / 2, 3 + (rest[2:3] == ["of"])
    if first == "a" and rest and rest[0] in sets:
        return sets[rest[0]], 2 + (rest[1:2] == ["of"])
    if first in sets:
        return sets[first], 1 + (rest[:1] == ["of"])
    if first == "a" and rest[:1] == ["hundred"]:
        first, rest, used = "one", rest, 1
    elif first[0].isdecimal():
        value = float(first)
        return (value + 0.5, 4) if list(rest[:3]) == ["and", "a", "half"] else (value, 1)
    elif first not in cardinals:
        return 0.0, 0
    else:
        used = 1
    value = cardinals[first]
    if rest and rest[0] == "hundred" and value < 10:
        value, rest, used = 100 * value, rest[1:], used + 1
        if rest[:1] == ["and"] and rest[1:2] and rest[1] in cardinals:
            rest, used = rest[1:], used + 1
        if rest and 0 < cardinals.get(rest[0], 0) < 100:
            value, rest, used = value + cardinals[rest[0]], rest[1:], used + 1
    elif rest and value < 10 and 10 < cardinals.get(rest[0], 0) < 100:  # one-eighty
        value, rest, used = 100 * value + cardinals[rest[0]], rest[1:], used + 1
    if value % 100 >= 20 and value % 10 == 0 and rest and 0 < cardinals.get(rest[0], 0) < 10:
        value, rest, used = value + cardinals[rest[0]], rest[1:], used + 1
    if list(rest[:3]) == ["and", "a", "half"]:
        value, used = value + 0.5, used + 3
    return float(value), used


@cache
def _elements(pattern: str) -> tuple[tuple[frozenset[str] | str, bool], ...]:
    """Returns the elements of a pattern: words or a class of tokens, and whether each may lack."""
    elements: list[tuple[frozenset[str] | str, bool]] = []
    for part in pattern.split():
        optional = part.endswith("?")
        part = part.removesuffix("?")
        if part in ("&", "*", "{any}", "{number}", "{angle}", "{stop}", "{end}"):
            elements.append((part, optional))
            continue
        words: set[str] = set()
        for word in part.split("|"):
            if word.startswith("~"):
                words |= forms(word[1:]).keys()
            elif word.startswith("{"):
                words |= listed(word[1:-1])
            else:
                words.add(word)
        elements.append((frozenset(words), optional))
    return tuple(elements)


def beginnings(pattern: str) -> frozenset[str]:
    """Returns the words that a pattern may begin with."""
    words: set[str] = set()
    for element, optional in _elements(pattern):
        assert isinstance(element, frozenset), pattern
        words |= element
        if not optional:
            break
    return frozenset(words)


def match(pattern: str, tokens: Sequence[Token], at: int) -> int | None:
    """Returns where a pattern that begins at a token ends; None if the tokens differ."""
    return next(_ends(_elements(pattern), tokens, at, None), None)


def _ends(
    elements: Sequence[tuple[frozenset[str] | str, bool]],
    tokens: Sequence[Token],
    at: int,
    end: int | None,
) -> Iterator[int]:
    """Yields the ends at which elements match; `end` is fixed once what follows is matched."""
    if not elements:
        yield at if end is None else end
        return
    (element, optional), rest = elements[0], elements[1:]
    here = tokens[at] if at < len(tokens) else None
    word = here is not None and here.text not in STOPS
    if element == "&":
        yield from _ends(rest, tokens, at, at)
    elif element == "*":
        for skipped in range(4):
            yield from _ends(rest, tokens, at + skipped, end)
            if at + skipped >= len(tokens) or tokens[at + skipped].text in STOPS:
                return
    elif element == "{end}":
        if here is None or here.text in ".!":
            yield from _ends(rest, tokens, at, end)
    elif element == "{stop}":
        if here is None or here.text in STOPS or here.text in listed("after_noun"):
            yield from _ends(rest, tokens, at, end)
    else:
        if (
            (element == "{any}" and word)
            or (element == "{number}" and here is not None and here.number > 0)
            or (element == "{angle}" and here is not None and here.number in ANGLES)
            or (isinstance(element, frozenset) and here is not None and here.text in element)
        ):
            yield from _ends(rest, tokens, at + 1, end)
        if optional:
            yield from _ends(rest, tokens, at, end)


_THIRD = {"be": "is", "do": "does", "go": "goes", "have": "has", "undo": "undoes"}

_PARTICIPLE = {"be": "being", "begin": "beginning", "mimic": "mimicking", "tiptoe": "tiptoeing"}

_PAST = {
    "take": "took", "go": "went", "run": "ran", "make": "made", "keep": "kept", "get": "got",
    "stand": "stood", "sit": "sat", "do": "did", "throw": "threw", "give": "gave", "swing": "swung",
    "hit": "hit", "strike": "struck", "put": "put", "hold": "held", "bend": "bent", "come": "came",
    "begin": "began", "spin": "spun", "turn": "turned", "lie": "lay", "rise": "rose",
    "kneel": "knelt", "creep": "crept", "leap": "leapt", "set": "set", "break": "broke",
    "bring": "brought", "spring": "sprang", "bear": "bore", "say": "said", "lay": "laid",
    "lose": "lost", "leave": "left", "spread": "spread", "sleep": "slept", "sink": "sank",
    "have": "had", "be": "was",
}  # fmt: skip

_DOUBLED = re.compile(r"[^aeiou]*(?:qu)?[aeiou][bdgklmnprt]|(?:un|zig|side)?(?:zag|step)")
# Verbs whose last letter is doubled before "ing" and "ed".
_DOUBLED_IN_PAST = re.compile(rf"{_DOUBLED.pattern}|side-step")

_IRREGULAR = {"third": _THIRD, "participle": _PARTICIPLE, "past": _PAST}

# Further forms that people write.
_OTHER = {
    "lean": ("leant",), "leap": ("leaped",), "kneel": ("kneeled",), "tiptoe": ("tiptoing",),
    "sleep": ("slept",), "hide": ("hid",), "fight": ("fought",),
    "swivel": ("swivelled", "swivelling"), "lie": ("lain", "laying"),
    "walk": ("walkes",), "spring": ("sprung",), "strike": ("stricken",),
}  # fmt: skip


def inflect(verb: str, form: str) -> str:
    """Returns a verb in a form; any other form than these is the base form.

    Args:
        verb: In its base form.
        form: `third` ("walks"), `participle` ("walking") or `past` ("walked").
    """
    if verb in _IRREGULAR.get(form, {}):
        return _IRREGULAR[form][verb]
    if form == "third":
        ending = "es" if re.search(r"(s|x|z|ch|sh|[^o]o)$", verb) else "s"
        return re.sub(r"(?<=[^aeiou])y$", "ie", verb) + ending
    if form == "participle":
        if _DOUBLED.fullmatch(verb):
            return f"{verb}{verb[-1]}ing"
        stem = f"{verb[:-2]}y" if verb.endswith("ie") else re.sub(r"(?<=[^eoy])e$", "", verb)
        return f"{stem}ing"
    if form == "past":
        if _DOUBLED_IN_PAST.fullmatch(verb):
            return f"{verb}{verb[-1]}ed"
        return re.sub(r"(?<=[^aeiou])y$", "i", verb).removesuffix("e") + "ed"
    return verb


@cache
def forms(verb: str) -> Mapping[str, str]:
    """Returns the forms of a verb with the name of each: `base`, `third`, `participle`, `past`."""
    names = dict.fromkeys(_OTHER.get(verb, ()), "past")
    names |= {inflect(verb, name): name for name in ("past", "participle", "third")}
    return names | {verb: "base"}


@lru_cache(maxsize=4096)
def other_forms(word: str) -> frozenset[str]:
    """Returns all forms of the verbs, and of regular nouns, that a word may be a form of.

    For a search: "sitting" and "sat" give sit, sits, sat, sitting. A stem that is no word does no
    harm there.
    """
    stems = {word, *(verb for table in _IRREGULAR.values() for verb in table)}
    for ending in ("s", "es", "ed", "ing", "ies", "ied"):
        stem = word.removesuffix(ending)
        if len(stem) >= 2:
            stems |= {stem, f"{stem}e", f"{stem}y", stem[:-1] if stem[-1:] == stem[-2:-1] else stem}
    return frozenset(form for stem in stems if word in forms(stem) for form in forms(stem))
