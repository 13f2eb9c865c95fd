"""The condition that a model card names: sentences, labels or nothing."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from latentmotion.condition.interface import Condition, TextEncoder
from latentmotion.condition.text.encoder_files import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.lengths import LENGTHS_FILE, LengthFile
from latentmotion.condition.text.prompt_cache import KnowingEncoder, RememberingTextEncoder
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.folder import find_model, shipped_models


def condition_of(card: ModelCard, folder: Path, cache: Path | None = None) -> Condition:
    """Returns the condition of a folder that runs without PyTorch.

    Args:
        card: What the model is.
        folder: Its folder.
        cache: Folder in which answers of the text encoder are kept.

    Raises:
        ModelError: The text encoder is missing or damaged; with a cache, once a prompt is new.
    """
    return build_condition(card, lambda: _encoder(encoder_folder(card, folder) or folder, cache))


def build_condition(card: ModelCard, encoder: Callable[[], TextEncoder]) -> Condition:
    """Returns the condition of a model; the text encoder is asked for where there are sentences."""
    return card.condition.condition(card.trained_denoiser.condition_width, encoder)


def encoder_folder(card: ModelCard, folder: Path) -> Path | None:
    """Returns the model's folder or a shipped one, whichever holds the encoder that it reads."""
    if (folder / GRAPH_FILE).is_file():
        return folder
    name = card.condition.text_encoder
    shipped = (find_model(model) for model in shipped_models())
    holding = (place for place in shipped if (place / GRAPH_FILE).is_file())
    return next((place for place in holding if _encoder_named_in(place) == name), None)


def find_lengths(card: ModelCard, folder: Path) -> LengthFile | None:
    """Returns what predicts lengths, from the model's folder or from its text encoder's."""
    if not card.condition.reads_text:
        return None
    places = folder, encoder_folder(card, folder)
    found = [place / LENGTHS_FILE for place in places if place is not None]
    path = next((path for path in found if path.is_file()), None)
    return path and LengthFile(path, card.condition.text_encoder)


def _encoder_named_in(folder: Path) -> str | None:
    return read_card(folder).condition.text_encoder


def _encoder(folder: Path, cache: Path | None) -> TextEncoder:
    def load() -> KnowingEncoder:
        # Looked up only here, since known prompts need not even a tokenizer.
        return import_module("latentmotion.condition.text.student").load_text_encoder(folder)

    files = folder / GRAPH_FILE, folder / TOKENIZER_FILE
    if cache is None or not all(file.is_file() for file in files):
        return load()
    return RememberingTextEncoder(files, load, cache / "prompts")
