"""Index of clips: their latents and captions, in few bits, which sampling starts from.

    latents (tokens, width) · embeddings of captions (captions, width) · clips, spans, owners, terms

A file is a safetensors file within zlib; its array `text` is JSON. Indexes are joined: that which
ships with a model, and those that a user taught (`teach.py`).
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
import zlib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from safetensors import SafetensorError
from safetensors.numpy import load, save

from latentmotion.arrays import unit
from latentmotion.data.clip import Source
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import MOVES_FILE
from latentmotion.model.config import LatentSpace
from latentmotion.storage.configuration import from_json, to_json
from latentmotion.storage.files import atomic_file

FORMAT = "latentmotion moves 4"
# The same without one of the classifiers, or both.
_BY_COLUMN = (FORMAT, "latentmotion moves 3", "latentmotion moves 2")
_ROW_BY_ROW = "latentmotion moves 1"  # The same in another order: movements that people taught.

# Cosine from which the clip of a caption may show what a sentence asks for: above .70 it usually
# does, below .60 usually not (trial on 16 sentences, lab/diary/rare_acts.md).
LEAST_COSINE = 0.6

# Cosine from which a drawn clip may show what a sentence asks for: its sentences are short, and
# share words with others ("ape around" is 0.71 from "sneaks around", but 0.98 from a wording). Of
# eight prompts of users between 0.64 and 0.68 three start from what they ask for, three from
# something near it; they are doubted, too.
LEAST_OF_DRAWN = 0.64

# How much nearer than the wording of a drawn clip that of a recording has to be: sentences of drawn
# clips were written for what they show. Of 600 prompts for drawn movements, by a writer who knew
# their names alone, the nearest row is right for 47 % then, 40 % without.
RECORDING_MARGIN = 0.04

# Support up to which a movement is rare: with so few clips of 3,700 the denoiser often makes
# another one from noise. With 60 frequent movements lost (lab/diary/rare_acts.md).
RARE = 20

# Support from which a caption is too common for a clip or a wording to be taken on less than clear
# evidence.
OFTEN = 120

# How much farther than the nearest a caption may be for its support to count. Along discriminants
# cosines lie farther apart: with 0.03 "walks forward and sits down" was rare, as 23 of 200 known
# sentences were; along principal directions it was not, and 19 were.
ABOUT = 0.05

# Supports that nothing was counted for: of a clip that a user showed, which is started from however
# frequent the movement is, and of one that was drawn for its sentences.
SHOWN, DRAWN = 0, -1

# Cosine from which a sentence says the same as one of a drawn clip, however frequent it is.
ALIKE_WORDS = 0.9

ALL_DIRECTIONS = np.zeros((0, 0), np.float32)  # Directions of an index that keeps embeddings whole.

# Unpacked size of the largest file: some 5,000 hours of clips.
_MOST_BYTES = 1 << 28

# Limits of what a file may hold.
_LONGEST_TEXT, _MOST_CLIPS, _MOST_CAPTIONS = 1_000, 100_000, 1_000_000

# Arrays that a file holds channel by channel: codes of one are alike, which packs them 6 % smaller.
_BY_CHANNEL = ("latents", "embeddings")

# Bytes that are packed by one strategy: text by its repetitions, codes by their frequencies.
_BLOCK = 1 << 18

# Sentences whose cosines with all captions are kept, some 40 kB each.
_KEPT = 32


@cache
def outside_kinds() -> Sequence[Mapping[str, Any]]:
    """Returns the kinds of what no body can do: name, words, and what to say."""
    return tomllib.loads(Path(__file__).with_name("outside.toml").read_text("utf-8"))["kind"]


@dataclass(frozen=True)
class IndexedClip:
    """A clip in an index."""

    id: str  # Unique name.
    source: str  # Name of its source.
    origin: str  # The recording that it was cut from and where.
    start: int  # First row of its latents.
    tokens: int  # Number of rows.


@dataclass(frozen=True)
class IndexedCaption:
    """A sentence about a clip, or about a part of it."""

    text: str  # The sentence.
    clip: int  # Number of the clip.
    start: int  # First latent token of the part, counted from the clip's first.
    end: int  # One past its last.
    # Number of clips with a caption of nearly the same meaning (`teach.py`), SHOWN or DRAWN.
    support: int


@dataclass(frozen=True)
class Neighbor:
    """A caption near a sentence."""

    caption: IndexedCaption  # The caption.
    cosine: float  # Cosine of their embeddings.
    mirrored: bool = False  # Whether the caption is near the sentence with left and right swapped.

    @property
    def is_near(self) -> bool:
        """Whether its clip may show what the sentence asks for."""
        return self.cosine >= (LEAST_OF_DRAWN if self.caption.support == DRAWN else LEAST_COSINE)


@dataclass(frozen=True)
class ClassifiedMovement:
    """The drawn movement that a sentence names, as it is classified."""

    caption: IndexedCaption  # Its name.
    probability: float  # How likely.
    mirrored: bool  # Whether the sentence names it with left and right swapped.


@dataclass(frozen=True, eq=False)
class SentenceClassifier:
    """Softmax regression of low rank: what a sentence asks for, by its embedding s of unit length.

    p(class | s) = softmax(s A B + b)
    """

    inward: Float[np.ndarray, "embedding rank"]  # A.
    outward: Float[np.ndarray, "rank classes"]  # B.
    bias: Float[np.ndarray, " classes"]  # b.
    labels: Int[np.ndarray, " classes"]  # Number of what each class stands for.

    def probabilities(
        self, sentences: Float[np.ndarray, "sides embedding"]
    ) -> Float[np.ndarray, "sides classes"]:
        """Returns how likely sentences are of each class."""
        values = sentences @ self.inward @ self.outward + self.bias
        values = np.exp(values - values.max(axis=1, keepdims=True))
        return values / values.sum(axis=1, keepdims=True)

    def fits(self, width: int, labels: range) -> bool:
        """Whether sizes are those of embeddings of a width, and all labels are among these."""
        (rank, classes), numbers = self.outward.shape, self.labels.tolist()
        sizes = self.inward.shape == (width, rank) and len(self.bias) == len(numbers) == classes
        return not numbers or (sizes and all(number in labels for number in numbers))

    def coded(self, name: str) -> dict[str, np.ndarray]:
        """Returns arrays of a file: both matrices in 8 bits, with the steps of their columns."""
        (inward, in_steps), (outward, out_steps) = (
            quantized(matrix, 0, MOST_LEVELS) for matrix in (self.inward, self.outward)
        )
        arrays = inward, in_steps, outward, out_steps, self.bias, self.labels
        return dict(zip(_arrays_of(name), map(np.ascontiguousarray, arrays), strict=True))

    @classmethod
    def decoded(cls, name: str, arrays: dict[str, np.ndarray]) -> SentenceClassifier:
        """Returns the classifier that arrays of a file hold, which are taken from them, if any.

        Raises:
            ValueError: They are of other sizes or types, or not finite.
        """
        names = _arrays_of(name)
        if arrays.keys().isdisjoint(names):
            return NO_CLASSIFIER
        inward, in_steps, outward, out_steps, bias, labels = map(arrays.pop, names)
        kinds = [(array.dtype.type, array.ndim) for array in (inward, outward, bias, labels)]
        if kinds != [(np.int8, 2), (np.int8, 2), (np.float32, 1), (np.int32, 1)]:
            raise ValueError("a classifier of other sizes or types")
        if not all(np.isfinite(array).all() for array in (in_steps, out_steps, bias)):
            raise ValueError("a classifier that is not finite")
        return cls(inward * in_steps, outward * out_steps, bias, labels)


def _arrays_of(classifier: str) -> list[str]:
    parts = ("in", "in_steps", "out", "out_steps", "bias", "captions")
    return [f"{classifier}_{part}" for part in parts]


NO_CLASSIFIER = SentenceClassifier(
    np.zeros((0, 0), np.float32),
    np.zeros((0, 0), np.float32),
    np.zeros(0, np.float32),
    np.zeros(0, np.int32),
)


@dataclass(frozen=True, eq=False)
class ClipIndex:
    """Clips, their captions and latents.

    Raises:
        InputError: Numbers of rows differ, or a caption or clip lies outside.
    """

    text_encoder: str  # Name of the text encoder of the embeddings.
    latent_space: str  # Fingerprint of the latent space (`fingerprint`).
    sources: tuple[Source, ...]  # Owners of the clips, with their terms.
    clips: tuple[IndexedClip, ...]  # The clips.
    captions: tuple[IndexedCaption, ...]  # The captions.
    latents: Int[np.ndarray, "tokens width"]  # Codes of the latents of all clips.
    latent_scale: Float[np.ndarray, " width"]  # Step of each channel, in the denoiser's scale.
    # Number of the caption that each wording, which is kept by its embedding alone, says in the
    # words that people type.
    wordings: Int[np.ndarray, " wordings"]
    # Codes of the pooled embeddings of captions, then of wordings; their lengths carry no meaning.
    embeddings: Int[np.ndarray, "rows components"]
    # Directions of embeddings along which those of an index are compared; of no components where
    # that is all of them.
    directions: Float[np.ndarray, "embedding directions"]
    # Words of all captions of the data, with the number of clips whose captions have them; also of
    # captions that were left out (`teach.py`).
    words: Mapping[str, int]
    # Which drawn movement a sentence names, by the numbers of the captions that name them; fitted
    # to all their sentences. Of 600 prompts by somebody who saw 300 names alone 92 % are classified
    # rightly, where p is 0.5 or more 97 % (`python -m benchmarks.quality.movements fast`).
    classifier: SentenceClassifier = NO_CLASSIFIER
    # Which kind of `outside.toml` a sentence asks for that no body can do; -1 stands for none.
    outside: SentenceClassifier = NO_CLASSIFIER
    # The cosines asked for last: a sentence and its clauses are read for clips and for doubts.
    _latest: dict[tuple[bool, bytes], Float[np.ndarray, "sides rows"]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        sources = {source.name for source in self.sources}
        clips_fit = all(
            clip.start >= 0
            and 0 < clip.tokens <= len(self.latents) - clip.start
            and clip.source in sources
            for clip in self.clips
        )
        rows_fit = len(self.embeddings) == len(self.captions) + len(self.wordings)
        named = 0 <= self.wordings.min(initial=0) <= self.wordings.max(initial=0)
        named = named and self.wordings.max(initial=0) < len(self.captions)
        width = len(self.directions) or self.embeddings.shape[1]
        classified = self.classifier.fits(width, range(len(self.captions)))
        classified = classified and self.outside.fits(width, range(-1, len(outside_kinds())))
        if not (rows_fit and named and clips_fit and classified):
            raise InputError("clips and captions of an index do not fit its arrays")
        for caption in self.captions:
            has_clip = 0 <= caption.clip < len(self.clips)
            if (
                not has_clip
                or not 0 <= caption.start < caption.end <= self.clips[caption.clip].tokens
            ):
                raise InputError(f"caption {caption.text[:80]!r} of an index lies outside its clip")

    @cached_property
    def _units(self) -> Float[np.ndarray, "rows components"]:
        return unit(self.embeddings.astype(np.float32))

    def _cosines(
        self, sentences: Float[np.ndarray, "sides width"], wordings: bool = False
    ) -> Float[np.ndarray, "sides rows"]:
        """Returns the cosines of sentences with captions, or with their wordings."""
        key = (wordings, sentences.tobytes())
        cosines = self._latest.get(key)
        if cosines is None:
            along = sentences @ self.directions if self.directions.size else sentences
            captions, others = np.split(self._units, [len(self.captions)])
            # Sides first: the larger of two is then found in a tenth of the time.
            cosines = np.ascontiguousarray(((others if wordings else captions) @ unit(along).T).T)
            if len(self._latest) >= _KEPT:
                self._latest.clear()
            self._latest[key] = cosines
        return cosines

    def nearest(self, sentences: Float[np.ndarray, "sides width"], count: int) -> list[Neighbor]:
        """Returns the captions nearest to a sentence, one for each clip, the nearest first.

        Args:
            sentences: Pooled embedding of the sentence; and that of the sentence with left and
                right swapped, if it names a side.
            count: Number of captions.
        """
        cosines = self._cosines(sentences)
        best = cosines.max(axis=0)
        neighbors: dict[int, Neighbor] = {}
        for _ in range(min(count, len(self.captions))):
            row = int(best.argmax())
            caption = self.captions[row]
            if caption.clip in neighbors:  # no clip is left
                break
            neighbors[caption.clip] = Neighbor(
                caption, float(best[row]), bool(cosines[:, row].argmax())
            )
            best[self.captions_of[caption.clip]] = -np.inf
        return list(neighbors.values())

    @cached_property
    def captions_of(self) -> Mapping[int, Sequence[int]]:
        """The numbers of the captions of each clip."""
        rows: dict[int, list[int]] = {}
        for number, caption in enumerate(self.captions):
            rows.setdefault(caption.clip, []).append(number)
        return rows

    def texts_of(self, clip: int) -> list[str]:
        """Returns the captions of a clip, given by its number."""
        return [self.captions[row].text for row in self.captions_of[clip]]

    @cached_property
    def _most(self) -> int:
        # Captions that have the most frequent word.
        return max(self.words.values(), default=1)

    def weight(self, forms: Collection[str]) -> float:
        """Returns how much a word says: the logarithm of how few captions have a form of it."""
        return math.log(self._most / (1 + max(self.words.get(form, 0) for form in forms)))

    def neighbor(self, number: int, sentences: Float[np.ndarray, "sides width"]) -> Neighbor:
        """Returns a caption as a neighbor of a sentence, given as for `nearest`."""
        cosines = self._cosines(sentences)[:, number]
        return Neighbor(self.captions[number], float(cosines.max()), bool(cosines.argmax()))

    def mean_cosine(self, clip: int, sentences: Float[np.ndarray, "sides width"]) -> float:
        """Returns the mean cosine of a clip's captions with a sentence, given as for `nearest`."""
        cosines = self._cosines(sentences)[:, self.captions_of[clip]]
        return float(cosines.max(axis=0).mean(dtype=np.float64))

    def nearest_by_wording(self, sentences: Float[np.ndarray, "sides width"]) -> Neighbor | None:
        """Returns the caption one of whose wordings is nearest to a sentence, if there are any.

        A wording of a recording counts as farther by RECORDING_MARGIN.

        Args:
            sentences: As for `nearest`.
        """
        if not len(self.wordings):
            return None
        cosines = self._cosines(sentences, wordings=True)
        clear = cosines - np.float32(RECORDING_MARGIN) * self._recorded[len(self.captions) :]
        side, row = np.unravel_index(clear.argmax(), cosines.shape)
        caption = self.captions[self.wordings[row]]
        return Neighbor(caption, float(cosines[side, row]), bool(side))

    def classified(self, sentences: Float[np.ndarray, "sides width"]) -> ClassifiedMovement | None:
        """Returns the drawn movement that a sentence names likeliest; None if none is recognized.

        Args:
            sentences: As for `nearest`.
        """
        if not self.classifier.labels.size:
            return None
        likely = self.classifier.probabilities(unit(sentences))
        side, number = np.unravel_index(likely.argmax(), likely.shape)
        caption = self.captions[self.classifier.labels[number]]
        return ClassifiedMovement(caption, float(likely[side, number]), bool(side))

    def outside_kind(self, sentences: Float[np.ndarray, "sides width"]) -> tuple[int, float]:
        """Returns what kind of what no body can do a sentence likeliest asks for.

        Args:
            sentences: As for `nearest`.

        Returns:
            The number of the kind, and how likely the sentence asks for any of them; 0 without a
            classifier.
        """
        if not self.outside.labels.size:
            return -1, 0.0
        likely = self.outside.probabilities(unit(sentences[:1]))[0]
        likely = np.where(self.outside.labels < 0, 0, likely)
        return int(self.outside.labels[likely.argmax()]), float(likely.sum())

    @cached_property
    def classified_clips(self) -> frozenset[int]:
        """Numbers of the clips that the classifier of movements knows."""
        return frozenset(self.captions[number].clip for number in self.classifier.labels)

    @cached_property
    def _recorded(self) -> Bool[np.ndarray, " rows"]:
        recorded = np.array([caption.support > SHOWN for caption in self.captions])
        return np.concatenate([recorded, recorded[self.wordings]])

    def support(self, sentences: Float[np.ndarray, "sides width"], margin: float = 0.0) -> int:
        """Returns the largest support of the captions that are about as near as the nearest.

        The nearest caption of "race along" may be of one clip, beside others of hundreds.

        Args:
            sentences: As for `nearest`.
            margin: How much farther a caption of a recording counts.
        """
        recorded = self._recorded[: len(self.captions)]
        cosines = self._cosines(sentences).max(axis=0) - np.float32(margin) * recorded
        near = np.flatnonzero(cosines >= cosines.max() - ABOUT)
        return max(self.captions[row].support for row in near.tolist())

    def preferred(self, support: int = SHOWN) -> ClipIndex:
        """Returns the index as shown or drawn: of captions near a sentence its nearest decides."""
        captions = tuple(replace(caption, support=support) for caption in self.captions)
        return replace(self, captions=captions)

    def latents_of(self, caption: IndexedCaption) -> Float[np.ndarray, "tokens width"]:
        """Returns the latents of the part that a caption tells of, in the denoiser's scale."""
        first = self.clips[caption.clip].start
        part = self.latents[first + caption.start : first + caption.end]
        return part.astype(np.float32) * self.latent_scale

    def about(self, neighbor: Neighbor) -> dict[str, Any]:
        """Returns which clip a caption tells of, its owner and terms, as JSON can hold them."""
        caption, clip = neighbor.caption, self.clips[neighbor.caption.clip]
        source = next(candidate for candidate in self.sources if candidate.name == clip.source)
        return {
            "clip": clip.id,
            "origin": clip.origin,
            "caption": caption.text,
            "cosine": round(neighbor.cosine, 4),
            "mirrored": neighbor.mirrored,
            "source": source.name,
            "credit": source.credit,
            "license": source.license,
        }

    def along(self, directions: Float[np.ndarray, "embedding components"]) -> ClipIndex:
        """Returns the index with embeddings along some directions only.

        Raises:
            InputError: They are kept along others already.
        """
        if np.array_equal(self.directions, directions):
            return self
        if self.directions.size:
            raise InputError(
                "embeddings of two indexes are kept along different directions; teach them again"
            )
        codes, _ = quantized(unit(self._units @ directions), 1, EMBEDDING_LEVELS)
        return replace(self, embeddings=codes, directions=directions)

    def joined(self, other: ClipIndex) -> ClipIndex:
        """Returns one index of the clips of both.

        Raises:
            InputError: They are of different models.
        """
        if (self.text_encoder, self.latent_space) != (other.text_encoder, other.latent_space):
            raise InputError(
                "the clips of two indexes were encoded by different models; teach them again"
            )
        directions = self.directions if self.directions.size else other.directions
        mine, theirs = self.along(directions), other.along(directions)
        first_caption = len(self.captions)
        by_name = {source.name: source for source in self.sources}
        renamed = {
            source.name: source.name
            if by_name.get(source.name, source) == source
            else f"{source.name} (2)"
            for source in other.sources
        }
        sources = [replace(source, name=renamed[source.name]) for source in other.sources]
        shift, first = len(self.clips), len(self.latents)
        peaks = (
            index.latent_scale * np.abs(index.latents).max(axis=0, initial=1)
            for index in (self, other)
        )
        scale = np.maximum(*peaks) / np.float32(MOST_LEVELS)
        latents = [
            np.round(index.latents * (index.latent_scale / scale)).astype(np.int8)
            for index in (self, other)
        ]
        return ClipIndex(
            self.text_encoder,
            self.latent_space,
            (*self.sources, *(source for source in sources if source not in self.sources)),
            (
                *self.clips,
                *(
                    replace(clip, start=clip.start + first, source=renamed[clip.source])
                    for clip in other.clips
                ),
            ),
            (*self.captions, *(replace(c, clip=c.clip + shift) for c in other.captions)),
            np.concatenate(latents),
            scale,
            np.concatenate([self.wordings, other.wordings + first_caption]),
            np.concatenate(
                [
                    mine.embeddings[:first_caption],
                    theirs.embeddings[: len(other.captions)],
                    mine.embeddings[first_caption:],
                    theirs.embeddings[len(other.captions) :],
                ]
            ),
            directions,
            dict(Counter(self.words) + Counter(other.words)),
            self.classifier
            if self.classifier.labels.size
            else replace(other.classifier, labels=other.classifier.labels + first_caption),
            self.outside if self.outside.labels.size else other.outside,
        )

    def write(self, path: Path) -> None:
        """Writes the index.

        Raises:
            InputError: The file cannot be written.
        """
        arrays = {
            name: np.ascontiguousarray(getattr(self, name))
            for name in ("latents", "latent_scale", "wordings", "embeddings", "directions")
        }
        arrays |= self.classifier.coded("classifier") | self.outside.coded("outside")
        arrays |= {name: np.ascontiguousarray(arrays[name].T) for name in _BY_CHANNEL}
        text = {
            "format": FORMAT,
            "text_encoder": self.text_encoder,
            "latent_space": self.latent_space,
            "sources": [to_json(source) for source in self.sources],
            # Column by column, which packs 9 % smaller.
            "clips": [*zip(*map(_values, self.clips), strict=True)],
            "captions": [*zip(*map(_values, self.captions), strict=True)],
            "words": dict(sorted(self.words.items())),
        }
        about = json.dumps(text, separators=(",", ":"), ensure_ascii=False).encode()
        content = save({**arrays, "text": np.frombuffer(about, np.uint8)})
        with atomic_file(path) as temporary:
            Path(temporary).write_bytes(_packed(content))


