"""Choice of clips: which clips each movement of a sentence starts from.

    sentence → movements → nearest captions of each → clips that take turns, or none

What a sentence asks for is compared with captions by embeddings; words decide where those mislead:
sides, opposites, gaits, counts, and captions of drawn clips, which are short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np

from latentmotion.arrays import unit
from latentmotion.language.acts import lookups
from latentmotion.language.claims import NO_CORRECTIONS, Claim, data, kinds, mirror_words
from latentmotion.language.reading import asked_exactly, request_of
from latentmotion.language.words import (
    at_once,
    clauses_of,
    content_words,
    listed,
    named_sides,
    opposites,
    other_forms,
    parts_of,
    refers_back,
    suffered,
    verb_of,
    words_of,
)
from latentmotion.retrieval.doubts import (
    ALIKE,
    EQUAL,
    MOST_COMPARED,
    NEARLY_ALIKE,
    Reading,
    SentenceReader,
    fitting,
)
from latentmotion.retrieval.index import (
    ABOUT,
    ALIKE_WORDS,
    DRAWN,
    OFTEN,
    RARE,
    RECORDING_MARGIN,
    SHOWN,
    Neighbor,
)

USUAL = 60.0  # Support of a movement that succeeds from noise about as often as from a clip.

# Cosine from which a caption tells of a gait and of the gesture over it: "runs with both arms in
# the air" is .80 from arms that are held back, "texting while walking" .85 from the same.
TELLS_BOTH = 0.83

# Least part of the weight of a sentence's words, and of its weightiest word, that the caption of a
# drawn clip must have to be started from for its words alone.
LEAST_SAID, LEAST_WEIGHT = 0.45, 4.0

# Cosine of a caption with each clause of a sentence, and with all on average, from which it tells
# of all of them.
LEAST_TOLD, MEAN_TOLD = 0.38, 0.54

# Weight of the embedding of a sentence beside that of a single word of it: with 0.5 archers shoot
# with rifles, with 0.7 other words are outweighed.
CONTEXT = 0.6

_TAILS = ",;:(!"  # Marks after which a sentence says how its movement is done.

MOST_CHOICES = 4  # Clips among which takes take turns.

MOST_MOVEMENTS = 8  # Movements of a sentence that start from clips of their own; more have no time.


@dataclass(frozen=True)
class Choice:
    """Captions near a movement of a sentence, and how many clips show it."""

    # The nearest, and those that are nearly as near, whose clips take turns; none for a movement
    # that is sampled from noise beside others from clips.
    neighbors: tuple[Neighbor, ...]
    support: int  # About how many clips show the movement.
    sentence: str  # What says the movement.
    under: Choice | None = None  # What the body does beneath a gesture.

    @property
    def cosine(self) -> float:
        """Cosine of the nearest."""
        return self.neighbors[0].cosine

    def clip_for(self, seed: int) -> Neighbor | None:
        """Returns the clip whose turn it is with a seed; None where noise is sampled."""
        return self.neighbors[seed % len(self.neighbors)] if self.neighbors else None


Span = tuple[tuple[str, ...], Choice]  # Clauses of a sentence in a row, and clips near them.


@dataclass(frozen=True)
class Chooser(SentenceReader):
    """Chooses clips of an index for the movements of sentences."""

    def neighbors(self, sentence: str, count: int = MOST_CHOICES) -> list[Neighbor]:
        """Returns the captions nearest to a sentence, the nearest first."""
        return self.index.nearest(self._sides(sentence), count)

    def read(self, sentence: str) -> Reading:
        """Returns a sentence as the model reads it; what is made in layers is not doubted."""
        reading = super().read(sentence)
        doubted = reading.doubt and reading.doubt.is_far and self._layers(reading.sentence)
        return replace(reading, doubt=None) if doubted else reading

    def choices(self, reading: Reading) -> list[Choice]:
        """Returns clips to start from, for each movement of a sentence that follows another.

        Of several movements each starts as it would alone: one that is not rare has no neighbors,
        and is sampled from noise.

        Returns:
            Nothing where no movement starts from a clip.
        """
        if layers := self._layers(reading.sentence):
            return layers
        movements = self._movements(reading.prompt)
        if len(movements) == 1:
            choice = self._rare(movements[0], reading, reading.sentence)
            choice = choice or self._headed(reading.sentence)
            # What was typed may say how fast, which a caption does not.
            return [replace(choice, sentence=reading.sentence)] if choice else []
        # Few words about what is before them ("lower it") are near a clip by chance.
        movements = [
            choice
            for choice in movements
            if request_of(choice.sentence).claims
            or choice.cosine >= NEARLY_ALIKE
            or (choice.neighbors[0].is_near and not refers_back(choice.sentence))
        ]
        row = [
            self._rare(choice, reading, choice.sentence)
            or self._headed(choice.sentence)
            or self._beside(choice)
            for choice in movements
        ]
        # Noise makes fewer movements of a row than it would alone.
        return row if any(choice.neighbors and choice.support <= USUAL for choice in row) else []

    def _headed(self, sentence: str) -> Choice | None:
        """Returns the clips of what a sentence says first: "sneaking on tiptoes, cartoon style".

        What follows says how. Nothing is returned where it claims what the clip does not show.
        """
        several = len(clauses_of(sentence, self.is_word)) > 1
        if several or asked_exactly(sentence, any_length=True) != NO_CORRECTIONS:
            return None
        stops = [sentence.find(mark) for mark in _TAILS if mark in sentence]
        head = sentence[: min(stops, default=0)].strip()
        if len(words_of(head)) < 2:
            return None
        choice = self.choice(head)
        alike = choice.support <= RARE and choice.cosine >= NEARLY_ALIKE
        if not alike or not _claims(sentence) - {"place"} <= self._claims_of(choice.neighbors[0]):
            return None
        near = tuple(self._on_side(neighbor, sentence) for neighbor in choice.neighbors)
        return Choice(near, choice.support, sentence)

    def _beside(self, choice: Choice) -> Choice:
        """Returns what a movement that is not rare starts from beside rare ones.

        Not the best of several takes is kept of it, so that a clip shows it more surely than noise;
        not of the most common ones, whose captions say little of their clips.
        """
        exact = asked_exactly(choice.sentence, any_length=True) != NO_CORRECTIONS
        alike = choice.cosine >= NEARLY_ALIKE and choice.support <= OFTEN
        return choice if alike and not exact else replace(choice, neighbors=())

    def _rare(self, choice: Choice, reading: Reading, sentence: str) -> Choice | None:
        """Returns the clips of a movement that starts from clips, None for one from noise.

        A sentence in words of its own claims nothing that a clip could spoil, so that its movement
        may be less rare.

        Args:
            choice: Clips near the movement.
            reading: The sentence.
            sentence: What says how often the movement is done.
        """
        # Noise has the count or the turn that a sentence asks for exactly more often than a
        # recording; a clip that was shown or drawn has clear repetitions, which clean-up counts.
        exactly = asked_exactly(sentence, any_length=True)
        texts = self.index.texts_of(choice.neighbors[0].caption.clip)
        turns = any(exactly.turn == asked_exactly(text, any_length=True).turn for text in texts)
        is_given = choice.support == SHOWN or (choice.support == DRAWN and turns)
        exact = exactly != NO_CORRECTIONS and not is_given
        rare = choice.support <= (USUAL if reading.caption else RARE) and not exact
        if rare and choice.neighbors[0].is_near:
            return choice
        said = None if exact else self._said(choice.sentence)
        return Choice((said,), DRAWN, choice.sentence) if said else None

    def _layers(self, sentence: str) -> list[Choice]:
        """Returns a gesture over a gait, or after a posture: "walks while eating an apple".

        Returns:
            Nothing where a caption tells of both, no drawn clip is near the gesture, or a clip was
            shown for the sentence.
        """
        pairs = at_once(sentence)
        if not pairs or asked_exactly(sentence, any_length=True) != NO_CORRECTIONS:
            return []
        whole = self.choice(sentence)
        if whole.support == SHOWN:
            return []
        shown = _claims(whole.neighbors[0].caption.text) if whole.cosine >= TELLS_BOTH else ()
        gestures = [
            (self.choice(over), under)
            for under, over in pairs
            if (claims := _claims(under)) and claims.issubset(kinds("base")) and not at_once(under)
            if claims.isdisjoint(shown) and _claims(over).issubset(kinds("arms") + kinds("pose"))
        ]
        drawn = [
            (over, under)
            for over, under in gestures
            if over.support == DRAWN and over.cosine >= max(NEARLY_ALIKE, whole.cosine)
        ]
        if not drawn:
            return []
        over, under = max(drawn, key=lambda pair: pair[0].cosine)
        base = self.choice(under)
        if _claims(under).isdisjoint(kinds("way")):
            # A seat may float where it was recorded.
            surely = base.support == DRAWN and base.cosine >= NEARLY_ALIKE
            return [base if surely else replace(base, neighbors=()), over]
        rare = self._rare(base, Reading(under), under)
        return [replace(over, under=rare or self._beside(base))]

    def _movements(self, sentence: str) -> list[Choice]:
        """Returns clips near each movement of a sentence.

        Clauses are one movement where a caption tells of all of them: it is nearer to them together
        than to any alone, and as near as others are to each alone.
        """
        clauses = clauses_of(sentence, self.is_word)
        done = [clause for clause in clauses if listed("barely").isdisjoint(words_of(clause))]
        if not done or len(clauses) == 1 or len(done) > MOST_MOVEMENTS:
            return [self.choice(sentence)]
        if len(done) == 1:  # "nearly falls, catches himself"
            return [self.choice(done[0])]
        spans: list[Span] = [((clause,), self.choice(clause, sentence)) for clause in done]
        whole, said = (tuple(done), self.choice(sentence)), self._said(sentence)
        shown = whole[1].neighbors[0].caption.support == SHOWN
        if shown or self._tells(whole, spans):
            return [whole[1]]
        text = _text_of(said) if said else ""
        if said and _in_turn(text, sentence, done) and self._names([text], done):
            return [Choice((said,), DRAWN, sentence)]
        while len(spans) > 2:
            rows = [(*first, *second) for (first, _), (second, _) in pairwise(spans)]
            pairs = [(row, self.choice(" and ".join(row))) for row in rows]
            joinable = [n for n, pair in enumerate(pairs) if self._tells(pair, spans[n : n + 2])]
            if not joinable:
                break
            n = max(joinable, key=lambda n: pairs[n][1].cosine)
            spans[n : n + 2] = [pairs[n]]
        return [choice for _, choice in spans]

    def _tells(self, span: Span, parts: Sequence[Span]) -> bool:
        """Whether the caption nearest to a span of clauses tells of all of them."""
        clauses, choice = span
        caption, text = choice.neighbors[0].caption, _text_of(choice.neighbors[0])
        if any(map(_gaits_of, clauses)) and not _gaits_of(text):
            return False  # "walks to the window and looks out" is no look through one
        if not _in_turn(text, choice.sentence, clauses):
            return False
        if caption.support == DRAWN:
            texts = self.index.texts_of(caption.clip)
            return (
                choice.support == DRAWN
                and choice.neighbors[0].is_near
                and self._names(texts, clauses)
                and self._in_order(text, clauses)
            )
        if choice.support > RARE and len(named_sides(" ".join(clauses))) > 1:
            return False  # noise mixes sides up
        of_clip = self.index.captions_of[caption.clip]
        number = next(n for n in of_clip if self.index.captions[n] is caption)
        cosines = [
            max(self.index.neighbor(number, self._sides(text)).cosine for text in lookups(clause))
            for clause in clauses
        ]
        if max(cosines) >= choice.cosine:
            return False
        near = choice.cosine >= min(part.cosine for _, part in parts) - EQUAL
        near = near and min(cosines) >= LEAST_TOLD and sum(cosines) >= MEAN_TOLD * len(cosines)
        return near or choice.cosine >= ALIKE_WORDS

    def choice(self, sentence: str, context: str = "") -> Choice:
        """Returns clips near a movement.

        Args:
            sentence: The movement.
            context: The sentence that it is a part of, which says what a single word means:
                "draws a bow and shoots".
        """
        versions = [self._sides(text) for text in lookups(sentence)]
        alone = len(set(words_of(sentence)) - listed("person")) == 1
        if context and alone and not _claims(sentence):
            meant = CONTEXT * self._sides(context)[0]
            versions = [unit(sides + meant) for sides in versions]
        nearest = [(sides, self.index.nearest(sides, MOST_COMPARED)) for sides in versions]
        sides, every = max(nearest, key=lambda version: version[1][0].cosine)
        support = self.index.support(sides, 0.0 if _claims(sentence) else RECORDING_MARGIN)
        near = [n for n in every if n.caption.support == SHOWN or _fits(n.caption.text, sentence)]
        near = fitting(near, sides, sentence, self.index)
        if {*kinds("gait"), "move"} & _claims(sentence):
            near = self._plainly(near, sentence)
        if done := suffered(sentence):  # how common it is to do it says nothing
            near = [n for n in near if suffered(n.caption.text) or n.cosine >= NEARLY_ALIKE]
            support = max((n.caption.support for n in near), default=support)
            shows = max(done.values())
            if shows not in ("", sentence) and not (near and near[0].is_near):
                return replace(self.choice(shows), sentence=sentence)
        if len(content_words(sentence)) == 1 and not _claims(sentence) <= {*kinds("low")}:
            special = [n for n in near if n.caption.support == DRAWN and _says_more(n, sentence)]
            if special:  # what is farther is near by chance
                near = [n for n in near if n not in special and n.cosine >= NEARLY_ALIKE]
                support = max((n.caption.support for n in near), default=support)
        if not near:
            return Choice(tuple(every[:1]), max(support, OFTEN), sentence)
        near = near[:MOST_CHOICES]
        alike = [neighbor for neighbor in near if neighbor.cosine >= near[0].cosine - ALIKE]
        # "Waves" is as near to waving while walking as to waving at a friend.
        if not _gaits_of(sentence):
            stands = [n for n in alike if not _gaits_of(n.caption.text)]
            alike = alike if near[0].caption.support == SHOWN else stands or alike
        # A clip that was shown, or else drawn, for a sentence takes turns with none that was not.
        shown = [neighbor for neighbor in alike if neighbor.caption.support == SHOWN]
        drawn = [neighbor for neighbor in alike if neighbor.caption.support == DRAWN]
        beside = -np.inf  # support up to which recorded captions beside it do not stand against it
        if drawn and (
            drawn[0].cosine >= ALIKE_WORDS or _claims(sentence) <= self._claims_of(drawn[0])
        ):
            as_near = drawn[0].cosine >= alike[0].cosine - EQUAL
            most = np.inf if drawn[0].cosine >= ALIKE_WORDS else OFTEN
            beside = RARE if drawn[0].cosine < NEARLY_ALIKE else most if as_near else USUAL
        if shown:
            same, support = shown, SHOWN
        elif support <= beside:
            same, support = drawn, DRAWN
        else:
            first = alike[0].caption.support == DRAWN
            same = drawn if first else [n for n in alike if n not in drawn]
            gaits = _gaits_of(sentence) if first else ()
            if gaits:  # who does not go in all the ways that are asked for, by one caption
                texts = self.index.texts_of(drawn[0].caption.clip)
                ways = {gait.direction for text in texts for gait in _gaits_of(text)}
                goes = ways and (ways | {""}).issuperset(gait.direction for gait in gaits)
                support = support if goes else max(support, OFTEN)
        if same is drawn and "turn" in _claims(sentence) - self._claims_of(drawn[0]):
            support = max(support, OFTEN)  # "rotate rightward" is no turn of the torso alone
        return Choice(tuple(self._on_side(n, sentence) for n in same), support, sentence)

    def _plainly(self, near: list[Neighbor], sentence: str) -> list[Neighbor]:
        """Returns clips near a gait but those drawn for more than it, none if they are much nearer.

        Who "walks forward" does not walk "forward and back": noise makes a plain gait.
        """
        if len(clauses_of(sentence, self.is_word)) > 1:
            return near
        plain = [
            n
            for n in near
            if n.caption.support != DRAWN
            or n.cosine >= ALIKE_WORDS
            or len(clauses_of(n.caption.text, self.is_word)) == 1
        ]
        far = plain and plain[0].cosine < near[0].cosine - ABOUT
        return [] if far else plain

    def _names(self, captions: Sequence[str], clauses: Sequence[str]) -> bool:
        """Whether captions have the verb of each clause, in any form."""
        words = {*chain(*map(words_of, captions))}
        verbs = [verb_of(clause, self.is_word) for clause in clauses]
        return all(words & (other_forms(verb) | {verb}) for verb in verbs)

    def _in_order(self, caption: str, clauses: Sequence[str]) -> bool:
        """Whether a caption has those verbs of clauses that it has in the order of the clauses.

        A verb may return: "walks forward, turns around and walks back".
        """
        words, place = words_of(caption), 0
        for clause in clauses:
            verb = verb_of(clause, self.is_word)
            forms = other_forms(verb) | {verb}
            places = [n for n, word in enumerate(words) if word in forms]
            if places and places[-1] < place:
                return False
            place = next((n for n in places if n >= place), place)
        return True

    def _claims_of(self, neighbor: Neighbor) -> frozenset[str]:
        """Returns the kinds of what the captions of a clip tell of that can be measured."""
        return frozenset().union(*map(_claims, self.index.texts_of(neighbor.caption.clip)))

    @cached_property
    def _drawn_by_word(self) -> dict[str, dict[int, frozenset[str]]]:
        # By each of their words the captions of drawn clips: number and all words of each.
        drawn: dict[str, dict[int, frozenset[str]]] = {}
        for number, caption in enumerate(self.index.captions):
            words = content_words(caption.text) if caption.support == DRAWN else ()
            for word in words:
                drawn.setdefault(word, {})[number] = frozenset(words)
        return drawn

    def _said(self, sentence: str) -> Neighbor | None:
        """Returns the drawn clip whose caption says the most of a sentence and nothing else.

        "A tennis player tosses the ball up and serves" is as near to much else as to "a tennis
        serve", whose words it has.
        """
        forms = {word: other_forms(word) | {word} for word in content_words(sentence)}
        weights = {word: self.index.weight(forms[word]) for word in forms}
        every_form = frozenset().union(*forms.values())
        telling: dict[int, frozenset[str]] = {}  # captions that have a word of weight
        for form in chain(*(forms[word] for word in forms if weights[word] >= LEAST_WEIGHT)):
            telling |= self._drawn_by_word.get(form, {})
        said: dict[float, list[int]] = {}
        for number in sorted(telling):
            words = telling[number]
            if words <= every_form:
                shared = (weights[word] for word in forms if words & forms[word])
                said.setdefault(sum(shared), []).append(number)
        most = max(said, default=0.0)
        if most < LEAST_SAID * sum(weights.values()) or not said:
            return None
        versions = [self._sides(text) for text in lookups(sentence)]
        near = (self.index.neighbor(n, sides) for n in said[most] for sides in versions)
        neighbor = max(near, key=lambda neighbor: neighbor.cosine)
        caption = neighbor.caption.text
        lacks = "both" in content_words(sentence) - content_words(caption)
        walks = _gaits_of(sentence) and not _gaits_of(caption)
        if lacks or walks or not (neighbor.is_near and _fits(caption, sentence)):
            return None
        return self._on_side(neighbor, sentence)

    def _on_side(self, neighbor: Neighbor, sentence: str) -> Neighbor:
        """Returns a clip that was shown or drawn on the side that a sentence names.

        The nearest caption may name the other side, or none; another of the same clip says then
        which one it shows.
        """
        named, caption = named_sides(sentence), neighbor.caption
        if len(named) != 1 or caption.support > SHOWN:
            return neighbor
        texts = [caption.text] if named_sides(caption.text) else self.index.texts_of(caption.clip)
        shown = set().union(*(sides for sides in map(named_sides, texts) if len(sides) == 1))
        return replace(neighbor, mirrored=named != shown) if len(shown) == 1 else neighbor


def _text_of(neighbor: Neighbor) -> str:
    """Returns the caption of a clip, of a mirrored one with its sides exchanged."""
    text = neighbor.caption.text
    return mirror_words(text) if neighbor.mirrored else text


def _in_turn(caption: str, sentence: str, clauses: Sequence[str]) -> bool:
    """Whether a caption may tell of movements in a row: not of one meanwhile, or of one side.

    "Jump kick" is no kick, then a jump. It names the sides that the clauses of the sentence name,
    or none.
    """
    named = {*chain(*map(named_sides, clauses))}
    if not named <= (named_sides(caption) or named):
        return False
    if len(parts_of(sentence)) == 1 or len(parts_of(caption)) > 1:
        return True
    words = {*words_of(caption)}
    row = "," in caption or not words.isdisjoint(("and", "before", "after"))
    return row and "while" not in words and len(named_sides(sentence)) < 2


def _says_more(neighbor: Neighbor, sentence: str) -> bool:
    """Whether a caption that is not the same repeats a sentence and says more.

    Who spins does not spin on the back: noise makes a plain act that can be claimed.
    """
    words, caption = content_words(sentence), content_words(neighbor.caption.text)
    said = [caption & (other_forms(word) | {word}) for word in words]
    more = all(said) and caption - frozenset().union(*said)
    return bool(more) and neighbor.cosine < ALIKE_WORDS


def _gaits_of(sentence: str) -> list[Claim]:
    return [claim for claim in request_of(sentence).claims if claim.kind in kinds("gait")]


def _fits(caption: str, sentence: str) -> bool:
    """Whether a caption says nothing against a sentence: "off" for "onto", a way for "in place".

    Who is hit does not hit; who puts both hands up does not put a hand up.
    """
    said, words = {*words_of(sentence)}, {*words_of(caption)}
    against = any(
        said & word and words & opposite and not said & opposite and not words & word
        for word, opposite in opposites()
    )
    active, passive = suffered(sentence).keys() & words, suffered(caption).keys() & said
    told = "him" in words and not words.isdisjoint(("someone", "somebody"))  # "someone pushes him"
    against |= bool(active) and not (suffered(caption) or "him" in words)
    against |= (bool(passive) or told) and not suffered(sentence) and "him" not in said
    against |= "both" in said and len(named_sides(caption)) == 1
    single = {noun for lead, noun in pairwise(words_of(caption)) if lead in listed("determiner")}
    against |= any(
        limb in single and limbs in said - words for limb, limbs in data("words.toml")["limbs"]
    )
    ways = [{gait.direction == "place" for gait in _gaits_of(text)} for text in (sentence, caption)]
    return not against and (ways[0] == ways[1] or True not in ways[0] | ways[1])


def _claims(sentence: str) -> frozenset[str]:
    """Returns the kinds of what a sentence asks for that can be measured."""
    return frozenset(claim.kind for claim in request_of(sentence).claims)
