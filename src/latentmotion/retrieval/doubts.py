"""Reading of a sentence by the captions of an index: its doubts, misspelled and unusual words.

Doubts: what a sentence asks for that the model does not know. Three signs, measured on sentences
that no rule was written for (lab/diary/rare_acts.md): no caption of the training data is near the
sentence; a word that no caption has changes what the sentence means, since without it the embedding
is another one; or a word names what is never moved (`outside.toml`).

Wordings: each movement that people say otherwise than captions do is read as the caption whose
wording is nearest (`wordings.py`).

Classes: classifiers (`index.py`) tell which drawn movement a sentence names; where that is
sure, the sentence is read so, and where nothing is near, as what is likeliest.

Fit: how well a drawn clip shows what a sentence asks for. Captions of drawn clips are short, so
that one of them may be near a sentence for a single word: "bow and arrow" is nearer to "bows to the
queen" than "a person bows". The other captions of the clip, and the words that they share with the
sentence, tell the two apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.encoder import pieces
from latentmotion.language.acts import lookups, of_a_person
from latentmotion.language.claims import NO_CORRECTIONS, kinds, mirror_words
from latentmotion.language.reading import (
    affirmed,
    asked_exactly,
    is_idle,
    request_of,
    told_in_order,
)
from latentmotion.language.words import (
    ENDINGS,
    at_once,
    clauses_of,
    content_words,
    listed,
    named_sides,
    other_forms,
    parts_of,
    refers_back,
    suffered,
    tokens_of,
    uncounted,
    with_words,
    words_of,
)
from latentmotion.retrieval.index import (
    ABOUT,
    DRAWN,
    OFTEN,
    RARE,
    RECORDING_MARGIN,
    SHOWN,
    ClassifiedMovement,
    ClipIndex,
    Neighbor,
    outside_kinds,
)

# Cosine of the nearest caption below which a sentence is foreign, unless a wording is near. With
# the other signs 2 % of 200 known sentences and 94 % of 161 foreign ones are doubted (lists of
# benchmarks/quality/acts).
FAR = 0.66

# The same where that caption is of a drawn clip, whose short sentences share words with others.
FAR_OF_DRAWN = 0.7

# Change of the embedding without a word, as 1 - cosine, from which the word matters.
TURNS_MEANING = 0.2

# Cosine of the nearest caption from which the sentence is known, whatever its words are.
NEAR_ENOUGH = 0.8

# Cosine of the nearest wording from which it is known, too; wordings name more than clips show.
SAID_OTHERWISE = 0.85

# Cosine from which a sentence says what a wording does, and from which its own words are near
# enough to those of a caption. Chosen on the acts of benchmarks/quality/acts, by clips in ten.
NEAR_WORDING, NEAR_CAPTION = 0.7, 0.78

# The same of a wording whose caption more than OFTEN clips support: of nine prompts between the
# two, five were read as something else ("tap someone on the shoulder" as "he moves his arms").
NEAR_WORDING_OF_COMMON = 0.8

# How much nearer than a drawn clip's sentence a wording of a common movement has to be. Of 31
# prompts of users with both, ten then start from what they ask for, one from something else, and
# four from noise with their own words (0.05 before).
NEARER = 0.2

# Cosine from which a sentence is a wording of a clip that was drawn or shown, so that it is read so
# whatever it claims: who wrote the wording knew what the clip shows.
SAME_WORDING = 0.8

# Probability from which a sentence surely names a drawn movement, right for 97 % of 600 prompts,
# and from which it does likelier than any other, 79 % of those below.
SURE, LIKELY = 0.5, 0.3

# The same where a sentence is a part of another, has further clauses or a gait beside a gesture, or
# where a caption of a recording is at least so near.
CERTAIN, NEAR_RECORDING = 0.85, 0.88

# Probability from which a sentence asks for what no body can do, and the same where it claims
# something. Of 1,641 prompts that are none of the lists and were not doubted 2 % are, then.
OUTSIDE, OUTSIDE_THOUGH_CLAIMED = 0.5, 0.6

# Weights of the mean cosine of all captions of a clip, and of the share of a sentence's words that
# they have, beside the cosine of the nearest. Of 4,393 captions of drawn clips, left out one at a
# time, 63 % then find their clip among all, 53 % by the nearest caption alone.
BY_ALL, BY_WORDS = 0.5, 0.3

# Cosine of the nearest caption from which a clip fits whatever the others say, and sum of the mean
# cosine and the share of words from which it does below: of 31 prompts of the lists that lie below,
# 24 asked for something else, three for the same.
NEARLY_ALIKE, LEAST_SUM = 0.8, 0.75

MOST_COMPARED = 16  # Clips among which those that fit best are looked for.

# How much nearer a mirror image has to be than a clip of the side that is asked for.
MIRRORED = 0.02

# Cosine from which a caption says the sentence itself and decides alone, "plays tennis" for
# "playing tennis" beside table tennis; difference that codes of embeddings do not show.
SAME_SENTENCE, EQUAL = 0.95, 0.01

ALIKE = 0.03  # How much worse than the best a clip may fit to be another start.

# Clips that have a word which another is taken for a misspelling of.
_FREQUENT = 20


class DoubtWarning(UserWarning):
    """A sentence asks for what the model does not know, or has a misspelled word."""


@dataclass(frozen=True)
class Doubt:
    """Something that the model does not know."""

    about: str  # The words in question.
    reason: str  # Why it is not known.
    nearest: str  # The nearest caption that the model learned.
    is_far: bool = False  # Whether no more than that caption's distance speaks against it.

    def __str__(self) -> str:
        doubt = f'not sure about "{self.about}" ({self.reason})'
        return f'{doubt}; nearest that I learned: "{self.nearest}"'


@dataclass(frozen=True)
class Reading:
    """A sentence as the model reads it."""

    # The sentence, misspelled words corrected, its acts in the order of time, and without what it
    # says is not to happen.
    sentence: str
    negated: bool = False  # Whether something was left out since it is not to happen.
    corrections: tuple[tuple[str, str], ...] = ()  # Words as they were typed and as they are read.
    doubt: Doubt | None = None  # What the model does not know of it.
    # The sentence in words of captions, where its own are far from them.
    caption: str | None = None
    translation: str = ""  # What was understood of a sentence in another language.

    @property
    def prompt(self) -> str:
        """What the denoiser reads."""
        return self.caption or self.sentence

    def notes(self) -> list[str]:
        """Returns what to tell whoever typed it, a line each."""
        read = [self.translation] if self.translation else []
        read += [f'read "{wrong}" as "{right}"' for wrong, right in self.corrections]
        if self.negated:
            read.append(f'read as "{self.sentence}": what is not to happen is left out')
        return [*read, str(self.doubt)] if self.doubt else read

    @classmethod
    def of(cls, sentence: str) -> Reading:
        """Returns a sentence as it is read where nothing is known of the training data."""
        said = affirmed(sentence)
        return cls(told_in_order(said), negated=said != sentence)

    def about(self) -> dict[str, Any]:
        """Returns what a file says of it, as JSON can hold it; nothing if all is known."""
        read_as = [f'read as "{self.caption}"'] if self.caption else []
        notes = [*self.notes(), *read_as]
        about: dict[str, Any] = {"notes": notes} if notes else {}
        about |= {"nearest": [self.doubt.nearest]} if self.doubt else {}
        return about | ({"read_as": self.caption} if self.caption else {})


@dataclass(frozen=True)
class SentenceReader:
    """Reads sentences by the captions of an index."""

    index: ClipIndex  # Captions of the training data.
    text_encoder: TextEncoder  # Embeds sentences.

    def read(self, sentence: str) -> Reading:
        """Returns a sentence as the model reads it, and what it does not know of it."""
        corrected, corrections = self.corrected(sentence)
        said = affirmed(corrected)
        (whole,) = self.index.nearest(self.text_encoder([said, of_a_person(said)]).pooled, 1)
        # A sentence that a clip was shown for is meant as it stands, whatever its parts are.
        shown = whole.caption.support == SHOWN and whole.cosine >= NEAR_ENOUGH
        ordered = said if shown else told_in_order(said)
        parts = [] if shown else parts_of(ordered)
        captions = [
            None if number and refers_back(part) else self._caption(part, len(parts) == 1)
            for number, part in enumerate(parts)
        ]
        read_as = ", then ".join(
            caption or part for caption, part in zip(captions, parts, strict=True)
        )
        doubt = self.doubt(ordered)
        if doubt and len(parts) == 1 and captions[0]:
            doubt = replace(doubt, nearest=captions[0])  # what is made is what is told
        return Reading(
            ordered,
            said != corrected,
            tuple(corrections.items()),
            doubt,
            read_as if any(captions) else None,
        )

    def _caption(self, sentence: str, whole: bool) -> str | None:
        """Returns a movement in words that the denoiser learned; None where its own are near them.

        What people say otherwise than captions do becomes the caption whose wording is nearest, or
        the drawn movement that it names; not so where it names a side that the caption does not, or
        what is done to the person.
        """
        named = None if is_idle(tokens_of(sentence)) else self._named(sentence, whole)
        if named is None:
            return None
        caption, sides = named.caption.text, named_sides(sentence)
        if isinstance(named, Neighbor):
            mirrored = named.mirrored
        else:  # "looks left and right" has no side
            sides = sides if len(sides) == 1 or named_sides(caption) else set[str]()
            mirrored = sides not in (set(), named_sides(caption))
        caption = mirror_words(caption) if mirrored else caption
        if sides - named_sides(caption) or (suffered(sentence) and not suffered(caption)):
            return None
        return caption

    def _named(self, sentence: str, whole: bool) -> ClassifiedMovement | Neighbor | None:
        """Returns the movement that a sentence names in other words than captions do, if any.

        One that claims something that can be measured names none, unless certainly: the denoiser
        learned claims from sentences of all kinds.
        """
        sides, claims = self._sides(sentence), request_of(sentence).claims
        near = self.index.nearest_by_wording(sides)
        if near is None:
            return None
        same = near.caption.support <= SHOWN and near.cosine >= SAME_WORDING
        movement = self._classified(sentence)
        if claims:
            movement = movement if movement and _certainly(movement, sentence, whole) else None
            if not (movement or same):
                return None
        literal = max(
            (self.index.nearest(self._sides(text), 1)[0] for text in lookups(sentence)),
            key=lambda neighbor: neighbor.cosine,
        )
        # A clip was shown for this movement, so it is meant, however well others fit.
        own = literal.caption.support <= SHOWN and (
            literal.caption.clip not in self.index.classified_clips
        )
        if literal.cosine >= SAME_SENTENCE or (own and literal.is_near):
            return None
        shown, said = near.caption.support == SHOWN, near.cosine >= SAME_SENTENCE
        least = SURE if max(near.cosine, literal.cosine) >= SAME_WORDING else LIKELY
        if literal.caption.support > SHOWN and literal.cosine >= NEAR_RECORDING:
            least = CERTAIN
        if movement and movement.probability >= least and not shown:
            return movement
        single = len(clauses_of(sentence, self.is_word)) == 1
        if (movement or single) and not (said or shown) and self._is_far(sentence, literal, sides):
            # What nothing is near is read as what it likeliest names, and doubted.
            return _likeliest(movement, near, literal)
        if same or near.cosine >= max(SAME_WORDING, literal.cosine + RECORDING_MARGIN):
            return near if near.cosine > literal.cosine else None
        # One that was drawn has short sentences, which are less near than wordings, and shows the
        # movement where the wording's caption is too common for a start from its clip.
        drawn = ABOUT if near.caption.support <= RARE else NEARER
        farther = {SHOWN: 1.0, DRAWN: drawn}.get(literal.caption.support, 0.0)
        common = near.caption.support > OFTEN
        least = NEAR_WORDING_OF_COMMON if common else NEAR_WORDING
        if literal.cosine >= min(NEAR_CAPTION, near.cosine) or near.cosine < least:
            return None
        return None if literal.is_near and near.cosine <= literal.cosine + farther else near

    def _classified(self, sentence: str) -> ClassifiedMovement | None:
        """Returns the drawn movement that a sentence names, None if there is none for all of it.

        A sentence one of whose clauses names another asks for them one after the other.
        """
        movement = self.index.classified(self._sides(sentence))
        clauses = clauses_of(sentence, self.is_word)
        if not movement or movement.probability >= CERTAIN or len(clauses) == 1:
            return movement
        parts = [self.index.classified(self._sides(clause)) for clause in clauses]
        others = [part for part in parts if part and part.caption.clip != movement.caption.clip]
        return None if any(part.probability >= LIKELY for part in others) else movement

    def _sides(self, sentence: str) -> Float[np.ndarray, "sides width"]:
        """Returns the embedding of a sentence, and that of its mirror image if it differs."""
        return self.text_encoder([*dict.fromkeys((sentence, mirror_words(sentence)))]).pooled

    def corrected(self, sentence: str) -> tuple[str, dict[str, str]]:
        """Returns a sentence with misspelled words corrected, and the corrections.

        A word is misspelled where no caption has it, the text encoder has no piece for it, and
        exactly one frequent word of captions with the same first letter differs from it by one
        letter, or by two exchanged.
        """
        corrections: dict[str, str] = {}
        for word in words_of(sentence):
            english = not word.isascii() or any(map(self.is_word, _stems(word)))
            if self._is_known(word) or len(word) < 4 or english:
                continue
            # The first letter is seldom wrong (Yannakoudakis and Fawthrop 1983): "mows" is no bow.
            near = [
                other
                for other in _edits(word)
                if other[:1] == word[0] and self.index.words.get(other, 0) >= _FREQUENT
            ]
            if len(set(near)) == 1:
                corrections[word] = near[0]
        return with_words(sentence, corrections), corrections

    def doubt(self, sentence: str) -> Doubt | None:
        """Returns what the model knows least of a sentence, None if it knows all."""
        text, outside = f" {' '.join(words_of(sentence))} ", ""
        for phrase in _outside_words():  # the first words of what is never moved
            head, hit, _ = text.partition(f" {phrase} ")
            if hit and "like" not in head.split()[-3:]:
                outside = phrase
                break
        parts = parts_of(sentence)
        for number, part in enumerate(parts):
            sides = [part, of_a_person(part)]
            if not listed("repetition").isdisjoint(words_of(part)):
                sides.append(uncounted(part))  # "claps twice" is known where "claps" is
            vectors = self.text_encoder(sides).pooled
            (neighbor,) = self.index.nearest(vectors, 1)
            wording = self.index.nearest_by_wording(vectors) or neighbor
            movement = None if request_of(part).claims else self._classified(part)
            caption = _likeliest(movement, neighbor, wording).caption.text
            near = neighbor.cosine >= NEAR_ENOUGH
            if outside and outside in part.lower():
                by_word = _outside_words()[outside]
                if by_word.get("never") or not (near and outside in neighbor.caption.text.lower()):
                    return Doubt(outside, by_word["says"], caption)
            words = words_of(part)
            unheard = sum(not self._is_known(word) for word in words)
            if unheard > 1 and 2 * unheard >= len(words):  # another language
                return Doubt(part.strip(), "captions have few of its words", caption)
            surely = movement is not None and movement.probability >= SURE
            kind, probability = self.index.outside_kind(vectors)
            least = OUTSIDE_THOUGH_CLAIMED if request_of(part).claims else OUTSIDE
            # "Like a dog" is a way of doing something, "two jumping jacks" are no crowd.
            alone = len(parts) == 1 and neighbor.cosine < SAME_SENTENCE and "like" not in words
            alone = alone and asked_exactly(part, any_length=True).count is None
            if alone and probability >= least:
                return Doubt(part.strip(), outside_kinds()[kind]["says"], caption)
            if near or surely or wording.cosine >= SAID_OTHERWISE:
                continue
            word = self._foreign_word(part)
            if word:
                return Doubt(word, "no caption has it", caption)
            if number and refers_back(part):
                continue
            if self._is_far(part, neighbor, vectors):
                # Of clauses that start on their own only those are told that are far, too.
                clauses = clauses_of(part, self.is_word)
                far = Doubt(part.strip(), "no caption is near", caption, is_far=True)
                doubt = self.doubt(", then ".join(clauses)) if len(clauses) > 1 else far
                if doubt:
                    return doubt
        return None

    def _is_far(
        self, sentence: str, nearest: Neighbor, sides: Float[np.ndarray, "sides width"]
    ) -> bool:
        """Whether the nearest caption is too far for the movement of a sentence to be known."""
        drawn = nearest.caption.support == DRAWN
        if nearest.cosine < (FAR_OF_DRAWN if drawn else FAR):
            return True
        if not drawn or request_of(sentence).claims:
            return False
        return not fitting(self.index.nearest(sides, MOST_COMPARED), sides, sentence, self.index)

    def _foreign_word(self, sentence: str) -> str | None:
        """Returns the word that no caption has and that matters most, None if none matters."""
        words = words_of(sentence)
        unheard = [word for word in dict.fromkeys(words) if not self._is_known(word)]
        if not unheard:
            return None
        without = [" ".join(other for other in words if other != word) for word in unheard]
        vectors = self.text_encoder([sentence, *(text or "a person" for text in without)]).pooled
        changes = dict(zip((1 - vectors[1:] @ vectors[0]).tolist(), unheard, strict=True))
        return changes[max(changes)] if max(changes) >= TURNS_MEANING else None

    def is_word(self, word: str) -> bool:
        """Whether captions have a word, or the text encoder reads it in one piece."""
        return word in self.index.words or len(pieces(self.text_encoder, word)) == 1

    def _is_known(self, word: str) -> bool:
        """Returns whether captions have a word or another form of it."""
        words = self.index.words
        return word in words or any(
            stem + ending in words for stem in _stems(word) for ending in ("", *ENDINGS)
        )


def _stems(word: str) -> Iterator[str]:
    """Yields what a word may be without its ending."""
    for ending in ENDINGS:
        if word.endswith(ending) and len(word) - len(ending) >= 3:
            stem = word[: -len(ending)]
            yield stem
            if len(stem) > 3 and stem[-1] == stem[-2]:
                yield stem[:-1]
    yield word


def _edits(word: str) -> Iterator[str]:
    """Yields all strings that differ from a word by one letter, or by two letters exchanged."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    for at in range(len(word) + 1):
        head, tail = word[:at], word[at:]
        if tail:
            yield head + tail[1:]
        if len(tail) > 1:
            yield head + tail[1] + tail[0] + tail[2:]
        for letter in letters:
            yield head + letter + tail
            if tail:
                yield head + letter + tail[1:]