def _packed(content: bytes) -> bytes:
    """Returns content as one zlib stream, each block by the strategy that packs it smallest."""
    packed = [b"\x78\xda"]  # window and level, as RFC 1950 has it
    for first in range(0, len(content), _BLOCK):
        block, tries = content[first : first + _BLOCK], list[bytes]()
        for strategy in (zlib.Z_DEFAULT_STRATEGY, zlib.Z_FILTERED, zlib.Z_RLE):
            packing = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS, 6, strategy)
            tries.append(packing.compress(block) + packing.flush(zlib.Z_SYNC_FLUSH))
        packed.append(min(tries, key=len))
    end = zlib.compressobj(wbits=-zlib.MAX_WBITS).flush()
    return b"".join([*packed, end, zlib.adler32(content).to_bytes(4)])


def _values(row: Any) -> list[Any]:
    return [getattr(row, column.name) for column in fields(row)]


def fingerprint(space: LatentSpace) -> str:
    """Returns what tells a latent space from others: a hash of its description."""
    about = json.dumps(to_json(space), sort_keys=True)
    return hashlib.sha256(about.encode()).hexdigest()[:16]


# Largest codes of latents, of embeddings and of joined latents, which zlib packs. With 31 levels of
# latents hands of drawn movements were 54 mm from where they belong, with 63 they are 27 mm; the
# cosine of two embeddings is off by 0.006.
LATENT_LEVELS, EMBEDDING_LEVELS, MOST_LEVELS = 63, 7, 127


