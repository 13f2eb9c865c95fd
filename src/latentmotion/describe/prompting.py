"""One measured action, or two → prompts as users type them: short, varied, in every form.

Patterns of `prompt_phrases` become third person ("a man turns left"), orders ("turn left"),
progressive forms ("someone is turning left"), bare participles, or noun phrases ("a left turn").
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from latentmotion.describe.prompt_phrases import IN_A_ROW, ONCE, ONE, Wording
from latentmotion.describe.prompt_wording import contrasted, wording
from latentmotion.describe.single import SingleAction
from latentmotion.describe.verbs import present_participle, third_person

Form = Callable[[str], str]
"""How a verb is written."""


@dataclass(frozen=True)
class Subject:
    """Who acts, and the words that agree with it."""

    name: str
    """As the sentence begins; empty in orders and bare participles."""
    his: str
    """The possessive."""
    him: str
    """The object."""
    he: str
    """The pronoun."""

    @property
    def plural(self) -> bool:
        """Whether its verb is the plural one, as that of "they"."""
        return self.name == "they"


_HE, _SHE, _THEY = ("his", "him", "he"), ("her", "her", "she"), ("their", "them", "they")
_PEOPLE = {
    **dict.fromkeys(("a person", "the person", "someone", "somebody", "they"), _THEY),
    **dict.fromkeys(("a man", "the man", "he", "this guy", "a guy", "the boy", "a boy"), _HE),
    **dict.fromkeys(("a woman", "the woman", "she", "a girl", "the girl", "a lady"), _SHE),
    **dict.fromkeys(("the figure", "the character", "a figure", "a character"), _THEY),
    **dict.fromkeys(("the kid", "a child", "a kid", "a player", "a dancer", "our hero"), _THEY),
}
_COMMON = (
    "a person",
    "a person",
    "a person",
    "someone",
    "a man",
    "a woman",
    "the person",
    "he",
    "she",
)
_MASCULINE = re.compile(r"\b(?:man|businessman|grandpa|knight|butler|monk)\b")
_FEMININE = re.compile(r"\b(?:woman|grandma|girl)\b")

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
_DOUBLED = re.compile(r"[^aeiou]*(?:qu)?[aeiou][bdgklmnprt]|(?:un|zig|side-?)?(?:zag|step)")
_IRREGULAR = {"be": "is", "have": "has"}
_FORMS = {"order": 34, "third": 27, "is": 8, "doing": 7, "participle": 9, "noun": 13, "past": 2}
"""Shares of the forms of a sentence about one action."""

_SHOWN = ("show", "show me", "animate", "an animation of", "a video of")
"""What users put before "a man turning left"."""

_CLOSED = re.compile(r"\[([^\[\]]*)\]")
_CLUMSY = re.compile(
    r"\b(?:keep|start|beginn|stopp|finish)ing \w+ing\b|\bbeing\b|then .*then .*then"
    r"|(?:spot|place) while|\b(\w+) \1\b"
)
"""What nobody types, though the grammar gives it: "keeping hopping"."""

_MANIFOLD = re.compile(r"\b(?:then|before|after|first|from|followed)\b|,")
"""Patterns that tell of an order themselves."""

_VOWEL = re.compile(r"\b([Aa]) (?=[aeio](?!ne\b|ne-))")


def prompts(
    action: SingleAction,
    generator: np.random.Generator,
    count: int,
    refused: frozenset[str] = frozenset(),
) -> list[str]:
    """Writes different prompts that ask for one action.

    Args:
        action: What is done.
        generator: What draws wording and style.
        count: How many; fewer where there are fewer ways to say it.
        refused: Prompts never to be returned, as `plain` writes them.
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
        first: What is done first.
        second: What follows.
        generator: What draws wording and style.
        count: How many; fewer where there are fewer ways to say it.
        refused: Prompts never to be returned, as `plain` writes them.
    """
    one, two = _plainer(wording(first)), _plainer(wording(second))
    contrasts = contrasted(first, second)

    def draw() -> str:
        if contrasts and generator.random() < 0.35:
            return _styled(_single(Wording(contrasts), generator), generator)
        return _styled(_ordered(one, two, generator), generator)

    return _different(draw, count, refused)


def plain(sentence: str) -> str:
    """Returns a sentence in lower case without punctuation, for comparison."""
    return " ".join(re.sub(r"[^\w\s]", " ", sentence.lower()).split())


def _plainer(words: Wording) -> Wording:
    """Leaves out patterns that tell of an order themselves, where there are others, and "once"."""
    clauses = tuple(text for text in words.clauses if not _MANIFOLD.search(text))
    nouns = tuple(text for text in words.nouns if not _MANIFOLD.search(text))
    return replace(
        words,
        clauses=tuple(_uncounted(text) for text in clauses or words.clauses),
        nouns=tuple(_uncounted(text) for text in nouns),
    )


def _uncounted(pattern: str) -> str:
    """Tells a single time less often."""
    return pattern.replace(ONCE, "[|||||once]").replace(ONE, "[a|a|a|a|one]").replace(IN_A_ROW, "")


def _different(draw: Callable[[], str], count: int, refused: frozenset[str]) -> list[str]:
    found: dict[str, str] = {}
    for _ in range(30 * count + 100):
        if len(found) >= count:
            break
        sentence = draw()
        if plain(sentence) not in refused and not _CLUMSY.search(sentence):
            found.setdefault(plain(sentence), sentence)
    return list(found.values())


def _single(words: Wording, generator: np.random.Generator) -> str:
    """One action in a form drawn at random."""
    form = _draw_share(generator, _FORMS)
    if words.orders and generator.random() < 0.06:
        return _pick(words.orders, generator)
    if form == "noun" and words.nouns:
        return _noun(words, generator)
    text = _clause(
        _front(words.clauses, generator), form, _subject(words, form, generator), generator
    )
    if form == "doing" and generator.random() < 0.15:
        return f"{_pick(_SHOWN, generator)} {text}"
    if words.places and generator.random() < 0.06:
        text = f"{text} {_pick(words.places, generator)}"
    return text


def _ordered(one: Wording, two: Wording, generator: np.random.Generator) -> str:
    """Two actions, in an order of words drawn at random."""
    style = _draw_share(generator, {"plain": 55, "before": 12, "after": 14, "noun": 12, "dot": 7})
    if style == "noun" and one.nouns and two.nouns:
        return _nouns_in_order(one, two, generator)
    form = _draw_share(generator, {"order": 42, "third": 40, "is": 7, "participle": 9, "past": 2})
    who = _subject(one if generator.random() < 0.5 else two, form, generator)
    follow = two.after if two.after and generator.random() < 0.4 else two.clauses
    a, b = _front(one.clauses, generator), _front(follow, generator)
    if style == "before":
        return _before(a, b, form, who, generator)
    if style == "after":
        return _after(a, b, form, who, generator)
    bare = Subject("", who.his, who.him, who.he)
    then = {"is": "participle", "third": "plural" if who.plural else "third"}.get(form, form)
    begin, end = _clause(a, form, who, generator), _clause(b, then, bare, generator)
    if style == "dot":
        if form in ("third", "past") and who.name:
            end = _clause(b, form, Subject(who.he, who.his, who.him, who.he), generator)
        return f"{begin}. then {end}"
    if generator.random() < 0.12:
        return f"first {begin}, then {end}"
    joins = (", then ", ", then ", " and then ", " and then ", " and ", " then ", ", and then ")
    return f"{begin}{_pick(joins, generator)}{end}"


def _before(a: str, b: str, form: str, who: Subject, generator: np.random.Generator) -> str:
    """The second action in a clause with "before"."""
    doing = _clause(b, "participle", Subject("", who.his, who.him, who.he), generator)
    main = _clause(a, form, who, generator)
    return f"before {doing}, {main}" if generator.random() < 0.4 else f"{main} before {doing}"


def _after(a: str, b: str, form: str, who: Subject, generator: np.random.Generator) -> str:
    """The first action in a clause with "after"."""
    doing = _clause(a, "participle", Subject("", who.his, who.him, who.he), generator)
    main = _clause(b, form, who, generator)
    return f"after {doing}, {main}" if generator.random() < 0.6 else f"{main} after {doing}"


def _nouns_in_order(one: Wording, two: Wording, generator: np.random.Generator) -> str:
    a, b = _noun(one, generator), _noun(two, generator)
    joins = (", then ", ", followed by ", " followed by ", " and then ", " before ")
    if generator.random() < 0.12:
        return f"first {a}, then {b}"
    return f"{a}{_pick(joins, generator)}{b}"


def _clause(pattern: str, form: str, who: Subject, generator: np.random.Generator) -> str:
    """Fills a pattern of a verb phrase in a form, with its subject where it has one."""
    inflect = _inflect(form, who)
    text = _agreed(_expanded(pattern, generator), who, generator)
    text = re.sub(r"~([\w-]+)", lambda match: inflect(match[1]), text)
    lead = who.name
    if form == "is" and who.name:
        lead = f"{who.name} {'are' if who.plural else 'is'}"
    return _tidy(f"{lead} {text}")


def _inflect(form: str, who: Subject) -> Form:
    if form in ("is", "doing", "participle"):
        return _participle
    if form == "past":
        return _past
    return _third if form == "third" and not who.plural else _base


def _noun(words: Wording, generator: np.random.Generator) -> str:
    who = Subject("", "the", "them", "they")
    return _tidy(_agreed(_expanded(_front(words.nouns, generator), generator), who, generator))


def _subject(words: Wording, form: str, generator: np.random.Generator) -> Subject:
    """Draws who acts; orders and bare participles have no subject."""
    if form == "order" or (form == "participle" and generator.random() < 0.4):
        return Subject("", "your", "you", "you")
    if form == "participle":
        return Subject("", *_THEY)
    named = _PEOPLE if generator.random() < 0.45 else _COMMON
    if words.people and generator.random() < 0.2:
        named = words.people
    name = _pick(tuple(named), generator)
    while form == "doing" and name in ("he", "she", "they"):
        name = _pick(_COMMON, generator)
    terse = generator.random() < 0.08
    return Subject(
        re.sub(r"^(?:a|an|the) ", "", name) if terse else name, *_pronouns(name, generator)
    )


def _pronouns(name: str, generator: np.random.Generator) -> tuple[str, str, str]:
    if _MASCULINE.search(name):
        return _HE
    if _FEMININE.search(name):
        return _SHE
    words = _PEOPLE.get(name, _THEY)
    loose = words is _THEY and name not in ("they", "someone", "somebody")
    return _HE if loose and generator.random() < 0.3 else words


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


def _third(verb: str) -> str:
    return _IRREGULAR.get(verb) or third_person(verb)


def _participle(verb: str) -> str:
    return "being" if verb == "be" else present_participle(verb)


def _past(verb: str) -> str:
    if verb in _PAST:
        return _PAST[verb]
    if _DOUBLED.fullmatch(verb):
        return f"{verb}{verb[-1]}ed"
    return re.sub(r"(?<=[^aeiou])y$", "i", verb).removesuffix("e") + "ed"


def _base(verb: str) -> str:
    return verb


def _front(patterns: tuple[str, ...], generator: np.random.Generator) -> str:
    """Draws a pattern; the first are drawn about twice as often as the last."""
    return patterns[int(len(patterns) * generator.random() ** 1.5)]


def _pick(found: tuple[str, ...], generator: np.random.Generator) -> str:
    return found[int(generator.integers(len(found)))]


def _draw_share(generator: np.random.Generator, shares: dict[str, int]) -> str:
    parts = np.array(list(shares.values()), float)
    return list(shares)[int(generator.choice(len(parts), p=parts / parts.sum()))]
