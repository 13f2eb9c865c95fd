"""Starting from the nearest clip: what sampling begins with where a sentence names a rare movement.

    sentence → nearest captions → latents of their clips, stretched to the length that is wanted
    z_t = alpha(t) z_0 + sigma(t) epsilon, then the last steps with the sentence itself

A denoiser averages movements away that few clips show; started from such a clip at half of the
steps it keeps the movement, and sentence, seed and length still shape it (SDEdit, Meng et al. 2022;
figures in lab/diary/rare_acts.md). Frequent movements start from pure noise, as before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask, unit
from latentmotion.condition import TextEncoder
from latentmotion.corrections import NO_CORRECTIONS
from latentmotion.engine.backend import FeatureEncoder
from latentmotion.engine.request import GenerationRequest, Start
from latentmotion.language.acts import lookups
from latentmotion.language.claims import Claim, both_sides, kinds
from latentmotion.language.reading import asked_exactly, request_of, usual_range
from latentmotion.language.words import (
    content_words,
    listed,
    named_sides,
    other_forms,
    parts_of,
    tokens_of,
)
from latentmotion.model.card import ModelCard
from latentmotion.representation.interface import Representation
from latentmotion.retrieval.doubts import Doubts, Reading
from latentmotion.retrieval.index import (
    ALIKE_WORDS,
    DRAWN,
    OFTEN,
    RARE,
    SHOWN,
    ClipIndex,
    IndexedCaption,
    Neighbor,
)

UNRELATED, UNRELATED_OF_DRAWN = 0.55, 0.4
"""Cosine up to which a caption says nothing of what a sentence asks for; the short sentences of
drawn clips are still right where longer captions are not (by two lists of 80 prompts)."""

USUAL = 60.0
"""Support of a movement that succeeds from noise about as often as from a clip."""

NEARLY_ALIKE = 0.8
"""Cosine from which a sentence says nearly the same as one of a drawn clip, which it then starts
from where no more than OFTEN clips support captions that are about as near. With this and the rules
below 39 of 817 prompts start from another clip: 26 from what they ask for, five from something near
it, eight from something else."""

LEAST_SAID, LEAST_WEIGHT = 0.45, 4.0
"""Least part of the weight of a sentence's words, and of its weightiest word, that the caption of a
drawn clip must have to be started from for its words alone."""

SHARES = ((SHOWN, 0.25, 0.7), (5, 0.25, 0.0), (RARE, 0.5, 0.0))
"""Largest support, share of the sampling steps that are left after a start, and share of the clip
that stays in the result: the more the denoiser knows of a movement, the more it may change. What
was shown or drawn is what is wanted: one step takes hands 89 mm from it, with 0.7 kept 37 mm."""

ALIKE = 0.03
"""How much farther than the nearest a caption may be for its clip to be another start."""

MOST_CHOICES = 4
"""Clips among which takes take turns."""

LONGEST_STRETCH = 1.4
"""Factor by which a clip may be slowed down or sped up; beyond it is repeated or cut."""

# Meters from which a clip goes somewhere; seconds of a walk before another act; captions among
# which one is looked for.
_WAY, _WALKS, _CAPTIONS_OF_WALKS = 1.2, (1.8, 4.0), 100

# Cosine of both upper limbs with the line between the shoulders, and seconds of it at the start,
# from which a recording begins with a calibration.
_HELD_OUT, _CALIBRATION = 0.6, 0.3


@dataclass(frozen=True)
class Choice:
    """Captions near a movement of a sentence, and how many clips show it."""

    neighbors: tuple[Neighbor, ...]
    """The nearest, and those that are nearly as near; their clips take turns."""
    support: int
    """About how many clips show the movement."""

    @property
    def cosine(self) -> float:
        """Cosine of the nearest."""
        return self.neighbors[0].cosine

    @property
    def is_given(self) -> bool:
        """Whether a clip was shown for the sentence, or drawn for nearly the same words."""
        support = self.neighbors[0].caption.support
        return support == SHOWN or (support == DRAWN and self.cosine >= ALIKE_WORDS)

    @property
    def is_near(self) -> bool:
        """Whether the nearest may show the movement."""
        return self.neighbors[0].is_near


@dataclass(frozen=True)
class ClipStart:
    """Latents of one clip or of several in a row, and what they are of."""

    start: Start
    """Where sampling starts."""
    frames: int
    """Length of the motion."""
    clips: tuple[dict[str, Any], ...]
    """Clips with their owners and terms, as JSON can hold them."""
    advantage: float
    """How much likelier the motion shows what is asked than one from noise, 0 to 1: the nearness of
    sentence and caption, less where many clips support it."""

    def about(self) -> dict[str, Any]:
        """Returns what a file says of the start."""
        return {"from_clips": [*self.clips], "steps_left": self.start.share}


@dataclass(frozen=True)
class ClipStarts:
    """Chooses starts among the clips of an index."""

    card: ModelCard
    """The model."""
    index: ClipIndex
    """The clips."""
    text_encoder: TextEncoder
    """Embeds sentences."""
    encoder: FeatureEncoder
    """Encodes mirrored clips."""
    decode: Callable[[np.ndarray, np.ndarray], np.ndarray]
    """Latents and mask of frames to features: decodes the clips that are mirrored."""
    representation: Representation
    """Mirrors features."""

    @property
    def doubts(self) -> Doubts:
        """Finds what sentences ask for that the clips do not show."""
        return Doubts(self.index, self.text_encoder)

    def neighbors(self, sentence: str, count: int = MOST_CHOICES) -> list[Neighbor]:
        """Returns the captions nearest to a sentence, the nearest first."""
        return self.index.nearest(self._sides(sentence), count)

    def _sides(self, sentence: str) -> Float[np.ndarray, "sides width"]:
        """Returns the embedding of a sentence, and that of its mirror image if it differs."""
        return self.text_encoder(both_sides(sentence)).pooled

    def choices(self, reading: Reading) -> list[Choice]:
        """Returns clips to start from, for each movement of a sentence that follows another.

        A sentence in words of its own claims nothing that a clip could spoil, so that its movement
        may be less rare.

        Returns:
            Nothing where no movement is rare, or where a rare one has no clip near enough.
        """
        parts = [self._choice(part) for part in parts_of(reading.prompt)]
        whole = self._choice(reading.prompt) if len(parts) > 1 else parts[0]
        # A caption that tells of all movements in a row is nearer than captions of each; one that
        # is nearer to a single movement tells of that alone.
        texts = {part.neighbors[0].caption.text: part.cosine for part in parts}
        alone = len(texts) > 1 and texts.get(whole.neighbors[0].caption.text, 0) >= whole.cosine
        if whole.cosine >= min(part.cosine for part in parts) and not alone:
            parts = [whole]
        support = min(part.support for part in parts)
        # Noise has the count or the turn that a sentence asks for exactly more often than a clip,
        # but for a clip that was shown for it, or drawn for the same.
        exactly = asked_exactly(reading.sentence, any_length=True)
        captions = (
            asked_exactly(part.neighbors[0].caption.text, any_length=True) for part in parts
        )
        shown = all(part.support == SHOWN for part in parts)
        drawn = all(part.is_given for part in parts) and exactly in captions
        exact = exactly != NO_CORRECTIONS and not (shown or drawn)
        rare = support <= (USUAL if reading.caption else RARE) and not exact
        if not (rare and all(part.is_near for part in parts)):
            said = None if exact else self._said(reading.prompt)
            return [Choice((said,), DRAWN)] if said else []
        walk = self._approach(reading.prompt, parts)
        # A part for the walk may be there, by a clip that stays on the spot.
        instead = len(parts) > 1 and bool(_gaits_of(parts[0].neighbors[0].caption.text))
        return [*walk, *parts[1 if walk and instead else 0 :]]

    def _approach(self, sentence: str, parts: Sequence[Choice]) -> list[Choice]:
        """Returns a walk to begin with, where a sentence begins with one that its clips lack.

        Clips of single acts stand: "walks to the fridge and drinks" is nearest to drinking alone.
        """
        ends = (t.start for t in tokens_of(sentence) if t.text in listed("then") | {"and", ","})
        head = sentence[: next(ends, 0)].strip()
        gaits = _gaits_of(head)
        if len(gaits) != 1 or gaits[0].direction == "place":
            return []
        for neighbor in (neighbor for part in parts for neighbor in part.neighbors):
            caption = neighbor.caption
            goes = any(gait.direction != "place" for gait in _gaits_of(caption.text))
            if goes or caption.support == SHOWN or self._goes(neighbor):
                return []
        frames_per_token = self.card.latents.frames_per_token or 1
        walks: list[Neighbor] = []
        for near in self.index.nearest(self._sides(head), _CAPTIONS_OF_WALKS):
            claims = request_of(near.caption.text).claims
            same = [(claim.kind, claim.direction in ("", "forward")) for claim in claims]
            seconds = len(self.index.latents_of(near.caption)) * frames_per_token
            seconds /= self.representation.fps
            if same == [(gaits[0].kind, True)] and _WALKS[0] <= seconds <= _WALKS[1]:
                walks += [near] if self._goes(near) else []
            if len(walks) == MOST_CHOICES:
                break
        return [Choice(tuple(walks), self.index.support(self._sides(head)))] if walks else []

    def _goes(self, neighbor: Neighbor) -> bool:
        """Whether a clip goes some way over the floor."""
        joints = self.representation.decode(self._features(neighbor.caption))
        return float(np.linalg.norm(np.diff(joints[:, 0, ::2], axis=0), axis=-1).sum()) > _WAY

    def _features(self, caption: IndexedCaption) -> Float[np.ndarray, "frames features"]:
        latents = self.index.latents_of(caption)
        frames = len(latents) * (self.card.latents.frames_per_token or 1)
        return self.decode(latents[None], prefix_mask([frames]))[0]

    def _calibrates(self, features: Float[np.ndarray, "frames features"]) -> int:
        """Returns how many tokens a recording begins with both arms held out, for calibration."""
        names = list(self.representation.skeleton.names)
        joints, out = self.representation.decode(features), np.ones(len(features), bool)
        for side, other in (("left", "right"), ("right", "left")):
            shoulder, across, wrist = (
                joints[:, names.index(name)]
                for name in (f"{side}_shoulder", f"{other}_shoulder", f"{side}_wrist")
            )
            out &= (unit(wrist - shoulder) * unit(shoulder - across)).sum(axis=-1) > _HELD_OUT
        frames = int(np.argmin(out)) if not out.all() else 0
        per_token = self.card.latents.frames_per_token or 1
        usual = frames >= _CALIBRATION * self.representation.fps and 2 * frames < len(features)
        return -(-frames // per_token) if usual else 0

    def _choice(self, sentence: str) -> Choice:
        versions = (self._sides(text) for text in lookups(sentence))
        nearest = [(sides, self.index.nearest(sides, MOST_CHOICES)) for sides in versions]
        sides, near = max(nearest, key=lambda version: version[1][0].cosine)
        alike = [neighbor for neighbor in near if neighbor.cosine >= near[0].cosine - ALIKE]
        # "Waves" is as near to waving while walking as to waving at a friend.
        if not _gaits_of(sentence):
            stands = [n for n in alike if not _gaits_of(n.caption.text)]
            alike = alike if near[0].caption.support == SHOWN else stands or alike
        # A clip that was shown, or else drawn, for a sentence takes turns with none that was not.
        shown = [neighbor for neighbor in alike if neighbor.caption.support == SHOWN]
        drawn = [neighbor for neighbor in alike if neighbor.caption.support == DRAWN]
        support = self.index.support(sides)
        if shown:
            same, support = shown, SHOWN
        elif (
            drawn
            and support <= _most_beside(drawn[0], drawn[0] is alike[0])
            and (
                drawn[0].cosine >= ALIKE_WORDS
                or _claims(sentence) <= _claims(drawn[0].caption.text)
            )
        ):
            same, support = drawn, DRAWN
        else:
            first = alike[0].caption.support == DRAWN
            same = drawn if first else [n for n in alike if n not in drawn]
        return Choice(tuple(self._on_side(neighbor, sentence) for neighbor in same), support)

    @cached_property
    def _said_by_drawn(self) -> list[tuple[frozenset[str], int]]:
        # The words of each caption of a drawn clip, and its number.
        return [
            (content_words(caption.text), number)
            for number, caption in enumerate(self.index.captions)
            if caption.support == DRAWN
        ]

    def _said(self, sentence: str) -> Neighbor | None:
        """Returns the drawn clip whose caption says the most of a sentence and nothing else.

        "A tennis player tosses the ball up and serves" is as near to much else as to "a tennis
        serve", whose words it has.
        """
        forms = {word: other_forms(word) | {word} for word in content_words(sentence)}
        weights = {word: self._weight(forms[word]) for word in forms}
        every_form = frozenset().union(*forms.values())
        said: dict[float, list[int]] = {}
        for words, number in self._said_by_drawn:
            if words and words <= every_form:
                shared = [weights[word] for word in forms if words & forms[word]]
                if max(shared) >= LEAST_WEIGHT:
                    said.setdefault(sum(shared), []).append(number)
        most = max(said, default=0.0)
        if most < LEAST_SAID * sum(weights.values()) or not said:
            return None
        versions = [self._sides(text) for text in lookups(sentence)]
        near = (self.index.neighbor(n, sides) for n in said[most] for sides in versions)
        neighbor = max(near, key=lambda neighbor: neighbor.cosine)
        caption = neighbor.caption.text
        lacks = "both" in content_words(sentence) - content_words(caption)
        if lacks or not neighbor.is_near or (_gaits_of(sentence) and not _gaits_of(caption)):
            return None
        return self._on_side(neighbor, sentence)

    def _weight(self, forms: frozenset[str]) -> float:
        """Returns how much a word says: the logarithm of how few captions have a form of it."""
        words = self.index.words
        most = max(words.values(), default=1)
        return math.log(most / (1 + max(words.get(form, 0) for form in forms)))

    def _on_side(self, neighbor: Neighbor, sentence: str) -> Neighbor:
        """Returns a clip that was shown or drawn on the side that a sentence names.

        The nearest caption may name no side; another of the same clip says which one it shows.
        """
        named, caption = named_sides(sentence), neighbor.caption
        if len(named) != 1 or caption.support > SHOWN or named_sides(caption.text):
            return neighbor
        texts = [other.text for other in self.index.captions if other.clip == caption.clip]
        shown = set().union(*(sides for sides in map(named_sides, texts) if len(sides) == 1))
        return replace(neighbor, mirrored=named != shown) if len(shown) == 1 else neighbor

    def starts(
        self,
        readings: Sequence[Reading],
        request: GenerationRequest,
        free: Sequence[bool],
        wanted: Sequence[bool],
    ) -> list[ClipStart | None]:
        """Returns what each motion of a request starts from, None for pure noise.

        Args:
            readings: Their sentences.
            request: The motions.
            free: Whether nobody gave the length of each.
            wanted: Whether each may start from a clip.
        """
        choices = {reading: self.choices(reading) for reading in dict.fromkeys(readings)}
        return [
            self.start(
                choices[reading],
                None if any_length else frames,
                seed,
                usual_range(reading.sentence) if any_length else None,
            )
            if take and choices[reading]
            else None
            for reading, frames, seed, take, any_length in zip(
                readings, request.frames, request.seeds, wanted, free, strict=True
            )
        ]

    def nearest_start(self, reading: Reading, frames: int, seed: int) -> ClipStart:
        """Returns a start from the clips nearest to a sentence, however usual its movement is.

        Args:
            reading: The sentence.
            frames: Length of the motion.
            seed: Takes turns among the clips.
        """
        return self.start([self._choice(reading.prompt)], frames, seed)

    def start(
        self,
        choices: Sequence[Choice],
        frames: int | None,
        seed: int,
        limits: tuple[float, float] | None = None,
    ) -> ClipStart:
        """Returns what a motion starts from.

        Args:
            choices: Clips for each movement of the sentence.
            frames: Length of the motion; by default that of the clips.
            seed: Takes turns among them.
            limits: Seconds that what the sentence asks for lasts at least and at most; a longer
                clip is made as short.
        """
        chosen = [choice.neighbors[seed % len(choice.neighbors)] for choice in choices]
        shortest, longest = self.card.frames
        per_token = self.card.latents.frames_per_token or 1
        parts = [self._latents(neighbor) for neighbor in chosen]
        if frames is None:
            frames = sum(map(len, parts)) * per_token
            shown = any(choice.support == SHOWN for choice in choices)
            most = limits[1] * self.representation.fps if limits and not shown else longest
            frames = int(min(max(frames, shortest), longest, most))
        tokens = self.card.latents.tokens_of(frames)
        shares = np.cumsum([0, *map(len, parts)]) / sum(map(len, parts))
        ends = np.round(shares * tokens).astype(int)
        latents = [
            stretched(part, max(int(end - start), 1))
            for part, start, end in zip(parts, ends, ends[1:], strict=False)
        ]
        joined = np.concatenate(latents)[:tokens]
        about = tuple(self.index.about(neighbor) for neighbor in chosen)
        rarest = min(choices, key=lambda choice: choice.support)
        support = rarest.support
        left, keep = next(((s, k) for most, s, k in SHARES if support <= most), SHARES[-1][1:])
        usual = USUAL / (USUAL + max(support, 0))
        unrelated = UNRELATED_OF_DRAWN if support == DRAWN else UNRELATED
        likely = max(rarest.cosine - unrelated, 0.0) / (1 - unrelated)
        return ClipStart(Start(joined, left, keep), frames, about, likely * usual)

    def _latents(self, neighbor: Neighbor) -> Float[np.ndarray, "tokens width"]:
        """Returns the latents of a neighbor's clip, or of its mirror image."""
        latents = self.index.latents_of(neighbor.caption)
        recorded = neighbor.caption.support > SHOWN
        if not (neighbor.mirrored or recorded):
            return latents
        features = self._features(neighbor.caption)
        begin = self._calibrates(features) if recorded else 0
        if neighbor.mirrored:
            latents = self.encoder(self.representation.mirror(features))[: len(latents)]
        return latents[begin:]


