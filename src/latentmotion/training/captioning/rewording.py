"""Captions in other words that mean the same, as users type them, and two captions in one.

    "the person walks forward slowly, then turns to the left."
    → "walk ahead at a slow pace, then turn left"    "a woman walks forward slowly and then turns
    left"    "walking forwards slowly, then turning to the left"

The subject, the form of the verb, synonyms, counts as digits and the links between clauses may
change; actions, their order, sides, directions and counts stay. A sentence that is not understood
word by word (`clauses.py`) gets another subject at most. Captions of `wordings.tsv.xz` have
wordings that language models wrote one by one, too: `caption<TAB>wording|…`; a clause of a longer
caption takes those of the caption that it would be alone.
"""

from __future__ import annotations

import lzma
import re
from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np

from latentmotion.language.words import inflect
from latentmotion.training.captioning.clauses import (
    PHRASES,
    SUBJECT,
    VERB_GROUPS,
    Clause,
    Sentence,
    other_number,
    read_clauses,
    word_set,
    words_of,
)
from latentmotion.training.captioning.prompting import SUBJECTS

_OWN = {
    "male": ("his", "him", "himself"),
    "female": ("her", "her", "herself"),
    "neutral": ("their", "them", "themselves"),
    "you": ("your", "you", "yourself"),
}

_SELF = {"himself", "herself", "themselves", "themself", "oneself"}

_NEAR, _NOT_GOING = word_set("near"), word_set("not_going")
_FROM_BELOW = word_set("from_below")

# Phrases in which short commands leave out "your" and "the".
_DROPPED = re.compile(
    r"\b(raise|lift|lower|wave|swing|bend|move|with|using|shake|stretch|kick) (?:your|the) "
    r"(?=left|right|arms?|hands?|legs?|knees?)"
)

_ATTEMPTS = 8

# Share of written wordings, where a caption has any.
_WRITTEN = 0.6

# The same of a clause among others.
_WRITTEN_CLAUSE = 0.4

# Words before a part of the body that do not tell captions apart.
_OWNERS = {"his", "her", "their", "your", "the"}


def rewordings(sentence: str, generator: np.random.Generator, count: int) -> list[str]:
    """Returns sentences that say the same in other words.

    Args:
        sentence: A caption.
        generator: Source of every choice.
        count: Number of sentences.

    Returns:
        Different sentences, none of them the given one; fewer than `count` where there is doubt.
    """
    read, written = read_clauses(sentence), written_wordings(sentence)
    texts_so_far = {_bare(sentence)}
    texts: list[str] = []
    for _ in range(count * _ATTEMPTS):
        if len(texts) == count:
            break
        if written and generator.random() < _WRITTEN:
            text = str(generator.choice(written))
        elif read is None:
            text = _other_subject(sentence, generator)
        else:
            text = reworded(_with_written_clauses(read, generator), generator)
        if text and _bare(text) not in texts_so_far:
            texts_so_far.add(_bare(text))
            texts.append(text)
    return texts


def written_wordings(sentence: str) -> tuple[str, ...]:
    """Returns the wordings of a caption in `wordings.tsv.xz`; none if it is not there.

    Subject and form of the verb do not matter: "a man kneels" and "kneeling" are one caption.
    """
    return _written().get(_predicate(sentence), ())


@cache
def _written() -> dict[str, tuple[str, ...]]:
    """Returns written wordings by the predicate of the caption that they are of."""
    packed = files("latentmotion.training.captioning").joinpath("wordings.tsv.xz").read_bytes()
    table = lzma.decompress(packed).decode()
    rows = (line.split("\t") for line in table.splitlines() if not line.startswith("#"))
    return {_predicate(caption): tuple(texts.split("|")) for caption, texts in rows}