def quantized(
    vectors: Float[np.ndarray, "rows width"], axis: int, levels: int
) -> tuple[Int[np.ndarray, "rows width"], Float[np.ndarray, " _"]]:
    """Returns codes of vectors, and the steps of rows (axis 1) or channels (axis 0)."""
    steps = np.abs(vectors).max(axis=axis, initial=1e-6) / levels
    shown = steps[:, None] if axis == 1 else steps
    return np.round(vectors / shown).astype(np.int8), steps.astype(np.float32)


_DAMAGE = (OSError, SafetensorError, zlib.error, KeyError, TypeError, ValueError, InputError)


def read_index(path: Path) -> ClipIndex:
    """Reads an index.

    Raises:
        ModelError: The file is missing, damaged or of another version.
    """
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(path.read_bytes(), _MOST_BYTES)
        if not unpacking.eof:
            raise ValueError(f"cut off, or more than {_MOST_BYTES} bytes")
        arrays = load(content)
        text = json.loads(arrays.pop("text").tobytes())
        by_column = text["format"] in _BY_COLUMN
        if not by_column and text["format"] != _ROW_BY_ROW:
            raise ValueError(f"format {str(text['format'])[:40]!r}, expected {FORMAT!r}")
        if by_column:
            text |= {name: zip(*text[name], strict=True) for name in ("clips", "captions")}
            arrays |= {name: np.ascontiguousarray(arrays[name].T) for name in _BY_CHANNEL}
        classifier = SentenceClassifier.decoded("classifier", arrays)
        outside = SentenceClassifier.decoded("outside", arrays)
        kinds = (str, str, str, int, int)
        clips = tuple(IndexedClip(*_typed(row, kinds)) for row in text["clips"])
        kinds = (str, int, int, int, int)
        captions = tuple(IndexedCaption(*_typed(row, kinds)) for row in text["captions"])
        _check(arrays, clips, captions)
        words = text["words"]
        if not isinstance(words, dict) or len(words) > _MOST_CAPTIONS:
            raise ValueError("a list of words")
        rows = [_typed(row, (str, int)) for row in words.items()]
        return ClipIndex(
            str(text["text_encoder"]),
            str(text["latent_space"]),
            tuple(from_json(Source, source) for source in text["sources"]),
            clips,
            captions,
            **arrays,
            words={str(word): int(count) for word, count in rows},
            classifier=classifier,
            outside=outside,
        )
    except _DAMAGE as error:
        raise ModelError(f"{path} is no index of clips, or damaged ({error})") from error


