"""An evaluator of text and motion on disk: `evaluator.json`, `weights.safetensors`, text encoder.

The weights file holds the networks, the evaluator's own statistics and, where words have a table,
their vectors. A small text encoder's files are copied; of others name and place are kept.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from safetensors.torch import save_file
from torch import Tensor

from latentmotion.checkpoint import load_weights, read_weights
from latentmotion.condition.text.graph import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.student import StudentTextEncoder
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.extractors.interface import EVALUATOR_FILE, WEIGHTS_FILE
from latentmotion.evaluation.extractors.text_motion import (
    FORMAT,
    MEAN,
    STD,
    WORDS,
    TextMotionCard,
    TextMotionEvaluator,
    tensors_of,
)
from latentmotion.evaluation.extractors.word_vectors import EncodedWords, GloveWords, WordVectors
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.storage.files import atomic_folder


def save_text_motion(
    folder: str | Path, evaluator: TextMotionEvaluator, encoder: Path | None = None
) -> None:
    """Writes an evaluator folder in place of what is there, or nothing at all.

    Args:
        folder: Where to.
        evaluator: What to write.
        encoder: Folder of the small text encoder that it reads words through, which is copied.

    Raises:
        InputError: The folder cannot be written.
    """
    tensors = {name: t.detach().cpu().contiguous() for name, t in tensors_of(evaluator).items()}
    with atomic_folder(folder, EVALUATOR_FILE) as temporary:
        write_json(temporary / EVALUATOR_FILE, evaluator.card)
        save_file(tensors, temporary / WEIGHTS_FILE)
        for name in (GRAPH_FILE, TOKENIZER_FILE) if encoder else ():
            shutil.copyfile(Path(encoder or "") / name, temporary / name)


def load_text_motion(folder: Path) -> TextMotionEvaluator:
    """Reads an evaluator folder; the networks are in `eval()` mode, on the CPU.

    Raises:
        ModelError: Something is missing, damaged, or does not fit the rest.
    """
    card = _read_card(folder / EVALUATOR_FILE)
    tensors = read_weights(folder / WEIGHTS_FILE)
    try:
        mean, std = (tensors.pop(name).numpy() for name in (MEAN, STD))
        normalizer = Normalizer(mean, std)
        vectors = _word_vectors(card, folder, tensors)
    except (KeyError, InputError) as error:
        raise ModelError(f"{folder / WEIGHTS_FILE} does not fit: {error}") from error
    networks = card.networks.build()
    load_weights(networks, tensors, str(folder / WEIGHTS_FILE))
    return TextMotionEvaluator(card, networks, normalizer, vectors)


def _word_vectors(card: TextMotionCard, folder: Path, tensors: dict[str, Tensor]) -> WordVectors:
    if card.vocabulary:
        return GloveWords(card.vocabulary, tensors.pop(WORDS).numpy())
    encoder = _text_encoder(card.words, folder)
    if encoder.name != card.words:
        raise ModelError(
            f"{folder} reads words through {card.words!r}, found {encoder.name!r}; "
            "put that text encoder there, or train the evaluator again"
        )
    return EncodedWords(encoder)


def _text_encoder(name: str, folder: Path) -> Any:
    if (folder / GRAPH_FILE).is_file():
        return StudentTextEncoder.load(folder)
    from latentmotion.condition.text.pretrained import KINDS, PretrainedTextEncoder

    kind, _, place = name.partition(":")
    if kind in KINDS:
        return PretrainedTextEncoder.load(kind, place)
    raise ModelError(f"{folder} lacks its text encoder {name!r}: {GRAPH_FILE}; copy it again")


def _read_card(path: Path) -> TextMotionCard:
    try:
        card = read_json(TextMotionCard, path)
    except InputError as error:
        raise ModelError(str(error)) from error
    if card.format != FORMAT:
        raise ModelError(f"{path}: format {card.format}, expected {FORMAT}; update latentmotion")
    return card