def _certainly(movement: ClassifiedMovement, sentence: str, whole: bool) -> bool:
    """Whether a sentence that claims something names a movement, so that it is read as it.

    Not where it asks for an exact count or turn, for a side that the movement does not have, or for
    a gait under a gesture.
    """
    claims, caption = request_of(sentence).claims, movement.caption.text
    caption = mirror_words(caption) if movement.mirrored else caption
    named = request_of(caption).claims
    exact = asked_exactly(sentence, any_length=True) != NO_CORRECTIONS
    exact = exact or any(claim.degrees for claim in claims)
    sided = {claim.side for claim in claims} <= {"", *(claim.side for claim in named)}
    gaits = {claim.kind for claim in claims if claim.kind in kinds("base")}
    gesture = at_once(sentence) and gaits - {claim.kind for claim in named}
    least = SURE if whole and not gesture else CERTAIN
    return movement.probability >= least and sided and not exact


def _likeliest(
    movement: ClassifiedMovement | None, *near: Neighbor
) -> ClassifiedMovement | Neighbor:
    """Returns what a sentence likeliest names; else what is nearest, recordings clearly so."""
    if movement and movement.probability >= LIKELY:
        return movement
    return max(near, key=lambda n: n.cosine - RECORDING_MARGIN * (n.caption.support > SHOWN))


