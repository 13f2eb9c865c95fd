"""Distillation of a small text encoder from a large one (all-MiniLM-L6-v2).

The student is a BERT-like transformer, 3 layers of width 384 by default. It starts from some of the
teacher's layers and from the teacher's piece embeddings (`StudentRecipe.layers`). With the
teacher's sentence embeddings p (unit length) and piece states h, and the student's p̂ and ĥ:

    total = 20 · mean ‖p̂ − p‖²  +  mean ‖ĥ − h‖² / ‖h‖²  +  20 · mean (p̂ p̂ᵀ − p pᵀ)²

The last term is relational distillation (Park et al. 2019): it keeps the similarities between the
sentences of a batch. With several ranks each compares the sentences of its own share.

Captions are varied by other subjects, synonyms, imperatives, single clauses and typos. The student
learns the teacher's embedding of each variation, so a variation need not keep the meaning of its
caption; it only has to look like a prompt that a user may type.

Training data of a text encoder: captions, the teacher's outputs for them, batches by step.

A line of HumanML3D's text files is `caption#word/POS word/POS …#from#to`, with times in seconds.
One sentence in twenty is held out, by the hash of its text in which left and right are made equal:
a caption and its mirrored copy, or an equal variation, are never on different sides.
"""

from __future__ import annotations

import hashlib
import json
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from tokenizers import Tokenizer

from latentmotion.arrays import prefix_mask
from latentmotion.engine.encoder import StudentTextEncoder, silent_of_unknown, split_words
from latentmotion.errors import DataError, InputError
from latentmotion.export.package import export_student
from latentmotion.language.words import inflect
from latentmotion.networks.device import autocast
from latentmotion.networks.pretrained_text import AT_ONCE, PretrainedTextEncoder
from latentmotion.networks.text_encoder import NetworkShape, StudentNetwork, teacher_state
from latentmotion.storage import reading
from latentmotion.storage.files import atomic_folder, write_file
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import TrainingSettings, optimization
from latentmotion.training.loop import Stage, train
from latentmotion.training.run_folder import open_run

# Batches among which sentences are sorted by length.
_WINDOW = 50


@dataclass(frozen=True)
class TeacherOutputs:
    """The teacher's outputs for many sentences; arrays may be memory-mapped."""

    pooled: Float[np.ndarray, "sentences width"]  # Sentence embeddings of unit length, float32.
    # States of all pieces, sentence after sentence, float16.
    words: Float[np.ndarray, "pieces width"]
    # First row of each sentence in `words`, and the number of rows.
    starts: Int[np.ndarray, " bounds"]


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
    folder: Path, ids: Sequence[Sequence[int]], teacher: PretrainedTextEncoder, device: torch.device
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
            outputs = teacher.kind.read(teacher.model, tokens.to(device), mask.to(device))
        pooled[rows] = outputs.pooled.float().cpu().numpy()
        states = outputs.words.float().cpu()
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

    tokens: Int[torch.Tensor, "batch words"]  # Pieces in the student's vocabulary.
    mask: Bool[torch.Tensor, "batch words"]  # True on real pieces, False on padding.
    pooled: Float[torch.Tensor, "batch width"]  # The teacher's sentence embeddings of unit length.
    # True on real pieces of sentences that both tokenizers split alike.
    aligned: Bool[torch.Tensor, "batch words"]
    # The teacher's states of the aligned pieces, in their order.
    words: Float[torch.Tensor, "pieces width"]

    def to(self, device: torch.device) -> SentenceBatch:
        """Returns the batch on a device."""
        return SentenceBatch(*(part.to(device) for part in vars(self).values()))


@dataclass(frozen=True)
class TrainingSet:
    """Sentences to train on, with the teacher's outputs."""

    ids: Sequence[Sequence[int]]  # Pieces of each sentence in the student's vocabulary.
    # Whether the tokenizers of student and teacher split the sentence alike.
    aligned: Sequence[bool]
    targets: TeacherOutputs  # The teacher's outputs, in the order of the sentences.

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

    sentences: Sequence[str]  # The sentences, in random order.
    ids: Sequence[Sequence[int]]  # Pieces of each in the student's vocabulary.
    # The teacher's sentence embeddings of unit length.
    pooled: Float[np.ndarray, "sentences width"]


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


