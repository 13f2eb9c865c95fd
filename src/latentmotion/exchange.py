"""One model's decoder for another model, where both have the same encoder and so the same latents.

A student and a cheap decoder are made apart from the same model, and put together here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from latentmotion.checkpoint import FirstStageModel
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import ModelCard, Provenance
from latentmotion.vae.halves import fingerprint

Model = TypeVar("Model", bound=FirstStageModel)

_OF_DECODER = ("vae_", "decoder_")
"""How figures begin that are a decoder's alone."""

_OF_DENOISER = ("denoiser_", "student_", "teacher")
"""How figures begin that no decoder changes."""


def with_decoder(model: Model, other: FirstStageModel) -> Model:
    """Returns `model` with the decoder of `other`.

    Raises:
        InputError: Their latents are not the same.
        ModelError: One of them has no VAE.
    """
    check_latents(model, other)
    card = replace(
        model.card,
        vae=other.card.vae,
        provenance=_joined(model.card.provenance, other.card),
        figures={**other_figures(model.card), **decoder_figures(other.card)},
    )
    return replace(model, card=card, vae=other.vae)


def check_latents(model: FirstStageModel, other: FirstStageModel) -> None:
    """Compares what two models' latents are made of.

    Raises:
        InputError: They differ.
        ModelError: One of them has no VAE.
    """
    pairs = {
        "encoders": (_encoder_of(model), _encoder_of(other)),
        "normalizers": (scale_of(model.card), scale_of(other.card)),
    }
    for what, (one, another) in pairs.items():
        if one != another:
            raise InputError(
                f"models {model.card.name!r} and {other.card.name!r} have different {what}, so one "
                "cannot read the other's latents; make a decoder for them: latentmotion train "
                "decoder"
            )


def scale_of(card: ModelCard) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
    """Returns which features a model knows and how they are normalized."""
    return card.representation, card.normalizer_mean, card.normalizer_std


def other_figures(card: ModelCard) -> dict[str, Any]:
    """Returns what was measured of a model and holds with any decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DENOISER)}


def decoder_figures(card: ModelCard) -> dict[str, Any]:
    """Returns what was measured of a model's decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DECODER)}


def _encoder_of(model: FirstStageModel) -> str:
    if not model.card.vae.has_weights:
        raise ModelError(f"model {model.card.name!r} has no VAE: run latentmotion train vae")
    return fingerprint(model.vae)


def _joined(mine: Provenance, other: ModelCard) -> Provenance:
    its = other.provenance
    return replace(
        mine,
        data=tuple(dict.fromkeys((*mine.data, *its.data))),
        data_hashes={**its.data_hashes, **mine.data_hashes},
        commands=tuple(dict.fromkeys((*mine.commands, *its.commands))),
        hours=round(mine.hours + other.figures.get("decoder_hours", 0.0), 3),
    )
