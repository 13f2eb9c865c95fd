"""Inflection of English verbs: from the base form to the others, and from any form to all.

Regular endings and some forty irregular verbs are all that movements need. Libraries were tried:
lemminflect unpickles its models, simplemma takes 19 MB, and inflect knows participles only.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache

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

# Further forms that people write.
_OTHER = {
    "lean": ("leant",), "leap": ("leaped",), "kneel": ("kneeled",), "tiptoe": ("tiptoing",),
    "sleep": ("slept",), "hide": ("hid",), "fight": ("fought",),
    "swivel": ("swivelled", "swivelling"), "lie": ("lain", "laying"),
    "walk": ("walkes",), "spring": ("sprung",), "strike": ("stricken",),
}  # fmt: skip


def third_person(verb: str) -> str:
    """Returns "walks" for "walk"."""
    if verb in _THIRD:
        return _THIRD[verb]
    if re.search(r"(s|x|z|ch|sh|[^o]o)$", verb):
        return f"{verb}es"
    return re.sub(r"(?<=[^aeiou])y$", "ie", verb) + "s"


def present_participle(verb: str) -> str:
    """Returns "walking" for "walk", "running" for "run", "dancing" for "dance"."""
    if verb in _PARTICIPLE:
        return _PARTICIPLE[verb]
    if _DOUBLED.fullmatch(verb):
        return f"{verb}{verb[-1]}ing"
    if verb.endswith("ie"):
        return f"{verb[:-2]}ying"
    return re.sub(r"(?<=[^eoy])e$", "", verb) + "ing"


def past_tense(verb: str) -> str:
    """Returns "walked" for "walk", "ran" for "run"."""
    if verb in _PAST:
        return _PAST[verb]
    if _DOUBLED_IN_PAST.fullmatch(verb):
        return f"{verb}{verb[-1]}ed"
    return re.sub(r"(?<=[^aeiou])y$", "i", verb).removesuffix("e") + "ed"


def inflect(verb: str, form: str) -> str:
    """Returns a verb as `third` person, `participle` or `past`; any other form is the base form."""
    if form == "third":
        return third_person(verb)
    if form == "participle":
        return present_participle(verb)
    return past_tense(verb) if form == "past" else verb


@cache
def forms(verb: str) -> Mapping[str, str]:
    """Returns the forms of a verb with the name of each: `base`, `third`, `participle`, `past`."""
    names = dict.fromkeys(_OTHER.get(verb, ()), "past")
    names |= {inflect(verb, name): name for name in ("past", "participle", "third")}
    return names | {verb: "base"}


def other_forms(word: str) -> frozenset[str]:
    """Returns all forms of the verbs, and of regular nouns, that a word may be a form of.

    For a search: "sitting" and "sat" give sit, sits, sat, sitting. A stem that is no word does no
    harm there.
    """
    stems = {word, *(verb for table in (_THIRD, _PAST, _PARTICIPLE) for verb in table)}
    for ending in ("s", "es", "ed", "ing", "ies", "ied"):
        stem = word.removesuffix(ending)
        if len(stem) >= 2:
            stems |= {stem, f"{stem}e", f"{stem}y", stem[:-1] if stem[-1:] == stem[-2:-1] else stem}
    return frozenset(form for stem in stems if word in forms(stem) for form in forms(stem))
