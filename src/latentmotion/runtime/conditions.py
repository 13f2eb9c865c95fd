"""The condition that a model card names: sentences, labels or nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from latentmotion.condition.action import ActionCondition
from latentmotion.condition.interface import Condition, TextEncoder
from latentmotion.condition.sentence import SentenceCondition, SentenceReading
from latentmotion.condition.text.student import load_text_encoder
from latentmotion.condition.unconditional import Unconditional
from latentmotion.configuration import from_json
from latentmotion.model_card import ModelCard


def condition_of(card: ModelCard, folder: Path) -> Condition:
    """Returns the condition of a folder that runs without PyTorch.

    Raises:
        ModelError: The text encoder is missing or damaged.
    """
    return build_condition(card, lambda: load_text_encoder(folder))


def build_condition(card: ModelCard, encoder: Callable[[], TextEncoder]) -> Condition:
    """Returns the condition of a model; the text encoder is asked for where there are sentences."""
    if card.task == "action":
        return ActionCondition(labels_of(card))
    if card.task == "unconditional":
        return Unconditional(int(card.denoiser["condition_width"]))
    reading = from_json(SentenceReading, card.condition.get("reading", {}))
    return SentenceCondition(encoder(), reading)


def labels_of(card: ModelCard) -> tuple[str, ...]:
    """Returns the labels that an action model knows; numbers, where it was not told names."""
    classes = range(int(card.denoiser.get("condition_width", 0)))
    return tuple(card.condition.get("labels", ())) or tuple(map(str, classes))
