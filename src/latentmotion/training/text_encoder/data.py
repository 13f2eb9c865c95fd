"""Training data of a text encoder: captions, the teacher's outputs for them, batches by step.

A line of HumanML3D's text files is `caption#word/POS word/POS …#from#to`, with times in seconds.
One sentence in twenty is held out, by the hash of its text in which left and right are made equal:
a caption and its mirrored copy, or an equal variation, are never on different sides.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from tokenizers import Tokenizer

from latentmotion.arrays import prefix_mask
from latentmotion.errors import DataError, InputError
from latentmotion.networks.device import autocast
from latentmotion.networks.pretrained_text import AT_ONCE, PretrainedTextEncoder
from latentmotion.storage.files import atomic_folder
from latentmotion.storage.reading import parse_json, read_json_file, read_text, unpack_xz
from latentmotion.training.distributed import DistributedContext

# Batches among which sentences are sorted by length.
_WINDOW = 50


@dataclass(frozen=True)
class TeacherOutputs:
    """The teacher's outputs for many sentences; arrays may be memory-mapped."""

    pooled: Float[np.ndarray, "sentences width"]
    """Sentence embeddings of unit length, float32."""
    words: Float[np.ndarray, "pieces width"]
    """States of all pieces, sentence after sentence, float16."""
    starts: Int[np.ndarray, " bounds"]
    """First row of each sentence in `words`, and the number of rows."""


def teacher_targets(
    folder: Path,
    sentences: Sequence[str],
    tokenizer: Tokenizer,
    teacher: PretrainedTextEncoder,
    context: DistributedContext,
) -> TeacherOutputs:
    """Reads targets from `folder`, computed first where they are missing or of other sentences.

    Args:
        folder: Folder of the teacher's outputs.
        sentences: Sentences for the teacher.
        tokenizer: The teacher's tokenizer, without padding.
        teacher: Runs on the device of `context` and is on the CPU afterwards.
        context: The leading rank computes.

    Raises:
        InputError: The folder cannot be written or holds something else.
    """
    digest = hashlib.sha256("\n".join(sentences).encode()).hexdigest()
    stamp = folder / "sentences.json"
    if context.is_main and (not stamp.is_file() or json.loads(stamp.read_text()) != digest):
        ids = [encoding.ids for encoding in tokenizer.encode_batch(list(sentences))]
        with atomic_folder(folder, stamp.name) as temporary:
            _compute_targets(temporary, ids, teacher, context.device)
            (temporary / stamp.name).write_text(json.dumps(digest))
    context.wait()
    names = ("pooled", "words", "starts")
    try:  # nothing is unpickled: `np.load` refuses arrays of objects
        return TeacherOutputs(*(np.load(folder / f"{name}.npy", mmap_mode="r") for name in names))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder} is damaged ({error}); delete it and start again") from error


@torch.no_grad()
def _compute_targets(
    folder: Path,
    ids: Sequence[Sequence[int]],
    teacher: PretrainedTextEncoder,
    device: torch.device,
) -> None:
    starts = np.concatenate([[0], np.cumsum([len(row) for row in ids])])
    pooled = np.empty((len(ids), teacher.width), np.float32)
    words = np.empty((starts[-1], teacher.width), np.float16)
    by_length = np.argsort([len(row) for row in ids], kind="stable")
    teacher.model.to(device)
    for first in range(0, len(ids), AT_ONCE):
        rows = by_length[first : first + AT_ONCE]
        tokens, mask = padded([ids[row] for row in rows])
        # Three times faster than float32; cosines change in the 5th digit.
        with autocast(device):
            reading = teacher.kind.read(teacher.model, tokens.to(device), mask.to(device))
        pooled[rows] = reading.pooled.float().cpu().numpy()
        states = reading.words.float().cpu()
        for row, state, real in zip(rows, states, mask, strict=True):
            words[starts[row] : starts[row + 1]] = state[real].numpy()
        if first // AT_ONCE % 100 == 0:
            print(f"teacher: {first} of {len(ids)} sentences", file=sys.stderr, flush=True)
    teacher.model.cpu()
    for name, array in (("pooled", pooled), ("words", words), ("starts", starts)):
        np.save(folder / f"{name}.npy", array)


