"""The T2M evaluator as metrics use it: motions in their own units and captions to vectors."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from latentmotion.data.clip import Caption
from latentmotion.errors import InputError
from latentmotion.evaluation.extractors.networks import (
    FRAMES,
    TextMotionConfig,
    TextMotionNetworks,
)
from latentmotion.evaluation.extractors.word_vectors import GloveWords, WordVectors
from latentmotion.model.card import Provenance
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.configuration import to_json

FORMAT = 1
"""Version of evaluator.json that this code writes and reads."""

AT_ONCE = 64
"""Motions or captions that go through a network together."""

MEAN, STD, WORDS = "normalizer.mean", "normalizer.std", "words.vectors"
"""Names of what is not a network's in the weights file."""


@dataclass(frozen=True)
class TextMotionCard:
    """What `evaluator.json` says."""

    name: str
    """What it is called."""
    representation: str
    """Name of the motion features."""
    networks: TextMotionConfig
    """Sizes of the networks."""
    words: str
    """Where word vectors come from: `glove`, or the name of a text encoder."""
    vocabulary: tuple[str, ...] = ()
    """The words that have vectors; none where a text encoder gives them."""
    provenance: Provenance = field(default_factory=Provenance)
    """Where the weights come from."""
    figures: dict[str, Any] = field(default_factory=dict)
    """Measured figures, by name."""
    kind: Literal["text_motion"] = "text_motion"
    """What distinguishes it from other evaluators."""
    format: int = FORMAT
    """Version of this file."""


@dataclass(frozen=True, eq=False)
class TextMotionEvaluator:
    """Motions and captions to vectors of one space; a `TextMotionExtractor`."""

    card: TextMotionCard
    """What it is."""
    networks: TextMotionNetworks
    """The three networks, in `eval()` mode."""
    normalizer: Normalizer
    """Its own statistics, which are not the data set's."""
    vectors: WordVectors
    """Captions to word vectors."""

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.card.networks.width

    @property
    def official(self) -> bool:
        """Whether it is one that papers use: a file of its authors, converted."""
        commands = self.card.provenance.commands
        return bool(commands) and all("convert evaluator" in command for command in commands)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of weights, statistics and sizes."""
        digest = hashlib.sha256(json.dumps([to_json(self.card.networks), self.card.words]).encode())
        for name, tensor in sorted(tensors_of(self).items()):
            digest.update(name.encode() + tensor.cpu().numpy().tobytes())
        return digest.hexdigest()

    @torch.no_grad()
    def motions(
        self, features: Sequence[Float[np.ndarray, "_ features"]]
    ) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of motions, each what it is alone.

        Frames past the last movement of four are not looked at.

        Raises:
            InputError: A motion is shorter than four frames, or of other features.
        """
        lengths = [self._used_frames(motion) for motion in features]
        found = np.zeros((len(features), self.width), np.float32)
        for length in sorted(set(lengths)):
            places = [place for place, other in enumerate(lengths) if other == length]
            for part in _parts(places):
                batch = np.stack([features[place][:length] for place in part])
                found[part] = self._motions(batch)
        return found

    @torch.no_grad()
    def texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of captions; each different sentence is read once."""
        numbers: dict[tuple[str, str], int] = {}
        rows = [numbers.setdefault((c.text, c.tokens), len(numbers)) for c in captions]
        different = [Caption(text, 0, 0, tokens) for text, tokens in numbers]
        found = [self._texts([different[i] for i in p]) for p in _parts(range(len(different)))]
        return np.concatenate([np.zeros((0, self.width), np.float32), *found])[rows]

    def _motions(
        self, features: Float[np.ndarray, "batch frames features"]
    ) -> Float[np.ndarray, "batch width"]:
        normalized = torch.from_numpy(self.normalizer.normalize(features.astype(np.float32)))
        mask = torch.ones(normalized.shape[:2], dtype=torch.bool)
        return self.networks.motions(normalized, mask).numpy()

    def _texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "batch width"]:
        read = self.vectors(captions)
        tensors = (torch.from_numpy(part) for part in (read.words, read.parts, read.mask))
        return self.networks.texts(*tensors).numpy()

    def _used_frames(self, motion: Float[np.ndarray, "frames features"]) -> int:
        frames, features = motion.shape
        if features != self.card.networks.features:
            raise InputError(
                f"a motion of {features} features a frame; the evaluator {self.card.name!r} takes "
                f"{self.card.networks.features} ({self.card.representation})"
            )
        if frames < FRAMES:
            raise InputError(f"a motion of {frames} frames; the evaluator needs {FRAMES} or more")
        return frames // FRAMES * FRAMES


def tensors_of(evaluator: TextMotionEvaluator) -> dict[str, Tensor]:
    """Returns all numbers of an evaluator, by the names of its file."""
    statistics = {MEAN: evaluator.normalizer.mean, STD: evaluator.normalizer.std}
    arrays = {name: np.asarray(values, np.float32) for name, values in statistics.items()}
    if isinstance(evaluator.vectors, GloveWords):
        arrays[WORDS] = np.asarray(evaluator.vectors.vectors, np.float32)
    own = {name: torch.from_numpy(values.copy()) for name, values in arrays.items()}
    return {**own, **evaluator.networks.state_dict()}


def _parts(places: Sequence[int]) -> list[list[int]]:
    return [list(places[first : first + AT_ONCE]) for first in range(0, len(places), AT_ONCE)]
