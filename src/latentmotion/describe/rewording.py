"""Captions in other words that mean the same, as users type them.

    "the person walks forward slowly, then turns to the left."
    → "walk ahead at a slow pace, then turn left"    "a woman walks forward slowly and then turns
    left"    "walking forwards slowly, then turning to the left"

Who acts, the form of the verb, synonyms, counts as digits and how clauses are joined may change;
actions, their order, sides, directions and counts stay. A sentence that is not understood word by
word (`clauses.py`) gets another subject at most.
"""

from __future__ import annotations

import re

import numpy as np

from latentmotion.describe.clauses import SUBJECT, Clause, Sentence, read_clauses, words_of
from latentmotion.describe.synonyms import PHRASES, VERB_GROUPS, VerbGroup, other_number
from latentmotion.describe.verbs import present_participle, third_person

_SUBJECTS = {
    "neutral": ("a person", "the person", "someone", "a figure", "the figure", "a human", "person"),
    "male": ("a man", "the man", "he"),
    "female": ("a woman", "the woman", "she"),
}

_OWN = {
    "male": ("his", "him", "himself"),
    "female": ("her", "her", "herself"),
    "neutral": ("their", "them", "themselves"),
    "you": ("your", "you", "yourself"),
}

_SELF = {"himself", "herself", "themselves", "themself", "oneself"}

_NEAR = {"of", "behind", "beside", "above", "around", "to", "towards", "toward", "at", "near",
         "over", "below", "with", "under"}  # fmt: skip
"""Words after which "them" is taken for the person, not for things."""

_NOT_GOING = {"start", "begin", "continue", "stop", "proceed", "try", "end", "remain", "finish",
              "let", "land", "attempt", "hold", "keep", "come", "halt", "resume", "use",
              "regain", "lose"}  # fmt: skip
"""Verbs that nobody puts into the progressive in a row of actions."""

_DROPPED = re.compile(
    r"\b(raise|lift|lower|wave|swing|bend|move|with|using|shake|stretch|kick) (?:your|the) "
    r"(?=left|right|arms?|hands?|legs?|knees?)"
)
"""Where short commands leave out "your" and "the"."""

_ATTEMPTS = 8


def rewordings(sentence: str, generator: np.random.Generator, count: int) -> list[str]:
    """Returns sentences that say the same in other words.

    Args:
        sentence: A caption.
        generator: Source of every choice.
        count: How many are wanted.

    Returns:
        Different sentences, none of them the given one; fewer than `count` where there is doubt.
    """
    read = read_clauses(sentence)
    known = {_bare(sentence)}
    found: list[str] = []
    for _ in range(count * _ATTEMPTS):
        if len(found) == count:
            break
        text = _other_subject(sentence, generator) if read is None else reworded(read, generator)
        if text and _bare(text) not in known:
            known.add(_bare(text))
            found.append(text)
    return found


def reworded(sentence: Sentence, generator: np.random.Generator) -> str:
    """Returns one random wording of a caption in clauses."""
    form = _form(sentence, generator)
    gender = _gender(sentence, generator)
    owner = {"go": "you", "going": "neutral"}.get(form, gender)
    if not _keeps_owner(sentence, owner):
        return ""
    subject = ""
    if form in ("goes", "is going"):
        subject = str(generator.choice(_SUBJECTS[gender]))
    clauses = [_varied(clause, sentence, owner, generator) for clause in sentence.clauses]
    short = form == "go" and generator.random() < 0.4
    return _joined(clauses, subject, form, short, generator)


def predicate(sentence: Sentence, form: str, owner: str, generator: np.random.Generator) -> str:
    """Returns the clauses of a sentence, in one random wording, without a subject.

    Args:
        sentence: A caption in clauses; no "he" or "they" inside.
        form: `go`, `goes` or `going`.
        owner: Whose hands and feet they are: `male`, `female`, `neutral` or `you`.
        generator: Source of every choice.
    """
    clauses = [_varied(clause, sentence, owner, generator) for clause in sentence.clauses]
    return _joined(clauses, "", form, False, generator).rstrip(".")


def inflected(phrase: str, form: str) -> str:
    """Returns a clause, its verb first in base form, as `go`, `goes` or `going`."""
    verb, _, rest = phrase.partition(" ")
    forms = {"goes": third_person, "going": present_participle}
    return f"{forms[form](verb) if form in forms else verb} {rest}".strip()


def _form(sentence: Sentence, generator: np.random.Generator) -> str:
    """Returns `goes`, `is going`, `going` or `go`, whichever the sentence allows."""
    static = _NOT_GOING & {clause.verb for clause in sentence.clauses}
    forms = ["goes", "goes"] + ([] if static else ["is going"])
    if not sentence.referring:
        forms += ["go", "go", "go"] + ([] if static else ["going"])
    return str(generator.choice(forms))