HELD_OUT_PERCENT = 5  # Share of sentences that are held out, in percent.

GROUP = 33  # Sentences among which the nearest one is looked for.


@dataclass(frozen=True)
class TaggedCaption:
    """A caption with HumanML3D's part-of-speech tags."""

    text: str  # The sentence in lower case, words separated by one blank each.
    # (lemma, part of speech) of each word, such as ("walk", "VERB").
    tags: tuple[tuple[str, str], ...]


def read_captions(path: str | Path) -> list[TaggedCaption]:
    """Reads captions, each text once, in the order of the files.

    Args:
        path: `texts.json.xz` or `.json` (clip id → lines) or a folder of HumanML3D's `.txt` files.

    Raises:
        DataError: The path does not exist or holds no caption.
    """
    path = Path(path)
    if path.is_dir():
        texts = [reading.read_text(file) for file in sorted(path.rglob("*.txt"))]
    elif not path.is_file():
        raise DataError(f"{path} does not exist; expected HumanML3D's texts folder or JSON file")
    else:
        packed = path.suffix == ".xz"
        entries = (
            reading.parse_json(reading.unpack_xz(path), path)
            if packed
            else reading.read_json_file(path)
        )
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

    sentences: int  # Number of held-out sentences.
    cosine: float  # Mean cosine of both embeddings of a sentence.
    cosine_5_percent: float  # 5th percentile of the cosines.
    # Share of sentences whose nearest among 32 others is the same for student and teacher.
    nearest: float
    # Share of sentences whose student embedding is nearest to their own teacher embedding, among 33
    # teacher embeddings.
    own_first: float


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
# Special pieces of a WordPiece vocabulary, and what marks pieces inside words. A smaller vocabulary
# keeps its teacher's spelling, so that a sentence of these pieces is split in the same places as
# its teacher splits it, and the states of both can be compared word by word.
CONTINUATION = "##"


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


POOLED_WEIGHT = 20.0
RELATION_WEIGHT = 20.0
CARD_FILE = "card.json"
LICENSE = "Apache-2.0 (started from all-MiniLM-L6-v2, Apache-2.0; captions HumanML3D, MIT)"


@dataclass(frozen=True)
class StudentRecipe:
    """Everything that decides what the distillation yields, but captions and teacher."""

    # The teacher's layer that each layer of the student starts from.
    layers: tuple[int, ...] = (0, 2, 5)
    # Frequent English words in the vocabulary, besides the pieces of the captions.
    words: int = 8000
    # Frequent word ends (`##ing`) in the vocabulary, besides those of the captions.
    continuations: int = 1200
    positions: int = 128  # Longest sentence in pieces; longer ones are cut.
    # Optimization; the seed also decides the variations of captions.
    training: TrainingSettings = field(default_factory=partial(optimization, "text_encoder"))


def distillation_losses(
    pooled: Float[torch.Tensor, "batch width"],
    states: Float[torch.Tensor, "batch words width"],
    batch: SentenceBatch,
) -> dict[str, torch.Tensor]:
    """Returns the losses of one batch; "total" weights the others as stated at the top.

    Args:
        pooled: The student's sentence embeddings of unit length.
        states: The student's piece states.
        batch: The sentences with the teacher's outputs.
    """
    sentence = (pooled - batch.pooled).square().sum(1).mean()
    relation = (pooled @ pooled.T - batch.pooled @ batch.pooled.T).square().mean()
    error = (states[batch.aligned] - batch.words).square().sum(1)
    words = (error / batch.words.square().sum(1)).sum() / max(1, len(batch.words))
    total = POOLED_WEIGHT * sentence + words + RELATION_WEIGHT * relation
    return {"total": total, "sentence": sentence, "words": words, "relation": relation}