def index_file(path: Path) -> Path:
    """Returns the file of an index, which is given as its folder or as itself.

    Raises:
        ModelError: There is none.
    """
    file = path / MOVES_FILE if path.is_dir() else path
    if not file.is_file():
        raise ModelError(
            f"{path} holds no {MOVES_FILE}; make it: latentmotion teach CLIP SENTENCE -o {path}"
        )
    return file


def joined(moves: Sequence[Path | ClipIndex], latent_space: str, text_encoder: str) -> ClipIndex:
    """Returns one index of several, or of their files.

    Args:
        moves: At least one.
        latent_space: Fingerprint of the model that is to start from them.
        text_encoder: Name of its text encoder.

    Raises:
        ModelError: A file is damaged, or an index was made for another model.
    """
    together: ClipIndex | None = None
    for source in moves:
        index = (
            source
            if isinstance(source, ClipIndex)
            else _read_once(source, source.stat().st_mtime_ns)
        )
        if (index.latent_space, index.text_encoder) != (latent_space, text_encoder):
            name = source if isinstance(source, Path) else "an index"
            raise ModelError(f"{name} was made for another model; teach its clips to this one")
        together = together.joined(index) if together else index
    assert together is not None
    return together


@lru_cache(maxsize=4)
def _read_once(path: Path, changed: int) -> ClipIndex:
    """Reads a file that did not change since it was read last only once."""
    return read_index(path)