def padded(
    ids: Sequence[Sequence[int]],
) -> tuple[Int[torch.Tensor, "batch words"], Bool[torch.Tensor, "batch words"]]:
    """Returns tokens, padded with zeros to the longest sentence, and the mask of the real ones."""
    mask = prefix_mask(torch.tensor([len(row) for row in ids]))
    tokens = torch.zeros(mask.shape, dtype=torch.long)
    tokens[mask] = torch.tensor([token for row in ids for token in row])
    return tokens, mask


@dataclass(frozen=True)
class SentenceBatch:
    """Sentences of similar length with the teacher's outputs."""

    tokens: Int[torch.Tensor, "batch words"]
    """Pieces in the student's vocabulary."""
    mask: Bool[torch.Tensor, "batch words"]
    """True on real pieces, False on padding."""
    pooled: Float[torch.Tensor, "batch width"]
    """The teacher's sentence embeddings of unit length."""
    aligned: Bool[torch.Tensor, "batch words"]
    """True on real pieces of sentences that both tokenizers split alike."""
    words: Float[torch.Tensor, "pieces width"]
    """The teacher's states of the aligned pieces, in their order."""

    def to(self, device: torch.device) -> SentenceBatch:
        """Returns the batch on a device."""
        parts = (self.tokens, self.mask, self.pooled, self.aligned, self.words)
        return SentenceBatch(*(part.to(device) for part in parts))


@dataclass(frozen=True)
class TrainingSet:
    """Sentences to train on, with the teacher's outputs."""

    ids: Sequence[Sequence[int]]
    """Pieces of each sentence in the student's vocabulary."""
    aligned: Sequence[bool]
    """Whether the tokenizers of student and teacher split the sentence alike."""
    targets: TeacherOutputs
    """The teacher's outputs, in the order of the sentences."""

    def batch(self, rows: Int[np.ndarray, " batch"]) -> SentenceBatch:
        """Returns the sentences at these rows."""
        tokens, mask = padded([self.ids[row] for row in rows])
        alike = torch.tensor([self.aligned[row] for row in rows])
        starts = self.targets.starts
        words = [
            self.targets.words[starts[row] : starts[row + 1]] for row in rows if self.aligned[row]
        ]
        width = self.targets.words.shape[1]
        states = np.concatenate([np.zeros((0, width), np.float16), *words]).astype(np.float32)
        pooled = torch.from_numpy(self.targets.pooled[rows])
        return SentenceBatch(tokens, mask, pooled, mask & alike[:, None], torch.from_numpy(states))


@dataclass(frozen=True)
class ValidationSentences:
    """Sentences for validation."""

    sentences: Sequence[str]
    """The sentences, in random order."""
    ids: Sequence[Sequence[int]]
    """Pieces of each in the student's vocabulary."""
    pooled: Float[np.ndarray, "sentences width"]
    """The teacher's sentence embeddings of unit length."""


