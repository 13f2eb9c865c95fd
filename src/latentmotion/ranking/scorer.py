"""Scorer: sentences and motions to vectors of unit length, close if they mean the same.

A folder holds `scorer.json`, `motion.onnx` (features, mask → vector), `text.onnx` (word pieces,
mask → vector) and, where they may be passed on, the vectors of training clips. Word pieces come
from the text encoder of a shipped model, which the card names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import prefix_mask
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.engine.encoder import LazyTextEncoder
from latentmotion.engine.session import LazySession
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import SHIPPED, Provenance, shipped_text_encoder
from latentmotion.motion import Motion, features_of
from latentmotion.representation import representation_named
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.representation.interface import ClipFeatures, Representation
from latentmotion.storage.configuration import read_json

FORMAT = 1  # Version of scorer.json.

CARD_FILE, MOTION_FILE, TEXT_FILE = "scorer.json", "motion.onnx", "text.onnx"  # Files of a scorer.

CLIPS_FILE = "clips.safetensors"  # Vectors of training clips, if any.

UNIT = 4  # Frames of a token; lengths are multiples of it.

# Most motions that go through the graph together.
_AT_ONCE = 32


@dataclass(frozen=True)
class ScorerCard:
    """Content of `scorer.json`."""

    name: str  # Name of the scorer.
    representation: str  # Name of the motion features.
    text_encoder: str  # Name of the text encoder whose word pieces it reads.
    word_width: int  # Numbers per word piece.
    width: int  # Numbers per vector.
    fingerprint: str  # Hash of weights and statistics.
    provenance: Provenance = field(default_factory=Provenance)  # Origin of the weights.
    figures: dict[str, Any] = field(default_factory=dict)  # Measured figures, by name.
    format: int = FORMAT  # Version of this file.


@dataclass(frozen=True)
class Scorer:
    """Both towers, loaded when they are first needed."""

    card: ScorerCard  # The scorer's card.
    folder: Path  # Its folder.
    motion_tower: LazySession  # Features, mask → vectors.
    text_tower: LazySession  # Word pieces, mask → vectors.
    encoder: TextEncoder  # Sentences to word pieces.

    @classmethod
    def load(cls, folder: str | Path | None = None, encoder: TextEncoder | None = None) -> Scorer:
        """Opens a scorer.

        Args:
            folder: Its folder; by default the one that ships.
            encoder: Text encoder that is loaded anyway; used if it is the scorer's.

        Raises:
            ModelError: A file is missing or damaged, or no model has the text encoder.
        """
        place = SHIPPED / "scorer" if folder is None else Path(folder)
        if not (place / CARD_FILE).is_file():
            raise ModelError(
                f"{place} is no scorer: it has no {CARD_FILE}; make one by latentmotion export "
                "scorer"
            )
        try:
            card = read_json(ScorerCard, place / CARD_FILE)
        except InputError as error:
            raise ModelError(str(error)) from error
        if card.format != FORMAT:
            raise ModelError(f"{place}: format {card.format}, expected {FORMAT}; update it")
        if encoder is None or encoder.name != card.text_encoder:
            source = shipped_text_encoder(card.text_encoder)
            if source is None:
                raise ModelError(
                    f"{place} reads words through {card.text_encoder!r}, which no shipped model has"
                )
            encoder = LazyTextEncoder(source, card.text_encoder, card.word_width)
        motion_tower = LazySession(place / MOTION_FILE, threads=1)
        return cls(card, place, motion_tower, LazySession(place / TEXT_FILE, threads=1), encoder)

    @cached_property
    def representation(self) -> Representation:
        """The motion features that it reads."""
        features = representation_named(self.card.representation)
        # Rotations follow from positions, so towers leave them out; they are a third of the time.
        rotates = isinstance(features, HumanML3DRepresentation)
        return replace(features, rotated=False) if rotates else features

    def texts(self, sentences: Sequence[str]) -> Float[np.ndarray, "sentences width"]:
        """Returns the vectors of sentences.

        Raises:
            InputError: There is no sentence.
        """
        read = self.encoder(sentences)
        # One at a time, so that a vector does not depend on the company of its sentence.
        rows = [
            self.text_tower(words=words[mask][None], mask=np.ones((1, mask.sum()), bool))
            for words, mask in zip(read.words, read.mask, strict=True)
        ]
        return self._finite(np.concatenate(rows))

    def motions(self, motions: Sequence[Motion]) -> Float[np.ndarray, "motions width"]:
        """Returns the vectors of motions, each as it would be alone.

        Raises:
            InputError: A motion has another skeleton, or is shorter than 0.3 s.
        """
        return self.embed([features_of(motion, self.representation) for motion in motions])

    def embed(self, features: Sequence[ClipFeatures]) -> Float[np.ndarray, "motions width"]:
        """Returns the vectors of features in their own units.

        Frames after the last complete token of four are ignored.

        Raises:
            InputError: There are fewer than four frames.
        """
        lengths = np.array([len(each) // UNIT * UNIT for each in features], int)
        if len(lengths) and not lengths.min():
            raise InputError(f"a motion of fewer than {UNIT + 1} frames; expected 0.3 s or more")
        vectors = np.zeros((len(features), self.card.width), np.float32)
        order = np.argsort(lengths, kind="stable")
        for start in range(0, len(order), _AT_ONCE):
            rows = order[start : start + _AT_ONCE]
            mask = prefix_mask(lengths[rows])
            padded = np.zeros((*mask.shape, features[0].shape[1]), np.float32)
            padded[mask] = np.concatenate([features[row][: lengths[row]] for row in rows])
            vectors[rows] = self.motion_tower(features=padded, mask=mask)
        return self._finite(vectors)

    def _finite(self, vectors: Float[np.ndarray, "rows width"]) -> Float[np.ndarray, "rows width"]:
        """Raises ModelError for vectors that only damaged weights give."""
        if not np.isfinite(vectors).all():
            raise ModelError(f"{self.folder}: the scorer's weights are damaged; copy it again")
        return vectors


@cache
def shipped_scorer() -> Scorer:
    """Returns the scorer that ships, opened once."""
    return Scorer.load()
