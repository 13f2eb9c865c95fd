"""Augmentation of captions: other subjects, synonyms, imperatives, single clauses, typos.

The student learns the teacher's embedding of each variation, so a variation need not keep the
meaning of its caption; it only has to look like a prompt that a user may type.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Sequence

from latentmotion.language.inflection import present_participle, third_person
from latentmotion.training.text_encoder.data import TaggedCaption

SUBJECTS = (
    "a person", "the person", "person", "a man", "the man", "man", "a woman", "the woman",
    "someone", "somebody", "he", "she", "they", "a human", "a figure", "the figure", "this person",
    "the character", "a guy", "an actor", "a boy", "a girl", "a child", "an old man", "a dancer",
    "a robot", "a zombie", "the subject", "a stick figure", "a player", "i",
)  # fmt: skip

SYNONYMS = (
    ("walks", "strolls", "strides", "steps", "marches", "moves", "paces", "wanders"),
    ("walking", "strolling", "striding", "stepping", "marching", "moving", "pacing"),
    ("walk", "stroll", "stride", "step", "march", "move", "go"),
    ("runs", "jogs", "sprints", "races", "dashes"),
    ("running", "jogging", "sprinting", "racing"),
    ("jumps", "hops", "leaps", "bounces", "skips"),
    ("jumping", "hopping", "leaping", "skipping"),
    ("turns", "spins", "rotates", "pivots", "twists"),
    ("picks", "grabs", "takes", "lifts", "collects"),
    ("throws", "tosses", "hurls", "pitches", "lobs"),
    ("throwing", "tossing", "hurling", "pitching"),
    ("puts", "places", "sets", "lays", "drops"),
    ("crouches", "squats", "kneels", "bends", "stoops"),
    ("quickly", "fast", "rapidly", "hastily", "swiftly"),
    ("slowly", "carefully", "gently", "casually", "lazily", "cautiously"),
    ("forward", "forwards", "ahead", "straight", "straight ahead"),
    ("backward", "backwards", "back", "in reverse"),
    ("hand", "arm", "fist"), ("hands", "arms", "both hands"), ("leg", "foot", "knee"),
    ("waves", "gestures", "signals"), ("punches", "hits", "strikes", "boxes"),
    ("something", "an object", "a box", "a ball", "a cup", "a bottle", "a phone", "a sword"),
    ("dances", "sways", "grooves", "waltzes"), ("looks", "stares", "glances"),
    ("circle", "loop", "square", "figure eight", "zigzag"), ("two", "three", "four", "several"),
    ("left", "right"), ("clockwise", "counterclockwise", "counter clockwise", "anti-clockwise"),
    ("happily", "angrily", "sadly", "drunkenly", "like a zombie", "like an old man"),
)  # fmt: skip

ACTIVITIES = (
    "ballet", "tango", "waltz", "salsa", "hip hop", "breakdance", "cha cha", "the twist", "karate",
    "kung fu", "tai chi", "yoga", "boxing", "tennis", "golf", "baseball", "basketball", "soccer",
    "football", "volleyball", "cricket", "bowling", "hockey", "badminton", "skating", "skiing",
    "swimming", "the guitar", "the drums", "the violin", "the piano", "jumping jacks", "push ups",
    "sit ups", "squats", "lunges", "stretches", "a cartwheel", "a handstand", "a backflip",
    "a somersault", "a pirouette", "a moonwalk", "the robot", "a high kick", "a front kick",
    "the dishes", "laundry", "cleaning", "cooking", "fencing", "wrestling", "gymnastics",
)  # fmt: skip

ACTIVITY_FRAMES = (
    "{}", "a person does {}", "a person is doing {}", "do {}", "dance {}", "play {}",
    "a man plays {}", "a woman is dancing {}", "someone practices {}", "the person performs {}",
    "practicing {}", "a person is playing {}",
)  # fmt: skip

MANNERS = (
    "", "forward", "backwards", "in a circle", "quickly", "slowly", "in place", "to the left",
    "to the right", "up the stairs", "down the stairs", "and stops", "twice", "happily",
    "and turns around", "with the left hand", "with the right leg", "on the floor",
    "with both hands", "around",
)  # fmt: skip

VERB_FRAMES = (
    "{plain}", "{going}", "a person {goes}", "a person is {going}", "a man {goes}",
    "someone is {going}", "the woman {goes}", "he {goes}", "person {going}",
    "a person starts to {plain}",
)  # fmt: skip

_SUBJECT = re.compile(
    r"^(?:(?:a|an|the|this)\s+)?(?:standing\s+)?"
    r"(?:person|man|woman|figure|human|someone|somebody|he|she|they|guy|character)\b"
)
_CLAUSES = re.compile(r"\s*(?:,|\.|;|\band then\b|\bthen\b|\band\b|\bwhile\b|\bbefore\b)\s*")
_SYNONYM_GROUP = {word: group for group in SYNONYMS for word in group}


def vary(caption: TaggedCaption, words: Sequence[str], generator: random.Random) -> str:
    """Returns one random variation of a caption.

    Args:
        caption: The caption.
        words: English words, one of which replaces a random word in one variation of five.
        generator: Draws every choice.
    """
    form = generator.choice((None, _one_clause, _imperative))
    text = form(caption, generator) if form else caption.text
    if generator.random() < 0.6:
        text = _SUBJECT.sub(generator.choice(SUBJECTS), text)
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
        phrases += [frame.format_map(forms) for frame in VERB_FRAMES]
    phrases += [f"{phrase} {generator.choice(MANNERS)}".strip() for phrase in phrases]
    phrases += [frame.format(what) for what in ACTIVITIES for frame in ACTIVITY_FRAMES]
    phrases += [f"{generator.choice(verbs)} {generator.choice(nouns)}" for _ in nouns]
    return phrases + nouns + list(words)


def _one_clause(caption: TaggedCaption, generator: random.Random) -> str:
    clauses = [clause for clause in _CLAUSES.split(caption.text) if clause]
    return generator.choice(clauses) if clauses else caption.text


def _imperative(caption: TaggedCaption, generator: random.Random) -> str:
    """Lemmas from the first verb on, "walk forward then turn", cut at a random length."""
    verbs = [index for index, (_, tag) in enumerate(caption.tags) if tag == "VERB"]
    if not verbs:
        return caption.text
    lemmas = [lemma for lemma, _ in caption.tags[verbs[0] :]]
    return " ".join(lemmas[: generator.randint(1, len(lemmas))])