@cache
def _outside_words() -> Mapping[str, Mapping[str, Any]]:
    return {word: kind for kind in outside_kinds() for word in kind["words"]}


def _fit(
    neighbor: Neighbor, sides: Float[np.ndarray, "sides width"], sentence: str, index: ClipIndex
) -> tuple[float, bool]:
    """Returns how well a drawn clip fits a sentence, and whether well enough to be started from.

    Args:
        neighbor: The nearest caption of the clip.
        sides: Embedding of the sentence, as for `ClipIndex.nearest`.
        sentence: The sentence.
        index: The clips.
    """
    rows = index.captions_of[neighbor.caption.clip]
    mean = index.mean_cosine(neighbor.caption.clip, sides)
    words = frozenset().union(*(content_words(index.captions[row].text) for row in rows))
    forms = [other_forms(word) | {word} for word in content_words(sentence)]
    weights = [index.weight(every) for every in forms]
    said = sum(weight for weight, every in zip(weights, forms, strict=True) if words & every)
    share = said / max(sum(weights), 1e-6)
    score = neighbor.cosine + BY_ALL * mean + BY_WORDS * share
    return score, neighbor.cosine >= NEARLY_ALIKE or mean + share >= LEAST_SUM


def fitting(
    near: Sequence[Neighbor],
    sides: Float[np.ndarray, "sides width"],
    sentence: str,
    index: ClipIndex,
) -> list[Neighbor]:
    """Returns clips near a sentence, of the drawn ones only those that fit enough and best.

    Nothing is returned where what is left is much farther than what was not fit: then it is near
    for the same chance.

    Args:
        near: The nearest caption of each, the nearest first.
        sides: Embedding of the sentence, as for `ClipIndex.nearest`.
        sentence: The sentence.
        index: The clips.
    """
    named = named_sides(sentence)
    itself = max(
        (n.cosine for n in near if named and named == named_sides(n.caption.text)),
        default=0.0,
    )
    # No mirror image of a drawn clip, nor one of both sides, where another shows the side itself.
    near = [
        n
        for n in near
        if n.caption.support != DRAWN
        or named == named_sides(n.caption.text)  # its other sentences are nearer by chance
        or not (n.mirrored or (itself >= NEARLY_ALIKE and named < named_sides(n.caption.text)))
        or (n.mirrored and len(named_sides(n.caption.text)) < 2 and n.cosine > itself + MIRRORED)
    ]
    fits = {n: _fit(n, sides, sentence, index) for n in near if n.caption.support == DRAWN}
    nearest = max((n.cosine for n in fits), default=0.0)
    says = nearest - EQUAL if nearest >= SAME_SENTENCE else 0.0
    best = sorted((n for n in fits if n.cosine >= says), key=lambda neighbor: -fits[neighbor][0])
    least = fits[best[0]][0] - ALIKE if best else 0.0
    drawn = [n for n in best if fits[n][0] >= least and fits[n][1]]
    first = max((n.cosine for n in drawn), default=0.0)
    others = [n for n in near if n not in fits]
    left = [
        *(n for n in others if n.cosine > first),
        *drawn,
        *(n for n in others if n.cosine <= first),
    ]
    misfit = bool(fits) and not fits[max(fits, key=lambda n: n.cosine)][1]
    far = bool(left) and left[0].cosine < near[0].cosine - ABOUT
    return [] if misfit and far else left