class TextEncoderStage(Stage[StudentNetwork]):
    """The student, the sentences it is trained on, and those it is validated on.

    Args:
        network: The network to train.
        data: Sentences with the teacher's outputs.
        held_out: At least 33 other sentences.
        settings: Batch size and seed.
        context: The device and rank.
    """

    def __init__(
        self,
        network: StudentNetwork,
        data: TrainingSet,
        held_out: ValidationSentences,
        settings: TrainingSettings,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = network
        self._data, self._held_out, self._context = data, held_out, context
        lengths = np.array([len(row) for row in data.ids])
        self._sampler = SentenceSampler(lengths, settings.batch_size, settings.seed)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        rows, device = self._sampler(step), self._context.device
        batch = self._data.batch(rows[self._context.ranks.shard(len(rows))]).to(device)
        pooled, states = self.network(batch.tokens, batch.mask)
        with torch.autocast(device.type, enabled=False):
            return distillation_losses(pooled, states.float(), batch)

    @torch.no_grad()
    def validate(self, network: StudentNetwork) -> dict[str, float]:
        """Agreement with the teacher on held-out sentences, see `Figures`."""
        ids, device = self._held_out.ids, self._context.device
        batches = (padded(ids[first : first + AT_ONCE]) for first in range(0, len(ids), AT_ONCE))
        pooled = [network(tokens.to(device), mask.to(device))[0] for tokens, mask in batches]
        figures = compare(torch.cat(pooled).cpu().numpy(), self._held_out.pooled)
        return {k: v for k, v in asdict(figures).items() if k != "sentences"}


def train_text_encoder(
    recipe: StudentRecipe,
    captions: Sequence[TaggedCaption],
    teacher: PretrainedTextEncoder,
    folder: Path,
    context: DistributedContext,
) -> Path:
    """Distills a text encoder, or resumes it; returns the folder with its files and card.

    Args:
        recipe: Sizes of the student and settings of its training.
        captions: Captions of motions; one in twenty is held out for validation.
        teacher: MiniLM or another BERT whose sentence embedding is the mean of the piece states.
        folder: Run folder; the encoder is written to `encoder/` in it.
        context: The device and rank.

    Raises:
        DataError: Fewer than 33 captions are held out.
        InputError: The run folder holds another run.
    """
    held_out = held_out_sentences(captions)
    corpus = json.dumps([(caption.text, caption.tags) for caption in captions])
    digest = hashlib.sha256(corpus.encode()).hexdigest()
    run = {"kind": "TextEncoderRun", "stage": "text-encoder", "captions": digest}
    open_run(folder, {**run, "teacher": teacher.name, "recipe": recipe}, context)
    large = Tokenizer.from_str(teacher.tokenizer.backend_tokenizer.to_str())
    large.no_padding()
    large.enable_truncation(recipe.positions)
    texts = [caption.text for caption in captions]
    pieces = pieces_to_keep(large, texts, recipe.words, recipe.continuations)
    small = restrict(large, pieces, recipe.positions)
    sentences = training_sentences(captions, large, recipe)
    targets = teacher_targets(folder / "targets", sentences, large, teacher, context)
    data = TrainingSet(_ids(small, sentences), aligned(sentences, large, small), targets)
    measured = ValidationSentences(held_out, _ids(small, held_out), teacher(held_out).pooled)
    network = first_network(recipe, teacher.model, places_in(large, small))
    stage = TextEncoderStage(network, data, measured, recipe.training, context)
    network, _ = train(stage, recipe.training, folder, context)
    encoder = folder / "encoder"
    if context.is_main:
        encoder.mkdir(exist_ok=True)
        export_student(network.cpu(), small, known_words(small, texts), encoder)
        write_card(encoder, recipe, teacher.name, measured)
    return encoder


def held_out_sentences(captions: Sequence[TaggedCaption]) -> list[str]:
    """Returns the held-out captions in random order.

    Raises:
        DataError: There are fewer than 33, one group of the validation.
    """
    sentences = sorted(caption.text for caption in captions if is_held_out(caption.text))
    if len(sentences) < GROUP:
        raise DataError(
            f"{len(sentences)} of {len(captions)} captions are held out for validation, expected "
            f"{GROUP} or more; use more captions"
        )
    random.Random(0).shuffle(sentences)
    return sentences


def training_sentences(
    captions: Sequence[TaggedCaption], tokenizer: Tokenizer, recipe: StudentRecipe
) -> list[str]:
    """Returns captions, a variation of each, short phrases and the empty sentence, sorted.

    Args:
        captions: All captions; held-out ones are left out.
        tokenizer: The teacher's tokenizer.
        recipe: Number of frequent words, and the seed of the variations.
    """
    generator = random.Random(recipe.training.seed)
    words = frequent_words(tokenizer, recipe.words)
    train = [caption for caption in captions if not is_held_out(caption.text)]
    sentences = [caption.text for caption in train]
    sentences += [vary(caption, words, generator) for caption in train]
    sentences += plain_phrases(train, words, generator)
    return sorted({text for text in sentences if not is_held_out(text)} | {""})


def aligned(sentences: Sequence[str], large: Tokenizer, small: Tokenizer) -> list[bool]:
    """Returns for each sentence whether both tokenizers split it into the same pieces."""
    texts = list(sentences)
    pairs = zip(large.encode_batch(texts), small.encode_batch(texts), strict=True)
    return [theirs.tokens == ours.tokens for theirs, ours in pairs]


def first_network(recipe: StudentRecipe, teacher: Any, pieces_kept: np.ndarray) -> StudentNetwork:
    """Returns the untrained student, made of the teacher's layers and piece embeddings.

    Args:
        recipe: Layers to keep and number of positions.
        teacher: Hugging Face's `BertModel`.
        pieces_kept: The teacher's id of each piece of the student.
    """
    config = teacher.config
    shape = NetworkShape(
        len(pieces_kept), config.hidden_size, len(recipe.layers), config.num_attention_heads,
        config.intermediate_size, recipe.positions,
    )  # fmt: skip
    network = StudentNetwork(shape)
    pieces = pieces_kept.tolist()
    state = teacher_state(teacher.state_dict(), pieces, recipe.layers, recipe.positions)
    network.load_state_dict(state)
    return network


def known_words(tokenizer: Tokenizer, texts: Sequence[str]) -> list[str]:
    """Returns words that the tokenizer splits but that occur twice or more, so are no typos."""
    split = Counter(word for text in texts for word in split_words(tokenizer, text))
    return [word for word, count in split.items() if count > 1]


def write_card(
    folder: Path, recipe: StudentRecipe, teacher: str, held_out: ValidationSentences
) -> None:
    """Writes the card of an exported student: origin, agreement with the teacher, speed, sizes."""
    student = StudentTextEncoder.load(folder)
    with silent_of_unknown():
        figures = compare(student(held_out.sentences).pooled, held_out.pooled)
        pace = milliseconds(student, held_out.sentences[:300])
    card = {
        "name": student.name,
        "teacher": "all-MiniLM-L6-v2" if teacher.startswith("minilm") else teacher,
        "license": LICENSE,
        "recipe": asdict(recipe),
        "held_out": asdict(figures),
        "milliseconds_a_sentence": pace,
        "bytes": {p.name: p.stat().st_size for p in folder.iterdir() if p.name != CARD_FILE},
    }
    write_file(folder / CARD_FILE, json.dumps(card, indent=2) + "\n")


def _ids(tokenizer: Tokenizer, sentences: Sequence[str]) -> list[list[int]]:
    return [encoding.ids for encoding in tokenizer.encode_batch(list(sentences))]


# `subjects`, `synonyms`, `activities`, `manners`, and `frames` that verbs and activities fill.
_WORDS = reading.packaged_toml(__file__, "augmentation.toml")

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
    elif form == "imperative":  # lemmas from the first verb on, "walk forward then turn"
        verbs = [index for index, (_, tag) in enumerate(caption.tags) if tag == "VERB"]
        if verbs:
            lemmas = [lemma for lemma, _ in caption.tags[verbs[0] :]]
            text = " ".join(lemmas[: generator.randint(1, len(lemmas))])
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
        forms = {
            "plain": verb,
            "goes": inflect(verb, "third"),
            "going": inflect(verb, "participle"),
        }
        phrases += [frame.format_map(forms) for frame in _WORDS["verb_frames"]]
    phrases += [f"{phrase} {generator.choice(_WORDS['manners'])}".strip() for phrase in phrases]
    phrases += [
        frame.format(what) for what in _WORDS["activities"] for frame in _WORDS["activity_frames"]
    ]
    phrases += [f"{generator.choice(verbs)} {generator.choice(nouns)}" for _ in nouns]
    return phrases + nouns + list(words)