def _most_beside(drawn: Neighbor, nearest: bool) -> float:
    """Returns up to which support of recorded captions beside it a drawn clip is started from."""
    if drawn.cosine < NEARLY_ALIKE:
        return RARE
    if not nearest:
        return USUAL
    return np.inf if drawn.cosine >= ALIKE_WORDS else OFTEN


def _gaits_of(sentence: str) -> list[Claim]:
    return [claim for claim in request_of(sentence).claims if claim.kind in kinds("gait")]


def _claims(sentence: str) -> frozenset[str]:
    """Returns the kinds of what a sentence asks for that can be measured."""
    return frozenset(claim.kind for claim in request_of(sentence).claims)


def stretched(
    latents: Float[np.ndarray, "tokens width"], tokens: int
) -> Float[np.ndarray, "longer width"]:
    """Returns latents in another timing: slowed down or sped up a little, else repeated or cut.

    Args:
        latents: Of a clip.
        tokens: How many are wanted.
    """
    longest, shortest = len(latents) * LONGEST_STRETCH, len(latents) / LONGEST_STRETCH
    if tokens > longest:
        repeats = int(np.ceil(tokens / longest))
        latents = np.concatenate([latents] * repeats)
    elif tokens < shortest:
        spare = len(latents) - int(np.floor(tokens * LONGEST_STRETCH))
        latents = latents[spare // 2 : len(latents) - (spare - spare // 2)]
    at = np.linspace(0, len(latents) - 1, tokens)
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, len(latents) - 1)
    part = (at - low)[:, None].astype(latents.dtype)
    return latents[low] * (1 - part) + latents[high] * part
