"""Words of captions for text-motion evaluators: tokens, parts of speech and word vectors.

As in the T2M evaluator, a word of one of five keyword lists has that list's class instead of its
part of speech; at most 20 words count, and `sos` and `eos` stand around them. The lists are those
of the T2M code (MIT). Vectors are that code's GloVe vectors, or the states of a text encoder.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.arrays import prefix_mask
from latentmotion.data.clip import Caption
from latentmotion.engine.encoder import AroundEncoder, silent_of_unknown
from latentmotion.errors import FileFormatError, ModelError
from latentmotion.storage import pickles
from latentmotion.storage.array_files import read_array

MAX_WORDS = 20  # Most words of a sentence.

OTHER = "OTHER"  # Part of speech of words that have none.

# Keywords by their class.
KEYWORDS = {
    "Loc_VIP": "left right clockwise counterclockwise anticlockwise forward back backward up down "
    "straight curve",
    "Body_VIP": "arm chin foot feet face hand mouth leg waist eye knee shoulder thigh",
    "Obj_VIP": "stair dumbbell chair window floor car ball handrail baseball basketball",
    "Act_VIP": "walk run swing pick bring kick put squat throw hop dance jump turn stumble stop "
    "sit lift lower raise wash stand kneel stroll rub bend balance flap jog shuffle lean rotate "
    "spin spread climb",
    "Desc_VIP": "slowly carefully fast careful slow quickly happy angry sad happily angrily sadly",
}

# All classes, in the order of the network's input.
PARTS_OF_SPEECH = (
    *("VERB", "NOUN", "DET", "ADP", "NUM", "AUX", "PRON", "ADJ", "ADV"),
    *KEYWORDS,
    OTHER,
)

_CLASS_OF = {word: name for name, words in KEYWORDS.items() for word in words.split()}

_WORD = re.compile(r"[a-z]+|[0-9]+")
_ENDINGS = (("s", ""), ("es", ""), ("ies", "y"), ("ing", ""), ("ing", "e"), ("ed", ""), ("ed", "e"))


@dataclass(frozen=True)
class TaggedWord:
    """A word with its part of speech."""

    word: str  # Lower case; the base form if it was tagged.
    part: str  # Part of speech, as spaCy names it.
    # Whether the tags come from the data set; else the sentence was split here.
    tagged: bool = True


START, END = TaggedWord("sos", OTHER), TaggedWord("eos", OTHER)


def tokens_of(caption: Caption) -> list[TaggedWord]:
    """Returns the words of a caption between `sos` and `eos`.

    A caption without tags is split into its words, each of part of speech OTHER.
    """
    if caption.tokens:
        pairs = (token.rpartition("/") for token in caption.tokens.split())
        words = [TaggedWord(word, part) for word, _, part in pairs if word]
    else:
        matches = _WORD.findall(caption.text.lower())
        words = [TaggedWord(word, OTHER, tagged=False) for word in matches]
    return [START, *words[:MAX_WORDS], END]


def class_of(token: TaggedWord) -> int:
    """Returns the index of a token's class in `PARTS_OF_SPEECH`."""
    name = _CLASS_OF.get(token.word, token.part)
    return PARTS_OF_SPEECH.index(name if name in PARTS_OF_SPEECH else OTHER)


def base_forms(word: str) -> list[str]:
    """Returns a word and the base forms that it may have, likeliest first."""
    forms = [word]
    for ending, replacement in _ENDINGS:
        if word.endswith(ending):
            stem = word.removesuffix(ending)
            forms.append(stem + replacement)
            if not replacement and len(stem) > 2 and stem[-1] == stem[-2]:
                forms.append(stem[:-1])
    return forms


UNKNOWN = "unk"  # Word that stands for all words without a vector.


@dataclass(frozen=True)
class Sentences:
    """Input of the sentence network."""

    words: Float[np.ndarray, "batch words width"]  # One vector per word, zero in the padding.
    parts: Int[np.ndarray, "batch words"]  # Index of each word's part of speech.
    mask: Bool[np.ndarray, "batch words"]  # True on real words.


