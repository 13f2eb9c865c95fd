"""Augmentation of captions: other subjects, synonyms, imperatives, single clauses, typos.

The student learns the teacher's embedding of each variation, so a variation need not keep the
meaning of its caption; it only has to look like a prompt that a user may type.
"""

from __future__ import annotations

import random
import re
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

from latentmotion.language.inflection import present_participle, third_person
from latentmotion.training.text_encoder.data import TaggedCaption

# `subjects`, `synonyms`, `activities`, `manners`, and `frames` that verbs and activities fill.
_WORDS = tomllib.loads(Path(__file__).with_name("augmentation.toml").read_text(encoding="utf-8"))

_SUBJECT = re.compile(
    r"^(?:(?:a|an|the|this)\s+)?(?:standing\s+)?"
    r"(?:person|man|woman|figure|human|someone|somebody|he|she|they|guy|character)\b"
)
_CLAUSES = re.compile(r"\s*(?:,|\.|;|\band then\b|\bthen\b|\band\b|\bwhile\b|\bbefore\b)\s*")
_SYNONYM_GROUP = {word: group for group in _WORDS["synonyms"] for word in group}


def vary(caption: TaggedCaption, words: Sequence[str], generator: random.Random) -> str:
    """Returns one random variation of a caption.

    Args:
        caption: The caption.
        words: English words, one of which replaces a random word in one variation of five.
        generator: Draws every choice.
    """
    form = generator.choice((None, "clause", "imperative"))
    text = caption.text
    if form == "clause":
        clauses = [clause for clause in _CLAUSES.split(text) if clause]
        text = generator.choice(clauses) if clauses else text
    elif form == "imperative":
        text = _imperative(caption, generator)
    if generator.random() < 0.6:
        text = _SUBJECT.sub(generator.choice(_WORDS["subjects"]), text)
    if generator.random() < 0.6:
        text = " ".join(
            generator.choice(_SYNONYM_GROUP[word])
            if word in _SYNONYM_GROUP and generator.random() < 0.5
            else word
            for word in text.split()
        )
    if generator.random() < 0.2:
        parts = text.split()
        if parts and words:
            parts[generator.randrange(len(parts))] = generator.choice(words)
        text = " ".join(parts)
    if generator.random() < 0.15 and len(text) >= 4:  # one letter dropped, doubled or swapped
        at = generator.randrange(len(text) - 1)
        first, second = text[at], text[at + 1]
        text = text[:at] + generator.choice(("", first * 2, second + first)) + text[at + 1 :]
    bare = text.strip(" .,")
    return bare + generator.choice((".", "", "", "!")) if bare else text


def plain_phrases(
    captions: Iterable[TaggedCaption], words: Sequence[str], generator: random.Random
) -> list[str]:
    """Returns short prompts, such as "a person is walking", "play tennis" or "chair".

    Args:
        captions: Captions whose verbs and nouns are used.
        words: English words, each of which is a prompt of its own.
        generator: Draws manners ("backwards") and pairs of verb and noun.
    """
    tags = [tag for caption in captions for tag in caption.tags]
    verbs = sorted({lemma for lemma, tag in tags if tag == "VERB" and lemma.isalpha()})
    nouns = sorted({lemma for lemma, tag in tags if tag == "NOUN" and lemma.isalpha()})
    phrases = []
    for verb in verbs:
        forms = {"plain": verb, "goes": third_person(verb), "going": present_participle(verb)}
        phrases += [frame.format_map(forms) for frame in _WORDS["verb_frames"]]
    phrases += [f"{phrase} {generator.choice(_WORDS['manners'])}".strip() for phrase in phrases]
    phrases += [
        frame.format(what) for what in _WORDS["activities"] for frame in _WORDS["activity_frames"]
    ]
    phrases += [f"{generator.choice(verbs)} {generator.choice(nouns)}" for _ in nouns]
    return phrases + nouns + list(words)


def _imperative(caption: TaggedCaption, generator: random.Random) -> str:
    """Lemmas from the first verb on, "walk forward then turn", cut at a random length."""
    verbs = [index for index, (_, tag) in enumerate(caption.tags) if tag == "VERB"]
    if not verbs:
        return caption.text
    lemmas = [lemma for lemma, _ in caption.tags[verbs[0] :]]
    return " ".join(lemmas[: generator.randint(1, len(lemmas))])