def _gender(sentence: Sentence, generator: np.random.Generator) -> str:
    """Returns who acts; a pronoun inside the sentence has to fit."""
    inside = [word for clause in sentence.clauses for word in clause.rest]
    if sentence.referring or {"him", "themself"} & set(inside):
        return {"male": "male", "female": "female"}.get(sentence.gender, "neutral")
    return str(generator.choice(["neutral", "neutral", "neutral", "male", "female"]))


def _keeps_owner(sentence: Sentence, owner: str) -> bool:
    """Whether every "her" and "them" is clear enough to be given to another owner."""
    words = [word for clause in sentence.clauses for word in clause.rest]
    return not ({"herself", "hers", "theirs"} & set(words) and owner == "you")


def _varied(
    clause: Clause, sentence: Sentence, owner: str, generator: np.random.Generator
) -> Clause:
    """Returns the clause with other owners, synonyms and numbers."""
    rest = clause.rest if sentence.referring else _owned(clause.rest, owner, sentence)
    text = " ".join((clause.verb, *rest)).replace(" ,", ",")
    for group in VERB_GROUPS:
        if generator.random() < 0.6:
            text = _swapped(text, group, generator)
    for pattern, choices in PHRASES:
        if generator.random() < 0.6:
            choice = str(generator.choice(choices))
            text = re.sub(pattern, choice, text, count=1)
    if generator.random() < 0.4:
        text = other_number(text)
    verb, *words = text.split()
    return Clause(clause.link, verb, tuple(words), clause.before)


def _swapped(text: str, group: VerbGroup, generator: np.random.Generator) -> str:
    if group.unless and re.search(group.unless, text.partition(" ")[2]):
        return text
    for phrase in sorted(group.phrases, key=len, reverse=True):
        following = text[len(phrase) :]
        if not re.match(rf"{phrase}(?![a-z-])", text):
            continue
        if group.following and not re.match(group.following, following.strip()):
            continue
        return str(generator.choice(group.phrases)) + following
    return text


def _owned(words: tuple[str, ...], owner: str, sentence: Sentence) -> tuple[str, ...]:
    """Returns the words with "his", "their" and the like given to another owner."""
    own, person, self_ = _OWN[owner]
    result = []
    for place, word in enumerate(words):
        last = place + 1 == len(words) or words[place + 1] in ("and", "then", ",", "while", "with")
        near = place > 0 and words[place - 1] in _NEAR
        if word in _SELF:
            word = self_
        elif word in ("his", "their") or (word == "her" and not last):
            word = own
        elif word in ("him", "her") or (word == "them" and near and sentence.gender == "neutral"):
            word = person
        result.append(word)
    return tuple(result)


def _joined(
    clauses: list[Clause], subject: str, form: str, short: bool, generator: np.random.Generator
) -> str:
    """Writes the clauses one after another."""
    chain = str(generator.choice([", then", " then", " and then", ", and then"]))
    verb_form = form.split()[-1]
    text = f"{subject} is" if form == "is going" and subject else subject
    for number, clause in enumerate(clauses):
        link = {"then": chain, "and": " and", "": "", ",": ","}.get(clause.link, " and")
        if short and clause.link == "then":
            link = ","
        spoken = inflected(" ".join((clause.verb, *clause.rest)), verb_form)
        before = " ".join(word for word in clause.before)
        if clause.link == "," and number == len(clauses) - 1 and not short:
            link = ", and" if number > 1 else " and"
        text += f"{link} {before} {spoken}" if before else f"{link} {spoken}"
    if short:
        text = _DROPPED.sub(r"\1 ", text)
    text = re.sub(r"\ban? (?=anti)", "an ", re.sub(r"\ban? (?=counter)", "a ", text))
    text = re.sub(r"\s+", " ", text).replace(" ,", ",").strip(" ,")
    return text + (str(generator.choice([".", ""])) if not short else "")


def _other_subject(sentence: str, generator: np.random.Generator) -> str:
    """Returns the sentence with another subject, where the first word after it is plain."""
    words = words_of(sentence)
    if words is None:
        return ""
    text = " ".join(words)
    match = SUBJECT.match(text)
    if not match or match.group("pronoun") or " and " in match.group(0):
        return ""
    after = text[match.end() :].split()
    if not after or after[0] in ("and", ",", "with", "or", "s", "s'") or "." in words:
        return ""
    noun = match.group("noun")
    if noun in ("man", "woman", "guy", "boy", "girl", "lady", "dude"):
        return ""
    chosen = str(generator.choice(_SUBJECTS["neutral"][:6]))
    return (chosen + text[match.end() :]).replace(" ,", ",")


def _bare(text: str) -> str:
    return " ".join(words_of(text) or text.lower().split())