@dataclass(frozen=True, eq=False)
class GloveWords:
    """A table of word vectors, as in the T2M evaluator, with `unk`, `sos` and `eos`."""

    words: tuple[str, ...]  # The words.
    vectors: Float[np.ndarray, "words width"]  # The vector of each.

    @property
    def name(self) -> str:
        """`glove` and a digest of the vectors."""
        return f"glove {hashlib.sha256(self.vectors.tobytes()).hexdigest()[:16]}"

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.vectors.shape[1]

    def __call__(self, captions: Sequence[Caption]) -> Sentences:
        """Returns the words of captions; one without a vector is `unk` of class OTHER."""
        rows = []
        for caption in captions:
            row = []
            for token in tokens_of(caption):
                forms = [token.word] if token.tagged else base_forms(token.word)
                form_known = next((form for form in forms if form in self._numbers), None)
                row.append(
                    TaggedWord(form_known, token.part) if form_known else TaggedWord(UNKNOWN, OTHER)
                )
            rows.append(row)
        numbers = [np.array([self._numbers[token.word] for token in row]) for row in rows]
        parts = [np.array([class_of(token) for token in row]) for row in rows]
        return fill([self.vectors[row] for row in numbers], parts)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {word: number for number, word in enumerate(self.words)}


@dataclass(frozen=True, eq=False)
class EncodedWords(AroundEncoder):
    """States of a text encoder's word pieces in their sentence; no parts of speech."""

    def __call__(self, captions: Sequence[Caption]) -> Sentences:
        """Returns the word pieces of captions."""
        with silent_of_unknown():
            # Misspelled captions of a data set are not the user's.
            encoded = self.encoder([caption.text for caption in captions])
        rows = [words[mask] for words, mask in zip(encoded.words, encoded.mask, strict=True)]
        other = PARTS_OF_SPEECH.index(OTHER)
        return fill(rows, [np.full(len(row), other) for row in rows])


WordVectors = GloveWords | EncodedWords  # Captions to the vectors of their words.


def fill(
    rows: Sequence[Float[np.ndarray, "_ width"]], parts: Sequence[Int[np.ndarray, " _"]]
) -> Sentences:
    """Pads sentences with zeros to the longest."""
    mask = prefix_mask([len(row) for row in rows])
    words = np.zeros((*mask.shape, rows[0].shape[1]), np.float32)
    classes = np.zeros(mask.shape, np.int64)
    words[mask], classes[mask] = np.concatenate(rows), np.concatenate(parts)
    return Sentences(words, classes, mask)


# Files of the T2M code's `glove` folder: vectors, words, and the row of each word.
VECTORS, WORDS, NUMBERS = "our_vab_data.npy", "our_vab_words.pkl", "our_vab_idx.pkl"


def read_glove(folder: str | Path) -> GloveWords:
    """Reads the three files of the T2M code's `glove` folder.

    Raises:
        ModelError: A file is missing.
        FileFormatError: A file is damaged, holds more than words, or does not fit the others.
    """
    folder = Path(folder)
    missing = [name for name in (VECTORS, WORDS, NUMBERS) if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; pass the `glove` folder that the T2M code "
            "distributes"
        )
    path = folder / VECTORS
    vectors = read_array(path)
    if vectors.ndim != 2 or not np.issubdtype(vectors.dtype, np.floating):
        problem = f"{vectors.dtype} of shape {vectors.shape}"
        raise FileFormatError(path, f"found {problem}, expected one vector of numbers per word")
    words, numbers = pickles.load(folder / WORDS), pickles.load(folder / NUMBERS)
    for name, content, kind in ((WORDS, words, list), (NUMBERS, numbers, dict)):
        if not isinstance(content, kind):
            problem = type(content).__name__
            raise FileFormatError(folder / name, f"found a {problem}, expected {kind.__name__}")
    if not all(isinstance(word, str) for word in words):
        raise FileFormatError(folder / WORDS, "something that is no word; download it again")
    lacking = [word for word in (START.word, END.word, UNKNOWN) if word not in words]
    if lacking:
        raise FileFormatError(folder / WORDS, f"lacks the words {', '.join(lacking)}")
    rows = range(len(vectors))
    problem = (numbers.get(word) for word in words)
    fits = (isinstance(number, int) and number in rows for number in problem)
    lost = next((word for word, fit in zip(words, fits, strict=True) if not fit), None)
    if lost is not None:
        raise FileFormatError(
            folder / NUMBERS,
            f"{lost!r} has no row among the {len(vectors)} of {VECTORS}; the three files "
            "belong together: download them again",
        )
    return GloveWords(tuple(words), vectors.astype(np.float32)[[numbers[word] for word in words]])