def _with_written_clauses(sentence: Sentence, generator: np.random.Generator) -> Sentence:
    """Returns the sentence with some of its clauses in written wordings."""
    if sentence.referring:
        return sentence
    clauses = []
    for clause in sentence.clauses:
        written = _written_clauses(" ".join((clause.verb, *clause.rest)))
        if written and generator.random() < _WRITTEN_CLAUSE:
            other = written[int(generator.integers(len(written)))]
            clause = replace(other, link=clause.link, before=clause.before)
        clauses.append(clause)
    return replace(sentence, clauses=tuple(clauses))


@cache
def _written_clauses(caption: str) -> tuple[Clause, ...]:
    """Returns the written wordings of a caption that are one clause."""
    read = (read_clauses(wording) for wording in written_wordings(caption))
    return tuple(
        sentence.clauses[0] for sentence in read if sentence and len(sentence.clauses) == 1
    )


def _predicate(caption: str) -> str:
    """Returns a caption without its subject, verbs in their base form, where it is understood."""
    read = read_clauses(caption)
    if read is None:
        return _bare(caption)
    words = (word for c in read.clauses for word in (c.link, *c.before, c.verb, *c.rest) if word)
    return " ".join("their" if word in _OWNERS else word for word in words)


def reworded(sentence: Sentence, generator: np.random.Generator) -> str:
    """Returns one random wording of a caption in clauses; empty if its owner cannot change."""
    words = {word for clause in sentence.clauses for word in clause.rest}
    static = _NOT_GOING & {clause.verb for clause in sentence.clauses}
    forms = ["goes", "goes"] + ([] if static else ["is going"])
    if not sentence.referring:
        forms += ["go", "go", "go"] + ([] if static else ["going"])
    form = str(generator.choice(forms))
    if sentence.referring or {"him", "themself"} & words:  # a pronoun inside has to fit
        gender = {"male": "male", "female": "female"}.get(sentence.gender, "neutral")
    else:
        gender = str(generator.choice(["neutral", "neutral", "neutral", "male", "female"]))
    owner = {"go": "you", "going": "neutral"}.get(form, gender)
    if owner == "you" and {"herself", "hers", "theirs"} & words:
        return ""
    subject = ""
    if form in ("goes", "is going"):
        subject = str(generator.choice(SUBJECTS["of_gender"][gender]))
    parts = sentence.clauses
    first, *others = parts
    bends = first.verb == "bend" and first.rest in (("down",), ("over",)) and others
    if bends and others[0].verb in _FROM_BELOW and generator.random() < 0.5:
        parts = (replace(others[0], link=""), *others[1:])  # the next action implies the bend
    clauses = [_varied(clause, sentence, owner, generator) for clause in parts]
    return _joined(clauses, subject, form, form == "go" and generator.random() < 0.4, generator)


def in_order(
    first: Sentence, second: Sentence, generator: np.random.Generator, count: int
) -> list[str]:
    """Returns sentences about one action and then another.

    Args:
        first: The first action.
        second: The next action, by the same person.
        generator: Source of every choice.
        count: Number of sentences.

    Returns:
        Different sentences: "a person walks forward, then sits down.", "walk forward, sit down",
        "after walking forward, a person sits down", "first walk forward, then sit down" and the
        like; fewer than `count` where there are no more.
    """
    joined = together(first, second)
    written: dict[str, None] = {}
    for _ in range(6 * count):
        if len(written) == count:
            break
        if joined.referring or generator.random() >= 0.4:
            written.setdefault(reworded(joined, generator))
            continue
        gender = str(generator.choice(["neutral", "neutral", "male", "female"]))
        actors = SUBJECTS["actors"][gender]
        subject, again = actors[int(generator.integers(len(actors)))]
        frames = SUBJECTS["frames"]
        *forms, frame = frames[int(generator.integers(len(frames)))]
        owner = "you" if "go" in forms else gender
        first_part = predicate(first, forms[0], owner, generator)
        other = predicate(second, forms[1], owner, generator)
        written.setdefault(frame.format(subject=subject, again=again, one=first_part, other=other))
    return [text for text in written if text]