def _typed(row: Any, kinds: Sequence[type]) -> list[Any]:
    if len(row) != len(kinds) or any(
        type(value) is not kind for value, kind in zip(row, kinds, strict=False)
    ):
        raise ValueError(f"a row {str(row)[:80]}")
    if any(isinstance(value, str) and len(value) > _LONGEST_TEXT for value in row):
        raise ValueError(f"a text of more than {_LONGEST_TEXT} letters")
    return list(row)


def _check(
    arrays: dict[str, np.ndarray], clips: Sequence[object], captions: Sequence[object]
) -> None:
    """Raises ValueError if sizes and kinds of arrays are not those of an index."""
    if len(clips) > _MOST_CLIPS or len(captions) > _MOST_CAPTIONS:
        raise ValueError(f"{len(clips)} clips and {len(captions)} captions")
    expected = {
        "latents": (np.int8, 2),
        "latent_scale": (np.float32, 1),
        "wordings": (np.int32, 1),
        "embeddings": (np.int8, 2),
        "directions": (np.float32, 2),
    }
    kinds = {name: (array.dtype.type, array.ndim) for name, array in arrays.items()}
    if kinds != expected or arrays["latents"].shape[1:] != arrays["latent_scale"].shape:
        raise ValueError(f"arrays {', '.join(sorted(arrays))} of other sizes or types")
    scale, directions = arrays["latent_scale"], arrays["directions"]
    if not np.isfinite(scale).all() or (scale <= 0).any():
        raise ValueError("a scale that is no positive number")
    if directions.size and directions.shape[1] != arrays["embeddings"].shape[1]:
        raise ValueError("directions of another number than embeddings have components")
    if not np.isfinite(directions).all():
        raise ValueError("directions that are not finite")
