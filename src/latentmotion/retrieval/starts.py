"""Starting from the nearest clip: what sampling begins with where a sentence names a rare movement.

    choices of clips (`choices.py`) → their latents, joined, stretched to the length that is wanted
    z_t = alpha(t) z_0 + sigma(t) epsilon, then the last steps with the sentence itself

A denoiser averages movements away that few clips show; started from such a clip at half of the
steps it keeps the movement, and sentence, seed and length still shape it (SDEdit, Meng et al. 2022;
figures in lab/diary/rare_acts.md). Frequent movements start from pure noise, as before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask, unit
from latentmotion.engine.backend import FeatureEncoder
from latentmotion.engine.request import GenerationRequest, Start
from latentmotion.language.reading import asked_exactly, request_of, usual_range
from latentmotion.language.words import listed, words_of
from latentmotion.measure.repetitions import repetitions
from latentmotion.model.card import ModelCard
from latentmotion.representation.canonical import heading, turn
from latentmotion.representation.interface import Representation
from latentmotion.retrieval.choices import USUAL, Choice, Chooser
from latentmotion.retrieval.doubts import Reading
from latentmotion.retrieval.index import DRAWN, RARE, SHOWN, Neighbor
from latentmotion.retrieval.layers import is_gesture, layered, lowest, stands

# Cosine up to which a caption says nothing of what a sentence asks for; the short sentences of
# drawn clips are still right where longer captions are not (by two lists of 80 prompts).
UNRELATED, UNRELATED_OF_DRAWN = 0.55, 0.4

# Largest support, share of the sampling steps that are left after a start, and share of the clip
# that stays in the result: the more the denoiser knows of a movement, the more it may change. What
# was shown or drawn is what is wanted: one step takes hands 89 mm from it, with 0.7 kept 37 mm.
SHARES = ((SHOWN, 0.25, 0.7), (5, 0.25, 0.0), (RARE, 0.5, 0.0))

# Factor by which a clip may be slowed down or sped up; beyond it is repeated or cut.
LONGEST_STRETCH = 1.4

# Speed at which the joints go from one movement to the next, m/s; most seconds of it.
_SEAM, _LONGEST_SEAM = 0.6, 1.6

# Mean difference of the joints' heights in meters up to which two poses are the same, and from
# which they differ as standing and sitting do.
_SAME, _OTHER = 0.12, 0.25

# Meters above the floor from which one has climbed.
_UP = 0.3

# Most seconds of a movement that is sampled beside others from clips.
LONGEST_SAMPLED = 4.0

# Movements that are kept as features, some 80 kB each.
_KEPT = 16

# Cosine of both upper limbs with the line between the shoulders, and seconds of it at the start,
# from which a recording begins with a calibration.
_HELD_OUT, _CALIBRATION = 0.6, 0.3


@dataclass(frozen=True)
class ClipStart:
    """Latents of one clip or of several in a row, and what they are of."""

    start: Start  # Where sampling starts.
    frames: int  # Length of the motion.
    clips: tuple[dict[str, Any], ...]  # Clips with their owners and terms, as JSON can hold them.
    movements: int  # How many follow each other.
    # How much likelier the motion shows what is asked than one from noise, 0 to 1: the nearness of
    # sentence and caption, less where many clips support it.
    advantage: float

    def about(self) -> dict[str, Any]:
        """Returns what a file says of the start."""
        return {"from_clips": [*self.clips], "steps_left": self.start.share}


@dataclass(frozen=True)
class ClipStarts:
    """Makes starts of the clips that are chosen for sentences."""

    card: ModelCard  # The model.
    chooser: Chooser  # Chooses clips.
    encoder: FeatureEncoder  # Encodes mirrored clips.
    # Latents and mask of frames to features: decodes the clips that are mirrored.
    decode: Callable[[np.ndarray, np.ndarray], np.ndarray]
    representation: Representation  # Mirrors features.
    # Features of one movement of a sentence, sampled from noise for each seed of a request.
    # As many frames as are given, or as is usual.
    sample: Callable[[str, GenerationRequest, int | None], list[np.ndarray]]
    # What was decoded last: the ends of a movement are compared with those before it and after it,
    # and takes of a sentence share their clips. Decoding takes 2 ms each time.
    _latest: dict[bytes, Float[np.ndarray, "frames features"]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def _decoded(
        self, latents: Float[np.ndarray, "tokens width"]
    ) -> Float[np.ndarray, "frames features"]:
        key = latents.tobytes()
        features = self._latest.get(key)
        if features is None:
            frames = len(latents) * self._frames_per_token
            features = self.decode(latents[None], prefix_mask([frames]))[0]
            if len(self._latest) >= _KEPT:
                self._latest.clear()
            self._latest[key] = features
        return features

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
        usual = frames >= _CALIBRATION * self.representation.fps and 2 * frames < len(features)
        return -(-frames // self._frames_per_token) if usual else 0

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
        choices = {reading: self.chooser.choices(reading) for reading in dict.fromkeys(readings)}
        rows: dict[Reading, list[int]] = {}
        for row, (reading, take, any_length) in enumerate(zip(readings, wanted, free, strict=True)):
            if (
                take
                and choices[reading]
                and self._is_countable(reading, choices[reading], any_length)
            ):
                rows.setdefault(reading, []).append(row)
        starts: list[ClipStart | None] = [None] * len(readings)
        for reading, taken in rows.items():
            requests = [request.take([row]) for row in taken]
            # What a sentence's takes sample from noise is sampled together.
            beside = {
                choice.sentence: self.sample(choice.sentence, request.take(taken), None)
                for choice in choices[reading]
                if not choice.neighbors
            }
            for number, row in enumerate(taken):
                starts[row] = self.start(
                    choices[reading],
                    None if free[row] else request.frames[row],
                    requests[number],
                    usual_range(reading.sentence) if free[row] else None,
                    {sentence: takes[number] for sentence, takes in beside.items()},
                )
        return starts

    def _is_countable(self, reading: Reading, choices: Sequence[Choice], any_length: bool) -> bool:
        """Whether a drawn clip shows what a sentence counts, so that clean-up can correct it."""
        count = asked_exactly(reading.sentence, any_length=True).count
        if count is None or len(choices) > 1 or choices[0].support != DRAWN:
            return True
        caption = choices[0].neighbors[0].caption
        if asked_exactly(caption.text, any_length=True).count == count:
            return True
        features = self._decoded(self._latents(choices[0].neighbors[0]))
        joints = self.representation.decode(features).astype(np.float64)
        shown = repetitions(joints, count.act) if any_length else None
        return shown is not None and bool(shown.full)

    def nearest_start(self, reading: Reading, frames: int, request: GenerationRequest) -> ClipStart:
        """Returns a start from the clips nearest to a sentence, however usual its movement is.

        Args:
            reading: The sentence.
            frames: Length of the motion.
            request: The motion; its seed takes turns among the clips.
        """
        return self.start([self.chooser.choice(reading.prompt)], frames, request)

    def start(
        self,
        choices: Sequence[Choice],
        frames: int | None,
        request: GenerationRequest,
        limits: tuple[float, float] | None = None,
        beside: Mapping[str, np.ndarray] | None = None,
    ) -> ClipStart:
        """Returns what a motion starts from.

        Args:
            choices: Clips for each movement of the sentence.
            frames: Length of the motion; by default that of the clips.
            request: The motion; its seed takes turns among them.
            limits: Seconds that what the sentence asks for lasts at least and at most; a longer
                clip is made as short.
            beside: Features of each movement of the sentence that is sampled from noise.
        """
        (seed,) = request.seeds
        rarest = min((c for c in choices if c.neighbors), key=lambda choice: choice.support)
        chosen = [choice.clip_for(seed) for choice in choices]
        parts = self._parts(choices, chosen, request, beside or {})
        needed = self._needed(parts)
        choices, chosen = [choices[n] for n in needed], [chosen[n] for n in needed]
        parts = [parts[n] for n in needed]
        sentence = " ".join(choice.sentence for choice in choices)
        if len(parts) > 1 and any(c.kind == "climb" for c in request_of(sentence).claims):
            parts = self._staying_up(parts, choices)
        seams = [self._seam(*pair) for pair in pairwise(parts)]
        if frames is None:
            parts, frames = self._lengths(parts, seams, choices, chosen, limits)
        support = rarest.support
        left, keep = next(((s, k) for most, s, k in SHARES if support <= most), SHARES[-1][1:])
        if len(parts) > 1:  # each movement is as it is wanted but for the seams between
            left = SHARES[0][1]
        latents, keeps = joined(parts, seams, self.card.latents.tokens_of(frames), keep)
        start = Start(latents, left, keeps)
        usual = USUAL / (USUAL + max(support, 0))
        unrelated = UNRELATED_OF_DRAWN if support == DRAWN else UNRELATED
        likely = max(rarest.cosine - unrelated, 0.0) / (1 - unrelated)
        beneath = [choice.under.clip_for(seed) for choice in choices if choice.under]
        about = tuple(self.chooser.index.about(clip) for clip in [*chosen, *beneath] if clip)
        return ClipStart(start, frames, about, len(choices), likely * usual)

    def _lengths(
        self,
        parts: Sequence[Float[np.ndarray, "_ width"]],
        seams: Sequence[int],
        choices: Sequence[Choice],
        chosen: Sequence[Neighbor | None],
        limits: tuple[float, float] | None,
    ) -> tuple[list[Float[np.ndarray, "_ width"]], int]:
        """Returns movements in a row at the pace that is asked for, and the frames of the row."""
        paced: list[np.ndarray] = []
        for part, choice, neighbor in zip(parts, choices, chosen, strict=True):
            caption = neighbor.caption.text if neighbor else choice.sentence
            said = {*words_of(choice.sentence)} - {*words_of(caption)}
            slow, fast = (not listed(pace).isdisjoint(said) for pace in ("slow", "fast"))
            paced.append(stretched(part, round(LONGEST_STRETCH ** (slow - fast) * len(part))))
        shortest, longest = self.card.frames
        if limits and len(choices) == 1 and choices[0].support != SHOWN:
            longest = int(min(longest, limits[1] * self.representation.fps))
        frames = (sum(map(len, paced)) + sum(seams)) * self._frames_per_token
        return paced, min(max(frames, shortest), longest)

    @property
    def _frames_per_token(self) -> int:
        return self.card.latents.frames_per_token or 1

    def _parts(
        self,
        choices: Sequence[Choice],
        chosen: Sequence[Neighbor | None],
        request: GenerationRequest,
        beside: Mapping[str, np.ndarray],
    ) -> list[Float[np.ndarray, "_ width"]]:
        """Returns the latents of each movement, gestures over what the body does beneath."""
        parts: list[np.ndarray] = []
        for choice, neighbor in zip(choices, chosen, strict=True):
            latents = self._latents(neighbor) if neighbor else self.encoder(beside[choice.sentence])
            drawn = neighbor is not None and neighbor.caption.support == DRAWN
            if drawn and (choice.under or parts):
                latents = self._layered(latents, choice.under, parts, request)
            parts.append(latents)
        return parts

    def _layered(
        self,
        latents: Float[np.ndarray, "tokens width"],
        under: Choice | None,
        parts: list[np.ndarray],
        request: GenerationRequest,
    ) -> Float[np.ndarray, "tokens width"]:
        """Returns a gesture over what the body does meanwhile; any other movement as it is.

        Args:
            latents: Of the movement.
            under: What the body does meanwhile; by default it stays as the movement before left it
                where it does not stand: who sits stays on the seat while waving.
            parts: The movements before; the last is cut where it begins to rise.
            request: The motion.
        """
        names, gesture = list(self.representation.skeleton.names), self._joints(latents)
        if not is_gesture(gesture, names):
            return latents
        if under:
            clip = under.clip_for(request.seeds[0])
            beneath = (
                stretched(self._latents(clip), len(latents))
                if clip
                else self.encoder(self.sample(under.sentence, request, len(gesture))[0])
            )
            body = self._joints(beneath)[: len(gesture)]
        else:
            before = self._joints(parts[-1])
            if stands(before, names)[-1]:
                return latents
            last = lowest(before, names)
            parts[-1] = parts[-1][: last // self._frames_per_token + 1]
            body = np.repeat(before[last : last + 1], len(gesture), axis=0)
        features = self.representation.encode(layered(body, gesture, names))
        return self.encoder(features)[: len(latents)]

    def _joints(
        self, latents: Float[np.ndarray, "tokens width"]
    ) -> Float[np.ndarray, "frames joints 3"]:
        return self.representation.decode(self._decoded(latents)).astype(np.float64)

    def _latents(self, neighbor: Neighbor) -> Float[np.ndarray, "tokens width"]:
        """Returns the latents of a neighbor's clip, or of its mirror image."""
        latents = self.chooser.index.latents_of(neighbor.caption)
        recorded = neighbor.caption.support > SHOWN
        if not (neighbor.mirrored or recorded):
            return latents
        features = self._decoded(latents)
        begin = self._calibrates(features) if recorded else 0
        if neighbor.mirrored:
            latents = self.encoder(self.representation.mirror(features))[: len(latents)]
        return latents[begin:]

    def _needed(self, parts: Sequence[Float[np.ndarray, "_ width"]]) -> list[int]:
        """Returns which movements in a row are needed: who lies after a shot falls no more.

        One is left out that goes over to another pose, if the one before it ends in that pose.
        Poses are compared by the heights of joints above the lowest.
        """
        needed: list[int] = []
        before: np.ndarray | None = None
        for number, part in enumerate(parts if len(parts) > 1 else ()):
            heights = self._joints(part)[[0, -1], :, 1]
            begin, end = heights - heights.min(axis=1, keepdims=True)
            goes_over = np.abs(end - begin).mean() > _OTHER
            if before is None or not goes_over or np.abs(end - before).mean() > _SAME:
                needed.append(number)
                before = end
        return needed or [*range(len(parts))]

    def _seam(
        self, before: Float[np.ndarray, "_ width"], after: Float[np.ndarray, "_ width"]
    ) -> int:
        """Returns how many tokens lie between two movements, so that joints have time to go over.

        Poses are compared in the way that they face, above the same place.
        """
        space, poses = self.representation, []
        for latents, frame in ((before, -1), (after, 0)):
            joints = self._joints(latents)[frame]
            joints[:, [0, 2]] -= joints[0, [0, 2]]
            poses.append(turn(joints, -heading(joints, space.skeleton)))
        apart = float(np.linalg.norm(poses[1] - poses[0], axis=-1).mean())
        seconds = min(apart / _SEAM, _LONGEST_SEAM)
        return max(round(seconds * space.fps / self._frames_per_token), 1)

    def _staying_up(
        self, parts: Sequence[Float[np.ndarray, "_ width"]], choices: Sequence[Choice]
    ) -> list[Float[np.ndarray, "_ width"]]:
        """Returns movements in a row of which none that begins on the floor follows a climb there.

        Who has climbed a ladder waves from its top.
        """
        space, up = self.representation, [parts[0]]
        for part, choice in zip(parts[1:], choices[1:], strict=True):
            features = self._decoded(part)
            begin, end = (
                float(space.decode(those)[frame, :, 1].min())
                for those, frame in ((features, 0), (self._decoded(up[-1]), -1))
            )
            stays = {"down", "off"}.isdisjoint(words_of(choice.sentence))
            if stays and "root_height" in space.blocks and begin < _UP < end - begin:
                raised, positions = features.copy(), space.blocks["positions"]
                raised[:, space.blocks["root_height"]] += end - begin
                raised[:, positions.start + 1 : positions.stop : 3] += end - begin
                part = self.encoder(raised)
            up.append(part)
        return up