class SentenceSampler:
    """Which sentences each step shows: epochs in random order, batches of similar length.

    Args:
        lengths: Number of pieces of each sentence.
        batch_size: Sentences of a step.
        seed: Changes the order.
    """

    def __init__(self, lengths: Int[np.ndarray, " sentences"], batch_size: int, seed: int) -> None:
        self._lengths, self._batch_size, self._seed = lengths, batch_size, seed
        self._per_epoch = max(len(lengths) // batch_size, 1)
        self._epoch = lru_cache(maxsize=1)(self._plan_epoch)

    def __call__(self, step: int) -> Int[np.ndarray, " batch"]:
        """Returns the rows of step number `step`."""
        epoch, index = divmod(step, self._per_epoch)
        return self._epoch(epoch)[index]

    def _plan_epoch(self, epoch: int) -> list[Int[np.ndarray, " batch"]]:
        """Sorts a random order by length within windows, which keeps padding small."""
        size = self._batch_size
        order = np.random.default_rng((self._seed, epoch)).permutation(len(self._lengths))
        order = order[: self._per_epoch * size]
        batches: list[np.ndarray] = []
        for first in range(0, len(order), _WINDOW * size):
            window = order[first : first + _WINDOW * size]
            by_length = window[np.argsort(self._lengths[window])]
            batches += np.split(by_length, max(len(window) // size, 1))
        shuffled = np.random.default_rng((self._seed, epoch, 1)).permutation(len(batches))
        return [batches[index] for index in shuffled]


HELD_OUT_PERCENT = 5
"""Share of sentences that are held out, in percent."""

GROUP = 33
"""Sentences among which the nearest one is looked for."""


@dataclass(frozen=True)
class TaggedCaption:
    """A caption with HumanML3D's part-of-speech tags."""

    text: str
    """The sentence in lower case, words separated by one blank each."""
    tags: tuple[tuple[str, str], ...]
    """(lemma, part of speech) of each word, such as ("walk", "VERB")."""


def read_captions(path: str | Path) -> list[TaggedCaption]:
    """Reads captions, each text once, in the order of the files.

    Args:
        path: `texts.json.xz` or `.json` (clip id → lines) or a folder of HumanML3D's `.txt` files.

    Raises:
        DataError: The path does not exist or holds no caption.
    """
    path = Path(path)
    if path.is_dir():
        texts = [read_text(file) for file in sorted(path.rglob("*.txt"))]
    elif not path.is_file():
        raise DataError(f"{path} does not exist; expected HumanML3D's texts folder or JSON file")
    else:
        packed = path.suffix == ".xz"
        entries = parse_json(unpack_xz(path), path) if packed else read_json_file(path)
        if not isinstance(entries, dict) or not all(
            isinstance(e, str | list) for e in entries.values()
        ):
            raise DataError(f"{path}: expected captions by id, found something else")
        texts = [e if isinstance(e, str) else "\n".join(e) for e in entries.values()]
    lines = (line for text in texts for line in text.splitlines())
    captions = {caption.text: caption for line in lines if (caption := parse_line(line)).text}
    if not captions:
        raise DataError(f"{path} holds no captions; expected HumanML3D's texts folder or JSON file")
    return list(captions.values())


def parse_line(line: str) -> TaggedCaption:
    """Reads one line `caption#word/POS …#from#to`; the tags may be missing."""
    text, _, rest = line.partition("#")
    words = rest.partition("#")[0].split()
    tags = tuple((lemma, tag) for lemma, _, tag in (word.rpartition("/") for word in words))
    return TaggedCaption(" ".join(text.lower().split()), tags)


def is_held_out(sentence: str) -> bool:
    """Returns whether a sentence belongs to the held-out 5 %, decided by its text alone."""
    side_blind = re.sub(r"\b(left|right)", "side", " ".join(sentence.lower().split()))
    digest = hashlib.sha256(side_blind.encode()).digest()
    return int.from_bytes(digest[:4], "big") % 100 < HELD_OUT_PERCENT


@dataclass(frozen=True)
class Figures:
    """Agreement of a student's sentence embeddings with its teacher's."""

    sentences: int
    """Number of held-out sentences."""
    cosine: float
    """Mean cosine of both embeddings of a sentence."""
    cosine_5_percent: float
    """5th percentile of the cosines."""
    nearest: float
    """Share of sentences whose nearest among 32 others is the same for student and teacher."""
    own_first: float
    """Share of sentences whose student embedding is nearest to their own teacher embedding, among
    33 teacher embeddings."""


def compare(
    student: Float[np.ndarray, "sentences width"], teacher: Float[np.ndarray, "sentences width"]
) -> Figures:
    """Compares embeddings of at least 33 sentences.

    Args:
        student: The student's embeddings of unit length, in random order.
        teacher: The teacher's of the same sentences.
    """
    cosines = (student * teacher).sum(1)
    groups = [slice(first, first + GROUP) for first in range(0, len(student) - GROUP + 1, GROUP)]
    same = [_nearest_other(student[part]) == _nearest_other(teacher[part]) for part in groups]
    matches = [(student[part] @ teacher[part].T).argmax(1) == np.arange(GROUP) for part in groups]
    return Figures(
        sentences=len(student),
        cosine=float(cosines.mean()),
        cosine_5_percent=float(np.percentile(cosines, 5)),
        nearest=float(np.mean(same)),
        own_first=float(np.mean(matches)),
    )


def milliseconds(encode: Callable[[list[str]], object], sentences: Sequence[str]) -> float:
    """Returns the median time of encoding one sentence, in milliseconds of processor time.

    Unlike wall time it does not grow when other programs use the same cores.
    """
    encode([sentences[0]])
    times = []
    for sentence in sentences:
        started = time.process_time()
        encode([sentence])
        times.append(time.process_time() - started)
    return 1000 * float(np.median(times))


def _nearest_other(embeddings: Float[np.ndarray, "group width"]) -> np.ndarray:
    similarity = embeddings @ embeddings.T
    np.fill_diagonal(similarity, -np.inf)
    return similarity.argmax(1)


SPECIAL = ("[PAD]", "[UNK]", "[CLS]", "[SEP]")
CONTINUATION = "##"
"""Special pieces of a WordPiece vocabulary, and what marks pieces inside words.

A smaller vocabulary keeps its teacher's spelling, so that a sentence of these pieces is split in
the same places as its teacher splits it, and the states of both can be compared word by word.
"""


def frequent_words(tokenizer: Tokenizer, count: int) -> list[str]:
    """Returns the first `count` whole English words of a BERT vocabulary, most frequent first."""
    pieces = sorted(tokenizer.get_vocab().items(), key=lambda item: item[1])
    words = (piece for piece, _ in pieces if piece.isascii() and piece.isalpha() and len(piece) > 1)
    return [word for _, word in zip(range(count), words, strict=False)]


def pieces_to_keep(
    tokenizer: Tokenizer, sentences: Iterable[str], words: int, continuations: int
) -> list[str]:
    """Chooses the pieces of a smaller vocabulary, in the order of the large one.

    Args:
        tokenizer: The teacher's WordPiece tokenizer.
        sentences: Text whose every piece is kept.
        words: Number of most frequent whole words kept beside them.
        continuations: Number of most frequent `##` pieces kept beside them.
    """
    order = tokenizer.get_vocab()
    pieces = {piece for sentence in sentences for piece in tokenizer.encode(sentence).tokens}
    pieces |= {piece for piece in order if len(piece.removeprefix(CONTINUATION)) == 1}
    pieces |= set(frequent_words(tokenizer, words))
    tails = (piece for piece in order if piece.startswith(CONTINUATION) and piece.isascii())
    pieces |= set(sorted(tails, key=order.__getitem__)[:continuations])
    return sorted(pieces - set(SPECIAL), key=order.__getitem__)


def restrict(tokenizer: Tokenizer, pieces: Sequence[str], max_length: int) -> Tokenizer:
    """Returns the same tokenizer with the special pieces and `pieces` only, nothing padded."""
    vocabulary = {piece: place for place, piece in enumerate((*SPECIAL, *pieces))}
    settings = json.loads(tokenizer.to_str())
    settings["model"]["vocab"] = vocabulary
    settings["added_tokens"] = [
        token | {"id": vocabulary[token["content"]]}
        for token in settings["added_tokens"]
        if token["content"] in SPECIAL
    ]
    for name, token in settings["post_processor"]["special_tokens"].items():
        token["ids"] = [vocabulary[name]]
    settings |= {"padding": None, "truncation": None}
    smaller = Tokenizer.from_str(json.dumps(settings))
    smaller.enable_truncation(max_length)
    return smaller


def places_in(large: Tokenizer, small: Tokenizer) -> Int[np.ndarray, " pieces"]:
    """Returns the id in the large vocabulary of every piece of the small one, in its order."""
    order = large.get_vocab()
    pieces = sorted(small.get_vocab().items(), key=lambda item: item[1])
    return np.array([order[piece] for piece, _ in pieces])