def together(first: Sentence, second: Sentence) -> Sentence:
    """Returns both as one sentence with the first's subject."""
    then = replace(second.clauses[0], link="then")
    clauses = (*first.clauses, then, *second.clauses[1:])
    gender = first.gender if first.gender == second.gender else "neutral"
    return Sentence(first.subject, gender, clauses, first.referring or second.referring)


def predicate(sentence: Sentence, form: str, owner: str, generator: np.random.Generator) -> str:
    """Returns the clauses of a sentence, in one random wording, without a subject.

    Args:
        sentence: A caption in clauses; no "he" or "they" inside.
        form: `go`, `goes` or `going`.
        owner: The owner of hands and feet: `male`, `female`, `neutral` or `you`.
        generator: Source of every choice.
    """
    clauses = [_varied(clause, sentence, owner, generator) for clause in sentence.clauses]
    return _joined(clauses, "", form, False, generator).rstrip(".")


def _varied(
    clause: Clause, sentence: Sentence, owner: str, generator: np.random.Generator
) -> Clause:
    """Returns the clause with other owners, synonyms and numbers."""
    own_words, words = [], clause.rest
    possessive, person, reflexive = _OWN[owner]
    for index, word in enumerate(words):
        last = index + 1 == len(words) or words[index + 1] in ("and", "then", ",", "while", "with")
        near = index > 0 and words[index - 1] in _NEAR
        if sentence.referring:  # "his" and the like stay
            pass
        elif word in _SELF:
            word = reflexive
        elif word in ("his", "their", "your") or (word == "her" and not last):
            word = possessive
        elif word in ("him", "her") or (word == "them" and near and sentence.gender == "neutral"):
            word = person
        own_words.append(word)
    text = " ".join((clause.verb, *own_words)).replace(" ,", ",")
    for group in VERB_GROUPS:
        rest = text.partition(" ")[2]
        if generator.random() >= 0.6 or (group.unless and re.search(group.unless, rest)):
            continue
        for phrase in sorted(group.phrases, key=len, reverse=True):
            following = text[len(phrase) :]
            fits = not group.following or re.match(group.following, following.strip())
            if fits and re.match(rf"{phrase}(?![a-z-])", text):
                text = str(generator.choice(group.phrases)) + following
                break
    for pattern, choices in PHRASES:
        if generator.random() < 0.6:
            text = re.sub(pattern, str(generator.choice(choices)), text, count=1)
    if generator.random() < 0.4:
        text = other_number(text)
    verb, *words = text.split()
    return Clause(clause.link, verb, tuple(words), clause.before)


def _joined(
    clauses: list[Clause], subject: str, form: str, short: bool, generator: np.random.Generator
) -> str:
    """Writes the clauses one after another."""
    chain = str(generator.choice([", then", " then", " and then", ", and then"]))
    verb_form = {"goes": "third", "going": "participle"}.get(form.split()[-1], "base")
    text = f"{subject} is" if form == "is going" and subject else subject
    for number, clause in enumerate(clauses):
        link = {"then": chain, "and": " and", "": "", ",": ","}.get(clause.link, " and")
        if short and clause.link == "then":
            link = ","
        spoken = " ".join((inflect(clause.verb, verb_form), *clause.rest))
        before = " ".join(clause.before)
        if clause.link == "," and number == len(clauses) - 1 and not short:
            link = ", and" if number > 1 else " and"
        text += f"{link} {before} {spoken}" if before else f"{link} {spoken}"
    if short:
        text = _DROPPED.sub(r"\1 ", text)
    text = re.sub(r"\ban? (?=anti)", "an ", re.sub(r"\ban? (?=counter)", "a ", text))
    text = " ".join(text.split()).replace(" ,", ",").strip(" ,")
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
    chosen = str(generator.choice(SUBJECTS["of_gender"]["neutral"][:6]))
    return (chosen + text[match.end() :]).replace(" ,", ",")


def _bare(text: str) -> str:
    return " ".join(words_of(text) or text.lower().split())
