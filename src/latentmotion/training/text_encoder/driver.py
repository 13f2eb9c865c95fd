"""The starter's text encoder from captions to folder: what it reads, whom it follows, how long.

A 3-layer student of width 384 starts from layers 0, 2 and 5 of all-MiniLM-L6-v2 and from the
teacher's own piece embeddings, and learns the teacher's answers by `distillation`.
"""

from __future__ import annotations

import dataclasses
import json
import random
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tokenizers import Tokenizer

from latentmotion.export import text_encoder as export
from latentmotion.networks.pretrained_text import PretrainedTextEncoder, Reading
from latentmotion.networks.text_encoder import NetworkShape, StudentNetwork, teacher_state
from latentmotion.storage.files import atomic_file
from latentmotion.text import vocabulary
from latentmotion.text.encoder import StudentTextEncoder, UnknownWordsWarning, split_words
from latentmotion.training.text_encoder.augmentation import plain_phrases, vary
from latentmotion.training.text_encoder.corpus import (
    Figures,
    TaggedCaption,
    compare,
    is_held_out,
    milliseconds,
)
from latentmotion.training.text_encoder.stage import CPU, Schedule, TrainingSet, distill
from latentmotion.training.text_encoder.targets import teacher_targets

CHECKPOINT_FILE = "state.pt"
CARD_FILE = "card.json"
LICENSE = "Apache-2.0 (started from all-MiniLM-L6-v2, Apache-2.0; captions HumanML3D, MIT)"


@dataclass(frozen=True)
class StudentRecipe:
    """What decides the student's vocabulary, network and training."""

    schedule: Schedule
    """Steps and pace."""

    layers: tuple[int, ...] = (0, 2, 5)
    """The teacher's layer that each layer of the student starts from."""

    words: int = 8000
    """Frequent English words kept beside the captions' pieces."""

    continuations: int = 1200
    """Frequent word ends (`##ing`) kept beside them."""

    positions: int = 128
    """Longest sentence in pieces."""


def train_student(
    recipe: StudentRecipe,
    captions: Sequence[TaggedCaption],
    teacher: PretrainedTextEncoder,
    folder: Path,
    report: Callable[[str], None] = print,
    device: torch.device = CPU,
) -> Path:
    """Trains a student, or goes on where a killed run was, and writes its files.

    Args:
        recipe: What to make.
        captions: Captions of motions, held-out ones included; those are only measured on.
        teacher: MiniLM or another BERT with mean pooling.
        folder: Run folder; its `encoder/` gets the files and a card with figures.
        report: Called with lines of progress.
        device: Where teacher and student compute; both are on the CPU in the end.

    Returns:
        The folder with the encoder.
    """
    large = _unpadded(teacher, recipe.positions)
    texts = [caption.text for caption in captions]
    pieces = vocabulary.pieces_to_keep(large, texts, recipe.words, recipe.continuations)
    small = vocabulary.restrict(large, pieces, recipe.positions)
    sentences = training_sentences(captions, large, recipe)
    answers = _answers(teacher, device)
    targets = teacher_targets(folder / "targets", sentences, large, answers, report)
    teacher.model.cpu()
    ids = [encoding.ids for encoding in small.encode_batch(sentences)]
    data = TrainingSet(ids, aligned(sentences, large, small), targets)
    network = first_network(recipe, teacher.model, vocabulary.places_in(large, small))
    distill(network, data, recipe.schedule, folder / CHECKPOINT_FILE, report, device=device)
    network.cpu()
    return write_student(recipe, network, small, captions, teacher, folder / "encoder")


def training_sentences(
    captions: Sequence[TaggedCaption], tokenizer: Tokenizer, recipe: StudentRecipe
) -> list[str]:
    """Returns what to learn from: captions, a variation of each, phrases, the empty sentence."""
    generator = random.Random(recipe.schedule.seed)
    words = vocabulary.frequent_words(tokenizer, recipe.words)
    train = [caption for caption in captions if not is_held_out(caption.text)]
    sentences = [caption.text for caption in train]
    sentences += [vary(caption, words, generator) for caption in train]
    sentences += plain_phrases(train, words, generator)
    return sorted({text for text in sentences if not is_held_out(text)} | {""})


def aligned(sentences: Sequence[str], large: Tokenizer, small: Tokenizer) -> list[bool]:
    """Returns for every sentence whether both tokenizers cut it into the same pieces."""
    texts = list(sentences)
    pairs = zip(large.encode_batch(texts), small.encode_batch(texts), strict=True)
    return [theirs.tokens == ours.tokens for theirs, ours in pairs]


def first_network(recipe: StudentRecipe, teacher: Any, pieces_kept: np.ndarray) -> StudentNetwork:
    """Returns the untrained student, made of parts of its teacher."""
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


def write_student(
    recipe: StudentRecipe,
    network: StudentNetwork,
    tokenizer: Tokenizer,
    captions: Sequence[TaggedCaption],
    teacher: PretrainedTextEncoder,
    folder: Path,
) -> Path:
    """Writes the files of a trained student and its card, and returns their folder."""
    folder.mkdir(parents=True, exist_ok=True)
    split = Counter(word for caption in captions for word in split_words(tokenizer, caption.text))
    # A word seen once is as often as not a slip of the pen.
    known = [word for word, count in split.items() if count > 1]
    export.export_student(network, tokenizer, known, folder)
    student = StudentTextEncoder.load(folder)
    held_out = sorted(caption.text for caption in captions if is_held_out(caption.text))
    random.Random(0).shuffle(held_out)
    card = student_card(recipe, student, teacher, held_out, folder)
    with atomic_file(folder / CARD_FILE) as temporary:
        temporary.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    return folder


def student_card(
    recipe: StudentRecipe,
    student: StudentTextEncoder,
    teacher: PretrainedTextEncoder,
    held_out: Sequence[str],
    folder: Path,
) -> dict[str, Any]:
    """Measures a student and returns what its card says."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnknownWordsWarning)
        figures: Figures = compare(student(held_out).pooled, teacher(held_out).pooled)
        pace = milliseconds(student, held_out[:300])
    sizes = {path.name: path.stat().st_size for path in folder.iterdir() if path.name != CARD_FILE}
    return {
        "name": student.name,
        "teacher": "all-MiniLM-L6-v2" if teacher.name.startswith("minilm") else teacher.name,
        "license": LICENSE,
        "recipe": dataclasses.asdict(recipe),
        "held_out": dataclasses.asdict(figures),
        "milliseconds_a_sentence": pace,
        "bytes": sizes,
    }


def _unpadded(teacher: PretrainedTextEncoder, longest: int) -> Tokenizer:
    tokenizer = Tokenizer.from_str(teacher.tokenizer.backend_tokenizer.to_str())
    tokenizer.no_padding()
    tokenizer.enable_truncation(longest)
    return tokenizer


def _answers(
    teacher: PretrainedTextEncoder, device: torch.device
) -> Callable[..., tuple[torch.Tensor, torch.Tensor]]:
    """The teacher in 16 bits, which is three times faster and rounds cosines in the 5th digit."""

    def read(tokens: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        model = teacher.model.to(device)
        with torch.autocast(device.type, torch.bfloat16):
            reading: Reading = teacher.kind.read(model, tokens.to(device), mask.to(device))
        return reading.pooled.float().cpu(), reading.words.float().cpu()

    return read