def joined(
    parts: Sequence[Float[np.ndarray, "_ width"]], seams: Sequence[int], tokens: int, keep: float
) -> tuple[Float[np.ndarray, "tokens width"], Float[np.ndarray, " tokens"]]:
    """Returns movements in a row, and the share of each token that stays in the result.

    Args:
        parts: Latents of each movement.
        seams: Tokens between two, which go evenly from the last pose to the next.
        tokens: How long all are together.
        keep: Share of what stays of a movement; of a seam nothing does.
    """
    most = tokens // (2 * len(parts))  # a short motion has short seams
    seams = [0, *(min(seam, most) for seam in seams)]
    shares = np.cumsum([0, *map(len, parts)]) / sum(map(len, parts))
    ends = np.round(shares * (tokens - sum(seams))).astype(int)
    row: list[np.ndarray] = []
    keeps: list[float] = []
    for part, seam, length in zip(parts, seams, np.diff(ends), strict=True):
        part = stretched(part, max(int(length), 1))
        if seam:
            share = np.linspace(0, 1, seam + 2, dtype=part.dtype)[1:-1, None]
            row.append(row[-1][-1] * (1 - share) + part[0] * share)
        row.append(part)
        keeps += [0.0] * seam + [keep] * len(part)
    return np.concatenate(row)[:tokens], np.array(keeps[:tokens])


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
