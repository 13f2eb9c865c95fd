"""Decoder swap: one model's decoder for another model with the same encoder, so the same latents.

A few-step student and a light decoder are trained separately from the same model, and combined
here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import ModelCard
from latentmotion.networks.checkpoint import FirstStageModel
from latentmotion.networks.vae.interface import fingerprint

Model = TypeVar("Model", bound=FirstStageModel)

_OF_DECODER = ("vae_", "decoder_")
"""Prefixes of figures that depend on the decoder alone."""

_OF_DENOISER = ("denoiser_", "student_", "teacher")
"""Prefixes of figures that do not depend on the decoder."""


def with_decoder(model: Model, other: FirstStageModel) -> Model:
    """Returns `model` with the decoder of `other`.

    Raises:
        InputError: Their latents are not the same.
        ModelError: One of them has no VAE.
    """
    check_latents(model, other)
    ours, theirs = model.card.provenance, other.card.provenance
    provenance = replace(
        ours,
        data=tuple(dict.fromkeys((*ours.data, *theirs.data))),
        data_hashes={**theirs.data_hashes, **ours.data_hashes},
        commands=tuple(dict.fromkeys((*ours.commands, *theirs.commands))),
        hours=round(ours.hours + other.card.figures.get("decoder_hours", 0.0), 3),
    )
    card = replace(
        model.card,
        vae=other.card.vae,
        provenance=provenance,
        figures={**other_figures(model.card), **decoder_figures(other.card)},
    )
    return replace(model, card=card, vae=other.vae)


def check_latents(model: FirstStageModel, other: FirstStageModel) -> None:
    """Checks that the latents of two models are the same.

    Raises:
        InputError: They differ.
        ModelError: One of them has no VAE.
    """
    pairs = {
        "encoders": (_encoder_of(model), _encoder_of(other)),
        "normalizers": (scale_of(model.card), scale_of(other.card)),
    }
    for what, (ours, theirs) in pairs.items():
        if ours != theirs:
            raise InputError(
                f"models {model.card.name!r} and {other.card.name!r} have different {what}, so one "
                "cannot read the other's latents; make a decoder for them: latentmotion train "
                "decoder"
            )


def scale_of(card: ModelCard) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
    """Returns the representation of a model and the scale of its features."""
    return card.representation, card.normalizer_mean, card.normalizer_std


def other_figures(card: ModelCard) -> dict[str, Any]:
    """Returns the figures of a model that hold with any decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DENOISER)}


def decoder_figures(card: ModelCard) -> dict[str, Any]:
    """Returns the figures of a model's decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DECODER)}


def _encoder_of(model: FirstStageModel) -> str:
    if not model.card.vae.has_weights:
        raise ModelError(f"model {model.card.name!r} has no VAE: run latentmotion train vae")
    return fingerprint(model.vae)
